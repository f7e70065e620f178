"""Size and coordinate system that the root of an SVG declares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gauss2svg.errors import InputError, quoted
from gauss2svg.svg.syntax.css import declarations, words, written
from gauss2svg.svg.syntax.values import pixels_of, view_box

# Renderers hold numbers in 32 bits, of which the transform to pixels needs some of the range.
_LEAST, _MOST = 1e-30, 1e30
_SCALE = "to scale it to the size of the photo"


@dataclass(frozen=True)
class Frame:
    """Size and coordinates of an SVG.

    width, height  px, > 0
    view_box       x, y, width and height of the visible part in user units
    """

    width: float
    height: float
    view_box: tuple[float, float, float, float]


def frame_of(root: Mapping[str, str]) -> Frame:
    """The frame of a root's attributes; a missing size follows from the rest.

    Raises InputError where there is neither a viewBox nor a width and a height in absolute
    units, and for numbers that renderers do not hold: see _LEAST and _MOST.
    """
    styled = {
        one.lower_name: written(one.value)
        for one in declarations(root.get("style", ""))
        if [token.type for token in words(one.value)] in (["number"], ["dimension"])
    }
    width, height = (
        _length(name, styled.get(name) or root.get(name, "")) for name in ("width", "height")
    )
    box = view_box(root["viewBox"]) if root.get("viewBox", "").strip() else None
    if box is None:
        if width is None or height is None:
            raise InputError(
                "SVG must be of a known size, by a viewBox or by a width and a height in "
                'absolute units; got neither. Try to add viewBox="0 0 WIDTH HEIGHT" to its '
                "root"
            )
        return Frame(width, height, (0.0, 0.0, width, height))
    if max(map(abs, box)) > _MOST or min(box[2:]) < _LEAST:
        raise InputError(
            f"viewBox must be of numbers up to {_MOST:g}, and a width and a height of at least "
            f"{_LEAST:g}; got {quoted(root['viewBox'])}. Try {_SCALE}"
        )
    if width is None:
        width = box[2] if height is None else _side("width", height * box[2] / box[3])
        height = box[3] if height is None else height
    elif height is None:
        height = _side("height", width * box[3] / box[2])
    return Frame(width, height, box)


def _length(name: str, text: str) -> float | None:
    """Pixels; None for a relative length."""
    pixels = pixels_of(text)
    return None if pixels is None else _side(name, pixels, text)


def _side(name: str, pixels: float, text: str = "") -> float:
    if not _LEAST <= pixels <= _MOST:
        raise InputError(
            f"{name} of the SVG must be above 0 and in {_LEAST:g}..{_MOST:g} px; got "
            f"{quoted(text) if text else f'{pixels:g}'}. Try {_SCALE}"
        )
    return pixels
