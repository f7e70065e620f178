"""Measure how closely an SVG matches a photo: metrics, round trip, any SVG, options of `check`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from annotated_types import Interval

from gauss2svg.options import OptionGroup, Renderer, byte_size
from gauss2svg.photo.formats import DEFAULT_MAX_PIXELS, MOST_PIXELS


def color_name(name: str, value: Any) -> str:
    """Return a colour. Raise InputError with the option's name if `matte_color` refuses it."""
    from gauss2svg.photo.alpha import matte_color  # imports NumPy, which the help does not need

    matte_color(value, name)
    return value


@dataclass(frozen=True, kw_only=True)
class CheckOptions(OptionGroup):
    """Options of measuring an SVG."""

    renderer: Renderer = "resvg"
    """Renderer that rasterises the SVG. resvg comes with gauss2svg, cairo needs the system library
    cairo, and the others are programs to install."""

    max_svg_bytes: Annotated[int | str, byte_size] = "256M"
    """Maximum size of the SVG when decompressed, such as 150k or 1.5M."""

    max_elements: Annotated[int, Interval(ge=1)] = 1_000_000
    """Maximum number of elements in the SVG."""

    draw_timeout: Annotated[float, Interval(gt=0, le=86400)] = 300.0
    """Maximum time (s) for rasterising the SVG, up to 86400. chromium, librsvg, firefox and
    inkscape stop after 300 s in any case."""

    max_pixels: Annotated[int, Interval(ge=1, le=MOST_PIXELS)] = DEFAULT_MAX_PIXELS
    """Maximum number of pixels of a photo. Larger photos are refused before they are decoded."""

    max_size: Annotated[int | None, Interval(ge=1, le=MOST_PIXELS)] = None
    """Longest side (px) at which the SVG is compared. Larger photos are reduced first. The default
    is the size of the photo."""

    matte: Annotated[str | None, color_name] = None
    """Background colour for a transparent photo: white, black, #fa0 or #ffaa00. If not given,
    transparency is compared too."""

    reference_scale: Annotated[float | None, Interval(gt=0, le=MOST_PIXELS)] = None
    """Factor by which the SVG is enlarged to compare it with --reference. The default is 4."""
