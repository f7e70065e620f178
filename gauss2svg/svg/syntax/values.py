"""Attribute values of SVG as Python values: numbers, lengths, shares, colours, references.

InputErrors name the attribute; the reader adds the element.
"""

from __future__ import annotations

import math
import re

from PIL import ImageColor

from gauss2svg.errors import InputError, quoted

Color = tuple[float, float, float]

# float() alone would accept nan, inf and 1_000. The quantifiers are possessive so that a long run
# of digits that ends in rubbish takes linear time.
NUMBER = r"[+-]?+(?:\d++\.?+\d*+|\.\d++)(?:[eE][+-]?+\d++)?+"
_LENGTH = re.compile(rf"\s*+({NUMBER})\s*+([a-zA-Z%]*+)\s*+")
_LIST = re.compile(rf"(?:[\s,]*+{NUMBER})*+[\s,]*+")
_ONE = re.compile(NUMBER)
# CSS: 96 px per inch.
_UNITS = {"": 1.0, "px": 1.0, "in": 96.0, "pt": 4 / 3, "pc": 16.0}
_UNITS |= {"mm": 96 / 25.4, "cm": 96 / 2.54, "q": 96 / 101.6}
_REFERENCE = re.compile(r"""\s*url\(\s*['"]?#([^'")\s]+)['"]?\s*\)""")


def pixels_of(text: str, whole: float | None = None) -> float | None:
    """A length in px, at 96 to the inch; a percentage is one of `whole` where that is given.

    Returns None for anything but an absolute length, infinity for one that overflows.
    """
    match = _LENGTH.fullmatch(text)
    if match is None:
        return None
    unit = match[2].lower()
    if unit == "%":
        return None if whole is None else float(match[1]) * whole / 100
    return float(match[1]) * _UNITS[unit] if unit in _UNITS else None


def length(text: str, name: str, whole: float | None = None) -> float:
    """pixels_of a finite absolute length; raises InputError for anything else."""
    pixels = pixels_of(text, whole)
    if pixels is None or not math.isfinite(pixels):
        raise InputError(
            f"{name} must be a finite number, alone or in px, mm, cm, in, pt, pc or Q; got "
            f"{quoted(text)}"
        )
    return pixels


def numbers(text: str, name: str) -> list[float]:
    """Finite numbers, separated by white space or commas; raises InputError for anything else."""
    found = [float(one) for one in _ONE.findall(text)] if _LIST.fullmatch(text) else [math.inf]
    if not all(map(math.isfinite, found)):
        raise InputError(f"{name} must be finite numbers; got {quoted(text)}")
    return found


def view_box(text: str) -> tuple[float, float, float, float]:
    """x, y, width and height of a viewBox; raises InputError for anything else."""
    found = numbers(text, "viewBox")
    if len(found) != 4 or min(found[2:]) <= 0:
        raise InputError(
            f"viewBox must be x, y, and a width and a height above 0; got {quoted(text)}"
        )
    return found[0], found[1], found[2], found[3]


def share(text: str, name: str) -> float:
    """A number or percentage clamped to 0..1, as renderers do with opacities and offsets."""
    return min(max(length(text, name, 1.0), 0.0), 1.0)


def color(text: str, name: str) -> Color:
    """An opaque sRGB colour in 0..1: #rgb, #rrggbb, rgb(..), hsl(..) or a name."""
    try:
        levels = ImageColor.getrgb(text.strip())
    except ValueError:
        levels = ()
    if len(levels) != 3:
        raise InputError(f"{name} must be an opaque colour, such as #1a2b3c; got {quoted(text)}")
    return levels[0] / 255, levels[1] / 255, levels[2] / 255


def reference(text: str) -> str | None:
    """The id in url(#id), or None where there is no such reference."""
    match = _REFERENCE.match(text)
    return match[1] if match else None
