"""SVG files of scenes, which `write.write_svg` writes and `read.read_svg` reads.

This module has the options of a file. SvgFormat sets how shapes are written, and Document how the
file presents its picture.
"""

from __future__ import annotations

import dataclasses
import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from annotated_types import Interval

from gauss2svg.errors import InputError, quoted, refusal
from gauss2svg.options import OptionGroup

# Attribute of the root with the canvas's size in px. The root's own width may be a size in print.
CANVAS = "data-canvas"
MM = {"px": 25.4 / 96, "mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72, "pc": 25.4 / 6}
DEFAULT_TITLE = "Vectorised photo"
PHOTO_SIZE, RESPONSIVE = "photo", "responsive"
_SIZE = re.compile(rf"(\d+\.?\d*|\.\d+)({'|'.join(MM)})")
_ASPECT = re.compile(r"none|x(Min|Mid|Max)Y(Min|Mid|Max)( (meet|slice))?")
_DECIMALS = 4  # decimals of a size. In cm the last decimal is a micrometre
# CSS rule that hides all rounds above the round that the file's address names.
UP_TO_TARGET = "svg>g:target~g{display:none}"


def check_text(name: str, text: Any) -> str:
    """Return the text. Raise InputError if the text is empty, or if an element cannot hold it."""
    if not isinstance(text, str) or not text.strip():
        raise refusal(name, "text that is not empty", quoted(text))
    # Refuse control characters, lone surrogates, and the noncharacters that XML 1.0 excludes.
    if any(unicodedata.category(c) in ("Cc", "Cs") or c in "\ufffe\uffff" for c in text):
        raise refusal(name, "text of UTF-8 without control characters", quoted(text))
    return text


def check_size(name: str, size: Any) -> str:
    """Return the size. Raise InputError unless it is photo, responsive or a width with a unit."""
    if not (isinstance(size, str) and size in (PHOTO_SIZE, RESPONSIVE)):
        _width_of(name, size)
    return size


def check_aspect(name: str, aspect: Any) -> str:
    """Return the aspect. Raise InputError unless it is a value of preserveAspectRatio."""
    if not isinstance(aspect, str) or not _ASPECT.fullmatch(aspect):
        raise refusal(name, "none or such as xMidYMid or 'xMinYMax slice'", quoted(aspect))
    return aspect


@dataclass(frozen=True, kw_only=True)
class Document(OptionGroup):
    """Options for how the file presents its picture. SvgFormat has those for its shapes."""

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
        """Names of the given options that need layers of rounds."""
        return ["animate"] * (self.animate is not None) + ["fragments"] * self.fragments

    def check_without_layers(self, name: str, reason: str, advice: str) -> None:
        """Raise InputError if an option needs layers of rounds, which a file with `name` lacks."""
        for option in self.layered:
            raise InputError(f"{option} must not be given with {name}, {reason}. Try {advice}")

    @property
    def is_responsive(self) -> bool:
        """Whether the file has no size of its own, only proportions."""
        return self.size == RESPONSIVE

    def sides(self, width: float, height: float) -> tuple[str, str] | None:
        """Return the file's width and height, with unit, for a canvas of width x height px.

        Return None if no size is set, or if it is responsive. Raise InputError for an invalid size,
        and for one at which a side would be written as 0.
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

    def of_photo(self, width: int, height: int, dpi: tuple[float, float] | None) -> Document:
        """Return the document. If its size is "photo", the photo's resolution sets the width.

        dpi  px per inch across and down. None if the photo has no resolution tag
        Raise InputError if the size is "photo" and the photo has no resolution with square pixels,
        or if a side would be written as 0.
        """
        document = self
        if self.size == PHOTO_SIZE:
            across, down = dpi or (math.nan, math.nan)
            # Files round resolutions, so even those of square pixels differ by up to 1 %.
            if not abs(across / down - 1) <= 0.01:
                lacking = "without a resolution tag"
                if dpi is not None:
                    lacking = f"whose pixels are not square ({across:g}x{down:g} dpi)"
                raise refusal("size", f"a width for a photo {lacking}", repr(PHOTO_SIZE), "120mm")
            document = dataclasses.replace(self, size=f"{round(width / across * 25.4, 3):g}mm")
        document.sides(width, height)
        return document

    def mm_each(self, width: float) -> float:
        """Return the millimetres on paper of one px of a canvas that is `width` px wide."""
        has_size = self.size is not None and not self.is_responsive
        across, unit = _width_of("size", self.size) if has_size else (width, "px")
        return across * MM[unit] / width

    def style(self, rounds: Sequence[int]) -> str:
        """Return the style sheet for the groups of `rounds`, or "" if they need none.

        With `fragments` the sheet hides the groups above the group that the file's address names.
        If the address names no group, all groups are shown.

        With `animate` the groups fade in one after the other. A group is transparent until the
        group below is half visible, and has its written opacity in the end. Viewers who prefer less
        motion see the finished picture at once, and so do programs without CSS.
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
    """Return the id of a round's group. Rounds are counted from 0, ids from 1."""
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
# Range of the precision in px. Above 1 px thin shapes would be rounded to nothing.
LEAST_PRECISION, MOST_PRECISION = 0.001, 1.0
StopCount = Literal[5, 6, 8, 10, 12]  # number of stops of a gradient
Markup = Literal["editable", "minimal"]
STOP_COUNTS = get_args(StopCount)


@dataclass(frozen=True, kw_only=True)
class SvgFormat(OptionGroup):
    """Options for how write_svg writes a scene.

    vectorize derives them from its SvgOptions, its preset and its limits. Additive scenes have only
    gradients and no opacities.
    """

    form: Form = "gradient"
    """Form of the shapes that are not plain ellipses: a radial gradient, or, except for small
    ones, a disc under feGaussianBlur."""

    markup: Markup = "editable"
    """editable: layers with names, for editors; minimal: nothing that does not draw."""

    stops: StopCount = 5
    """Stops of a gradient, one of STOP_COUNTS."""

    precision: Annotated[float, Interval(ge=LEAST_PRECISION, le=MOST_PRECISION)] = 0.04
    """User unit of the file in px. Coordinates are whole numbers of units, and
    docs/decisions/numbers.md has the cost of this rounding."""

    layers: Literal["rounds", "inks"] = "rounds"
    """Layers of editable markup: the rounds of the fit, or shapes of one ink."""

    opacity_decimals: Annotated[int, Interval(ge=1, le=6)] = 2
    """Decimals of fill-opacity."""
