"""The progressive fit: a background, then rounds of Gaussians where the error is.

Coarse first; every round is optimised before the next, all Gaussians move until the
end. What was measured at 5000 Gaussians and 300 iterations, one change at a time, mean
PSNR of the model in dB. On Kodak 04, 13 and 20, with placement by error and relocation
from 32 % of the run on (the prototype that is the bar to beat reaches
31.40 there, at 2.6 times the CPU seconds):

    aspect bounded by 100 / 50 / 25 / 12              31.52 / 31.49 / 31.42 / 31.27
    first sigma 0.30 / 0.35 / 0.42 of the spacing     31.54 / 31.49 / 31.46
    step of the mean 0.16 / 0.24 / 0.36 sigma         31.47 / 31.49 / 31.52
    step of the shape 0.10 / 0.15 / 0.22              31.48 / 31.49 / 31.50
    relocation of 5 / 8 / 12 % every 10 iterations    31.48 / 31.49 / 31.48
    growth ends at 20 / 30 / 40 %                     31.49 / 31.49 / 31.46
    decay starts at 50 / 60 / 70 %                    31.48 / 31.49 / 31.51
    stratified instead of independent draws           31.50, and cheaper
    first 15 / 30 % of the iterations at half size    31.51 / 31.51, 7 / 16 % fewer pairs

On all eight development photos, placement by error / selective: 32.45 / 32.60 at 5000,
26.94 / 27.09 at 1000. On Kodak 04, 08, 13 and 20, selective, from 30.40 / 25.56 dB at
5000 / 1000:

    second-moment decay 0.95 / 0.995 instead of 0.99  30.47 / 25.56, 30.43 / 25.58
    relocation from 20 % instead of 32 %              30.44 / 25.58
    both (0.95)                                       30.49 / 25.58
    and decay from 75 / 85 % instead of 60 %          30.50 / 25.60, 30.50 / 25.60 <- 75 %
    and first opacity logit 0 / 2 instead of 1        30.50 / 25.59, 30.50 / 25.60
    and relocation every 6 iterations                 30.48 / 25.57
    weight of flat areas 0 / 4 / 15                   30.50, 30.48, 30.47 / 25.60, 25.60, 25.53
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.checks import whole_number
from gauss2svg.errors import InputError
from gauss2svg.fit import adam
from gauss2svg.fit.losses import DEFAULT_LOSS, check_loss, image_gradient
from gauss2svg.fit.placement import (
    DEFAULT_PLACEMENT,
    FIRST_OPACITY_LOGIT,
    PLACEMENTS,
    Target,
    place,
)
from gauss2svg.fit.schedule import DEFAULT_SCHEDULE, SCHEDULES, Round, plan_rounds, rate
from gauss2svg.fit.state import State
from gauss2svg.image import shrink
from gauss2svg.render.cpu import (
    kernel_lock,
    moments_of_gradient,
    removal_cost,
    render_planar,
    squared_error,
)
from gauss2svg.scene import Scene

# Under 0.3 px every SVG renderer loses mass: at 0.2 px 85 % of it is drawn, at 0.1 px 35 %.
LEAST_SIGMA = 0.35
# Fainter than this vanishes or is drawn 10 to 60 % wrong on 8-bit canvases.
LEAST_OPACITY = 0.02

# The squared error of flat areas counts up to 1 + this times in the mse loss. At 500
# Gaussians streaks over skies, walls and paper fade; see the ablation above for its price.
FLAT_WEIGHT = 8.0
# 228 bytes of optimiser state each: over 2 GB.
MOST_GAUSSIANS = 10_000_000

# What the kernels compute in. Neither ends truer: at 200 to 1000 Gaussians they differ by
# up to 0.2 dB either way, as each does from itself under noise of 1e-6, since another
# Gaussian is relocated; without relocation by 0.002.
PRECISIONS = ("float32", "float64")
DEFAULT_PRECISION = "float32"

_RELOCATION_EVERY = 10
_RELOCATION_SHARE = 0.08
_RELOCATION_FROM, _RELOCATION_TO = 0.2, 0.75


@dataclass(frozen=True)
class FitOptions:
    """What a fit does.

    gaussians   how many, >= 0; 0 gives the mean colour
    iterations  optimiser steps, >= 1
    placement   one of PLACEMENTS; schedule one of SCHEDULES; loss one of LOSSES
    seed        of the one random generator
    precision   one of PRECISIONS, of all that the kernels compute
    """

    gaussians: int = 5000
    iterations: int = 300
    placement: str = DEFAULT_PLACEMENT
    schedule: str = DEFAULT_SCHEDULE
    loss: str = DEFAULT_LOSS
    seed: int = 0
    precision: str = DEFAULT_PRECISION

    def __post_init__(self) -> None:
        whole_number("gaussians", self.gaussians, 0, MOST_GAUSSIANS)
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
        if self.precision not in PRECISIONS:
            raise InputError(
                f"precision is {self.precision!r}; needed is one of {', '.join(PRECISIONS)}"
            )


@dataclass(frozen=True)
class FitProgress:
    """Where a fit stands: counts so far, PSNR of the model in dB, seconds gone and left."""

    round: int
    rounds: int
    iteration: int
    iterations: int
    gaussians: int
    psnr: float
    elapsed_s: float
    remaining_s: float


@dataclass(frozen=True)
class FitResult:
    """A fitted scene on the working canvas, and how it came about.

    cpu_s counts the CPU seconds of all threads, pixel_pairs the pixel-Gaussian pairs
    of the optimiser's steps, forward and backward counted once.
    """

    scene: Scene
    iterations: int
    rounds: int
    wall_s: float
    cpu_s: float
    pixel_pairs: int
    stop_reason: str


def fit(
    pixels: NDArray[np.float32],
    options: FitOptions | None = None,
    progress: Callable[[FitProgress], None] | None = None,
) -> FitResult:
    """Fit Gaussians to pixels (h, w, 3) float32 in 0..1; deterministic in the seed.

    progress is called once an iteration, from this thread.
    """
    options = options or FitOptions()
    with kernel_lock:
        return _fit(pixels, options, progress)


def _fit(
    pixels: NDArray[np.float32],
    options: FitOptions,
    progress: Callable[[FitProgress], None] | None,
) -> FitResult:
    wall, cpu = time.perf_counter(), time.process_time()
    height, width = pixels.shape[:2]
    background = pixels.mean(axis=(0, 1), dtype=np.float64)
    # On 8 bits already, as it will be written: the fit makes up for the rounding.
    background = np.round(background * 255) / 255
    run = _Run(pixels, background, options)
    rounds: list[Round] = []
    if options.gaussians:
        rounds = plan_rounds(options.schedule, options.gaussians, options.iterations, width, height)
        for iteration in range(options.iterations):
            due = [r for r, plan in enumerate(rounds) if plan.first_iteration == iteration]
            for r in due:
                run.begin(r, rounds[r])
            run.step(iteration)
            if progress is not None:
                elapsed = time.perf_counter() - wall
                done = iteration + 1
                progress(
                    FitProgress(
                        round=run.round_index + 1,
                        rounds=rounds_with_growth(rounds),
                        iteration=done,
                        iterations=options.iterations,
                        gaussians=len(run.state),
                        psnr=run.psnr,
                        elapsed_s=elapsed,
                        remaining_s=elapsed / done * (options.iterations - done),
                    )
                )
        run.drop_undrawable()
    return FitResult(
        scene=run.state.scene(background, width, height),
        iterations=options.iterations if options.gaussians else 0,
        rounds=rounds_with_growth(rounds),
        wall_s=time.perf_counter() - wall,
        cpu_s=time.process_time() - cpu,
        pixel_pairs=run.pixel_pairs,
        stop_reason="iterations" if options.gaussians else "no Gaussians asked for",
    )


def rounds_with_growth(rounds: list[Round]) -> int:
    """Rounds that add Gaussians; a last one may only return to the full picture."""
    return len({plan.gaussians for plan in rounds})


class _Run:
    """One fit under way: the Gaussians in pixels of the present, perhaps reduced, picture."""

    def __init__(
        self, pixels: NDArray[np.float32], background: NDArray[np.float64], options: FitOptions
    ) -> None:
        self.pixels = pixels
        self.background = background
        self.options = options
        self.rng = np.random.default_rng(options.seed)
        self.state = State.empty()
        self.round_index = 0
        self.psnr = 0.0
        self.pixel_pairs = 0
        self.reduction = 1
        self.target = self._reduced(1)
        self.rates = adam.Rates()

    def _reduced(self, reduction: int) -> Target:
        height, width = self.pixels.shape[:2]
        size = max(1, height // reduction), max(1, width // reduction)
        planar = np.moveaxis(shrink(self.pixels, *size), -1, 0)
        planar = np.ascontiguousarray(planar, self.options.precision)
        return Target(planar, FLAT_WEIGHT)

    def begin(self, index: int, plan: Round) -> None:
        """Change to the round's picture and add its Gaussians."""
        before = self.target
        if plan.reduction != self.reduction:
            self.target, self.reduction = self._reduced(plan.reduction), plan.reduction
        scale = self.target.width / before.width, self.target.height / before.height
        if scale != (1.0, 1.0):
            self.state = self.state.scaled(*scale)
        count = plan.gaussians - len(self.state)
        if count > 0:
            self.round_index = index
            self._add(self._rendered(), count, plan.gaussians)

    def _rendered(self) -> NDArray[np.floating]:
        target = self.target
        splats = self.state.splats(self.background)
        return render_planar(splats, target.height, target.width, target.planar.dtype.type)

    def _add(self, rendered: NDArray[np.floating], count: int, total: int) -> None:
        new = place(self.options.placement, self.target, rendered, count, total, self.rng)
        opacity = np.full(count, FIRST_OPACITY_LOGIT)
        self.state = self.state.append(new.mean, new.factor, opacity, new.color, self.round_index)

    def step(self, iteration: int) -> None:
        """Relocate if it is time, then one step of the optimiser."""
        iterations = self.options.iterations
        timely = _RELOCATION_FROM < iteration / iterations < _RELOCATION_TO
        if timely and iteration % _RELOCATION_EVERY == 0:
            self._relocate()
        splats = self.state.splats(self.background)
        target = self.target
        image, loss, moments, rows = squared_error(splats, target.planar, target.weight)
        if self.options.loss != DEFAULT_LOSS:
            _, gradient = image_gradient(self.options.loss, image, self.target.planar)
            moments = moments_of_gradient(splats, gradient)
        gradient = adam.gradients(moments, splats.paint[:, 0])
        limits = adam.Limits(
            least_sigma=LEAST_SIGMA, most_sigma=float(max(self.target.width, self.target.height))
        )
        adam.step(self.state, gradient, self.rates, limits, rate(iteration, iterations))
        self.pixel_pairs += rows * 16
        error = loss / self.target.planar.size
        self.psnr = -10 * math.log10(error) if error > 0 else math.inf

    def _relocate(self) -> None:
        """Move the Gaussians that would be missed least to where the error is."""
        rendered, cost = removal_cost(self.state.splats(self.background), self.target.planar)
        total = len(self.state)
        count = int(_RELOCATION_SHARE * total)
        if count:
            kept = np.sort(np.argsort(cost[:, 0], kind="stable")[count:])
            self.state = self.state.select(kept)
            self._add(rendered, count, total)

    def drop_undrawable(self) -> None:
        """Drop what renderers would not draw: too faint, or nothing of it on the canvas."""
        splats = self.state.splats(self.background)
        _, cost = removal_cost(splats, self.target.planar)
        self.state = self.state.select((splats.paint[:, 0] >= LEAST_OPACITY) & (cost[:, 1] > 0))
