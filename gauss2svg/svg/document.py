"""How a document presents its picture: names, size on paper, layers, animation, fragments."""

from __future__ import annotations

import math
import os
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from gauss2svg.errors import InputError, quoted, whole_number
from gauss2svg.options import Number, OptionGroup, fields_of, file_name

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

DEFAULT_TITLE = "Vectorised photo"
PHOTO_SIZE, RESPONSIVE = "photo", "responsive"
# In mm; a pixel is that of CSS.
_UNITS = {"px": 25.4 / 96, "mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72, "pc": 25.4 / 6}
_SIZE = re.compile(rf"(\d+\.?\d*|\.\d+)({'|'.join(_UNITS)})")
_ASPECT = re.compile(r"none|x(Min|Mid|Max)Y(Min|Mid|Max)( (meet|slice))?")
_COUNT = re.compile("[0-9]{1,18}")  # of segments
_DECIMALS = 4  # of a size: a millionth of a metre where the unit is a centimetre
_LARGEST_LABEL = 2**31 - 1
MOST_SEGMENTS = 10_000
# It selects groups under the root alone: with a segment for its fragment a file shows the whole
# picture, and not a round without some of its segments under all later rounds.
UP_TO_TARGET = "svg>g:target~g{display:none}"


def check_text(name: str, text: Any) -> str:
    """Text that an element can hold; raises InputError for any other value."""
    if not isinstance(text, str) or not text.strip():
        raise InputError(f"{name} must be text that is not empty; got {quoted(text)}")
    # Control characters, lone surrogates, and what XML 1.0 has no place for.
    if any(unicodedata.category(c) in ("Cc", "Cs") or c in "\ufffe\uffff" for c in text):
        raise InputError(f"{name} must be text without control characters; got {quoted(text)}")
    return text


def check_size(name: str, size: Any) -> str:
    """A width with its unit, PHOTO_SIZE or RESPONSIVE."""
    if isinstance(size, str) and size in (PHOTO_SIZE, RESPONSIVE):
        return size
    _width_of(name, size)
    return size


def check_aspect(name: str, aspect: Any) -> str:
    """A value of preserveAspectRatio."""
    if not isinstance(aspect, str) or not _ASPECT.fullmatch(aspect):
        raise InputError(
            f"{name} must be none or such as xMidYMid or 'xMinYMax slice'; got {quoted(aspect)}"
        )
    return aspect


def check_segments(name: str, segments: Any) -> Any:
    """A number, also as text, a path, or an array of labels, whose values are checked."""
    # Here alone, for the help does not need them.
    import numpy as np

    from gauss2svg.photo.photo import plain_array

    if isinstance(segments, str) and _COUNT.fullmatch(segments):  # as on the command line
        segments = int(segments)
    if isinstance(segments, (str, os.PathLike)):
        return file_name(name, segments)
    if not isinstance(segments, np.ndarray) or segments.ndim == 0:
        return whole_number(name, segments, 1, MOST_SEGMENTS)
    labels = plain_array(segments, name)
    labels = labels.astype(np.uint8) if labels.dtype == bool else labels
    if labels.ndim != 2 or not labels.size:
        raise InputError(
            f"{name} must be an array (h, w) of whole numbers; got shape {labels.shape}"
        )
    if not np.issubdtype(labels.dtype, np.integer):
        raise InputError(f"{name} must be whole numbers; got type {labels.dtype}")
    if labels.min() < 0 or labels.max() > _LARGEST_LABEL:
        raise InputError(
            f"{name} must be whole numbers in 0..{_LARGEST_LABEL}; got "
            f"{labels.min()}..{labels.max()}"
        )
    return labels


# A label image, its path, or a number of superpixels. The command line takes no arrays.
if TYPE_CHECKING:
    Segments = int | str | os.PathLike[str] | NDArray[np.integer]
else:
    Segments = int | str | os.PathLike[str]


@dataclass(frozen=True, eq=False, kw_only=True)
class Document(OptionGroup):
    """How the document presents its picture; how shapes are written is SvgFormat."""

    title: Annotated[str, check_text] = DEFAULT_TITLE
    """Title, which browsers show and screen readers read."""

    alt: Annotated[str | None, check_text] = None
    """Description of what the picture shows, for screen readers."""

    size: Annotated[str | None, check_size] = None
    """Width where it is printed or placed, such as 120mm, 5in or 300px; photo: by the photo's
    resolution; responsive: none, so that it fills its place in a page. The height follows from the
    proportions."""

    aspect: Annotated[str | None, check_aspect] = None
    """How the picture fills a frame of other proportions: preserveAspectRatio, such as
    'xMidYMid slice'."""

    segments: Annotated[Segments | None, check_segments] = None
    """Layers inside the rounds: an approximate number of superpixels, or a label image of the
    photo's size."""

    animate: Annotated[float | None, Number(0, 3600.0, above=True)] = None
    """Seconds in which the rounds fade in, unless the viewer prefers reduced motion; the last frame
    is the still picture."""

    fragments: bool = False
    """Opened as out.svg#round-3 the file shows the picture up to that round."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Document) and self._values == other._values

    def __hash__(self) -> int:
        return hash(self._values)

    @property
    def _values(self) -> tuple[Any, ...]:
        """The fields as values that compare: labels as their shape and bytes."""
        values = (getattr(self, field.name) for field in fields_of(Document))
        return tuple(
            value
            if value is None or isinstance(value, (int, float, str))
            else (value.shape, value.astype("int64").tobytes())
            for value in values
        )

    @property
    def labels(self) -> NDArray[np.integer] | None:
        """(rows, columns) whole numbers >= 0, spread over the canvas, or None.

        In each round shapes whose centre lies on the same number are a layer of their own. Raises
        InputError where segments are a number or a path: `vectorize` finds labels in a photo.
        """
        if isinstance(self.segments, (int, str, os.PathLike)):
            raise InputError(
                f"segments must be an array (h, w) of labels here; got {quoted(self.segments)}"
            )
        return self.segments

    @property
    def layered(self) -> list[str]:
        """Which of segments, animate and fragments are given: they need layers of rounds."""
        given = {
            "segments": self.segments is not None,
            "animate": self.animate is not None,
            "fragments": self.fragments,
        }
        return [name for name, is_given in given.items() if is_given]

    @property
    def is_responsive(self) -> bool:
        """Whether the file has no size of its own, only proportions."""
        return self.size == RESPONSIVE

    def sides(self, width: float, height: float) -> tuple[str, str] | None:
        """Width and height with their unit of a canvas of width x height px; None without a size.

        Raises InputError for a size that is none, or at which a side would be written as 0.
        """
        if self.size is None or self.is_responsive:
            return None
        across, unit = _width_of("size", self.size)
        sides = [f"{side:.{_DECIMALS}f}" for side in (across, across * height / width)]
        if any(float(side) == 0 for side in sides):
            raise InputError(
                f"size must be larger; got {self.size}, which makes {width:g}x{height:g} px "
                f"{' by '.join(sides)}{unit}"
            )
        first, second = (side.rstrip("0").rstrip(".") + unit for side in sides)
        return first, second

    def mm_each(self, width: float) -> float:
        """Millimetres of a px of a canvas of so many px across, on paper."""
        given = None if self.size == RESPONSIVE else self.size
        across, unit = (width, "px") if given is None else _width_of("size", given)
        return across * _UNITS[unit] / width

    def style(self, rounds: Sequence[int]) -> str | None:
        """Style sheet of the groups of these rounds; None where it needs none.

        With fragments the groups after the one that the address names are hidden; without one in
        the address, or where no group has it for its id, none is.

        With animation they fade in, group by group. Each begins when the one before is half there.
        Before and while it waits a group is as it starts, afterwards as it is written, so nothing
        is left of the animation in the end; whoever wants less motion, or has no CSS, sees the end
        at once.
        """
        if not rounds:
            return None
        up_to_target = UP_TO_TARGET if self.fragments else ""
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


def _width_of(name: str, size: Any) -> tuple[float, str]:
    match = _SIZE.fullmatch(size) if isinstance(size, str) else None
    across = float(match[1]) if match else math.nan
    if match is None or not 0 < across <= 1e6:
        units = ", ".join(_UNITS)
        raise InputError(
            f"{name} must be a width above 0 with its unit, one of {units}: such as 120mm; got "
            f"{quoted(size)}"
        )
    return across, match[2]
