"""Attribute values of SVG as Python values: numbers, lengths, shares, colours, style declarations.

Every function raises InputError that names the attribute and what it holds; the reader adds
which element.
"""

from __future__ import annotations

import math
import re

from PIL import ImageColor

from gauss2svg.errors import InputError

Color = tuple[float, float, float]

# float() alone would let nan, inf and 1_000 through. Possessive quantifiers: a long run of digits
# that ends in rubbish must not be tried in every way to cut it.
NUMBER = r"[+-]?+(?:\d++\.?+\d*+|\.\d++)(?:[eE][+-]?+\d++)?+"
_LENGTH = re.compile(rf"\s*+({NUMBER})\s*+([a-zA-Z%]*+)\s*+")
_LIST = re.compile(rf"(?:[\s,]*+{NUMBER})*+[\s,]*+")
_ONE = re.compile(NUMBER)
# CSS: 96 px an inch.
_UNITS = {"": 1.0, "px": 1.0, "in": 96.0, "pt": 4 / 3, "pc": 16.0}
_UNITS |= {"mm": 96 / 25.4, "cm": 96 / 2.54, "q": 96 / 101.6}
_COMMENT = re.compile(r"/\*.*?(?:\*/|\Z)", re.DOTALL)
_REFERENCE = re.compile(r"""\s*url\(\s*['"]?#([^'")\s]+)['"]?\s*\)""")


def length(text: str, name: str, whole: float | None = None) -> float:
    """A length in px, at 96 to the inch; a percentage is one of `whole` where that is given."""
    match = _LENGTH.fullmatch(text)
    unit = match[2].lower() if match else ""
    if match and unit == "%" and whole is not None:
        return _finite(match[1], name) * whole / 100
    if match is None or unit not in _UNITS:
        raise InputError(
            f"{name} is {quoted(text)}; needed is a number, alone or in px, mm, cm, in, pt, pc or Q"
        )
    return _finite(match[1], name) * _UNITS[unit]


def numbers(text: str, name: str) -> list[float]:
    """Numbers apart by white space or commas."""
    if not _LIST.fullmatch(text):
        raise InputError(f"{name} is {quoted(text)}; needed are finite numbers")
    return [_finite(one, name) for one in _ONE.findall(text)]


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
        raise InputError(f"{name} is {quoted(text)}; needed is an opaque colour such as #1a2b3c")
    return levels[0] / 255, levels[1] / 255, levels[2] / 255


def reference(text: str) -> str | None:
    """The id in url(#id), or None where there is no such reference."""
    match = _REFERENCE.match(text)
    return match[1] if match else None


def declarations(style: str) -> dict[str, str]:
    """Properties of a style attribute by their names in lower case; a later one wins.

    Raises InputError for escapes in names and for what is !important.
    """
    if "/*" in style:
        style = _COMMENT.sub(" ", style)
    found: dict[str, str] = {}
    for name, colon, value in (part.partition(":") for part in style.split(";")):
        if "\\" in name or "!" in value:
            raise InputError(
                f"its style has {quoted((name + colon + value).strip())}; needed are declarations "
                "without escapes and without !important"
            )
        if colon:
            found[name.strip().lower()] = value.strip()
    return found


def _finite(text: str, name: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise InputError(f"{name} holds {quoted(text)}; needed are finite numbers")
    return value


def quoted(text: str | None) -> str:
    """A value as a message shows it, cut where it is long."""
    return repr(text if text is None or len(text) <= 60 else text[:57] + "...")
