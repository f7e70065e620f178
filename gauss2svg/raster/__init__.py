"""Rasterise SVGs with a renderer, and refuse files that the renderer is known to draw wrongly.

A renderer called NAME consists of two functions in a module of this package. The module is imported
when the renderer is first used.

    NAME(svg, width, height)  returns the raster (height, width, 4), float32 in 0..1, with straight
                              alpha. If the renderer is a browser, the function also takes the
                              colour of the page, which is white by default
    NAME_version()            returns the name and version of the renderer

Both functions raise RendererError if the renderer is not installed.
"""

from __future__ import annotations

import html
import io
import re
from enum import StrEnum
from pkgutil import resolve_name
from typing import Any, get_args
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray
from PIL.PngImagePlugin import PngImageFile

from gauss2svg.errors import InputError, RendererError
from gauss2svg.options import Field, Renderer
from gauss2svg.photo import MOST_PIXELS
from gauss2svg.photo.pixels import has_alpha, over
from gauss2svg.svg.drawable import UNMET_MEDIA
from gauss2svg.svg.file import from_root, stretched

RENDERERS: tuple[str, ...] = get_args(Renderer)
# The functions of these renderers also take the colour of the page.
BROWSERS = "chromium", "firefox"
WHITE, BLACK, CLEAR = "#fff", "#000", "transparent"  # colours of the page in a browser


class Feature(StrEnum):
    """A feature of SVG that some renderers draw wrongly. Error messages name it by its value.

    A file with a blur has the feature TURNED_BLUR if anything in the file is rotated or skewed. A
    file has the feature MOVING only if it has an animation that runs even when reduced motion is
    preferred. Any other animation has no effect, because the browsers are told to prefer reduced
    motion, and the other renderers show no animation.
    """

    TURNED_BLUR = "a blur of rotated or skewed shapes"
    BLUR = "a blur"
    LIGHTER = "mix-blend-mode: plus-lighter"
    BLEND = "mix-blend-mode"
    FILTER = "a filter"
    PLAIN_HREF = "href without xlink:"
    MASK = "a mask"
    MOVING = "animation, drawn at some moment of it"


_NO_FILTERS = "it has no filters but offset, flood and blend"
_SOME_MOMENT = "it shows some moment of it"
# For each renderer, the features that it draws wrongly (docs/decisions/renderers.md). The value of
# a feature is a remark on the fault, or "" if there is nothing to remark. The faults were observed
# with resvg 0.48, CairoSVG 2.9, Chromium 156, librsvg 2.54, Firefox 153 and Inkscape 1.2.
CANNOT_DRAW: dict[str, dict[Feature, str]] = {
    "resvg": {Feature.TURNED_BLUR: "20 to 43 levels off", Feature.LIGHTER: ""},
    "cairo": {
        **dict.fromkeys((Feature.TURNED_BLUR, Feature.BLUR, Feature.FILTER), _NO_FILTERS),
        Feature.LIGHTER: "",
        Feature.BLEND: "",
        Feature.MASK: "119 levels off at a grey; black and white ones are right",
    },
    "chromium": {Feature.MOVING: _SOME_MOMENT},
    "librsvg": {Feature.TURNED_BLUR: "39 to 45 levels off", Feature.LIGHTER: ""},
    "firefox": {Feature.MOVING: _SOME_MOMENT},
    "inkscape": {Feature.LIGHTER: "", Feature.PLAIN_HREF: ""},
}


def drawn_by(*features: Feature) -> tuple[str, ...]:
    """Return the names of the renderers that draw all of these features correctly."""
    return tuple(name for name in RENDERERS if CANNOT_DRAW[name].keys().isdisjoint(features))


# resvg is the default because it is fast and accurate, and because pip installs it as a wheel.
DEFAULT_RENDERER = "resvg"
DRAW_ROTATED_BLURS = drawn_by(Feature.TURNED_BLUR)
# The renderers that draw minimal markup correctly, because they draw masks and plain hrefs
# correctly.
DRAW_MINIMAL = drawn_by(Feature.MASK, Feature.PLAIN_HREF)
DRAW_BLENDS = drawn_by(Feature.BLEND, Feature.FILTER)


def renderer_version(name: str) -> str:
    """Return the name and version of a renderer. Raise RendererError if it is not installed."""
    return _renderer_function(name, "_version")()


def rasterize(
    svg: str, width: int, height: int, renderer: str = DEFAULT_RENDERER
) -> NDArray[np.float32]:
    """Return the raster of an SVG over white: (height, width, 3) float32 in 0..1.

    An SVG with a viewBox is stretched to width x height px, even if its own proportions are
    different. Raise RendererError if the renderer is not installed, if it fails on the file, or if
    it is known to draw a feature of the file wrongly.
    """
    return over(_drawn(svg, width, height, renderer, clear=False))


def rasterize_rgba(
    svg: str, width: int, height: int, renderer: str = DEFAULT_RENDERER
) -> NDArray[np.float32]:
    """Return the raster of an SVG with straight alpha: (height, width, 4) float32 in 0..1.

    Arguments and errors are those of rasterize. Firefox has no transparent page, so it draws the
    SVG twice, over white and over black.
    """
    return _drawn(svg, width, height, renderer, clear=True)


def rasterize_like(
    svg: str, picture: NDArray[np.floating], renderer: str = DEFAULT_RENDERER
) -> NDArray[np.float32]:
    """Return a raster that has the size of `picture`.

    If `picture` is opaque, the raster is over white. If `picture` has alpha, so has the raster.
    """
    height, width = picture.shape[:2]
    draw = rasterize_rgba if has_alpha(picture) else rasterize
    return draw(svg, width, height, renderer)


def rasterize_sized(
    svg: str, width: int, height: int, renderer: str, clear: bool = False
) -> NDArray[np.float32]:
    """Return the raster (height, width, 4) of an SVG whose size is width x height px.

    Raise RendererError if the renderer returns a raster of another size.

    clear  whether a browser draws on a transparent page rather than on a white one. The other
           renderers ignore it
    """
    page = [CLEAR] if clear and renderer in BROWSERS else []
    pixels = _renderer_function(renderer)(svg, width, height, *page)
    if pixels.shape[:2] != (height, width):
        got = f"{pixels.shape[1]}x{pixels.shape[0]} px"
        raise RendererError(
            f"raster of {renderer} must be {width}x{height} px; got {got}. Try to draw it smaller, "
            "or another --renderer"
        )
    return pixels


def refuse_unsupported(svg: str, renderer: str) -> None:
    """Raise RendererError if the SVG uses a feature that the renderer is known to draw wrongly."""
    cannot = CANNOT_DRAW[_checked(renderer)]
    for feature in (each for each in Feature if each in cannot and uses(svg, each)):
        others = drawn_by(feature)
        raise RendererError(
            f"renderer must be one of {', '.join(others)} for what the SVG uses, {feature}; "
            f"got {renderer}. Try --renderer {others[0]}"
        )


def _drawn(svg: str, width: int, height: int, renderer: str, clear: bool) -> NDArray[np.float32]:
    if width * height > MOST_PIXELS:  # photos have the same limit
        raise RendererError(
            f"the raster must be at most {MOST_PIXELS / 1e6:.0f} million px; got "
            f"{width}x{height}, {width * height / 1e6:.0f} million. Try to draw the SVG smaller"
        )
    try:
        text = from_root(svg)
        # Broken files are refused here, because some renderers would draw a part of such a file.
        expat.ParserCreate().Parse(text, True)
    except (InputError, expat.ExpatError, UnicodeEncodeError) as error:
        raise RendererError(f"cannot draw the SVG: {error}. Try to re-save it") from error
    refuse_unsupported(text, renderer)
    return rasterize_sized(stretched(text, width, height), width, height, renderer, clear)


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


def _checked(name: str) -> str:
    """Return `name` if it is the name of a renderer. Otherwise raise InputError."""
    return Field("renderer", words=RENDERERS).checked(name)


def _renderer_function(renderer: str, suffix: str = "") -> Any:
    """Return the function of a renderer: NAME, or NAME_version if the suffix is "_version"."""
    name = _checked(renderer)
    module = "chromium" if name == "chromium" else "renderers"
    return resolve_name(f"gauss2svg.raster.{module}:{name}{suffix}")


_GAP = r"(?:\s|/\*(?:[^*]|\*(?!/))*+\*/)*+"  # matches white space and comments of CSS
# Matches the text after the name of a property if the value of the property has an effect.
_ON = rf"""{_GAP}[:=]{_GAP}["']?+{_GAP}(?!none|normal|inherit|initial|unset)"""
_TAG = r"<(?:[\w.-]+:)?"
_LINKING = "(?:use|image|pattern|filter|lineargradient|radialgradient)"
# For each feature: one or more words, separated by blanks, and a pattern. A file that has the
# feature contains at least one of these words, and it also matches the pattern. The words are
# looked for first, because this is fast and rules out most files.
_SEARCHES = {
    Feature.BLUR: ("blur shadow", r"fegaussianblur|fedropshadow|(?<![\w-])(?:blur|drop-shadow)\("),
    Feature.LIGHTER: ("plus-", rf"mix-blend-mode{_ON}plus-"),
    Feature.BLEND: ("mix-blend-mode", rf"mix-blend-mode{_ON}"),
    Feature.FILTER: ("filter", rf"(?<![\w-])(?:-webkit-)?filter{_ON}"),
    Feature.PLAIN_HREF: ("href", rf"{_TAG}{_LINKING}(?=[^<>]*\shref\s*=)(?![^<>]*:href\s*=)"),
    Feature.MASK: ("mask", rf"{_TAG}mask\b"),
    Feature.MOVING: (
        "animat set discard starting-style",
        rf"{_TAG}(?:animate|set|discard)|@starting-style|(?<![\w-])animation(?:-name)?{_ON}",
    ),
}
# Matches a rotation, a skew, a matrix that does more than scale and move, and any transform that is
# a property of CSS.
_TURNS = re.compile(
    r"""rotate|skew|[;"'{\s]transform\s*:|matrix\s*+\((?!\s*[^\s,()]{1,40}[\s,]+0[\s,]+0[\s,])"""
)
# Matches comments, titles and descriptions, which are not drawn. It also matches CDATA, as group 1.
# `_visible` keeps group 1, because CDATA may be a style sheet.
_TEXTS = re.compile(
    rf"(<!\[cdata\[.*?\]\]>)|<!--.*?(?:-->|\Z)|{_TAG}(?:title|desc)\b[^<>]*>[^<]*", re.DOTALL
)


def uses(svg: str, feature: Feature) -> bool:
    """Return whether an SVG may use a feature.

    Only the text of the file is searched. So the answer may be true although the feature has no
    effect in the file.
    """
    if feature is Feature.TURNED_BLUR:
        return uses(svg, Feature.BLUR) and _TURNS.search(_visible(svg)) is not None
    words, pattern = _SEARCHES[feature]
    text = _visible(svg)
    if not any(word in text for word in words.split()):
        return False
    return re.search(pattern, UNMET_MEDIA.sub("", text)) is not None


def _visible(svg: str) -> str:
    """Return the text of an SVG in lower case, without comments, titles and descriptions."""
    text = _TEXTS.sub(lambda match: match[1] or "", svg.lower())
    # Character references are replaced by their characters, because XML may use them in any word.
    return re.sub(r"&#x?[\da-f]+;", lambda match: html.unescape(match[0]), text)
