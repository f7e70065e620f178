"""The scores of an SVG against its photo, one entry each.

The targets of a run, its search and report, the benchmark, the charts and tables of galleries and
the studio read these entries. The help imports this module, so it does not import NumPy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.util import find_spec
from pkgutil import resolve_name
from typing import Any

SPACE = "\N{NARROW NO-BREAK SPACE}"
NONE = "\N{EN DASH}"  # mark in tables of a value that was not measured


@dataclass(frozen=True, kw_only=True)
class Search:
    """The tolerances of a search for a target, in units of the score.

    tolerance   shortfall at which the target still counts as reached
    over        excess over the target at which a correction aims
    too_little  shortfall from which Gaussians are added
    too_good    excess from which Gaussians are removed
    slope       gain per doubling of the Gaussians, until it is measured. None means the slope of
                the growth, which sees the PSNR of the model and aims at the target itself
    slopes      smallest and largest plausible slope
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

    slug         name in file names and addresses, in a report and in the option target_SLUG
    name         name in texts
    defined_in   module of gauss2svg.measure with the function SLUG(raster, photo) of two pictures
                 (h, w, 3) float32 in 0..1. It raises ScoresMissingError if its package is missing
    form, unit   format and unit of a value in tables and tooltips
    least_step   smallest step between two ticks of the axis
    best         value of equal pictures, beyond which there is no tick. None means infinite, in dB
    title        title of the axis
    about        explanation of the score in galleries
    falls        whether lower values are better. The axis is then upside down
    always       whether every run measures it. Otherwise it is measured on request
    module       Python module that it needs, or ""
    package      name of the package of that module on PyPI, or ""
    least_side   least side of a picture, in px
    pixel_bytes  memory in bytes per pixel: the measured number and a tenth more
    search       tolerances of the option target_SLUG. None means that the score is no target
    """

    slug: str
    name: str
    defined_in: str
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
        """Factor that makes larger values better."""
        return -1 if self.falls else 1

    @property
    def digits(self) -> int:
        """Number of decimals of a value in tables."""
        return int(self.form[1:-1])

    @property
    def is_installed(self) -> bool:
        """Whether the package that it needs is installed."""
        return not self.module or find_spec(self.module) is not None

    @property
    def function(self) -> Callable[[Any, Any], float]:
        """Function (raster, photo) that measures the score."""
        return resolve_name(f"gauss2svg.measure.{self.defined_in}:{self.slug}")

    def worst(self, values: Iterable[float]) -> float:
        """Return the worst of some values."""
        return max(values) if self.falls else min(values)

    def has(self, value: float | None) -> bool:
        """Return whether a report's value can be shown. In dB, None is that of equal pictures."""
        return value is not None or self.best is None

    def text(self, value: float | None) -> str:
        """Return a value with its unit. None is "equal" for PSNR, which is infinite, else NONE."""
        if value is None:
            return "equal" if self.best is None else NONE
        return f"{value:{self.form}}" + (SPACE + self.unit if self.unit else "")


PSNR = Score(
    slug="psnr",
    name="PSNR",
    title="PSNR, dB",
    defined_in="metrics",
    form=".2f",
    unit="dB",
    least_step=1.0,
    best=None,
    always=True,
    # docs/decisions/numbers.md has the measurements for these tolerances and for those below.
    search=Search(
        tolerance=0.05, over=0.12, too_little=0.02, too_good=0.35, slope=None, slopes=(1.5, 12.0)
    ),
)
SSIM = Score(
    slug="ssim", name="SSIM", defined_in="metrics", form=".3f", least_step=0.01, best=1.0,
    always=True,
)  # fmt: skip
SSIMULACRA2 = Score(
    slug="ssimulacra2",
    name="SSIMULACRA2",
    about="how people would judge the SVG beside its photo; 100 means equal, 70 high quality, 50 "
    "medium, 30 low. It needs at least 225 px a side.",
    defined_in="perceptual",
    form=".1f",
    least_step=1.0,
    best=100.0,
    module="ssimulacra2",
    package="ssimulacra2",
    least_side=225,  # leaves 8 px at the smallest scale, a thirty-second of the size
    pixel_bytes=560,  # measured, as for FLIP, in docs/decisions/metrics.md
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
    defined_in="perceptual",
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
