"""Rasterise SVGs with a renderer, and refuse files that the renderer is known to draw wrongly.

A renderer called NAME is a function in a module of this package. The module is imported when the
renderer is first used.

    NAME(svg, width, height)  returns the raster (height, width, 4), float32 in 0..1, with straight
                              alpha. If the renderer is a browser, the function also takes the
                              colour of the page, which is white by default

It raises RendererError if the renderer is not installed. `version` of the module `renderers` tells
the name and version of each.
"""

from __future__ import annotations

import io
import re
from pkgutil import resolve_name
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from PIL.PngImagePlugin import PngImageFile

from gauss2svg.errors import InputError, RendererError
from gauss2svg.options import Field, Renderer
from gauss2svg.photo import MOST_PIXELS
from gauss2svg.photo.pixels import has_alpha, over
from gauss2svg.svg.file import from_root, parse, stretched

RENDERERS: tuple[str, ...] = get_args(Renderer)
# The functions of these renderers also take the colour of the page.
BROWSERS = "chromium", "firefox"
WHITE, BLACK, CLEAR = "#fff", "#000", "transparent"  # colours of the page in a browser


class Feature(NamedTuple):
    """A feature of SVG that some renderers draw wrongly.

    name          name in error messages
    not_drawn_by  renderers that draw it wrongly (docs/decisions/renderers.md), as observed with
                  resvg 0.48, CairoSVG 2.9, Chromium 156, librsvg 2.54, Firefox 153 and Inkscape 1.2
    words         words, separated by blanks. A file that has the feature contains one of them. They
                  are looked for first, because this is fast and rules out most files
    pattern       pattern that a file with the feature also matches
    """

    name: str
    not_drawn_by: tuple[str, ...]
    words: str
    pattern: str


# Matches the text after the name of a property if the value of the property has an effect.
_ON = r"""\s*+[:=]\s*+["']?+\s*+(?!none|normal|inherit|initial|unset)"""
_TAG = r"<(?:[\w.-]+:)?"
_BLURS = "blur shadow", r"fegaussianblur|fedropshadow|(?<![\w-])(?:blur|drop-shadow)\("
# A file with a blur has this feature if anything in the file is rotated or skewed.
TURNED_BLUR = Feature("a blur of rotated or skewed shapes", ("resvg", "cairo", "librsvg"), *_BLURS)
BLUR = Feature("a blur", ("cairo",), *_BLURS)
LIGHTER = Feature(
    "mix-blend-mode: plus-lighter", ("resvg", "cairo", "librsvg", "inkscape"), "plus-",
    rf"mix-blend-mode{_ON}plus-",
)  # fmt: skip
BLEND = Feature("mix-blend-mode", ("cairo",), "mix-blend-mode", rf"mix-blend-mode{_ON}")
FILTER = Feature("a filter", ("cairo",), "filter", rf"(?<![\w-])(?:-webkit-)?filter{_ON}")
PLAIN_HREF = Feature(
    "href without xlink:", ("inkscape",), "href",
    rf"{_TAG}(?:use|image|pattern|filter|(?:linear|radial)gradient)"
    r"(?=[^<>]*\shref\s*=)(?![^<>]*:href\s*=)",
)  # fmt: skip
MASK = Feature("a mask", ("cairo",), "<mask :mask", rf"{_TAG}mask\b")
# An animation that runs even when reduced motion is preferred. Any other animation has no effect,
# because the browsers are told to prefer reduced motion, and the other renderers show none.
MOVING = Feature(
    "animation, drawn at some moment of it", BROWSERS,
    "<animat :animat <set discard starting-style animation",
    rf"{_TAG}(?:animate|set|discard)|@starting-style|(?<![\w-])animation(?:-name)?{_ON}",
)  # fmt: skip
FEATURES = TURNED_BLUR, BLUR, LIGHTER, BLEND, FILTER, PLAIN_HREF, MASK, MOVING


def drawn_by(*features: Feature) -> tuple[str, ...]:
    """Return the names of the renderers that draw all of these features correctly."""
    wrong = {name for feature in features for name in feature.not_drawn_by}
    return tuple(name for name in RENDERERS if name not in wrong)


# resvg is the default because it is fast and accurate, and because pip installs it as a wheel.
DEFAULT_RENDERER = "resvg"
DRAW_ROTATED_BLURS = drawn_by(TURNED_BLUR)
# The renderers that draw minimal markup correctly, because they draw masks and plain hrefs
# correctly.
DRAW_MINIMAL = drawn_by(MASK, PLAIN_HREF)
DRAW_BLENDS = drawn_by(BLEND, FILTER)


# Browsers refuse animated files, so another renderer is no help with what only browsers draw.
AT_REST = "a copy without the animation, which shows the picture at rest"


def renderer_version(name: str) -> str:
    """Return the name and version of a renderer. Raise RendererError if it is not installed."""
    return resolve_name("gauss2svg.raster.renderers:version")(_checked(name))


def rasterize(
    svg: str, width: int, height: int, renderer: str = DEFAULT_RENDERER, alpha: bool = False
) -> NDArray[np.float32]:
    """Return the raster of an SVG, float32 in 0..1.

    It is over white (height, width, 3). If `alpha` is true, it has straight alpha (height, width,
    4). Firefox has no transparent page, so it then draws the SVG twice, over white and over black.

    An SVG with a viewBox is stretched to width x height px, even if its own proportions are
    different. Raise RendererError if the renderer is not installed, if it fails on the file, or if
    it is known to draw a feature of the file wrongly.
    """
    if width * height > MOST_PIXELS:  # photos have the same limit
        raise RendererError(
            f"the raster must be at most {MOST_PIXELS / 1e6:.0f} million px; got "
            f"{width}x{height}, {width * height / 1e6:.0f} million. Try to draw the SVG smaller"
        )
    try:
        text = from_root(svg)
        # Broken files are refused here, because some renderers would draw a part of such a file.
        parse(text, object())
    except InputError as error:
        raise RendererError(f"cannot draw the SVG: {error}") from error
    refuse_unsupported(text, renderer)
    return rasterize_sized(stretched(text, width, height), width, height, renderer, alpha)


def rasterize_like(
    svg: str, picture: NDArray[np.floating], renderer: str = DEFAULT_RENDERER
) -> NDArray[np.float32]:
    """Return a raster that has the size of `picture`.

    If `picture` is opaque, the raster is over white. If `picture` has alpha, so has the raster.
    """
    height, width = picture.shape[:2]
    return rasterize(svg, width, height, renderer, has_alpha(picture))


def rasterize_sized(
    svg: str, width: int, height: int, renderer: str, alpha: bool = False
) -> NDArray[np.float32]:
    """Return the raster of `rasterize` for an SVG whose size is width x height px.

    Raise RendererError if the renderer returns a raster of another size.
    """
    page = [CLEAR] if alpha and renderer in BROWSERS else []  # others have no page
    module = "chromium" if _checked(renderer) == "chromium" else "renderers"
    pixels = resolve_name(f"gauss2svg.raster.{module}:{renderer}")(svg, width, height, *page)
    if pixels.shape[:2] != (height, width):
        got = f"{pixels.shape[1]}x{pixels.shape[0]} px"
        raise RendererError(
            f"raster of {renderer} must be {width}x{height} px; got {got}. Try to draw it smaller, "
            "or another --renderer"
        )
    return pixels if alpha else over(pixels)


def refuse_unsupported(svg: str, renderer: str) -> None:
    """Raise RendererError if the SVG uses a feature that the renderer is known to draw wrongly."""
    for feature in FEATURES:
        if renderer in feature.not_drawn_by and uses(svg, feature):
            others = drawn_by(feature)
            advice = AT_REST if feature is MOVING else f"--renderer {others[0]}"
            raise RendererError(
                f"renderer must be one of {', '.join(others)} for what the SVG uses, "
                f"{feature.name}; got {renderer}. Try {advice}"
            )


def from_png(png: bytes) -> NDArray[np.float32]:
    """Return the pixels of a PNG that a renderer wrote, with straight alpha.

    They are (h, w, 4) float32 in 0..1.
    """
    # Image.open is not used, because it refuses very large images to protect against files of
    # strangers. The size of this image is no danger, because it is the size that the caller
    # requested.
    with PngImageFile(io.BytesIO(png)) as picture:
        pixels = np.array(picture.convert("RGBA"), np.float32)
    pixels /= np.float32(255)
    return pixels


def _checked(renderer: str) -> str:
    """Return the name of a renderer. Raise InputError for any other text."""
    return Field("renderer", words=RENDERERS).checked(renderer)


# Rules of media that a still picture on a white page does not meet.
_UNMET_MEDIA = re.compile(
    r"@media\s*(?:print|\(\s*prefers-(?:color-scheme\s*:\s*dark"
    r"|reduced-motion\s*:\s*no-preference)\s*\))\s*"
    r"\{(?:[^{}<]*+\{(?:[^{}<]*+\{[^{}<]*+\})*+[^{}<]*+\})*+[^{}<]*+\}"
)


def uses(svg: str, feature: Feature) -> bool:
    """Return whether an SVG may use a feature.

    Only the text of the file is searched, without comments, titles, descriptions, and the rules of
    an animated file of this project, which apply only if reduced motion is not preferred. So the
    answer may be true although the feature has no effect in the file.
    """
    text = svg.lower()
    if not any(word in text for word in feature.words.split()):
        return False
    unseen = rf"<!--.*?(?:-->|\Z)|{_TAG}(?:title|desc)\b[^<>]*>[^<]*"
    text = _UNMET_MEDIA.sub("", re.sub(unseen, "", text, flags=re.DOTALL))
    # A rotation, a skew, a matrix that does more than scale and move, or any transform of CSS.
    turned = (
        r"""rotate|skew|[;"'{\s]transform\s*:"""
        r"|matrix\s*+\((?!\s*[^\s,()]{1,40}[\s,]+0[\s,]+0[\s,])"
    )
    if feature is TURNED_BLUR and not re.search(turned, text):
        return False
    return re.search(feature.pattern, text) is not None
