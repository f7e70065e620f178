"""How closely an SVG matches a photo: metrics, the round trip, any SVG, and options of `check`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from gauss2svg.options import Number, OptionGroup, Renderer, Whole, byte_size
from gauss2svg.photo.formats import DEFAULT_MAX_PIXELS, MOST_PIXELS


def color_name(name: str, value: Any) -> str:
    """Return a colour that is valid for `matte_color`, or raise InputError that names it."""
    from gauss2svg.photo.alpha import matte_color  # with NumPy, which the help does not need

    matte_color(value, name)
    return value


@dataclass(frozen=True, kw_only=True)
class CheckOptions(OptionGroup):
    """How an SVG is measured."""

    renderer: Renderer = "resvg"
    """Renderer that rasterises the SVG; the last four must be installed."""

    max_svg_bytes: Annotated[int | str, byte_size] = "256M"
    """Maximum size of the SVG, decompressed: 150000, 150k or 1.5M."""

    max_elements: Annotated[int, Whole(1)] = 1_000_000
    """Maximum number of elements of the SVG."""

    draw_timeout: Annotated[float, Number(0, 86400, above=True)] = 300.0
    """Time limit (s) of rasterising, at most 86400; the last four renderers stop after 300."""

    max_pixels: Annotated[int, Whole(1, MOST_PIXELS)] = DEFAULT_MAX_PIXELS
    """Maximum number of pixels of the photo, checked before it is decoded."""

    max_size: Annotated[int | None, Whole(1, MOST_PIXELS)] = None
    """Longest side (px) to which a larger photo is reduced first; its own size if not given."""

    matte: Annotated[str | None, color_name] = None
    """Background colour to composite a transparent photo over: white, black, #fa0 or #ffaa00. If
    not given, alpha is compared as well."""

    reference_scale: Annotated[float | None, Number(0, MOST_PIXELS, above=True)] = None
    """Times the photo's size at which the SVG is compared with --reference; 4 if not given."""
