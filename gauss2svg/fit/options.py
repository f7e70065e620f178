"""What a fit is asked for, what it says on the way, and what comes out."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from gauss2svg.checks import number_within, whole_number
from gauss2svg.errors import InputError
from gauss2svg.falloff import ADAPTIVE, FALLOFFS, GAUSSIAN
from gauss2svg.fit.losses import DEFAULT_LOSS, check_loss, has_ssim
from gauss2svg.fit.placement import DEFAULT_PLACEMENT, PLACEMENTS
from gauss2svg.fit.schedule import DEFAULT_SCHEDULE, GROWTH_SHARE, SCHEDULES, totals
from gauss2svg.scene import ADD, BLENDS, OVER, Scene

# 228 bytes of optimiser state each: over 2 GB.
MOST_GAUSSIANS = 10_000_000

LEARNING_RATES = 1e-6, 1e6

# What the kernels compute in. Neither ends truer: at 200 to 1000 Gaussians they differ by
# up to 0.2 dB either way, as each does from itself under noise of 1e-6, since another
# Gaussian is relocated; without relocation by 0.002.
DTYPES = ("float32", "float64")
DEFAULT_DTYPE = "float32"


def check_blend(blend: str) -> None:
    """Raise InputError unless it is one of BLENDS."""
    if blend not in BLENDS:
        raise InputError(f"blend is {blend!r}; needed is one of {', '.join(BLENDS)}")


@dataclass(frozen=True)
class FitOptions:
    """What a fit does.

    gaussians   how many, >= 0; 0 gives the mean colour
    iterations  optimiser steps, >= 1; None: until the deadline
    placement   one of PLACEMENTS; schedule one of SCHEDULES; loss one of LOSSES
    seed        of the one random generator
    dtype       one of DTYPES, of all that the kernels compute
    falloff     one of FALLOFFS: Gaussians, or shapes that each learn an exponent; None: the
                latter, save where they are summed
    blend       one of gauss2svg.scene.BLENDS: painted over each other, or summed
    per_round   of growth to a given count, the paper's k or m: exponential rounds i = 0, 1, ..
                add min(2^i, per_round), linear ones per_round each; None: six rounds
    round_iterations  of each round; None: all rounds together have 30 % of the iterations
    ssim_weight  of 1 - SSIM in the losses that have it, 0..1, the rest being the pixel term's;
                None: 0.2
    relocate    whether those that are missed least are placed anew on the way
    learning_rate  times the usual sizes of all steps, in LEARNING_RATES; a fit that runs away
                with it goes back to its best state and lowers them
    reduce      whether rounds of few Gaussians run on a reduced picture, which is quicker
    """

    gaussians: int = 5000
    iterations: int | None = 200
    placement: str = DEFAULT_PLACEMENT
    schedule: str = DEFAULT_SCHEDULE
    loss: str = DEFAULT_LOSS
    seed: int = 0
    dtype: str = DEFAULT_DTYPE
    falloff: str | None = None
    blend: str = OVER
    per_round: int | None = None
    round_iterations: int | None = None
    ssim_weight: float | None = None
    relocate: bool = True
    reduce: bool = True
    learning_rate: float = 1.0

    def __post_init__(self) -> None:
        whole_number("gaussians", self.gaussians, 0, MOST_GAUSSIANS)
        if self.iterations is not None:
            whole_number("iterations", self.iterations, 1, 10**9)
        number_within("learning_rate", self.learning_rate, *LEARNING_RATES)
        whole_number("seed", self.seed, 0, 2**63 - 1)
        if self.placement not in PLACEMENTS:
            raise InputError(
                f"init is {self.placement!r}; needed is one of {', '.join(PLACEMENTS)}"
            )
        if self.schedule not in SCHEDULES:
            raise InputError(
                f"schedule is {self.schedule!r}; needed is one of {', '.join(SCHEDULES)}"
            )
        check_loss(self.loss)
        check_blend(self.blend)
        if self.falloff is None:
            falloff = GAUSSIAN if self.blend == ADD else ADAPTIVE
            object.__setattr__(self, "falloff", falloff)
        if self.falloff not in FALLOFFS:
            raise InputError(f"falloff is {self.falloff!r}; needed is one of {', '.join(FALLOFFS)}")
        if self.blend == ADD and self.falloff != GAUSSIAN:
            raise InputError(
                f"falloff is {self.falloff!r} with blend 'add', of Gaussians of eight parameters; "
                f"needed is {GAUSSIAN}, or blend {OVER!r}"
            )
        self._check_ssim_weight()
        self._check_rounds()
        if self.dtype not in DTYPES:
            raise InputError(f"dtype is {self.dtype!r}; needed is one of {', '.join(DTYPES)}")

    @property
    def totals(self) -> list[int]:
        """Ascending totals of the rounds in which the Gaussians asked for are added."""
        return totals(self.schedule, self.gaussians, self.iterations, self.per_round)

    def _check_ssim_weight(self) -> None:
        if self.ssim_weight is None:
            return
        number_within("ssim_weight", self.ssim_weight, 0, 1)
        if not has_ssim(self.loss):
            raise InputError(
                f"ssim_weight is {self.ssim_weight} with the loss {self.loss}, which has no SSIM; "
                f"needed is a loss {self.loss}+ssim"
            )

    def _check_rounds(self) -> None:
        if self.per_round is not None:
            whole_number("per_round", self.per_round, 1, MOST_GAUSSIANS)
        if self.round_iterations is not None:
            whole_number("round_iterations", self.round_iterations, 1, 10**9)
        rounds = len(self.totals)
        by_default = self.per_round is None and self.round_iterations is None
        if self.iterations is None or by_default:
            return
        each = self.round_iterations or 1
        room = self.iterations if self.round_iterations else int(self.iterations * GROWTH_SHARE)
        if rounds * each > room:
            raise InputError(
                f"{rounds} rounds of {each} iterations or more are asked for, with room for "
                f"{room}; needed are more iterations, or a larger per_round"
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
    gauss2svg.fit.rules.STOP_REASONS. rollbacks is how often the fit ran away and was taken back
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
