"""Inkscape, Extensions > Raster > Photo to Gaussians: layers of ellipses in place of a photo.

Copy this folder into the one of Edit > Preferences > System > User extensions. The photo may be
linked or embedded; its shapes are where it was, clipped to its edges.
"""

import base64
import os
import re
import subprocess
import tempfile
import urllib.parse
import urllib.request
from pathlib import Path

import inkex  # pyright: ignore[reportMissingImports] (Inkscape brings it)

IDS = re.compile(r'(\sid="|url\(#|href="#)')


class PhotoToGaussians(inkex.EffectExtension):
    """One layer for each selected photo, which it replaces."""

    def add_arguments(self, pars):
        """What the dialog asks for, with Inkscape's defaults."""
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
        width, height = drawing.viewbox_width, drawing.viewbox_height
        layer = inkex.Layer.new("Gaussians of " + photo.get_id())
        layer.transform = photo.transform @ fitted(photo, width, height)
        clip = inkex.ClipPath(inkex.Rectangle.new(0, 0, width, height))
        self.svg.defs.append(clip)
        layer.set("clip-path", clip.get_id(as_url=2))
        self.svg.defs.extend(drawing.defs)
        for element in drawing:
            if element.tag_name == "rect":  # 100 % of the page, which is another here
                element.update(width=width, height=height)
            if element.tag_name in ("rect", "g", "circle"):
                layer.append(element)
        photo.replace_with(layer)

    def data_of(self, photo):
        """Bytes of the photo, from the document or its file."""
        href = photo.get("xlink:href") or photo.get("href") or ""
        if href.startswith("data:"):
            return base64.b64decode(href.partition(",")[2])
        name = urllib.request.url2pathname(urllib.parse.urlparse(href).path)
        name = self.absolute_href(name, cwd=os.path.dirname(self.document_path() or ""))
        if not os.path.isfile(name):
            raise inkex.AbortExtension(f"photo must be a file; got {name!r}. Try to embed it")
        return Path(name).read_bytes()

    def drawn(self, source, out):
        """The drawing of gauss2svg, with ids that the document does not have."""
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
                "pip install gauss2svg, and its full path as the program"
            ) from None
        if run.returncode:
            said = run.stderr.strip().splitlines() or ["gauss2svg failed without a word"]
            raise inkex.AbortExtension(said[-1])
        prefix = self.svg.get_unique_id("gaussians") + "-"
        text = IDS.sub(lambda found: found[0] + prefix, out.read_text(encoding="utf-8"))
        return inkex.load_svg(text.encode()).getroot()


def fitted(photo, width, height):
    """From a drawing of this size to the frame of the photo, as its preserveAspectRatio says."""
    x, y = photo.left, photo.top
    scale_x, scale_y = photo.width / width, photo.height / height
    if not photo.get("preserveAspectRatio", "").startswith("none"):
        scale_x = scale_y = min(scale_x, scale_y)
        x += (photo.width - scale_x * width) / 2
        y += (photo.height - scale_y * height) / 2
    return inkex.Transform(translate=(x, y)) @ inkex.Transform(scale=(scale_x, scale_y))


if __name__ == "__main__":
    PhotoToGaussians().run()
