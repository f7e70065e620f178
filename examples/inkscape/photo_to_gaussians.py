"""Inkscape, Extensions > Raster > Photo to Gaussians: layers of ellipses in place of a photo.

Copy this folder into the one of Edit > Preferences > System > User extensions. The photo may be
linked or embedded; its shapes are where it was, clipped to its edges, and as it was styled.
"""

import math
import os
import re
import subprocess
import tempfile
import urllib.parse
import urllib.request
from pathlib import Path

import inkex  # pyright: ignore[reportMissingImports] (Inkscape brings it)

IDS = re.compile(r'(\sid="|url\(#|href="#)')
# What says of an image which one it is and where; all else is as true of a layer.
IMAGE_ONLY = (
    "x",
    "y",
    "width",
    "height",
    "preserveAspectRatio",
    "href",
    "xlink:href",
    "sodipodi:absref",
)
SHARES = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}


class PhotoToGaussians(inkex.EffectExtension):
    """One layer for each selected photo, which it replaces."""

    def add_arguments(self, pars):
        """Add what the dialog asks for, with Inkscape's defaults."""
        pars.add_argument("--quality")
        pars.add_argument("--kilobytes", type=int)
        pars.add_argument("--program")

    def effect(self):
        """Replace what is selected; an AbortExtension is one line of Inkscape's dialog."""
        photos = list(self.svg.selection.filter(inkex.Image).values())
        if not photos:
            raise inkex.AbortExtension("selection must have a photo; got none. Try to select one")
        for photo in photos:
            self.replace(photo)

    def replace(self, photo):
        """Put the layer where the photo was."""
        with tempfile.TemporaryDirectory() as folder:
            source, out = Path(folder, "photo"), Path(folder, "out.svg")
            source.write_bytes(self.data_of(photo))
            drawing = self.drawn(source, out)
        transform, visible = placed(photo, drawing)
        clip = inkex.ClipPath(inkex.Rectangle.new(*visible))
        self.svg.defs.append(clip)
        # What shapes would inherit, and an image does not show.
        shapes = inkex.Group.new("", style="stroke:none;fill-opacity:1", transform=str(transform))
        shapes.set("clip-path", clip.get_id(as_url=2))
        self.svg.defs.extend(drawing.defs)
        # If shapes reach beyond the page, an <svg> of the page's size has all of them.
        picture = next((one for one in drawing if one.tag_name == "svg"), drawing)
        for element in list(picture):
            if element.tag_name == "rect":  # 100 % of the page, which is another here
                element.update(width=drawing.viewbox_width, height=drawing.viewbox_height)
            if element.tag_name in ("rect", "g", "circle"):
                shapes.append(element)
        # The photo's clip, mask and filter are in its coordinates, which are those of the layer.
        layer = inkex.Layer.new("Gaussians of " + photo.get_id(), *photo, shapes)
        for name, value in photo.attrib.items():
            layer.set(name, value)
        for name in IMAGE_ONLY:
            layer.pop(name)
        photo.replace_with(layer)

    def data_of(self, photo):
        """Bytes of the photo, from the document or its file."""
        href = (photo.get("xlink:href") or photo.get("href") or "").strip()
        try:
            if href[:5].lower() == "data:":
                with urllib.request.urlopen(href) as stream:
                    data = stream.read()
            else:
                name = urllib.request.url2pathname(urllib.parse.urlparse(href).path)
                name = self.absolute_href(name, cwd=os.path.dirname(self.document_path() or ""))
                if not os.path.isfile(name):
                    raise inkex.AbortExtension(
                        f"photo must be a file; got {href[:80]!r}. Try to embed it"
                    )
                data = Path(name).read_bytes()
            if not data:
                raise ValueError("it is empty")
        except (ValueError, OSError) as error:
            raise inkex.AbortExtension(
                f"photo must be whole; got damaged data or a damaged name: {str(error)[:200]}. Try "
                "to embed it again"
            ) from None
        return data

    def drawn(self, source, out):
        """Return the drawing of gauss2svg, with ids that the document does not have."""
        options = ["--quality", self.options.quality, "--markup", "editable", "--quiet"]
        if self.options.kilobytes:
            options += ["--max-bytes", f"{self.options.kilobytes}k"]
        # Inkscape's own Python modules are not those of the program.
        own = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        command = [self.options.program, str(source), "-o", str(out), *options]
        try:
            run = subprocess.run(command, capture_output=True, text=True, env=own)
        except OSError:
            raise inkex.AbortExtension(
                f"program must be that of gauss2svg; got {self.options.program!r}. Try "
                "to install gauss2svg from its clone or wheel, and its full path as the program"
            ) from None
        if run.returncode:
            said = run.stderr.strip().splitlines() or ["gauss2svg failed without a word"]
            raise inkex.AbortExtension(said[-1])
        prefix = self.svg.get_unique_id("gaussians") + "-"
        text = IDS.sub(lambda found: found[0] + prefix, out.read_text(encoding="utf-8"))
        return inkex.load_svg(text.encode()).getroot()


def placed(photo, drawing):
    """From a drawing to the photo's frame, and what shows of the drawing: x, y, width, height."""
    given = {
        name: length(photo.get(name), whole)
        for name, whole in {
            "x": photo.root.viewbox_width, "width": photo.root.viewbox_width,
            "y": photo.root.viewbox_height, "height": photo.root.viewbox_height,
        }.items()
    }  # fmt: skip
    own = drawing.viewbox_width, drawing.viewbox_height
    width, height = given["width"], given["height"]
    if width is None and height is None:
        width = length(drawing.get("width"), 0)  # px of the photo
    width = height * own[0] / own[1] if width is None else width
    height = width * own[1] / own[0] if height is None else height
    if not 0 < min(width, height) <= max(width, height) < math.inf:
        raise inkex.AbortExtension(f"photo must have a size; got {width:g} x {height:g}")
    align, *how = photo.get("preserveAspectRatio", "").replace("defer", "").split() or ["xMidYMid"]
    scale = [width / own[0], height / own[1]]
    if align != "none":
        scale = 2 * [max(scale) if how == ["slice"] else min(scale)]
    frame, start, part = (given["x"] or 0, given["y"] or 0), [], []
    for k, side in enumerate((width, height)):
        rest = side - scale[k] * own[k]  # below 0 where the frame cuts off
        start.append(frame[k] + rest * SHARES.get(align[4 * k + 1 : 4 * k + 4], 0))
        part.append((max(0, (frame[k] - start[k]) / scale[k]), min(own[k], side / scale[k])))
    move = inkex.Transform(translate=tuple(start)) @ inkex.Transform(scale=tuple(scale))
    return move, [edge[0] for edge in part] + [edge[1] for edge in part]


def length(text, whole):
    """User units of a length, of which the whole is 100 %; None for auto."""
    text = (text or "").strip()
    if text in ("", "auto"):
        return None
    try:
        is_share = text.endswith("%")
        units = float(text[:-1]) / 100 * whole if is_share else inkex.units.convert_unit(text, "px")
    except ValueError:
        units = math.nan
    if not math.isfinite(units):
        raise inkex.AbortExtension(
            f"photo must have a size of finite numbers; got {text[:80]!r}. Try another size"
        )
    return units


if __name__ == "__main__":
    PhotoToGaussians().run()
