"""Elements of an SVG and the short texts in them: numbers, colours, ids.

All that gauss2svg draws is written by Element.text; svgwrite makes the root of editable files
(gauss2svg.svg.write).

Numbers of a file are limited, because renderers compute in float32 and some crash on large ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from string import ascii_letters

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gauss2svg.errors import SceneError
from gauss2svg.scene import Scene


class Element:
    """One element: its tag, what is inside it, and its attributes in the order of the file.

    inside      None for a tag that closes itself; or elements; or a text. Text and attributes are
                written as they are: what users say is escaped before
    attributes  fill_opacity is fill-opacity; those that are None are left out
    """

    __slots__ = "attributes", "inside", "tag"

    def __init__(
        self, tag: str, inside: Sequence[Element] | str | None = None, /, **attributes: str | None
    ) -> None:
        self.tag, self.inside = tag, inside
        self.attributes = {k.replace("_", "-"): v for k, v in attributes.items() if v is not None}

    def replace(self, **attributes: str | None) -> Element:
        """Return the element with some attributes replaced, added, or if they are None left out."""
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
    """Return attributes as they follow a tag's name, each with a space before it."""
    return "".join([f' {name}="{value}"' for name, value in attributes.items()])


def unless(default: str, value: str) -> str | None:
    """Return the value of an attribute, or None for the one that renderers assume without it."""
    return None if value == default else value


def number(value: float, decimals: int) -> str:
    """Return the shortest text of a finite value rounded to some decimals."""
    text = f"{value:.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if decimals else text
    if text.startswith(("0.", "-0.")):
        return text.replace("0.", ".", 1)
    return "0" if text == "-0" else text


def hex_color(color: Iterable[int], short: bool = True) -> str:
    """#rrggbb of three levels 0..255, or where it may be short #rgb if that is the same."""
    text = "#" + "".join(f"{int(v):02x}" for v in color)
    return "#" + text[1::2] if short and text[1::2] == text[2::2] else text


def short_id(index: int) -> str:
    """The index-th shortest id of letters: a, b, ..., Z, aa, ab, ..."""
    before, last = divmod(index, len(ascii_letters))
    return (short_id(before - 1) if before else "") + ascii_letters[last]


# resvg panics from about 1e9 on; all six renderers draw numbers up to 1e8 within 2.1 levels of 255
# (docs/decisions/numbers.md).
LARGEST_NUMBER = 1e8
_SMALLEST_CANVAS = 0.01
# px. Cairo has 23 bits for whole pixels, and is 47 levels off at 1e7.
_FARTHEST = 8e6


def check_view(scene: Scene, precision: float = 1.0) -> None:
    """Raise SceneError for a canvas that is too small, or too wide in units of `precision` px."""
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
    """Return (n,) whether each shape's numbers, in user units of `precision` px, fit into a file.

    radius  in sigmas, of the drawn discs, whose matrices are for circles of radius `unit`
    A shape whose numbers do not fit, or that reaches too far for renderers, can be left out where
    it lies entirely off the canvas. Raise SceneError for one that may be visible.
    """
    extent = np.asarray(radius)[..., None] * scene.sigma
    offset = np.abs(scene.mean)
    number = np.maximum(offset, extent / np.asarray(unit)[..., None]).max(axis=1) / precision
    farthest = (offset + extent).max(axis=1)
    canvas = np.array([scene.width, scene.height])
    beyond = np.maximum(-scene.mean, scene.mean - canvas)
    # All of a shape is drawn within 4 radii of its mean, because a blur fills up to 2.5 radii
    # around its disc; and a px for antialiasing.
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
