"""A fit in progress: rounds of growth, then steps of refinement with events between them.

    progress           event
    0 to 0.3           rounds of growth, each of which begins with new Gaussians
    0.2 to 0.75        useless Gaussians move to where the error is large, every few steps
    0.45, 0.55         a fit of few Gaussians changes to a larger target
    0.45, 0.55, 0.65   the policy may change the number of Gaussians
    0.75               Gaussians that gain too little are pruned
    0.85               exponents and colours become those of the file. Earlier it would be worse

When the target, the number of Gaussians or the exponents change, losses before the change cannot be
compared with losses after it. So `FitSession` restores the best state just before such an event,
and resets its guard just after it.

The constants of this package come from ablations, which are in fit.md, placement.md, palette.md,
divergence.md and numbers.md of docs/decisions.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import refusal
from gauss2svg.fit import FitConfig, FitProgress, FitResult, schedule
from gauss2svg.fit.population import AsWritten, Population
from gauss2svg.fit.schedule import NEGLIGIBLE, Clock, DivergenceGuard, doubled
from gauss2svg.fit.target import Target
from gauss2svg.photo.pixels import psnr_of
from gauss2svg.render import render
from gauss2svg.render.cpu import kernel_lock
from gauss2svg.scene import ADD, OVER, Scene

# Progress in refinement at which a policy may change the number of Gaussians.
ADJUST_AT = (0.45, 0.55, 0.65)
# Progress at which an action of a fit is due, and the action.
_Event = tuple[float, Callable[[], None]]


class DensificationPolicy:
    """A policy that decides the number of Gaussians. This base class follows the FitConfig.

    rounds       approximate number of rounds of growth
    stop_reason  reason why growth ended, as in FitResult. It is valid once growth has ended
    least_gain   gain in dB that a Gaussian must bring. Gaussians that gain less are pruned before
                 the last steps
    """

    least_gain = -math.inf

    def __init__(self, config: FitConfig) -> None:
        self._totals = config.round_totals or doubled(config.gaussians, config.iterations)
        self.rounds = len(self._totals)
        self.stop_reason = "iterations" if config.gaussians else "gaussians"

    def grow(self, fit: FitSession) -> int:
        """Return the number of Gaussians after the next round.

        If it is not above the present number, growth ends.
        """
        return next((total for total in self._totals if total > fit.count), fit.count)

    def adjust(self, fit: FitSession) -> int:
        """Return the number of Gaussians with which refinement continues.

        It is called whenever the progress reaches one of the values ADJUST_AT.
        """
        return fit.count

    def max_count(self, fit: FitSession, is_quantized: bool) -> int:
        """Return the largest number of Gaussians that a file may have.

        It is called before the last steps: before the Gaussians are quantised, and after it.
        """
        return fit.count


class FitSession:
    """A fit of a picture. When it is finished, `resize` can change it and refine it again.

    target      target of the picture at full size, made with config.fit.tuned
    policy      policy that decides the number of Gaussians. If it is None, the number follows
                config
    deadline    function that returns the time in s of time.perf_counter() at which the fit must
                end. It is infinite if no time limits the fit
    progress    function that is called after every iteration, in the thread that fits
    as_written  function from a scene and its PSNR in dB to the scene with the exponents and colours
                of its file. It is called before the last steps, so that these steps can make up for
                the change
    stop        function that is called before every step. If it returns True, the fit ends with its
                present state
    done        progress in 0..1
    """

    def __init__(
        self,
        target: Target,
        config: FitConfig,
        policy: DensificationPolicy | None = None,
        deadline: Callable[[], float] = lambda: math.inf,
        progress: Callable[[FitProgress], None] | None = None,
        as_written: AsWritten | None = None,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        self.config = config
        self.policy = policy or DensificationPolicy(config)
        steps = config.steps(target.width, target.height)
        self.clock = Clock(steps, self.policy.rounds, deadline, config.round_iterations, stop)
        self.population = Population(target, config)
        self.guard = DivergenceGuard(config.fit.learning_rate)
        self.pixel_pairs = 0
        self.wall_s = self.cpu_s = 0.0
        self._progress, self._as_written = progress or (lambda _: None), as_written
        self.done = 0.0
        self._error = math.inf  # mean squared error of the last sound step

    @property
    def count(self) -> int:
        """Number of Gaussians."""
        return len(self.population)

    def fit(self) -> None:
        """Grow and refine until the policy or the clock ends the fit."""
        with self._timed():
            if self.population.target.is_blank:
                self.policy.stop_reason = "enough"
                return
            if not self.count:
                self._grow()
            steps = self.clock.iterations - self.clock.iteration
            adjustments = [(at, self._adjust) for at in ADJUST_AT]
            pruning = schedule.DECAY_START, self._prune
            self._refine(steps, schedule.GROWTH_SHARE, [*adjustments, pruning])

    def resize(self, count: int, iterations: int) -> None:
        """Change the number of Gaussians of a finished fit to `count`, and refine the fit again.

        iterations: number of further steps.
        """
        with self._timed():
            self.population.densify_or_prune(count)
            self.population.soften()
            # From 0.6 on there is time for some relocations, and for the whole decay of the rate.
            self._refine(iterations, 0.6, [], gently=True)

    def begin_with(self, scene: Scene) -> None:
        """Begin with the shapes of an alpha-composited scene. Call `refine` afterwards."""
        with self._timed():
            self.population.begin_with(scene)

    def refine(self, count: int, iterations: int, keeps: bool) -> None:
        """Let `resize` refine the shapes with which the fit has begun.

        `resize` changes their number to `count` and takes `iterations` steps. If this gains less
        than 0.05 dB, it is undone, unless there were more than `count` shapes before or
        `keeps` is False.
        """
        population = self.population
        before, psnr = population.state.copy(), population.psnr()
        self.resize(count, iterations)
        if keeps and len(before) <= count and population.psnr() - psnr < 0.05:
            population.state = before

    def adopt(self, scene: Scene, count: int) -> None:
        """Begin with the Gaussians of an additive scene, as alpha-composited shapes.

        If they are fewer than `count`, more are added. Call it before `fit`, which then has no
        rounds of growth but only refines these Gaussians.
        """
        self.population.adopt(scene)
        self.population.densify_or_prune(max(count, self.count))

    def scene(self) -> Scene:
        """Return the Gaussians on the working canvas."""
        return self.population.scene()

    def result(self) -> FitResult:
        """Return the scene and the costs so far."""
        reason = "time_limit" if self.clock.out_of_time else self.policy.stop_reason
        return FitResult(
            self.scene(), self.clock.iteration,
            rounds=self.population.round_index + 1 if self.count else 0,
            wall_s=self.wall_s, cpu_s=self.cpu_s, pixel_pairs=self.pixel_pairs,
            stop_reason="interrupted" if self.clock.stopped() else reason,
            rollbacks=self.guard.rollbacks,
        )  # fmt: skip

    def _grow(self) -> None:
        """Run rounds of growth until the policy ends them.

        Then set the size of the target and the number of Gaussians with which refinement begins.
        """
        population, clock = self.population, self.clock
        for index in itertools.count():
            count = total = len(population)
            if not clock.stopped():
                self.done = clock.growth_progress(index - 1)
                total = self.policy.grow(self)
            self.guard.reset()
            if total <= count:
                population.reduce_to(population.reduction_at(schedule.GROWTH_SHARE))
                population.densify_or_prune(total)
                return
            population.reduce_to(population.reduction_of_round(total))
            population.round_index = index
            population.densify_or_prune(total)
            while not clock.round_is_over(index):
                self._step(clock.growth_progress(index))
            self._restore_best(tolerant=not clock.stopped())

    def _refine(
        self, steps: int, start: float, events: Iterable[_Event], gently: bool = False
    ) -> None:
        """Take steps from progress `start` to 1.

        steps   number of steps
        events  events to do on the way, in addition to the events of every refinement
        gently  whether the first steps are small
        """
        population = self.population
        if not len(population):
            return
        self.clock.begin_refinement(steps, start, population.reduction_at(start) > 1)
        self.guard.reset()
        if gently:
            self.guard.begin_gently()
        population.shared, self._quantized = None, False
        sizes = [(at, self._change_size) for at in (0.0, 0.45, schedule.FULL_FROM)]
        due: list[_Event] = [*sizes, *events, (0.85, self._quantize)]
        remaining = deque(sorted(due, key=itemgetter(0)))
        self.done = start
        while (done := self.clock.refinement_progress()) < 1:
            self.done = done
            while remaining and remaining[0][0] <= done:
                remaining.popleft()[1]()
            self._step(done)
        self.done = 1.0
        # These two are done even if the fit ends before their progress.
        self._change_size()
        if not self._quantized:
            self._quantize()
        self._restore_best()
        population.prune_invisible()
        population.shared = None

    @contextmanager
    def _changing(self, tolerant: bool = True) -> Iterator[None]:
        """Restore the best state before the `with` block, and reset the guard after it.

        The block makes a change after which losses cannot be compared with earlier losses.
        `tolerant` is passed to _restore_best.
        """
        self._restore_best(tolerant)
        yield
        self.guard.reset()

    def _change_size(self) -> None:
        """Change the target to the size for the present progress, if it has another size."""
        factor = self.population.reduction_at(self.done)
        if factor != self.population.reduction:
            with self._changing():
                self.population.reduce_to(factor, scale_moments=True)

    def _adjust(self) -> None:
        count = self.policy.adjust(self)
        if count != self.count:
            with self._changing():
                self.population.densify_or_prune(count)

    def _prune(self) -> None:
        with self._changing():
            self.population.prune(self.policy.least_gain)

    def _quantize(self) -> None:
        """Quantise the Gaussians: give them the exponents and colours of the file.

        If there are more Gaussians than the file may have, the least useful ones are removed: first
        those beyond an estimate, and then those beyond the bytes that the quantised ones take.
        After quantising, exponents no longer change, and shapes share the colours of the file.
        """
        population = self.population
        with self._changing(tolerant=False):
            population.densify_or_prune(min(self.policy.max_count(self, False), self.count))
            if self._as_written is not None and self.count:
                with self.clock.paused():
                    population.quantize(self._as_written, population.psnr())
                    population.densify_or_prune(min(self.policy.max_count(self, True), self.count))
            self._quantized = True

    def _restore_best(self, tolerant: bool = False) -> None:
        """Restore the best state of a stage if its last state is worse.

        tolerant: whether the last state is kept if its loss is at most 1.2 times the least loss,
        because recent relocations may still improve the picture.
        """
        population, best = self.population, self.guard.best
        if not len(population) or best is None:
            return
        loss = population.evaluate(population.splats()).loss
        if not loss <= self.guard.least * (1.2 if tolerant else 1.0):
            population.state = best.copy()

    def _step(self, done: float) -> None:
        """Take a step, or roll back if the fit has diverged. Then report the progress.

        If a relocation of Gaussians or an exchange of inks is due, it is done before the step.
        """
        population, guard = self.population, self.guard
        is_due = schedule.relocates(done, self.clock.iteration, self.config.relocate_rarely)
        is_due &= self.config.fit.relocate and self._error > NEGLIGIBLE
        if is_due and population.relocate():
            guard.allow_rise()
        if population.inks is not None and self.clock.iteration % 20 == 0:
            population.exchange_inks(population.inks)
        splats = population.splats()
        evaluated = population.evaluate(splats)
        is_sound = guard.observe(evaluated.loss, evaluated.error, population.state.copy)
        if is_sound:
            self._error = population.error_of(evaluated)
            # At an error of 1e-12 (120 dB), even the worst pixel of a picture of a million pixels
            # is off by less than half a level of 255. Adam would still take full steps, which could
            # make the fit worse. So no step is taken.
            if evaluated.error > 1e-12:
                size = self.config.fit.learning_rate * guard.rate * schedule.rate(done)
                is_sound = population.step(splats, evaluated, size)
        if not is_sound:
            guard.roll_back()
            if guard.best is not None:
                population.state = guard.best.copy()
        self.pixel_pairs += evaluated.pairs
        self.clock.iteration += 1
        elapsed = self.clock.elapsed_s
        self._progress(FitProgress(
            population.round_index + 1, self.clock.iteration, done, len(population),
            psnr_of(self._error), elapsed, remaining_s=elapsed / max(done, 0.01) * (1 - done),
            scene=population.scene,
        ))  # fmt: skip

    @contextmanager
    def _timed(self) -> Iterator[None]:
        """Add the wall-clock and CPU seconds of the `with` block to the costs of the fit."""
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        yield
        self.wall_s += time.perf_counter() - wall_s
        self.cpu_s += time.process_time() - cpu_s


def fit(
    pixels: NDArray[np.float32],
    config: FitConfig | None = None,
    progress: Callable[[FitProgress], None] | None = None,
) -> FitResult:
    """Fit config.gaussians Gaussians to pixels (h, w, 3) float32 in 0..1, or (h, w, 4) with alpha.

    The same seed gives the same result. `progress` is called after every iteration, in the thread
    that calls this function.
    """
    with kernel_lock:
        config = config or FitConfig()
        session = FitSession(Target(pixels, config.fit.tuned), config, progress=progress)
        session.fit()
        return session.result()


def convert_additive(
    scene: Scene,
    pixels: NDArray[np.float32] | None = None,
    config: FitConfig | None = None,
    progress: Callable[[FitProgress], None] | None = None,
) -> FitResult:
    """Convert an additive scene to the same number of alpha-composited shapes.

    Alpha-composited shapes are useful because every renderer draws them. They are fitted to
    `pixels`, which are (h, w, 3) float32 in 0..1, or to the render of the scene if `pixels` is
    None. The module gauss2svg.fit.population describes the method. The value of config.gaussians is
    ignored. Raise InputError unless the scene is additive and config.fit.blend is "over".
    """
    config = dataclasses.replace(config or FitConfig(), gaussians=len(scene))
    blends = scene.blend, config.fit.blend
    if blends != (ADD, OVER):
        needed = f"additive, and fitted by a config of blend {OVER!r}"
        raise refusal("the scene", needed, f"blends {blends[0]!r} and {blends[1]!r}")
    with kernel_lock:
        photo = render(scene) if pixels is None else pixels
        session = FitSession(Target(photo, config.fit.tuned), config, progress=progress)
        session.adopt(scene, len(scene))
        session.fit()
        return session.result()
