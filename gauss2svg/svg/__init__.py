"""SVG files of scenes. `write.write_svg` writes them, and `read.read_svg` reads them.

This module has the options of a file. The options of SvgFormat say how the shapes are written. The
options of Document say how the file presents its picture.
"""

from __future__ import annotations

import dataclasses
import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from gauss2svg.errors import InputError, quoted, refusal
from gauss2svg.options import Interval, OptionGroup

# This attribute of the root has the size of the canvas in px. The root's own width and height may
# be a size in print instead.
CANVAS = "data-canvas"
MOST_TRAP = 10.0  # mm by which regions of a cut file may spread
MM = {"px": 25.4 / 96, "mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72, "pc": 25.4 / 6}
NAMESPACE = 'xmlns="http://www.w3.org/2000/svg"'
DEFAULT_TITLE = "Vectorised photo"
RESPONSIVE = "responsive"
CURRENT_COLOR = '="currentColor"'  # end of an attribute with the colour that a page sets
# Sizes of paper in mm, the narrower side first.
_PAPERS = {
    "a2": (420, 594), "a3": (297, 420), "a4": (210, 297), "a5": (148, 210), "a6": (105, 148),
    "letter": (215.9, 279.4), "legal": (215.9, 355.6), "tabloid": (279.4, 431.8),
}  # fmt: skip


def signed(svg: str) -> str:
    """Return the text of an SVG with the mark of gauss2svg, which takes no byte.

    The mark is the namespace of the root in single quotes, while its other attributes are in
    double quotes. Other programs use quotes of one kind.
    """
    return svg.replace(NAMESPACE, NAMESPACE.replace('"', "'"), 1)


def check_text(name: str, text: Any) -> str:
    """Return the text. Raise InputError if it is empty or has characters that are not allowed.

    Control characters and lone surrogates are not allowed, nor are the noncharacters that XML 1.0
    excludes.
    """
    if not isinstance(text, str) or not text.strip():
        raise refusal(name, "text that is not empty", quoted(text))
    if any(unicodedata.category(c) in ("Cc", "Cs") or c in "\ufffe\uffff" for c in text):
        raise refusal(name, "text of UTF-8 without control characters", quoted(text))
    return text


def check_size(name: str, size: Any) -> str:
    """Return `size`. Raise InputError unless it is photo, responsive or a width with a unit."""
    if not isinstance(size, str) or size not in ("photo", RESPONSIVE):
        _width_of(name, size)
    return size


def check_aspect(name: str, aspect: Any) -> str:
    """Return `aspect`. Raise InputError unless it is a value that preserveAspectRatio may have."""
    allowed = r"none|x(Min|Mid|Max)Y(Min|Mid|Max)( (meet|slice))?"
    if not isinstance(aspect, str) or not re.fullmatch(allowed, aspect):
        raise refusal(name, "none or such as xMidYMid or 'xMinYMax slice'", quoted(aspect))
    return aspect


def check_sheet(name: str, sheet: Any) -> str:
    """Return `sheet` in lower case.

    Raise InputError unless it is the name of a paper or such as 300x200mm.
    """
    text = sheet.lower() if isinstance(sheet, str) else ""
    match = re.fullmatch(r"(\d+\.?\d*)x(\d+\.?\d*)mm", text)
    if text in _PAPERS or (match and all(1 <= float(side) <= 5000 for side in match.groups())):
        return text
    needed = f"{', '.join(_PAPERS)} or a width and a height such as 300x200mm"
    raise refusal(name, needed, quoted(sheet))


@dataclass(frozen=True, kw_only=True)
class Plotter(OptionGroup):
    """Options for the drawing of a pen plotter."""

    sheet: Annotated[str, check_sheet] = "a4"
    """Paper on which the picture is as large as the margins allow: a4, letter and others, which
    are turned as the picture is, or a width and a height such as 300x200mm."""

    margin: Annotated[float, Interval(ge=0, le=1000.0)] = 15.0
    """Width in mm at each side of the paper that stays white."""

    pen_width: Annotated[float, Interval(ge=0.05, le=10.0)] = 0.3
    """Width of the pen's strokes in mm."""

    hatch: Annotated[float | None, Interval(ge=0.1, le=100.0)] = None
    """Distance in mm of the hatching's lines in dark tones. Light tones have every second one. The
    default is twice the pen's width for a photo, and no hatching for a drawing."""

    hatch_angle: Annotated[float, Interval(ge=-360.0, le=360.0)] = 45.0
    """Direction of the hatching of light tones, in degrees clockwise from left to right."""

    def __post_init__(self) -> None:
        super().__post_init__()
        least = min(self.sides(is_wide=False))
        if min(self.room(least, least)) < 1:
            needed = f"smaller for a sheet of {self.sheet}"
            raise refusal("margin", needed, f"{self.margin:g} mm", f"{least / 10:g}")

    def sides(self, is_wide: bool) -> tuple[float, float]:
        """Return the width and height of the sheet in mm. A named paper lies flat if `is_wide`."""
        if self.sheet in _PAPERS:
            width, height = _PAPERS[self.sheet]
            return (height, width) if is_wide else (width, height)
        width, height = (float(side) for side in self.sheet.removesuffix("mm").split("x"))
        return width, height

    def room(self, width: float, height: float) -> tuple[float, float]:
        """Return the width and height in mm of the place between the margins for centrelines."""
        edges = 2 * self.margin + self.pen_width
        return width - edges, height - edges


@dataclass(frozen=True, kw_only=True)
class Document(OptionGroup):
    """Options that say how a file presents its picture. The options for shapes are in SvgFormat."""

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

    animate: Annotated[float | None, Interval(ge=0.001, le=3600.0)] = None
    """Seconds in which the layers fade in, one after the other. Viewers who prefer reduced motion
    see the finished picture at once."""

    fragments: bool = False
    """Let an address such as out.svg#round-3 show the picture as it is after three rounds. A fit
    adds its shapes in rounds, large ones first."""

    @property
    def layered(self) -> list[str]:
        """Names of the options that are set and need a layer for each round of the fit."""
        return ["animate"] * (self.animate is not None) + ["fragments"] * self.fragments

    def check_without_layers(self, name: str, reason: str, advice: str) -> None:
        """Raise InputError if an option is set that needs a layer for each round of the fit.

        The message is "OPTION must not be given with NAME, REASON. Try ADVICE".

        name    what the file has in place of such layers, such as "layers inks"
        reason  clause that says why, such as "whose layers are no rounds"
        advice  what the user can do instead, such as "layers rounds"
        """
        for option in self.layered:
            raise InputError(f"{option} must not be given with {name}, {reason}. Try {advice}")

    @property
    def is_responsive(self) -> bool:
        """Whether the file states only the proportions of its picture, and no size."""
        return self.size == RESPONSIVE

    def sides(self, width: float, height: float) -> tuple[str, str] | None:
        """Return the width and height that the file states, as texts with a unit.

        width, height  sides of the canvas in px

        Return None if no size is set, or if the size is responsive. Raise InputError if the size is
        invalid, or if a side would be written as 0.
        """
        if self.size is None or self.is_responsive:
            return None
        across, unit = _width_of("size", self.size)
        # With four decimals, a size in cm is exact to a micrometre.
        sides = [f"{side:.4f}" for side in (across, across * height / width)]
        if any(float(side) == 0 for side in sides):
            got = f"{self.size}, which makes {width:g}x{height:g} px {' by '.join(sides)}{unit}"
            raise refusal("size", "larger", got)
        first, second = (side.rstrip("0").rstrip(".") + unit for side in sides)
        return first, second

    def of_photo(self, width: int, height: int, dpi: tuple[float, float] | None) -> Document:
        """Return the document, with a width in mm in place of the size "photo".

        This width follows from the resolution of the photo. A document with any other size is
        returned as it is.

        width, height  sides of the canvas in px
        dpi            px per inch across and down. None if the photo has no resolution tag

        If the size is "photo", raise InputError if the photo has no resolution tag, or if its
        pixels are not square. For any size, raise InputError if a side would be written as 0.
        """
        document = self
        if self.size == "photo":
            across, down = dpi or (math.nan, math.nan)
            # Files store rounded numbers, so the px per inch across and down may differ by up to
            # 1 % although pixels are square.
            if not abs(across / down - 1) <= 0.01:
                lacking = "without a resolution tag"
                if dpi is not None:
                    lacking = f"whose pixels are not square ({across:g}x{down:g} dpi)"
                raise refusal("size", f"a width for a photo {lacking}", "'photo'", "120mm")
            document = dataclasses.replace(self, size=f"{round(width / across * 25.4, 3):g}mm")
        document.sides(width, height)
        return document

    def mm_each(self, width: float) -> float:
        """Return the size on paper, in mm, of one px of a canvas that is `width` px wide."""
        has_size = self.size is not None and not self.is_responsive
        across, unit = _width_of("size", self.size) if has_size else (width, "px")
        return across * MM[unit] / width

    def style(self, rounds: Sequence[int]) -> str:
        """Return the style sheet for the groups of `rounds`, or "" if they need none.

        If `fragments` is set, the sheet hides all groups above the group that the address of the
        file names. If the address names no group, all groups are shown.

        If `animate` is set, the groups fade in one after the other. A group begins to appear when
        the group below it is half visible, and has its own opacity in the end. Viewers who prefer
        reduced motion see the finished picture at once, and so do programs without CSS.
        """
        sheet = "svg>g:target~g{display:none}" if self.fragments and rounds else ""
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
    """Return the id of the group of a round. `index` counts from 0, and ids count from 1."""
    return f"round-{index + 1}"


def _width_of(name: str, size: Any) -> tuple[float, str]:
    match = re.fullmatch(rf"(\d+\.?\d*|\.\d+)({'|'.join(MM)})", str(size))
    if match is None or not 0 < float(match[1]) <= 1e6:
        needed = f"a width above 0 with its unit, one of {', '.join(MM)}: such as 120mm"
        raise refusal(name, needed, quoted(size))
    return float(match[1]), match[2]


Form = Literal["gradient", "blur"]
EDITABLE, MINIMAL = "editable", "minimal"
ROUNDS, INKS = "rounds", "inks"
# The range of the precision in px. A precision above 1 px would round thin shapes to nothing.
LEAST_PRECISION, MOST_PRECISION = 0.001, 1.0
StopCount = Literal[5, 6, 8, 10, 12]  # how many stops a gradient may have
Markup = Literal["editable", "minimal"]
STOP_COUNTS = get_args(StopCount)


@dataclass(frozen=True, kw_only=True)
class SvgFormat(OptionGroup):
    """Options that say how write_svg writes a scene.

    vectorize derives them from its SvgOptions, its preset and its limits. In the file of an
    additive scene all shapes have gradients, and there are no opacities.
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

    current_color: bool = False
    """Write the colour of a drawing of one colour as currentColor, with that colour at the root.
    The background is another one, or there is none."""
