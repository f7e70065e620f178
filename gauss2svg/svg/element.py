"""Elements of an SVG and the short texts in them: numbers, colours, ids.

Element.text writes all elements except the root of editable files, which svgwrite writes
(gauss2svg.svg.write).

Numbers in a file are limited, because renderers compute in float32 and some crash on large ones.
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
    attributes  names are written with - for _. Attributes whose value is None are left out

    Text and attributes are not escaped here. Callers escape the texts of users.
    """

    __slots__ = "attributes", "inside", "tag"

    def __init__(
        self, tag: str, inside: Sequence[Element] | str | None = None, /, **attributes: str | None
    ) -> None:
        self.tag, self.inside = tag, inside
        self.attributes = {k.replace("_", "-"): v for k, v in attributes.items() if v is not None}

    def replace(self, **attributes: str | None) -> Element:
        """Return the element with attributes replaced or added. None removes an attribute."""
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
    """Return attributes as text, each after a space."""
    return "".join([f' {name}="{value}"' for name, value in attributes.items()])


def unless(default: str, value: str) -> str | None:
    """Return an attribute's value, or None if it is the default, which need not be written."""
    return None if value == default else value


def number(value: float, decimals: int) -> str:
    """Return the shortest text of a finite value rounded to some decimals."""
    text = f"{value:.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if decimals else text
    if text.startswith(("0.", "-0.")):
        return text.replace("0.", ".", 1)
    return "0" if text == "-0" else text


def hex_color(color: Iterable[int], short: bool = True) -> str:
    """Return #rrggbb for three levels in 0..255, or #rgb if `short` and that is the same colour."""
    text = "#" + "".join(f"{int(v):02x}" for v in color)
    return "#" + text[1::2] if short and text[1::2] == text[2::2] else text


def short_id(index: int) -> str:
    """Return the id at `index` in the list a, b, ..., Z, aa, ab, ..., which has short ids first."""
    before, last = divmod(index, len(ascii_letters))
    return (short_id(before - 1) if before else "") + ascii_letters[last]


# Largest number in a file, in user units. resvg panics from about 1e9 on. All six renderers draw
# numbers up to 1e8 with errors of at most 2.1 levels of 255 (docs/decisions/numbers.md).
LARGEST_NUMBER = 1e8
_SMALLEST_CANVAS = 0.01  # px, shortest side of a canvas
# px, largest distance of a shape's edge from the origin. Cairo has 23 bits for whole pixels, and
# errs by 47 levels at 1e7.
_FARTHEST = 8e6


def check_view(scene: Scene, precision: float = 1.0) -> None:
    """Raise SceneError if the canvas is too small, or too large in units of `precision` px."""
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
    """Return whether the numbers and the reach of each shape (n,) are small enough for a file.

    radius     radius in sigmas of the disc that is drawn
    precision  user unit in px
    unit       radius of the circle that the shape's matrix maps, in user units

    Callers leave out the other shapes, which are off the canvas. Raise SceneError if one of these
    may be visible.
    """
    extent = np.asarray(radius)[..., None] * scene.sigma
    offset = np.abs(scene.mean)
    number = np.maximum(offset, extent / np.asarray(unit)[..., None]).max(axis=1) / precision
    farthest = (offset + extent).max(axis=1)
    canvas = np.array([scene.width, scene.height])
    beyond = np.maximum(-scene.mean, scene.mean - canvas)
    # A shape is drawn within 4 radii of its mean, because a blur extends its disc by up to 2.5
    # radii. Antialiasing adds a px.
    off = (beyond > 4.0 * extent + 1.0).any(axis=1)
    fits = (number <= LARGEST_NUMBER) & (farthest <= _FARTHEST)
    lost = ~fits & ~off
    if lost.any():
        i = int(lost.argmax())
        raise SceneError(
            f"Gaussian {i} must reach at most {_FARTHEST:g} px, with numbers up to "
            f"{LARGEST_NUMBER:g}; got {farthest[i]:.3g} px and {number[i]:.3g} at a precision of "
            f"{precision:g} px, for mean {scene.mean[i].tolist()} and sigma "
            f"{scene.sigma[i].tolist()} px. Try to clip its sigma, to scale the scene down, to "
            "drop the Gaussian, or a coarser precision"
        )
    return fits
