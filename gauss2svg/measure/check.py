"""Compare any SVG with a photo, by the scores that `vectorize` reports."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.measure import CheckOptions, decibels
from gauss2svg.measure.heatmap import heatmap
from gauss2svg.measure.perceptual import perceptual_scores
from gauss2svg.measure.roundtrip import measure_pixels
from gauss2svg.photo.load import ImageSource, load_image
from gauss2svg.photo.pixels import Photo, has_alpha, over
from gauss2svg.raster import AT_REST, BROWSERS, MOVING, refuse_unsupported, renderer_version, uses
from gauss2svg.raster.isolated import draw
from gauss2svg.svg.file import (
    Frame,
    SvgSource,
    file_bytes,
    frame_of,
    from_root,
    read_source,
    stretched,
)
from gauss2svg.svg.untrusted import Survey


@dataclass(frozen=True, eq=False)
class CheckResult:
    """The comparison of an SVG with a photo.

    report         scores, counts and notes for JSON. docs/reference/report.md explains the keys
    raster, photo  (h, w, 3) float32 in 0..1: the SVG's raster, and the photo as it was compared.
                   (h, w, 4) if the photo has alpha
    """

    report: dict[str, Any]
    raster: NDArray[np.float32]
    photo: NDArray[np.float32]

    def heatmap(self) -> bytes:
        """Return a PNG that shows the error at each pixel over white.

        See gauss2svg.measure.heatmap.
        """
        return heatmap(over(self.raster), over(self.photo))

    def __repr__(self) -> str:
        r = self.report
        size = f"{r['elements']} elements, {r['svg_bytes']} bytes"
        match = decibels(r["psnr_svg"])
        return f"<gauss2svg.CheckResult {r['width']}x{r['height']}, {match}, {size}>"


def check(
    photo: ImageSource,
    svg: SvgSource,
    **options: Any,
) -> CheckResult:
    """Rasterise an SVG at the size of a photo, and measure how closely it matches the photo.

    Both are composited over white and compared. If the photo has alpha, they are also compared over
    black, and their alpha channels are compared too. SSIMULACRA2 and FLIP need the extra
    gauss2svg[scores].

    photo          any image that `vectorize` accepts
    svg            a path, text that begins with <, bytes or a binary file, which may be gzipped, or
                   a Result of `vectorize`
    options        fields of gauss2svg.measure.CheckOptions:
      renderer         one of RENDERERS
      max_svg_bytes    largest size of the SVG without compression: 256000000, "256M"
      max_elements     largest number of elements in the SVG, >= 1
      draw_timeout     longest time in s that rasterising the SVG may take, 0.001..86400
      max_pixels       largest number of pixels of the photo, as in `vectorize`
      max_size         longest side in px to which a larger photo is reduced before the comparison
      matte            colour, such as white or #fa0, over which the photo is composited first.
                       If None, the photo keeps its alpha, which is compared too

    The SVG is not trusted. Entities, references to anything outside the file, and files beyond the
    limits are refused. A separate process draws the SVG, and on Linux its memory is limited.

    Raise InputError for a photo or an SVG that cannot be used. Raise RendererError for an SVG that
    cannot be drawn, and for a missing renderer. Raise TypeError for an unknown option.
    """
    asked = CheckOptions(**options)
    renderer = renderer_version(asked.renderer)
    picture = load_image(
        photo, max_pixels=asked.max_pixels, matte=asked.matte, needed=asked.max_size
    )
    pixels, size = picture.pixels, (picture.width, picture.height)
    data, text = read_source(getattr(svg, "svg", svg), int(asked.max_svg_bytes))
    surveyed, frame, sized_text = sized_svg(text, *size, asked.renderer, asked.max_elements)
    raster, unread = draw(sized_text, *size, asked.renderer, asked.draw_timeout, pixels.shape[2])
    unknown = [*(f"<{name}>" for name in surveyed.unknown), *unread]
    report = {
        "width": size[0],
        "height": size[1],
        "svg_width": frame.width,
        "svg_height": frame.height,
        "view_box": list(frame.view_box),
        "transparent": has_alpha(pixels),
        "renderer": renderer,
        **measure_pixels(raster, pixels),
        "svg_bytes": len(data),
        "svgz_bytes": len(file_bytes(data, gzipped=True)),
        **perceptual_scores(raster, pixels),
        "elements": surveyed.elements,
        "elements_by_tag": dict(surveyed.tags),
        "groups": surveyed.tags.get("g", 0),
        "layers": surveyed.layers,
        "notes": _notes(surveyed, frame, picture, asked.renderer, unknown, uses(text, MOVING)),
    }
    # JSON has no infinity, which is the PSNR of equal pictures.
    finite = {key: None if value == math.inf else value for key, value in report.items()}
    return CheckResult(finite, raster, pixels)


def sized_svg(
    text: str, width: int, height: int, renderer: str, most_elements: int
) -> tuple[Survey, Frame, str]:
    """Survey an untrusted SVG, and stretch it to width x height px.

    Return the survey, the frame of the SVG before it is stretched, and the stretched text.
    Raise InputError and RendererError as `check` does.
    """
    text = from_root(text)
    surveyed = Survey(text, most_elements)
    frame = frame_of(surveyed.root)
    refuse_unsupported(text, renderer)
    sized_text = stretched(text, width, height, " ".join(f"{v!r}" for v in frame.view_box))
    return surveyed, frame, sized_text


def _notes(
    surveyed: Survey,
    frame: Frame,
    photo: Photo,
    renderer: str,
    unknown: list[str],
    is_animated: bool,
) -> list[str]:
    """Return remarks on the comparison.

    unknown      what a renderer other than browsers is not known to draw
    is_animated  whether browsers refuse the SVG because it is animated
    """
    notes, tags = [f"photo {note}" for note in photo.notes], surveyed.tags
    for name, (width, height) in (("SVG", frame[:2]), ("viewBox", frame.view_box[2:])):
        # Enlarged or reduced until it fits, it may be a pixel smaller than the photo.
        scale = min(photo.width / width, photo.height / height)
        if max(photo.width - scale * width, photo.height - scale * height) > 1:
            shape = f"{name} is {width:g}x{height:g}, not in the photo's proportions"
            notes.append(f"{shape}, and was stretched to {photo.width}x{photo.height} px")
            # One note is enough if neither the SVG nor its viewBox has the photo's proportions.
            break
    if texts := tags.get("text", 0):
        how = "not drawn, because resvg gets no fonts. Try paths, or another --renderer"
        how = how if renderer == "resvg" else "drawn in the fonts of this machine"
        notes.append(f"text ({texts}) is {how}")
    if unknown and renderer not in BROWSERS:
        first, more = ", ".join(unknown[:3]), " and more" if unknown[3:] else ""
        remark = f"{renderer} is not known to draw these as browsers do: {first}{more}"
        notes.append(f"{remark}. Try {AT_REST if is_animated else '--renderer chromium'}")
    if not surveyed.qualified:
        notes.append("the root element has no xmlns of SVG, so browsers do not show the file")
    return notes
