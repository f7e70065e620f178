"""Attribute values of SVG as Python values: numbers, lengths, shares, colours, references.

InputErrors name the attribute; the reader adds the element.

An affine map of the plane is a tuple of six numbers, in the order of SVG's matrix(a b c d e f):

    x' = a x + c y + e,   y' = b x + d y + f

Thousands are read one by one, where numpy is ten times slower than tuples.

CSS is read by tinycss2: nodes of style sheets and style attributes, and tokens of any CSS.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from typing import Any

import tinycss2
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


Affine = tuple[float, float, float, float, float, float]

IDENTITY: Affine = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
_CALL = re.compile(r"[\s,]*([a-zA-Z]+)\s*\(([^()]*)\)[\s,]*")
# How many numbers each transform function may have.
COUNTS: dict[str, tuple[int, ...]] = {
    "matrix": (6,),
    "translate": (1, 2),
    "scale": (1, 2),
    "rotate": (1, 3),
}
COUNTS |= {"skewX": (1,), "skewY": (1,)}


def compose(outer: Affine, inner: Affine) -> Affine:
    """The map that does `inner` first, then `outer`."""
    a, b, c, d, e, f = outer
    p, q, r, s, t, u = inner
    return (
        a * p + c * q, b * p + d * q, a * r + c * s, b * r + d * s,
        a * t + c * u + e, b * t + d * u + f,
    )  # fmt: skip


def parse_transform(text: str, name: str = "transform") -> Affine:
    """The map of a transform list: matrix, translate, scale, rotate, skewX and skewY, in degrees.

    Raises InputError for anything else.
    """
    total, at = IDENTITY, 0
    text = text.strip()
    if text == "none":
        return total
    while at < len(text):
        call = _CALL.match(text, at)
        values = numbers(call[2], name) if call else []
        if call is None or len(values) not in COUNTS.get(call[1], ()):
            raise InputError(
                f"{name} must be a list of matrix, translate, scale, rotate, skewX, skewY; got "
                f"{quoted(text)}"
            )
        total = compose(total, affine_of(call[1], values)) if at else affine_of(call[1], values)
        at = call.end()
    return total


def affine_of(kind: str, values: list[float]) -> Affine:
    """The map of one transform function, with as many values as one of its COUNTS."""
    first, second = values[0], values[1] if len(values) > 1 else None
    if kind == "matrix":
        a, b, c, d, e, f = values
        return a, b, c, d, e, f
    if kind == "translate":
        return 1.0, 0.0, 0.0, 1.0, first, second or 0.0
    if kind == "scale":
        return first, 0.0, 0.0, first if second is None else second, 0.0, 0.0
    angle_rad = math.radians(first)
    if kind == "skewX":
        return 1.0, 0.0, math.tan(angle_rad), 1.0, 0.0, 0.0
    if kind == "skewY":
        return 1.0, math.tan(angle_rad), 0.0, 1.0, 0.0, 0.0
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    x, y = values[1:] or (0.0, 0.0)
    return cos, sin, -sin, cos, x - cos * x + sin * y, y - sin * x - cos * y


# Tokenising takes 1 to 5 microseconds a character: without a limit a hostile file takes minutes.
MOST_CSS = 4_000_000
_COMMENT = re.compile(r"/\*.*?(?:\*/|\Z)", re.DOTALL)


def nodes_of(text: str, is_sheet: bool, is_entered: Callable[[Any], bool]) -> Iterator[Any]:
    """Nodes of a style sheet or a style attribute, and those in the blocks that are entered.

    Raises InputError for more than MOST_CSS characters and for a number of more digits than Python
    reads.
    """
    parse = tinycss2.parse_stylesheet if is_sheet else tinycss2.parse_blocks_contents
    open_nodes = _parsed(parse, text, skip_whitespace=True)
    while open_nodes:
        node = open_nodes.pop()
        yield node
        if getattr(node, "content", None) and is_entered(node):
            open_nodes += tinycss2.parse_blocks_contents(node.content, True, True)


def declarations(style: str) -> list[Any]:
    """The declarations of a style attribute, in order; raises InputError as nodes_of."""
    parsed = _parsed(tinycss2.parse_blocks_contents, style)
    return [node for node in parsed if node.type == "declaration"]


def properties(style: str) -> dict[str, str]:
    """Properties of a style attribute by their names in lower case; a later one wins.

    They are split by hand: tinycss2 would take 0.1 s for 1000 shapes that an editor styled.

    Raises InputError for escapes in names and for what is !important.
    """
    if "/*" in style:
        style = _COMMENT.sub(" ", style)
    found: dict[str, str] = {}
    for name, colon, value in (part.partition(":") for part in style.split(";")):
        if "\\" in name or "!" in value:
            raise InputError(
                "its style must be without escapes and !important; got "
                f"{quoted((name + colon + value).strip())}"
            )
        if colon:
            found[name.strip().lower()] = value.strip()
    return found


def component_values(text: str) -> list[Any]:
    """The tokens of any CSS, blocks and functions as trees; raises InputError as nodes_of."""
    return _parsed(tinycss2.parse_component_value_list, text)


def words(tokens: list[Any]) -> list[Any]:
    """Tokens without white space."""
    return [token for token in tokens if token.type != "whitespace"]


def written(tokens: list[Any]) -> str:
    """Tokens as text, without white space; () for blocks in blocks, as tinycss2 would recurse."""
    return "".join(
        "()" if any(map(_inside, _inside(token))) else token.serialize() for token in words(tokens)
    )


def _inside(token: Any) -> list[Any]:
    return getattr(token, "content", None) or getattr(token, "arguments", None) or []


def _parsed(parse: Callable[..., Any], text: str, **options: bool) -> Any:
    if len(text) > MOST_CSS:
        raise InputError(
            f"CSS in the SVG must be at most {MOST_CSS} characters a style sheet; got {len(text)}. "
            "Try to save it as plain SVG"
        )
    try:
        return parse(text, skip_comments=True, **options)
    except ValueError as error:  # int() of thousands of digits
        raise InputError(f"CSS in the SVG must have shorter numbers; got {error}") from error
