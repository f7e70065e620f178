"""How a document presents its picture: names, size on paper, layers, animation, fragments."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError

DEFAULT_TITLE = "Vectorised photo"
_UNITS = ("px", "mm", "cm", "in", "pt", "pc")
_SIZE = re.compile(rf"(\d+\.?\d*|\.\d+)({'|'.join(_UNITS)})")
_ASPECT = re.compile(r"none|x(Min|Mid|Max)Y(Min|Mid|Max)( (meet|slice))?")
_LARGEST_SIZE = 1e6  # of a width, whatever its unit
_DECIMALS = 4  # of a size: a millionth of a metre where the unit is a centimetre
_LARGEST_LABEL = 2**31 - 1
LONGEST_ANIMATION_S = 3600.0
# Of groups under the root alone: with a segment for its fragment a file shows the whole picture,
# and not a round without some of its segments under all later rounds.
_UP_TO_TARGET = "svg>g:target~g{display:none}"


@dataclass(frozen=True, eq=False)
class Page:
    """How a document presents its picture; how shapes are written is SvgOptions.

    title     text of the title element: the picture's name for a screen reader, the tip of a
              browser
    alt       text of the desc element; None: how many Gaussians there are and what wrote them
    size      width of the picture with a unit, such as "120mm", "5in" or "300px"; the height
              follows from the proportions; None: the canvas in px
    aspect    preserveAspectRatio, such as "xMidYMid slice" or "none"; None: not written
    segments  (rows, columns) whole numbers >= 0, which are spread over the canvas: in each round
              shapes whose centre lies on the same number are a layer of their own; or None
    animate   seconds, above 0 and up to LONGEST_ANIMATION_S, in which the rounds fade in, one
              after the other; None: a still picture
    fragments whether the file, opened as out.svg#round-3, shows the picture up to that round

    Raises InputError for what is not valid.
    """

    title: str = DEFAULT_TITLE
    alt: str | None = None
    size: str | None = None
    aspect: str | None = None
    segments: NDArray[np.integer] | None = None
    animate: float | None = None
    fragments: bool = False

    def __post_init__(self) -> None:
        _check_text("title", self.title)
        if self.alt is not None:
            _check_text("alt", self.alt)
        if self.size is not None:
            _ = self.sides(1.0, 1.0)
        if self.aspect is not None and not (
            isinstance(self.aspect, str) and _ASPECT.fullmatch(self.aspect)
        ):
            raise InputError(
                f"aspect is {self.aspect!r}; needed is such as xMidYMid, 'xMinYMax slice' or none"
            )
        if self.segments is not None:
            _check_segments(self.segments)
        if self.animate is not None and not _is_between(self.animate, 0, LONGEST_ANIMATION_S):
            raise InputError(
                f"animate is {self.animate!r}; needed are seconds above 0, up to "
                f"{LONGEST_ANIMATION_S:g}"
            )
        if not isinstance(self.fragments, bool):
            raise InputError(f"fragments is {self.fragments!r}; needed is True or False")

    def sides(self, width: float, height: float) -> tuple[str, str] | None:
        """Width and height with their unit of a canvas of width x height px; None without a size.

        Raises InputError for a size that is none, or at which a side would be written as 0.
        """
        if self.size is None:
            return None
        match = _SIZE.fullmatch(self.size) if isinstance(self.size, str) else None
        across = float(match[1]) if match else math.nan
        if match is None or not _is_between(across, 0, _LARGEST_SIZE):
            raise InputError(
                f"size is {self.size!r}; needed is a width above 0 with its unit, one of "
                f"{', '.join(_UNITS)}: such as 120mm"
            )
        sides = [f"{side:.{_DECIMALS}f}" for side in (across, across * height / width)]
        if any(float(side) == 0 for side in sides):
            raise InputError(
                f"size is {self.size!r}, at which {width:g}x{height:g} px would be "
                f"{' by '.join(sides)}{match[2]}; needed is a larger one"
            )
        first, second = (side.rstrip("0").rstrip(".") + match[2] for side in sides)
        return first, second

    def style(self, rounds: Sequence[int]) -> str | None:
        """Style sheet of the groups of these rounds; None where the page needs none.

        With fragments the groups after the one that the address names are hidden; without one in
        the address, or where no group has it for its id, none is.

        With animation they fade in, group by group. Each begins when the one before is half there.
        Before and while it waits a group is as it starts, afterwards as it is written, so nothing
        is left of the animation in the end; whoever wants less motion, or has no CSS, sees the end
        at once.
        """
        if not rounds:
            return None
        up_to_target = _UP_TO_TARGET if self.fragments else ""
        return up_to_target + self._fading(rounds) or None

    def _fading(self, rounds: Sequence[int]) -> str:
        """The animation's rules, "" for a still picture."""
        if self.animate is None:
            return ""
        step = self.animate / (len(rounds) + 1)
        rules = "".join(
            f"#{round_id(index)}{{animation:fade-in {2 * step:.4g}s {at * step:.4g}s backwards}}"
            for at, index in enumerate(rounds)
        )
        return (
            "@media (prefers-reduced-motion:no-preference)"
            f"{{@keyframes fade-in{{from{{opacity:0}}}}{rules}}}"
        )


def round_id(index: int) -> str:
    """Id of the group of a round, from 0."""
    return f"round-{index + 1}"


def _is_between(value: Any, least: float, most: float) -> bool:
    """Whether a value is a number above the one and up to the other."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        return False
    return bool(least < float(value) <= most)


def _check_text(name: str, text: Any) -> None:
    if not isinstance(text, str) or not text.strip():
        raise InputError(f"{name} is {text!r}; needed is text, or none at all for the usual one")
    # Control characters, lone surrogates, and what XML 1.0 has no place for.
    if any(unicodedata.category(c) in ("Cc", "Cs") or c in "\ufffe\uffff" for c in text):
        raise InputError(f"{name} is {text!r}; needed is text without control characters")


def _check_segments(labels: Any) -> None:
    if not isinstance(labels, np.ndarray) or labels.ndim != 2 or not labels.size:
        got = f"of shape {labels.shape}" if isinstance(labels, np.ndarray) else repr(labels)[:60]
        raise InputError(f"segments are {got}; needed is an array (h, w) of whole numbers")
    if not np.issubdtype(labels.dtype, np.integer):
        raise InputError(f"segments are of type {labels.dtype}; needed are whole numbers")
    if labels.min() < 0 or labels.max() > _LARGEST_LABEL:
        raise InputError(
            f"segments are in {labels.min()}..{labels.max()}; needed are whole "
            f"numbers in 0..{_LARGEST_LABEL}"
        )
