"""The scores of an SVG against its photo, one entry each.

The targets of a run, its search and report, the benchmark, the charts and tables of galleries and
the studio take what they need of a score from its entry. This module loads no arrays: the options
need it for the help.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.util import find_spec
from pkgutil import resolve_name
from typing import Any

SPACE = "\N{NARROW NO-BREAK SPACE}"
NONE = "\N{EN DASH}"  # in tables, for what was not measured


@dataclass(frozen=True, kw_only=True)
class Search:
    """How closely a search meets a target of a score, in units of the score.

    tolerance   short of the target that still counts as reached
    over        better than the target that a correction aims at
    too_little  short of the target from which Gaussians are added
    too_good    better than the target from which Gaussians are removed
    slope       gained per doubling of the Gaussians, until it is measured; None: that of the
                growth, which sees the PSNR of the model and aims at the target itself
    slopes      least and most that is plausible
    """

    tolerance: float
    over: float
    too_little: float
    too_good: float
    slope: float | None
    slopes: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Score:
    """A score of an SVG against its photo.

    slug         its name in file names and addresses, in a report and in the option target_SLUG
    name, about  as text, the latter where a gallery says what the score is
    home         module of gauss2svg.measure with the function SLUG(raster, photo) of two pictures
                 (h, w, 3) float32 in 0..1; it raises ScoresMissingError without its package
    title        of its axis
    form, unit   of a value as tables and tooltips show it
    least_step   between two ticks
    best         value of equal pictures, over which there is no tick; None: infinite, in decibels
    falls        whether lower values are better; the axis is then upside down
    always       whether every run has it; else where it is asked for
    module, package  that it needs, by their names in Python and on PyPI; "": none
    least_side   of a picture, in px
    pixel_bytes  of memory that it takes a pixel, measured with a tenth added
    search       of the option target_SLUG; None: it is no target
    """

    slug: str
    name: str
    home: str
    form: str
    least_step: float
    best: float | None
    title: str = ""
    about: str = ""
    unit: str = ""
    falls: bool = False
    always: bool = False
    module: str = ""
    package: str = ""
    least_side: int = 1
    pixel_bytes: int = 0
    search: Search | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "title", self.title or self.name)

    @property
    def key(self) -> str:
        """Name of the score in a report."""
        return f"{self.slug}_svg"

    @property
    def option(self) -> str:
        """Name of the option that makes the score a target."""
        return f"target_{self.slug}"

    @property
    def sign(self) -> int:
        """Factor of the score by which more is better."""
        return -1 if self.falls else 1

    @property
    def digits(self) -> int:
        """Decimals of a value as tables show it."""
        return int(self.form[1:-1])

    @property
    def is_installed(self) -> bool:
        """Whether the package that it needs is installed."""
        return not self.module or find_spec(self.module) is not None

    @property
    def function(self) -> Callable[[Any, Any], float]:
        """The function (raster, photo) that measures it."""
        return resolve_name(f"gauss2svg.measure.{self.home}:{self.slug}")

    def worst(self, values: Iterable[float]) -> float:
        """The worst of some values."""
        return max(values) if self.falls else min(values)

    def has(self, value: float | None) -> bool:
        """Whether a report's value can be shown: None of decibels is that of equal pictures."""
        return value is not None or self.best is None

    def text(self, value: float | None) -> str:
        """A value with its unit; "equal" for a PSNR of None, the infinite one of an exact SVG."""
        if value is None:
            return "equal" if self.best is None else NONE
        return f"{value:{self.form}}" + (SPACE + self.unit if self.unit else "")


PSNR = Score(
    slug="psnr",
    name="PSNR",
    title="PSNR, dB",
    home="metrics",
    form=".2f",
    unit="dB",
    least_step=1.0,
    best=None,
    always=True,
    # docs/decisions/numbers.md, also for the tolerances of the others.
    search=Search(
        tolerance=0.05, over=0.12, too_little=0.02, too_good=0.35, slope=None, slopes=(1.5, 12.0)
    ),
)
SSIM = Score(
    slug="ssim", name="SSIM", home="metrics", form=".3f", least_step=0.01, best=1.0, always=True
)
SSIMULACRA2 = Score(
    slug="ssimulacra2",
    name="SSIMULACRA2",
    about="how people would judge the SVG beside its photo; 100 means equal, 70 high quality, 50 "
    "medium, 30 low. It needs at least 225 px a side.",
    home="perceptual",
    form=".1f",
    least_step=1.0,
    best=100.0,
    module="ssimulacra2",
    package="ssimulacra2",
    least_side=225,  # at a thirty-second of the size 8 px must be left
    pixel_bytes=560,  # docs/decisions/metrics.md, also for FLIP
    search=Search(
        tolerance=0.3, over=0.8, too_little=0.2, too_good=2.5, slope=18.0, slopes=(4.0, 60.0)
    ),
)
FLIP = Score(
    slug="flip",
    name="FLIP",
    title="FLIP, lower is better",
    about="mean of the differences that people would see in flipping from one to the other, in "
    "0..1; 0 means equal, lower is better.",
    home="perceptual",
    form=".4f",
    least_step=0.01,
    best=0.0,
    falls=True,
    module="flip_evaluator",
    package="flip-evaluator",
    pixel_bytes=150,
)
SCORES = (PSNR, SSIM, SSIMULACRA2, FLIP)
ON_REQUEST = tuple(score for score in SCORES if not score.always)
TARGETS = tuple(score for score in SCORES if score.search is not None)
