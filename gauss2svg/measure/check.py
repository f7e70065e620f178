"""How closely any SVG matches a photo: the numbers that `vectorize` reports."""

from __future__ import annotations

import gzip
import math
import os
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError
from gauss2svg.measure import CheckOptions, metrics
from gauss2svg.measure.heatmap import heatmap
from gauss2svg.measure.perceptual import Scores, perceptual_scores
from gauss2svg.measure.roundtrip import measure_pixels
from gauss2svg.photo.alpha import WHITE, has_alpha, matte_color, over, pixels_of, shrunk
from gauss2svg.photo.formats import DEFAULT_MAX_PIXELS, MOST_PIXELS
from gauss2svg.photo.load import ImageSource, load_image
from gauss2svg.raster import BROWSERS, DEFAULT_RENDERER, refuse_unsupported, renderer_version
from gauss2svg.raster.isolated import draw
from gauss2svg.svg.canvas import Frame, frame_of
from gauss2svg.svg.source import BLANKS, MOST_BYTES, SvgSource, from_root, read_source, stretched
from gauss2svg.svg.untrusted import MOST_ELEMENTS, Survey

DRAW_TIMEOUT_S = 300.0
REFERENCE_SCALE = 4.0
# Elements that have an effect in a web page and none on the raster. Browsers never draw animation
# here, because gauss2svg.raster refuses it.
_LEFT_OUT = ("script", "animate", "animateTransform", "animateMotion", "animateColor", "set")


@dataclass(frozen=True)
class Enlarged:
    """An SVG against what its photo was made from, larger than the photo, over white.

    width, height  px; scale: times as many as the photo has
    psnr           dB, infinite if equal
    ssim           -1..1, None under 3 px a side
    """

    scale: float
    width: int
    height: int
    psnr: float
    ssim: float | None


@dataclass(frozen=True, eq=False)
class CheckResult:
    """An SVG against a photo.

    psnr           dB, infinite if equal
    ssim           -1..1, None under 3 px a side
    ms_ssim        0..1, None under 176 px a side
    largest_error  of any channel, bias: mean of SVG - photo; levels of 255
    svg_bytes      of the file, gunzipped; svgz_bytes: gzipped at level 9
    survey         its elements; frame: its own size
    renderer       name and version
    raster, photo  (h, w, 3) float32 in 0..1, the raster and the reference, perhaps reduced; both
                   (h, w, 4) where the photo has alpha
    notes          remarks on the comparison
    scores         SSIMULACRA2 and FLIP, over the worse of white and black; see
                   gauss2svg.measure.scores
    psnr_black     dB over black, psnr_alpha: of alpha; None where the photo is opaque. All
                   other numbers are over white
    enlarged       against the reference, None where none is given
    """

    psnr: float
    ssim: float | None
    ms_ssim: float | None
    largest_error: float
    bias: float
    svg_bytes: int
    svgz_bytes: int
    survey: Survey
    frame: Frame
    renderer: str
    raster: NDArray[np.float32]
    photo: NDArray[np.float32]
    notes: tuple[str, ...]
    scores: Scores
    psnr_black: float | None = None
    psnr_alpha: float | None = None
    enlarged: Enlarged | None = None

    @cached_property
    def report(self) -> dict[str, Any]:
        """The numbers, ready for JSON; see docs/reference/report.md for the keys."""
        height, width = self.photo.shape[:2]
        enlarged = self.enlarged
        return {
            "width": width,
            "height": height,
            "svg_width": self.frame.width,
            "svg_height": self.frame.height,
            "view_box": list(self.frame.view_box),
            "renderer": self.renderer,
            "transparent": has_alpha(self.photo),
            "psnr_svg": _finite(self.psnr),
            "psnr_svg_black": _finite(self.psnr_black),
            "psnr_svg_alpha": _finite(self.psnr_alpha),
            "ssim_svg": self.ssim,
            "ms_ssim_svg": self.ms_ssim,
            **self.scores.report,
            "largest_error_svg": self.largest_error,
            "bias_svg": self.bias,
            "reference_scale": None if enlarged is None else enlarged.scale,
            "psnr_svg_enlarged": None if enlarged is None else _finite(enlarged.psnr),
            "ssim_svg_enlarged": None if enlarged is None else enlarged.ssim,
            "svg_bytes": self.svg_bytes,
            "svgz_bytes": self.svgz_bytes,
            "elements": self.survey.elements,
            "elements_by_tag": dict(self.survey.tags),
            "groups": self.survey.tags.get("g", 0),
            "layers": self.survey.layers,
            "notes": list(self.notes),
        }

    def heatmap(self) -> bytes:
        """PNG of the error at each pixel over white: see gauss2svg.measure.heatmap."""
        return heatmap(over(self.raster), over(self.photo))

    def __repr__(self) -> str:
        height, width = self.photo.shape[:2]
        return (
            f"<gauss2svg.CheckResult {width}x{height}, {self.psnr:.2f} dB, "
            f"{self.survey.elements} elements, {self.svg_bytes} bytes>"
        )


def check(
    photo: ImageSource,
    svg: SvgSource,
    *,
    renderer: str = DEFAULT_RENDERER,
    max_svg_bytes: int | str = MOST_BYTES,
    max_elements: int = MOST_ELEMENTS,
    draw_timeout: float = DRAW_TIMEOUT_S,
    max_pixels: int = DEFAULT_MAX_PIXELS,
    max_size: int | None = None,
    matte: str | None = None,
    reference: ImageSource | SvgSource | None = None,
    reference_scale: float | None = None,
) -> CheckResult:
    """Rasterise an SVG at the size of a photo, or max_size, and measure how closely it matches.

    Over white; where the photo has alpha, alpha is compared as well, and both over black.
    SSIMULACRA2 and FLIP are measured where the extra gauss2svg[scores] is installed.

    photo          any image that `vectorize` takes
    svg            a path, text that begins with <, bytes or a binary file; gzipped or not
    renderer       one of RENDERERS
    max_svg_bytes  limit of its size, gunzipped: 256000000, "256M"
    max_elements   limit of its elements, >= 1
    draw_timeout   time limit of the drawing in s, > 0
    max_pixels     limit of the photo, as of `vectorize`
    max_size       longest side in px to which a larger photo is reduced first; None: its own size
    matte          colour, such as white or #fa0, over which the photo is composited first; None:
                   its alpha is compared too
    reference      what the photo was made from: an SVG as for svg, or a picture of at least
                   reference_scale times as many px a side; the SVG is compared with it too
    reference_scale  times the photo's size at which it is, > 0; None: 4

    The SVG is not trusted: entities, references to anything outside of it and files beyond the
    limits are refused, and it is drawn in a separate process, whose memory is limited on Linux.
    Raises InputError for a photo or an SVG that cannot be used, RendererError for an SVG that
    cannot be drawn and for a renderer that is missing.
    """
    options = CheckOptions(
        renderer=renderer,  # pyright: ignore[reportArgumentType] (text that is checked there)
        max_svg_bytes=max_svg_bytes,
        max_elements=max_elements,
        draw_timeout=draw_timeout,
        max_pixels=max_pixels,
        max_size=max_size,
        matte=matte,
        reference_scale=reference_scale,
    )
    drawn_by = renderer_version(options.renderer)
    matted = None if options.matte is None else matte_color(options.matte)
    if options.reference_scale is not None and reference is None:
        raise InputError(
            "reference must be given for reference_scale; got none. Try --reference with the "
            "photo's source"
        )
    picture = load_image(photo, max_pixels=max_pixels, matte=matted, needed=options.max_size)
    wanted = pixels_of(picture)
    data, text = read_source(svg, int(options.max_svg_bytes))
    size = picture.width, picture.height
    larger = None
    if reference is not None:
        larger = enlarged(
            text, reference, size, options.reference_scale or REFERENCE_SCALE, options,
            WHITE if matted is None else matted,
        )  # fmt: skip
    surveyed, frame, sized = sized_svg(text, *size, options.renderer, options.max_elements)
    raster = draw(sized, *size, options.renderer, options.draw_timeout, wanted.shape[2])
    measured = measure_pixels(raster, wanted)
    measurable = min(picture.width, picture.height) >= metrics.LEAST_SIDE_FOR_MS_SSIM
    return CheckResult(
        psnr=measured["psnr_svg"],
        ssim=measured["ssim_svg"],
        ms_ssim=metrics.ms_ssim(over(raster), over(wanted)) if measurable else None,
        largest_error=measured["largest_error_svg"],
        bias=measured["bias_svg"],
        svg_bytes=len(data),
        svgz_bytes=len(gzip.compress(data, compresslevel=9, mtime=0)),
        survey=surveyed,
        frame=frame,
        renderer=drawn_by,
        raster=raster,
        photo=wanted,
        notes=(
            *(f"photo {note}" for note in picture.notes),
            *_notes(surveyed, frame, picture.width, picture.height, renderer),
        ),
        scores=perceptual_scores(raster, wanted),
        psnr_black=measured["psnr_svg_black"],
        psnr_alpha=measured["psnr_svg_alpha"],
        enlarged=larger,
    )


def enlarged(
    text: str,
    reference: ImageSource | SvgSource,
    size: tuple[int, int],
    scale: float,
    options: CheckOptions = CheckOptions(),
    matte: float | tuple[float, float, float] = WHITE,
) -> Enlarged:
    """How closely an SVG's text matches its photo's source at `scale` times the photo's size.

    size   width and height of the photo in px
    matte  colour in 0..1 that a transparent source is composited over
    The source is an SVG, or a picture that has as many px, which is reduced. Raises InputError
    and RendererError as `check`.
    """
    width, height = (max(1, round(scale * side)) for side in size)
    if width * height > MOST_PIXELS:
        raise InputError(
            f"photo times reference_scale must have at most {MOST_PIXELS} px; got "
            f"{width}x{height}. Try a smaller --reference-scale or --max-size"
        )
    if _is_svg(reference):
        source = read_source(reference, int(options.max_svg_bytes))[1]
        drawn = _raster(source, width, height, matte, options)
    else:
        picture = load_image(reference, max_pixels=options.max_pixels)
        if picture.width < width or picture.height < height:
            most = min(picture.width / size[0], picture.height / size[1])
            raise InputError(
                f"reference must have at least {width}x{height} px, {scale:g} times the photo's; "
                f"got {picture.width}x{picture.height}. Try an SVG, or --reference-scale {most:.3g}"
            )
        drawn = shrunk(over(pixels_of(picture), matte), height, width)
    raster = _raster(text, width, height, WHITE, options)
    measurable = min(width, height) >= metrics.LEAST_SIDE_FOR_SSIM
    return Enlarged(
        scale=float(scale),
        width=width,
        height=height,
        psnr=metrics.psnr(raster, drawn),
        ssim=metrics.ssim(raster, drawn) if measurable else None,
    )


def _raster(
    text: str,
    width: int,
    height: int,
    background: float | tuple[float, float, float],
    options: CheckOptions,
) -> NDArray[np.float32]:
    """Return the raster (height, width, 3) of an untrusted SVG over a colour in 0..1."""
    sized = sized_svg(text, width, height, options.renderer, options.max_elements)[2]
    channels = 3 if background == WHITE else 4  # browsers draw over white twice as fast
    raster = draw(sized, width, height, options.renderer, options.draw_timeout, channels)
    return over(raster, background)


def _is_svg(source: ImageSource | SvgSource) -> bool:
    """Whether a source is an SVG and not a picture: text or bytes of one, or a file's suffix."""
    if isinstance(source, bytes):
        return source.lstrip(BLANKS.encode()).startswith((b"<", b"\x1f\x8b"))
    if not isinstance(source, (str, os.PathLike)):
        return False
    name = os.fspath(source)
    is_text = isinstance(source, str) and source.lstrip(BLANKS).startswith("<")
    return is_text or str(name).lower().endswith((".svg", ".svgz"))


def sized_svg(
    text: str, width: int, height: int, renderer: str, most_elements: int
) -> tuple[Survey, Frame, str]:
    """What an untrusted SVG has, and the SVG that fills width x height px and can be drawn.

    Raises InputError and RendererError as `check`.
    """
    text = from_root(text)
    surveyed = Survey(text, most_elements)
    frame = frame_of(surveyed.root)
    refuse_unsupported(text, renderer)
    sized = stretched(text, width, height, " ".join(f"{v!r}" for v in frame.view_box))
    return surveyed, frame, sized


def _finite(psnr: float | None) -> float | None:
    """A PSNR; None for the infinite one of equal pictures, as JSON has no infinity."""
    return None if psnr is None or math.isinf(psnr) else psnr


def _notes(surveyed: Survey, frame: Frame, width: int, height: int, renderer: str) -> list[str]:
    notes = []
    for name, own in (("SVG", (frame.width, frame.height)), ("viewBox", frame.view_box[2:])):
        if not _fits(own, (width, height)):
            notes.append(
                f"{name} is {own[0]:g}x{own[1]:g}, not in the photo's proportions, and was "
                f"stretched to {width}x{height} px"
            )
            break  # one distortion is reported once
    if texts := surveyed.tags.get("text", 0):
        if renderer == "resvg":
            notes.append(f"text ({texts}) is not drawn, because resvg gets no fonts. Try paths")
        else:
            notes.append(f"text ({texts}) is drawn in the fonts of this machine")
    if pictures := surveyed.tags.get("image", 0) + surveyed.tags.get("feImage", 0):
        notes.append(f"embedded images ({pictures}) are measured along with the shapes")
    notes += [
        f"{tag} ({surveyed.tags[tag]}) is left out by the renderer"
        for tag in _LEFT_OUT
        if tag in surveyed.tags
    ]
    if pages := surveyed.tags.get("foreignObject", 0):
        how = "drawn only by browsers" if renderer in BROWSERS else "left out by the renderer"
        notes.append(f"foreignObject ({pages}) is {how}")
    if not surveyed.qualified:
        notes.append("the root element has no xmlns of SVG, so browsers do not show the file")
    return notes


def _fits(own: tuple[float, ...], size: tuple[int, int]) -> bool:
    """Whether a size scaled to the same width or the same height is at most a pixel off."""
    scale = min(size[0] / own[0], size[1] / own[1])
    return all(side - scale * mine <= 1 for side, mine in zip(size, own, strict=True))
