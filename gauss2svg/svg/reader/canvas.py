"""The root of an SVG: its canvas in px and the map from user units onto it.

Inkscape keeps width, height, viewBox and unknown attributes; resizing the page changes the first
three only.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gauss2svg.errors import InputError, quoted
from gauss2svg.scene import LEAST_CANVAS, MOST_CANVAS
from gauss2svg.svg.syntax.values import Affine, length, numbers, view_box

# The canvas in px, whatever the physical size that width and height say.
CANVAS = "data-canvas"
# What a background may leave free by rounding: px of the canvas, and of a path's units.
_COVERED = 0.01
_COVERED_UNITS = 0.05
_ALIGNED = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}


def read_canvas(root: Mapping[str, str]) -> tuple[float, float, Affine, tuple[float, float]]:
    """Width and height of the canvas in px, the map onto it, and the size in user units.

    By data-canvas where it is there, over all of which the viewBox is spread; else by width and
    height, fitted as preserveAspectRatio says; else by the viewBox alone.
    Raises InputError for sizes that are none, and where data-canvas and viewBox disagree.
    """
    box = view_box(root["viewBox"]) if root.get("viewBox", "").strip() else None
    whole = box[2:] if box else (None, None)
    width, height = (
        length(root.get(name, "100%"), name, side)
        for name, side in zip(("width", "height"), whole, strict=True)
    )
    if CANVAS in root:
        sides = numbers(root[CANVAS], CANVAS)
        if len(sides) != 2:
            raise InputError(
                f"{CANVAS} must be a width and a height in px; got {quoted(root[CANVAS])}"
            )
        width, height = sides
    if not LEAST_CANVAS <= min(width, height) <= max(width, height) <= MOST_CANVAS:
        raise InputError(
            f"canvas must be {LEAST_CANVAS:g}..{MOST_CANVAS:g} px a side; got "
            f"{width:g}x{height:g} px"
        )
    if box is None:
        return width, height, (1.0, 0.0, 0.0, 1.0, 0.0, 0.0), (width, height)
    x, y, across, down = box
    scale_x, scale_y = width / across, height / down
    left = top = 0.0
    if CANVAS in root:
        # Rounding changes proportions by less.
        if abs(scale_x / scale_y - 1) > 1e-3:
            raise InputError(
                f"{CANVAS} must be of the proportions of the viewBox, {across:g}x{down:g}; got "
                f"{width:g}x{height:g} px: the page was resized. Try to write its size in px "
                "there, or to remove the attribute"
            )
    else:
        scale_x, scale_y, left, top = _fitted(
            root.get("preserveAspectRatio", "xMidYMid meet"), (width, height), (across, down)
        )
    onto = scale_x, 0.0, 0.0, scale_y, left - scale_x * x, top - scale_y * y
    return width, height, onto, (across, down)


def _fitted(
    rule: str, size: tuple[float, float], box: tuple[float, float]
) -> tuple[float, float, float, float]:
    """Scales and offsets by which preserveAspectRatio puts a viewBox into a size."""
    scales = size[0] / box[0], size[1] / box[1]
    words = rule.split()
    if words == ["none"]:
        return *scales, 0.0, 0.0
    align, how = (*words, "meet")[:2] if words else ("", "")
    parts = align[1:4], align[5:]
    named = align[:1] == "x" and align[4:5] == "Y" and all(part in _ALIGNED for part in parts)
    if not named or how not in ("meet", "slice") or len(words) > 2:
        raise InputError(f"preserveAspectRatio must be such as xMidYMid meet; got {quoted(rule)}")
    scale = min(scales) if how == "meet" else max(scales)
    left, top = (
        _ALIGNED[part] * (side - scale * extent)
        for part, side, extent in zip(parts, size, box, strict=True)
    )
    return scale, scale, left, top


def misplaced(
    sides: Mapping[str, float], onto: Affine, canvas: tuple[float, float], in_units: bool
) -> str:
    """Text of the sides of a rectangle unless it is upright over all of a canvas in px, then "".

    sides     its x, y, width and height; onto the map of its user space to px
    in_units  whether its sides were rounded to whole units, as those of minimal markup are
    """
    a, b, c, d, e, f = onto
    x, y = np.add(sides["x"], [0, sides["width"]]), np.add(sides["y"], [0, sides["height"]])
    with np.errstate(all="ignore"):
        across, down = np.sort(a * x + c * y + e), np.sort(b * x + d * y + f)
    upright = max(abs(b), abs(c)) <= 1e-9 * max(abs(a), abs(d))
    free = max(_COVERED, _COVERED_UNITS * min(abs(a), abs(d))) if in_units else _COVERED
    covers = (
        upright
        and bool(np.isfinite([*across, *down]).all())
        and max(across[0], down[0]) <= free
        and min(across[1] - canvas[0], down[1] - canvas[1]) >= -free
    )
    return "" if covers else f"x {across[0]:g}..{across[1]:g}, y {down[0]:g}..{down[1]:g} px"
