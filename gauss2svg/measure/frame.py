"""The root of an SVG: the size and the coordinates that it gives itself."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from gauss2svg.errors import InputError
from gauss2svg.svg.reader.values import NUMBER

# px of CSS absolute lengths, 96 to the inch.
_UNITS = {
    "": 1.0, "px": 1.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "q": 96 / 101.6,
    "pt": 96 / 72, "pc": 16.0,
}  # fmt: skip
_LENGTH = re.compile(rf"\s*+({NUMBER})\s*+(px|in|cm|mm|q|pt|pc|)\s*+", re.IGNORECASE)
_STYLED_SIZE = re.compile(r"(?:^|(?<=;))\s*(width|height)\s*:\s*([^;]*)", re.IGNORECASE)


@dataclass(frozen=True)
class Frame:
    """Size and coordinates of an SVG.

    width, height  px that the file gives itself, > 0
    view_box       x, y, width, height of what is shown, in the file's own units
    """

    width: float
    height: float
    view_box: tuple[float, float, float, float]


def frame_of(root: Mapping[str, str]) -> Frame:
    """The frame that a root's attributes give; what they leave out follows from the rest.

    Raises InputError where there is neither a viewBox nor a width and a height in absolute
    units, and for a size that is not positive.
    """
    styled = {name.lower(): value for name, value in _STYLED_SIZE.findall(root.get("style", ""))}
    width, height = (
        _length(name, styled.get(name) or root.get(name)) for name in ("width", "height")
    )
    box = _view_box(root["viewBox"]) if root.get("viewBox", "").strip() else None
    if box is None:
        if width is None or height is None:
            raise InputError(
                "SVG has neither a viewBox nor a width and a height in absolute units; add "
                'viewBox="0 0 WIDTH HEIGHT" to its root'
            )
        return Frame(width, height, (0.0, 0.0, width, height))
    if width is None:
        width = box[2] if height is None else height * box[2] / box[3]
    return Frame(width, width * box[3] / box[2] if height is None else height, box)


def _length(name: str, value: str | None) -> float | None:
    """Pixels; None for a length that is relative to a page that is not there."""
    match = _LENGTH.fullmatch(value or "")
    if match is None:
        return None
    pixels = float(match[1]) * _UNITS[match[2].lower()]
    if not 0 < pixels < math.inf:
        raise InputError(f"{name} of the SVG is {match[0][:80]}; needed is more than 0, finite")
    return pixels


def _view_box(value: str) -> tuple[float, float, float, float]:
    try:
        x, y, width, height = (float(v) for v in value.replace(",", " ").split())
    except ValueError:
        x = y = width = height = math.nan
    if not (math.isfinite(x + y + width + height) and width > 0 and height > 0):
        raise InputError(
            f"viewBox of the SVG is {value[:80]!r}; needed are x, y, and a width and a height > 0"
        )
    return x, y, width, height
