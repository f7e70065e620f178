"""What a fit is asked for, what it says on the way, and what comes out."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from gauss2svg.errors import InputError, must_be, whole_number
from gauss2svg.fit.losses import has_ssim
from gauss2svg.fit.schedule import GROWTH_SHARE, totals
from gauss2svg.options import Number, OptionGroup, Whole
from gauss2svg.scene import ADD, OVER, Scene
from gauss2svg.scene.falloff import ADAPTIVE, GAUSSIAN

# 228 bytes of optimiser state each: over 2 GB.
MOST_GAUSSIANS = 10_000_000

# What the kernels compute in; docs/decisions/numbers.md has what the wider one buys: nothing.
DTYPES = ("float32", "float64")
DEFAULT_DTYPE = "float32"


@dataclass(frozen=True, kw_only=True)
class FitOptions(OptionGroup):
    """The model and the optimiser."""

    iterations: Annotated[int | None, Whole(1, 10**9)] = None
    """Optimiser steps; the preset's if not given."""

    loss: Literal["mse", "l1", "mse+ssim", "l1+ssim"] = "mse"
    """Loss; those with ssim keep more texture, take longer and need the extra torch."""

    ssim_weight: Annotated[float | None, Number(0, 1)] = None
    """Weight of 1 - SSIM in the losses with ssim, 0 to 1; 0.2 if not given."""

    learning_rate: Annotated[float, Number(1e-6, 1e6)] = 1.0
    """Learning-rate multiplier."""

    blend: Literal["over", "add"] = "over"
    """over: alpha compositing; add: the paper's additive blending of signed colours, for resvg,
    browsers, librsvg and Inkscape."""

    falloff: Literal["gaussian", "adaptive"] | None = None
    """adaptive: each shape learns how crisp its rim is; gaussian: all are Gaussians, as in the
    paper. The default is adaptive, and gaussian with additive blending."""

    seed: Annotated[int, Whole(0, 2**63 - 1)] = 0
    """Seed; the same seed gives the same file."""

    @property
    def learned_falloff(self) -> bool:
        """Whether each shape learns its exponent."""
        return (self.falloff or (GAUSSIAN if self.blend == ADD else ADAPTIVE)) == ADAPTIVE


@dataclass(frozen=True, kw_only=True)
class DensifyOptions(OptionGroup):
    """How Gaussians are added and moved during the fit."""

    init: Literal["selective", "error", "random", "live"] = "selective"
    """Placement of new Gaussians: on the largest components of the error, in proportion to the
    squared error, at random, or on components chosen as in LIVE."""

    schedule: Literal["exponential", "linear", "all-at-once"] = "exponential"
    """How the rounds grow to a given number of Gaussians."""

    per_round: Annotated[int | None, Whole(1, MOST_GAUSSIANS)] = None
    """Gaussians added in a round: exponential rounds add 1, 2, 4, ... up to this, linear ones
    this."""

    round_iterations: Annotated[int | None, Whole(1, 10**9)] = None
    """Optimiser steps in each round."""

    relocate: bool = True
    """Relocate the least useful Gaussians during the fit."""


@dataclass(frozen=True, kw_only=True)
class FitConfig:
    """All that a fit of one picture goes by.

    gaussians   number of Gaussians, >= 0; 0 gives the mean colour
    iterations  optimiser steps, >= 1; None: until the deadline
    dtype       one of DTYPES, of all that the kernels compute
    reduce      whether rounds of few Gaussians run on a reduced picture, which is quicker
    """

    gaussians: int = 5000
    iterations: int | None = 200
    fit: FitOptions = FitOptions()
    densify: DensifyOptions = DensifyOptions()
    dtype: str = DEFAULT_DTYPE
    reduce: bool = True

    def __post_init__(self) -> None:
        whole_number("gaussians", self.gaussians, 0, MOST_GAUSSIANS)
        if self.iterations is not None:
            whole_number("iterations", self.iterations, 1, 10**9)
        if self.dtype not in DTYPES:
            raise InputError(must_be("dtype", f"one of {', '.join(DTYPES)}", self.dtype))
        if self.fit.blend == ADD and self.fit.falloff not in (None, GAUSSIAN):
            needed = f"{GAUSSIAN} with additive blending"
            raise InputError(must_be("falloff", needed, self.fit.falloff, f"--blend {OVER}"))
        if self.fit.ssim_weight is not None and not has_ssim(self.fit.loss):
            needed, loss = "one with ssim where ssim_weight is given", self.fit.loss
            raise InputError(must_be("loss", needed, loss, f"--loss {loss}+ssim"))
        self._check_rounds()

    @property
    def totals(self) -> list[int]:
        """Ascending totals of the rounds in which the Gaussians asked for are added."""
        densify = self.densify
        return totals(densify.schedule, self.gaussians, self.iterations, densify.per_round)

    def _check_rounds(self) -> None:
        each, per_round = self.densify.round_iterations, self.densify.per_round
        rounds = len(self.totals)
        if self.iterations is None or (each is None and per_round is None):
            return
        room = self.iterations if each else int(self.iterations * GROWTH_SHARE)
        if rounds * (each or 1) > room:
            raise InputError(
                f"iterations must leave room for {rounds} rounds of {each or 1} or more; got "
                f"{room} for the rounds. Try more --iterations or a larger --per-round"
            )


@dataclass(frozen=True)
class FitProgress:
    """Where a fit stands: counts so far, PSNR of the model in dB, seconds gone and left.

    done is the share of the fit that is over, in 0..1, by iterations or by the clock.
    """

    round: int
    iteration: int
    done: float
    gaussians: int
    psnr: float
    elapsed_s: float
    remaining_s: float


@dataclass(frozen=True)
class FitResult:
    """A fitted scene on the working canvas, and how it came about.

    cpu_s counts the CPU seconds of all threads, pixel_pairs the pixel-Gaussian pairs
    of the optimiser's steps, forward and backward counted once. stop_reason is one of
    gauss2svg.fit.densification.STOP_REASONS. rollbacks is how often the fit ran away and was taken back
    to its best state, rate what its steps were in the end, as a share of the usual ones.
    """

    scene: Scene
    iterations: int
    rounds: int
    wall_s: float
    cpu_s: float
    pixel_pairs: int
    stop_reason: str
    rollbacks: int = 0
    rate: float = 1.0

    def after(self, before: FitResult | None, stop_reason: str) -> FitResult:
        """With the costs of a fit before it, and another reason of its end."""
        costs = ("iterations", "wall_s", "cpu_s", "pixel_pairs", "rollbacks")
        changes: dict[str, Any] = {
            name: getattr(self, name) + (getattr(before, name) if before else 0) for name in costs
        }
        return dataclasses.replace(self, stop_reason=stop_reason, **changes)
