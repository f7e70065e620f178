"""Sizes in SVG: absolute lengths, and the canvas that the attributes of a root set."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

from gauss2svg.errors import quoted, refusal

# Attribute of the root with the canvas in px. Its width and height may be a size in print.
CANVAS = "data-canvas"
MM = {"px": 25.4 / 96, "mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72, "pc": 25.4 / 6}
# float() alone would accept nan, inf and 1_000. The quantifiers are possessive so that a long run
# of digits that ends in rubbish takes linear time.
NUMBER = r"[+-]?+(?:\d++\.?+\d*+|\.\d++)(?:[eE][+-]?+\d++)?+"
_LENGTH = re.compile(rf"\s*+({NUMBER})({'|'.join(MM)}|)\s*+")
_LIST = re.compile(rf"(?:[\s,]*+{NUMBER})*+[\s,]*+")
# Renderers have 32-bit floats, and their transform to pixels needs part of the range.
_LEAST, _MOST = 1e-30, 1e30


class Frame(NamedTuple):
    """The size in px, and the visible part in user units: its x, y, width and height."""

    width: float
    height: float
    view_box: tuple[float, ...]


def numbers(text: str, name: str, count: int = 0) -> list[float]:
    """Return finite numbers, separated by blanks or commas. Raise InputError for other texts.

    count  required number of numbers, 0 for any
    """
    found = list(map(float, re.findall(NUMBER, text))) if _LIST.fullmatch(text) else [math.nan]
    if not all(map(math.isfinite, found)) or (count and len(found) != count):
        needed = "a finite number" if count == 1 else f"{count or ''} finite numbers".strip()
        raise refusal(name, needed, quoted(text))
    return found


def pixels_of(text: str) -> float | None:
    """Return an absolute length in px, at 96 to the inch, or None for anything else."""
    match = _LENGTH.fullmatch(text)
    return float(match[1]) * (MM[match[2] or "px"] / MM["px"]) if match else None


def frame_of(root: Mapping[str, str]) -> Frame:
    """Return the frame of a root's attributes. A missing side follows from the viewBox.

    Raise InputError if there is neither a viewBox nor a width and a height in absolute units, and
    for numbers that are too large or too small for renderers.
    """
    sides = [pixels_of(root.get(name, "")) for name in ("width", "height")]
    box = numbers(root["viewBox"], "viewBox", 4) if root.get("viewBox", "").strip() else None
    if box is None:
        if None in sides:
            needed = "of a known size, by a viewBox or by a width and a height in absolute units"
            advice = 'to add viewBox="0 0 WIDTH HEIGHT" to its root'
            raise refusal("the SVG", needed, "neither", advice)
        box = [0.0, 0.0, *(side or 0.0 for side in sides)]
    width, height = sides
    if width is None or height is None:
        scales = [s / b for s, b in zip(sides, box[2:], strict=True) if s is not None and b]
        width, height = (side * (scales or [1.0])[0] for side in box[2:])
    extents = width, height, *box[2:]
    is_held = all(_LEAST <= side <= _MOST for side in extents) and abs(box[0]) <= _MOST
    if not (is_held and abs(box[1]) <= _MOST):
        needed, got = f"above 0 and in {_LEAST:g}..{_MOST:g}", (width, height, *box)
        shown, advice = " ".join(f"{v:g}" for v in got), "to scale it to the size of the photo"
        raise refusal("width, height and viewBox of the SVG", needed, shown, advice)
    return Frame(width, height, tuple(box))
