"""Scores that say how closely an SVG matches a photo, and the options of `check`.

SCORES lists them. A run reads this list for its targets, its search and its report, and so do the
benchmark, the galleries and the studio. The help of the command line imports this module, so this
module does not import NumPy, which would make the help slow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pkgutil import resolve_name
from typing import Annotated, Any

from gauss2svg.errors import InputError
from gauss2svg.options import Interval, OptionGroup, Renderer, byte_size, check_color
from gauss2svg.photo import DEFAULT_MAX_PIXELS, MOST_PIXELS

SPACE = "\N{NARROW NO-BREAK SPACE}"
NONE = "\N{EN DASH}"  # text that tables show for a value that was not measured


@dataclass(frozen=True, kw_only=True)
class Search:
    """The tolerances of a search for a target. All are in units of the score.

    tolerance   the target counts as reached if the score is at most this much below the target
    margin      a correction of the number of Gaussians aims at the target plus this margin
    too_little  Gaussians are added if the score is more than this below the target
    too_good    Gaussians are removed if the score is more than this above the target
    slope       expected gain of the score if the number of Gaussians doubles. It is None for PSNR,
                whose gain is measured while the fit grows
    slopes      smallest and largest plausible value of the slope
    """

    tolerance: float
    margin: float
    too_little: float
    too_good: float
    slope: float | None
    slopes: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Score:
    """A score of an SVG against its photo.

    slug         short name in file names, addresses and reports, and in the option target_SLUG
    name         name that people read
    form, unit   number format and unit of the score in tables and tooltips
    least_step   smallest step between two ticks on the axis of a chart
    best         score of two equal pictures. No tick of an axis is beyond it. None: infinite
    title        title of the axis
    about        explanation of the score in galleries
    lower_wins   whether lower values are better. The axis is then upside down
    package      package on PyPI that must be installed to measure the score, or "". Its module has
                 the same name with underscores
    least_side   least width and height in px of a picture for which the score can be measured
    pixel_bytes  bytes of memory per pixel that measuring the score takes. The number includes a
                 margin of at least a tenth
    search       tolerances of the option target_SLUG. None: the score cannot be a target
    """

    slug: str
    name: str
    form: str
    least_step: float
    best: float | None
    title: str
    about: str = ""
    unit: str = ""
    lower_wins: bool = False
    package: str = ""
    least_side: int = 1
    pixel_bytes: int = 0
    search: Search | None = None

    @property
    def key(self) -> str:
        """Key of the score in a report."""
        return f"{self.slug}_svg"

    @property
    def option(self) -> str:
        """Name of the option that makes the score a target."""
        return f"target_{self.slug}"

    @property
    def sign(self) -> int:
        """1 if higher values are better, and -1 if lower ones are.

        After values are multiplied by this sign, a larger one is always better.
        """
        return -1 if self.lower_wins else 1

    @property
    def digits(self) -> int:
        """Number of decimals with which tables show the score."""
        return int(self.form[1:-1])

    @property
    def always(self) -> bool:
        """Whether every run measures the score. The others are measured on request only."""
        return not self.package

    @property
    def is_installed(self) -> bool:
        """Whether the package that the score needs is installed."""
        return self.always or find_spec(self.package.replace("-", "_")) is not None

    @property
    def function(self) -> Callable[[Any, Any], float]:
        """Function (raster, photo) that measures the score. Both are (h, w, 3) float32 in 0..1."""
        module = "metrics" if self.always else "perceptual"
        return resolve_name(f"gauss2svg.measure.{module}:{self.slug}")

    def can_show(self, value: float | None) -> bool:
        """Return whether a value can be shown.

        None cannot be shown, except for PSNR, where it means that the pictures are equal.
        """
        return value is not None or self.best is None

    def text(self, value: float | None) -> str:
        """Return a value with its unit as text.

        None becomes "equal" for PSNR, and NONE for all other scores.
        """
        if value is None:
            return "equal" if self.best is None else NONE
        return f"{value:{self.form}}" + (SPACE + self.unit if self.unit else "")


PSNR = Score(
    slug="psnr",
    name="PSNR",
    title="PSNR, dB",
    form=".2f",
    unit="dB",
    least_step=1.0,
    best=None,
    # docs/decisions/numbers.md has the measurements for the tolerances of all scores.
    search=Search(
        tolerance=0.05, margin=0.12, too_little=0.02, too_good=0.35, slope=None, slopes=(1.5, 12.0)
    ),
)
SSIM = Score(slug="ssim", name="SSIM", title="SSIM", form=".3f", least_step=0.01, best=1.0)
SSIMULACRA2 = Score(
    slug="ssimulacra2",
    name="SSIMULACRA2",
    title="SSIMULACRA2",
    about="how people would judge the SVG beside its photo; 100 means equal, 70 high quality, 50 "
    "medium, 30 low. It needs at least 225 px a side.",
    form=".1f",
    least_step=1.0,
    best=100.0,
    package="ssimulacra2",
    # SSIMULACRA2 compares the images at several scales. The smallest scale divides each side by 32
    # and rounds the result up. There, each side must have at least 8 px.
    least_side=225,
    # docs/decisions/metrics.md has the measurements of pixel_bytes for SSIMULACRA2 and FLIP.
    pixel_bytes=560,
    search=Search(
        tolerance=0.3, margin=0.8, too_little=0.2, too_good=2.5, slope=18.0, slopes=(4.0, 60.0)
    ),
)
FLIP = Score(
    slug="flip",
    name="FLIP",
    title="FLIP, lower is better",
    about="mean of the differences that people would see in flipping from one to the other, in "
    "0..1; 0 means equal, lower is better.",
    form=".4f",
    least_step=0.01,
    best=0.0,
    lower_wins=True,
    package="flip-evaluator",
    pixel_bytes=150,
)
SCORES = (PSNR, SSIM, SSIMULACRA2, FLIP)
ON_REQUEST = tuple(score for score in SCORES if not score.always)
# Entries of a report if no score is measured on request
NO_SCORES = {**dict.fromkeys(score.key for score in ON_REQUEST), "scores_missing": []}
TARGETS = tuple(score for score in SCORES if score.search is not None)
ADVICE = 'Try pip install "gauss2svg[scores]"'


def packages_missing() -> tuple[str, ...]:
    """Return a tuple of one line that names the scores whose packages are not installed.

    The tuple is empty if all packages are installed.
    """
    names = [score.name for score in ON_REQUEST if not score.is_installed]
    are = f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'}"
    return (f"{are} not measured: not installed. {ADVICE}",) if names else ()


def require_packages(score: Score | None = None) -> None:
    """Raise InputError unless the package that `score` needs is installed.

    If `score` is None, all scores are wanted, but it is enough if the package of one score is
    installed. This is because FLIP has no package for the newest Python.
    """
    scores = ON_REQUEST if score is None else (score,)
    if not any(each.is_installed for each in scores):
        name = "scores" if score is None else score.option
        needed = f"given with {' or '.join(each.package for each in scores)} installed"
        raise InputError(f"{name} must be {needed}; got none. {ADVICE}")


def packages() -> dict[str, str]:
    """Return the versions of the installed packages that scores need, by their names on PyPI."""
    # This is imported here, because it is slow to import and the help does not need it.
    from importlib.metadata import version

    return {s.package: version(s.package) for s in ON_REQUEST if s.is_installed}


@dataclass(frozen=True, kw_only=True)
class CheckOptions(OptionGroup):
    """Options of `check`."""

    renderer: Renderer = "resvg"
    """Renderer that rasterises the SVG. resvg comes with gauss2svg, cairo needs the system library
    cairo, and the others are programs to install."""

    max_svg_bytes: Annotated[int | str, byte_size] = "256M"
    """Maximum size of the SVG when decompressed, such as 150k or 1.5M."""

    max_elements: Annotated[int, Interval(ge=1)] = 1_000_000
    """Maximum number of elements in the SVG."""

    draw_timeout: Annotated[float, Interval(ge=0.001, le=86400)] = 300.0
    """Maximum time (s) for rasterising the SVG, up to 86400. chromium, librsvg, firefox and
    inkscape stop after 300 s in any case."""

    max_pixels: Annotated[int, Interval(ge=1, le=MOST_PIXELS)] = DEFAULT_MAX_PIXELS
    """Maximum number of pixels of a photo. Larger photos are refused before they are decoded."""

    max_size: Annotated[int | None, Interval(ge=1, le=MOST_PIXELS)] = None
    """Longest side (px) at which the SVG is compared. Larger photos are reduced first. The default
    is the size of the photo."""

    matte: Annotated[str | None, check_color] = None
    """Background colour for a transparent photo: a name such as white, #fa0 or #ffaa00. If not
    given, transparency is compared too."""


def decibels(value: float | None) -> str:
    """Return a report's PSNR in dB as text. None stands for equal images and becomes "equal"."""
    return "equal" if value is None else f"{value:.2f} dB"
