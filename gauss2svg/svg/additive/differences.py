"""What an additive file has beside its shapes: a style sheet, rectangles, and a filter.

    <style>#additive-1a2b3c4d circle,#additive-1a2b3c4d rect{mix-blend-mode:difference}</style>
    <g id="additive-1a2b3c4d" filter="url(#transfer-1a2b3c4d)"> <rect fill="#.."/>
      <g> <circle r="1" transform="matrix(..)" fill="url(#..)"/> ... </g> <rect fill="#f00"/> ...

gauss2svg.svg.additive.encode explains how they add up to a picture.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping

from gauss2svg.svg.element import Element

WHITE = 255
# Levels of 255 that are added in the end: resvg and Chromium truncate a filter's result to whole
# levels (bias -0.5 levels), the others round.
HALF_WAY = 0.25

Transfer = tuple[tuple[str, str], ...]  # slope and intercept of red, green and blue


def key_of(transfer: Transfer, background: str) -> str:
    """End of both ids, so that two additive drawings inline in one page keep their own filter."""
    return f"{zlib.crc32(repr((transfer, background)).encode()):08x}"


def difference_sheet(group: str) -> str:
    """Style sheet by which all within the group of this id is drawn as a difference.

    Under its first rectangle the group is transparent, where a difference draws its source.
    """
    return f"#{group} circle,#{group} rect{{mix-blend-mode:difference}}"


def cover(fill: str, more: Mapping[str, str] | None = None) -> Element:
    """A rectangle over the canvas and beyond, so that the filter maps opaque pixels only.

    The filter region is extended to whole pixels; a rectangle that ends within a pixel would leave
    it half inverted, which the filter makes an opaque line along the edge.
    """
    size = {"width": "120%", "x": "-10%", "y": "-10%"}
    return Element("rect", {"fill": fill, "height": "120%", **(more or {}), **size})


def transfer_filter(transfer: Transfer, name: str) -> Element:
    """The filter that maps channels by slope and intercept, all over the canvas at any size."""
    functions = [
        Element(f"feFunc{channel}", {"intercept": intercept, "slope": slope, "type": "linear"})
        for channel, (slope, intercept) in zip("RGB", transfer, strict=True)
    ]
    region = {"height": "100%", "id": name, "width": "100%", "x": "0", "y": "0"}
    attributes = {"color-interpolation-filters": "sRGB", "filterUnits": "userSpaceOnUse", **region}
    return Element(
        "filter", attributes, [Element("feComponentTransfer", {"in": "SourceGraphic"}, functions)]
    )
