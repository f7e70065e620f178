"""Elements of an SVG, and the short texts in them: numbers, colours and ids.

Element.text writes all elements except the root of an editable file, which svgwrite writes
(gauss2svg.svg.write).

The size of numbers in a file is limited, because renderers compute in float32, and some renderers
crash on large numbers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from string import ascii_letters

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gauss2svg.errors import SceneError
from gauss2svg.scene import Scene


class Element:
    """An element: its tag, its content, and its attributes in the order of the file.

    inside      elements, a text, or None for a tag that closes itself
    attributes  each _ in a name becomes -. Attributes whose value is None are left out

    Texts and attributes are not escaped here. Callers must escape texts that come from users.
    """

    __slots__ = "attributes", "inside", "tag"

    def __init__(
        self, tag: str, inside: Sequence[Element] | str | None = None, /, **attributes: str | None
    ) -> None:
        self.tag, self.inside = tag, inside
        self.attributes = {k.replace("_", "-"): v for k, v in attributes.items() if v is not None}

    def replace(self, **attributes: str | None) -> Element:
        """Return a copy of the element with other attributes. None removes an attribute."""
        return Element(self.tag, self.inside, **{**self.attributes, **attributes})

    def text(self) -> str:
        """Return the element as SVG text, without white space between tags."""
        begin, inside = f"<{self.tag}{attributes_text(self.attributes)}", self.inside
        if inside is None:
            return begin + "/>"
        if not isinstance(inside, str):
            inside = "".join([one.text() for one in inside])
        return f"{begin}>{inside}</{self.tag}>"


def attributes_text(attributes: Mapping[str, str]) -> str:
    """Return the attributes as they stand in a tag, with a space before each of them."""
    return "".join([f' {name}="{value}"' for name, value in attributes.items()])


def clipped(
    body: Sequence[Element],
    mean: NDArray[np.float64],
    half: NDArray[np.float64],
    canvas: NDArray[np.float64],
    **attributes: str,
) -> Sequence[Element]:
    """Return `body`, in an inner <svg> if a shape reaches beyond the canvas.

    If the box of a picture has other proportions than its view box, browsers also show what lies
    beside the view box. An inner <svg> covers the view box and clips what it contains
    (docs/decisions/clip.md).

    mean, half  (n, 2) centres of the shapes, and half of the sides of the boxes around them
    canvas      (2,) width and height, in the same unit
    attributes  attributes of the inner <svg>
    """
    if not ((mean < half) | (mean + half > canvas)).any():
        return body
    return [Element("svg", body, **attributes)]


def unless(default: str, value: str) -> str | None:
    """Return `value`, or None if it is the default of its attribute and need not be written."""
    return None if value == default else value


def number(value: float, decimals: int) -> str:
    """Return the shortest text of a finite value that is rounded to `decimals` decimals."""
    text = f"{value:.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if decimals else text
    if text.startswith(("0.", "-0.")):
        return text.replace("0.", ".", 1)
    return "0" if text == "-0" else text


def hex_color(color: Iterable[int], short: bool = True) -> str:
    """Return three levels in 0..255 as a colour #rrggbb.

    If `short` is true, return #rgb for a colour that can be written exactly in this form.
    """
    text = "#" + "".join(f"{int(v):02x}" for v in color)
    return "#" + text[1::2] if short and text[1::2] == text[2::2] else text


def short_id(index: int) -> str:
    """Return the id with this index, counted from 0, in the list a, b, ..., Z, aa, ab, ..."""
    before, last = divmod(index, len(ascii_letters))
    return (short_id(before - 1) if before else "") + ascii_letters[last]


# The largest number in a file, in user units. From about 1e9 on, resvg panics. With numbers up to
# 1e8, the errors of all six renderers are at most 2.1 levels of 255 (docs/decisions/numbers.md).
LARGEST_NUMBER = 1e8
_SMALLEST_CANVAS = 0.01  # shortest allowed side of a canvas, in px
# The largest distance of a shape's edge from the origin, in px. Renderers that use cairo are wrong
# beyond it, because cairo has only 23 bits for whole pixels. At a distance of 1e7 px their errors
# are 47 levels of 255.
FARTHEST = 8e6


def check_view(scene: Scene, precision: float = 1.0) -> None:
    """Raise SceneError if the canvas is too small or too large for a file.

    precision  user unit of the file in px. The sides in this unit must not exceed LARGEST_NUMBER
    """
    low, high = sorted((scene.width, scene.height))
    most = LARGEST_NUMBER * precision
    if low < _SMALLEST_CANVAS or high > most:
        raise SceneError(
            f"canvas of an SVG must be {_SMALLEST_CANVAS}..{most:g} px a side at a precision of "
            f"{precision:g} px; got {scene.width:g}x{scene.height:g} px. Try to scale the scene"
        )


def writable(
    scene: Scene, radius: ArrayLike, precision: float, unit: ArrayLike = 1
) -> NDArray[np.bool_]:
    """Return for each shape (n,) whether it can be written to a file.

    A shape can be written if its numbers do not exceed LARGEST_NUMBER, and if its edge is not
    farther than FARTHEST from the origin. Callers leave out the shapes that cannot be written.
    Raise SceneError if one of these may be visible on the canvas.

    radius     radius, in sigmas, of the disc that is drawn
    precision  user unit of the file in px
    unit       radius of the circle to which the shape's matrix applies, in user units
    """
    extent = np.asarray(radius)[..., None] * scene.sigma
    offset = np.abs(scene.mean)
    number = np.maximum(offset, extent / np.asarray(unit)[..., None]).max(axis=1) / precision
    farthest = (offset + extent).max(axis=1)
    canvas = np.array([scene.width, scene.height])
    beyond = np.maximum(-scene.mean, scene.mean - canvas)
    # A blurred disc reaches up to 2.5 radii beyond its edge, and other shapes reach less far. So no
    # shape reaches farther than 4 radii from its mean. Antialiasing adds one px.
    off = (beyond > 4.0 * extent + 1.0).any(axis=1)
    fits = (number <= LARGEST_NUMBER) & (farthest <= FARTHEST)
    lost = ~fits & ~off
    if lost.any():
        i = int(lost.argmax())
        raise SceneError(
            f"Gaussian {i} must reach at most {FARTHEST:g} px, with numbers up to "
            f"{LARGEST_NUMBER:g}; got {farthest[i]:.3g} px and {number[i]:.3g} at a precision of "
            f"{precision:g} px, for mean {scene.mean[i].tolist()} and sigma "
            f"{scene.sigma[i].tolist()} px. Try to clip its sigma, to scale the scene down, to "
            "drop the Gaussian, or a coarser precision"
        )
    return fits
