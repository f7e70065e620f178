"""Options of a file: SvgFormat says how a scene is written, Document how the file presents it."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from annotated_types import Interval

from gauss2svg.errors import InputError, quoted, refusal
from gauss2svg.options import OptionGroup
from gauss2svg.svg.canvas import MM

DEFAULT_TITLE = "Vectorised photo"
PHOTO_SIZE, RESPONSIVE = "photo", "responsive"
_SIZE = re.compile(rf"(\d+\.?\d*|\.\d+)({'|'.join(MM)})")
_ASPECT = re.compile(r"none|x(Min|Mid|Max)Y(Min|Mid|Max)( (meet|slice))?")
_DECIMALS = 4  # of a size: a millionth of a metre where the unit is a centimetre
# Hides the rounds above the one that the address names.
UP_TO_TARGET = "svg>g:target~g{display:none}"


def check_text(name: str, text: Any) -> str:
    """Text that an element can hold; raises InputError for any other value."""
    if not isinstance(text, str) or not text.strip():
        raise refusal(name, "text that is not empty", quoted(text))
    # Control characters, lone surrogates, and what XML 1.0 has no place for.
    if any(unicodedata.category(c) in ("Cc", "Cs") or c in "\ufffe\uffff" for c in text):
        raise refusal(name, "text of UTF-8 without control characters", quoted(text))
    return text


def check_size(name: str, size: Any) -> str:
    """A width with its unit, PHOTO_SIZE or RESPONSIVE."""
    if not (isinstance(size, str) and size in (PHOTO_SIZE, RESPONSIVE)):
        _width_of(name, size)
    return size


def check_aspect(name: str, aspect: Any) -> str:
    """A value of preserveAspectRatio."""
    if not isinstance(aspect, str) or not _ASPECT.fullmatch(aspect):
        raise refusal(name, "none or such as xMidYMid or 'xMinYMax slice'", quoted(aspect))
    return aspect


@dataclass(frozen=True, kw_only=True)
class Document(OptionGroup):
    """How the document presents its picture; how shapes are written is SvgFormat."""

    title: Annotated[str, check_text] = DEFAULT_TITLE
    """Title, which browsers show and screen readers read."""

    alt: Annotated[str | None, check_text] = None
    """Description of what the picture shows, for screen readers."""

    size: Annotated[str | None, check_size] = None
    """Width in print or in a page, such as 120mm, 5in or 300px, from which the height follows.
    photo: the width that the photo's resolution gives. responsive: fills the width of its
    place in a web page."""

    aspect: Annotated[str | None, check_aspect] = None
    """How the picture fills a frame of other proportions, as a value of preserveAspectRatio in SVG,
    such as 'xMidYMid slice'."""

    animate: Annotated[float | None, Interval(gt=0, le=3600.0)] = None
    """Seconds in which the layers fade in, one after the other. Viewers who prefer reduced motion
    see the finished picture at once."""

    fragments: bool = False
    """Let an address such as out.svg#round-3 show the picture up to that round of the fit."""

    @property
    def layered(self) -> list[str]:
        """Return the names of the given options that need layers of rounds."""
        return ["animate"] * (self.animate is not None) + ["fragments"] * self.fragments

    def check_without_layers(self, name: str, reason: str, advice: str) -> None:
        """Raise InputError for an option that needs layers of rounds, which `name` lacks."""
        for option in self.layered:
            raise InputError(f"{option} must not be given with {name}, {reason}. Try {advice}")

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
            got = f"{self.size}, which makes {width:g}x{height:g} px {' by '.join(sides)}{unit}"
            raise refusal("size", "larger", got)
        first, second = (side.rstrip("0").rstrip(".") + unit for side in sides)
        return first, second

    def mm_each(self, width: float) -> float:
        """Millimetres of a px of a canvas of so many px across, on paper."""
        has_size = self.size is not None and not self.is_responsive
        across, unit = _width_of("size", self.size) if has_size else (width, "px")
        return across * MM[unit] / width

    def style(self, rounds: Sequence[int]) -> str:
        """Return the style sheet of the groups of these rounds, "" where they need none.

        With fragments the groups after the one that the address names are hidden; without one in
        the address, or where no group has it for its id, none is.

        With animation they fade in, group by group. Each begins when the one before is half there.
        Before and while it waits a group is as it starts, afterwards as it is written, so nothing
        is left of the animation in the end; whoever wants less motion, or has no CSS, sees the end
        at once.
        """
        sheet = UP_TO_TARGET if self.fragments and rounds else ""
        if self.animate is not None and rounds:
            step = self.animate / (len(rounds) + 1)
            sheet += "@media (prefers-reduced-motion:no-preference){"
            sheet += "@keyframes fade-in{from{opacity:0}}"
            for at, index in enumerate(rounds):
                seconds = f"{2 * step:.4g}s {at * step:.4g}s"
                sheet += f"#{round_id(index)}{{animation:fade-in {seconds} backwards}}"
            sheet += "}"
        return sheet


def round_id(index: int) -> str:
    """Id of the group of a round, from 0."""
    return f"round-{index + 1}"


def _width_of(name: str, size: Any) -> tuple[float, str]:
    match = _SIZE.fullmatch(size) if isinstance(size, str) else None
    across = float(match[1]) if match else math.nan
    if match is None or not 0 < across <= 1e6:
        needed = f"a width above 0 with its unit, one of {', '.join(MM)}: such as 120mm"
        raise refusal(name, needed, quoted(size))
    return across, match[2]


Form = Literal["gradient", "blur"]
EDITABLE, MINIMAL = "editable", "minimal"
ROUNDS, INKS = "rounds", "inks"
# Over 1 px thin shapes would be rounded to nothing.
LEAST_PRECISION, MOST_PRECISION = 0.001, 1.0
StopCount = Literal[5, 6, 8, 10, 12]  # of a gradient
STOP_COUNTS = get_args(StopCount)


@dataclass(frozen=True, kw_only=True)
class SvgFormat(OptionGroup):
    """How write_svg writes a scene, as its caller says it.

    A run of vectorize takes SvgOptions, and finds this by them, its preset and its limits.

    An additive scene is written in gradients alone, and without opacities.
    """

    form: Form = "gradient"
    """Form of the shapes that are not plain ellipses: a radial gradient, or, except for small
    ones, a disc under feGaussianBlur."""

    markup: Literal["editable", "minimal"] = "editable"
    """editable: layers with names, for editors; minimal: nothing that does not draw."""

    stops: StopCount = 5
    """Stops of a gradient, one of STOP_COUNTS."""

    precision: Annotated[float, Interval(ge=LEAST_PRECISION, le=MOST_PRECISION)] = 0.04
    """The file's user unit in px, of which coordinates are whole numbers: docs/decisions/numbers.md
    has what rounding costs."""

    layers: Literal["rounds", "inks"] = "rounds"
    """Layers of editable markup: the rounds of the fit, or shapes of one ink."""

    opacity_decimals: Annotated[int, Interval(ge=1, le=6)] = 2
    """Decimals of fill-opacity."""
