"""What a fit is asked for, what it says on the way, and what comes out."""

from __future__ import annotations

from dataclasses import dataclass

from gauss2svg.checks import whole_number
from gauss2svg.errors import InputError
from gauss2svg.falloff import ADAPTIVE, FALLOFFS
from gauss2svg.fit.losses import DEFAULT_LOSS, check_loss
from gauss2svg.fit.placement import DEFAULT_PLACEMENT, PLACEMENTS
from gauss2svg.fit.schedule import DEFAULT_SCHEDULE, SCHEDULES
from gauss2svg.scene import Scene

# 228 bytes of optimiser state each: over 2 GB.
MOST_GAUSSIANS = 10_000_000

# What the kernels compute in. Neither ends truer: at 200 to 1000 Gaussians they differ by
# up to 0.2 dB either way, as each does from itself under noise of 1e-6, since another
# Gaussian is relocated; without relocation by 0.002.
DTYPES = ("float32", "float64")
DEFAULT_DTYPE = "float32"
DEFAULT_FALLOFF = ADAPTIVE


@dataclass(frozen=True)
class FitOptions:
    """What a fit does.

    gaussians   how many, >= 0; 0 gives the mean colour
    iterations  optimiser steps, >= 1; None: until the deadline
    placement   one of PLACEMENTS; schedule one of SCHEDULES; loss one of LOSSES
    seed        of the one random generator
    dtype       one of DTYPES, of all that the kernels compute
    falloff     one of FALLOFFS: Gaussians, or shapes that each learn an exponent
    """

    gaussians: int = 5000
    iterations: int | None = 200
    placement: str = DEFAULT_PLACEMENT
    schedule: str = DEFAULT_SCHEDULE
    loss: str = DEFAULT_LOSS
    seed: int = 0
    dtype: str = DEFAULT_DTYPE
    falloff: str = DEFAULT_FALLOFF

    def __post_init__(self) -> None:
        whole_number("gaussians", self.gaussians, 0, MOST_GAUSSIANS)
        if self.iterations is not None:
            whole_number("iterations", self.iterations, 1, 10**9)
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
        if self.falloff not in FALLOFFS:
            raise InputError(f"falloff is {self.falloff!r}; needed is one of {', '.join(FALLOFFS)}")
        if self.dtype not in DTYPES:
            raise InputError(f"dtype is {self.dtype!r}; needed is one of {', '.join(DTYPES)}")


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
    gauss2svg.fit.rules.STOP_REASONS.
    """

    scene: Scene
    iterations: int
    rounds: int
    wall_s: float
    cpu_s: float
    pixel_pairs: int
    stop_reason: str
