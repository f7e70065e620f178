"""Options, progress and result of a fit, which turns pixels into a scene.

--help reads the options from this module and must not wait for NumPy, so nothing that is imported
here may need NumPy.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from gauss2svg.errors import nearest, quoted, refusal
from gauss2svg.fit import schedule
from gauss2svg.fit.schedule import refinement_reduction
from gauss2svg.options import Interval, OptionGroup, Seed, check_color
from gauss2svg.scene import ADD, OVER
from gauss2svg.scene.ink_lists import MOST_TONES, Inks, check_inks

if TYPE_CHECKING:
    from gauss2svg.scene import Scene

Tune = Literal["perceptual", "psnr"]
PERCEPTUAL, PSNR = "perceptual", "psnr"
DEFAULT_LOSS = "weighted"
LossName = Literal["weighted", "mse", "l1", "mse+ssim", "l1+ssim"]
# Kinds of falloff. GAUSSIAN: the exponent beta of every shape is 1, as in the paper. ADAPTIVE: each
# shape learns its own beta. CRISP: shapes have sharp rims, as in a fit to inks.
GAUSSIAN, ADAPTIVE, CRISP = "gaussian", "adaptive", "crisp"
# Largest number of Gaussians in a fit. The state of so many takes 2.5 GB, because each Gaussian
# takes 253 bytes.
MOST_GAUSSIANS = 10_000_000


# A loss of one's own: a function of a render and the target, (h, w, 3) float32 in 0..1. It returns
# the loss, which is at least 0 and 0 for equal pictures, and the derivative of the loss with
# respect to each value of the render. These may be arrays or tensors. A fit calls it at each step,
# also with smaller pictures, and over white and over black if the photo has alpha.
LossFunction = Callable[[Any, Any], tuple[Any, Any]]


def check_loss(name: str, value: Any) -> Any:
    """Return a function. Raise InputError for a value that cannot be called."""
    if callable(value):
        return value
    words = get_args(LossName)
    close = nearest(value, words) if isinstance(value, str) else ""
    raise refusal(name, f"one of {', '.join(words)} or a function", quoted(value), close)


def has_ssim(loss: str | LossFunction) -> bool:
    """Return whether a loss has an SSIM term."""
    return isinstance(loss, str) and loss.endswith("+ssim")


@dataclass(frozen=True, kw_only=True)
class FitOptions(OptionGroup):
    """Options of the model, of the optimiser, and of adding Gaussians during the fit."""

    iterations: Annotated[int | None, Interval(ge=1, le=10**9)] = None
    """Number of steps of the fit, each of which moves all shapes a little. The default depends on
    the preset."""

    loss: Annotated[LossName | LossFunction, check_loss] = "weighted"
    """Error that the fit reduces: weighted (squared, weighted as --tune says), mse (squared) or l1
    (absolute), each of these two also with ssim (structural similarity). l1 and ssim follow the
    paper of the method. ssim takes about ten times as long. In Python also a function."""

    tune: Tune | None = None
    """What the fit is best at. perceptual: what people see, so errors count more on smooth areas
    and less in texture. psnr: PSNR. The default is perceptual, but psnr for the smallest files and
    for inks."""

    focus_strength: Annotated[float | None, Interval(ge=1, le=1000)] = None
    """Factor by which errors count more where the mask of --focus is white. The default is 4."""

    learning_rate: Annotated[float, Interval(ge=1e-6, le=1e6)] = 1.0
    """Factor by which every learning rate is multiplied."""

    blend: Literal["over", "add"] = "over"
    """over: shapes cover what is below them (alpha compositing). add: their colours add up and may
    be negative, as in the paper of the method. CairoSVG does not draw add."""

    falloff: Literal["gaussian", "adaptive"] | None = None
    """How opacity falls from the centre of a shape to its rim. adaptive: each shape learns how
    crisp its rim is. gaussian: all shapes stay Gaussians, as in the paper of the method. The
    default is adaptive, but gaussian with --blend add, above areas, and in pictures of at most
    32768 px without a limit, number or target."""

    inks: Annotated[Inks | None, check_inks] = None
    """Draw only in these colours, including the background: "#f7c306,#c0322c,navy". Or the number
    of colours to choose from the picture, or a palette file (.gpl). Shapes are opaque and have
    crisp rims."""

    paper: Annotated[str | None, check_color] = None
    """Colour of the paper, such as white, which shows where no ink is printed, and has no plate. A
    number of --inks does not count it. The default is white if none of the listed --inks is near
    white."""

    overprint: Annotated[int | None, Interval(ge=1, le=MOST_TONES)] = None
    """Let the listed --inks overprint: where several lie over each other, the colour is the product
    of theirs and the paper's. The number is that of the strengths of each ink. 1 is solid ink
    alone, 3 also prints thirds of it, as greys of its plate."""

    init: Literal["selective", "error", "random", "live"] = "selective"
    """Where new Gaussians are placed, which become the shapes. selective: on the areas with most
    error. error: at random, more often where the squared error is larger. random: anywhere. live:
    as in the LIVE paper. --tune perceptual weights the error."""

    relocate: bool = True
    """During the fit, move the least useful Gaussians to where the error is large."""

    seed: Seed = 0
    """Random seed. The same seed gives the same file. Another seed often does too, because few
    choices are random by default."""

    @property
    def tuned(self) -> Tune:
        """The option tune, or its default if it is None.

        The default is PSNR in a fit to inks (docs/decisions/inks.md), and PERCEPTUAL in other fits.
        """
        return self.tune or (PERCEPTUAL if self.inks is None else PSNR)

    @property
    def shaped(self) -> str:
        """The kind of falloff: GAUSSIAN, ADAPTIVE or CRISP.

        It is CRISP in a fit to inks. In other fits it is the option falloff. If this option is
        None, it is GAUSSIAN with additive blending, else ADAPTIVE.
        """
        if self.inks is not None:
            return CRISP
        return self.falloff or (GAUSSIAN if self.blend == ADD else ADAPTIVE)


@dataclass(frozen=True, kw_only=True)
class FitConfig:
    """Settings of `fit`: its options, and values from the run's preset and limits.

    gaussians   number of Gaussians, >= 0. If it is 0, the policy of the fit decides the number.
                Without a policy, the scene then has no Gaussians
    iterations  number of optimiser steps, >= 1
    reduce      whether early steps run on a smaller copy of the picture while there are few
                Gaussians, because such steps are faster
    extend      whether the number of iterations is doubled if most of them run on a smaller copy
    opaque      whether all opacities stay 1, which makes files shorter
    round_totals  total number of Gaussians after each round, of which the last is `gaussians`. If
                it is empty, each round doubles the number
    round_iterations  number of steps in each round. If it is None, the rounds share the first
                GROWTH_SHARE of the iterations equally
    relocate_rarely  whether the number of steps between two relocations must be at least a
                twentieth of the number of all steps. Fits of many steps need this
    """

    gaussians: int = 5000
    iterations: int = 200
    fit: FitOptions = FitOptions()
    reduce: bool = True
    extend: bool = False
    opaque: bool = False
    round_totals: tuple[int, ...] = ()
    round_iterations: int | None = None
    relocate_rarely: bool = False

    def __post_init__(self) -> None:
        if self.fit.blend == ADD and self.fit.falloff == ADAPTIVE:
            needed = f"{GAUSSIAN} with additive blending"
            raise refusal("falloff", needed, quoted(ADAPTIVE), f"--blend {OVER}")

    def steps(self, width: int, height: int) -> int:
        """Return the number of steps for a picture of width x height px."""
        start, can_extend = schedule.GROWTH_SHARE, self.extend and self.reduce and self.gaussians
        if can_extend and refinement_reduction(start, self.gaussians, width, height) > 1:
            return 2 * self.iterations
        return self.iterations


@dataclass(frozen=True)
class FitProgress:
    """Progress of a fit: counts so far, PSNR of the model in dB, seconds elapsed and remaining.

    psnr   PSNR against the photo, even if the fit is to inks. It is measured at the size of the
           target of the last step, which may be smaller than the photo
    done   progress in 0..1. It counts iterations or time, whichever is further along
    scene  function that returns the present Gaussians on the working canvas. It must be called
           before the next step, because a step changes the Gaussians
    areas  text on the areas and lines of the scene, such as 12 areas of 140 nodes, "" without any
    """

    round: int
    iteration: int
    done: float
    gaussians: int
    psnr: float
    elapsed_s: float
    remaining_s: float
    scene: Callable[[], Scene] = dataclasses.field(repr=False, compare=False)
    areas: str = ""


@dataclass(frozen=True)
class FitResult:
    """A fitted scene on the working canvas, with the costs of the fit.

    cpu_s        CPU seconds, summed over all threads
    pixel_pairs  number of pairs of a pixel and a Gaussian that were evaluated, summed over all
                 steps. The forward and the backward pass over a pair count as one evaluation
    stop_reason  what ended growth or the whole fit, a word of docs/reference/report.md
    rollbacks    number of times that the fit diverged and was rolled back to its best state
    """

    scene: Scene
    iterations: int
    rounds: int
    wall_s: float
    cpu_s: float
    pixel_pairs: int
    stop_reason: str
    rollbacks: int = 0

    def after(self, stop_reason: str, *others: FitResult) -> FitResult:
        """Return this result with another stop_reason, and with the costs of other fits added."""
        names, fits = ("iterations", "wall_s", "cpu_s", "pixel_pairs", "rollbacks"), (self, *others)
        costs: dict[str, Any] = {name: sum(getattr(fit, name) for fit in fits) for name in names}
        return dataclasses.replace(self, stop_reason=stop_reason, **costs)
