"""A fit in progress: rounds of growth, refinement, and changes of the count afterwards.

A guard against divergence rolls a fit back to its best state, from which it continues in smaller
steps. Detailed photos do not need it. Smooth images and those of few pixels do, because a single
step can undo nearly all progress (docs/decisions/divergence.md).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit import adam, schedule
from gauss2svg.fit.adam import OPAQUE_LOGIT, Rates
from gauss2svg.fit.clock import Clock, Stopwatch
from gauss2svg.fit.densification import ADJUST_AT, DensificationPolicy, FixedCount, Snapshot
from gauss2svg.fit.inks import EXCHANGED_EVERY
from gauss2svg.fit.losses import psnr_of
from gauss2svg.fit.options import DEFAULT_LOSS, FitConfig, FitProgress, FitResult
from gauss2svg.fit.population import Population
from gauss2svg.fit.shared import SharedColors
from gauss2svg.fit.state import State
from gauss2svg.fit.target import LossAndGradient, TargetPyramid
from gauss2svg.render.cpu import Splats
from gauss2svg.scene import SOFT, Scene
from gauss2svg.scene.parameters import LEAST_RAW_BETA, PARAMETERS

# Mean squared error under which a fit cannot diverge: 50 dB.
NEGLIGIBLE = 1e-5
# Mean squared error that no step can improve: 120 dB, at which no pixel of a million is off by half
# a level. Adam would take full steps all the same.
EXACT = 1e-12


# Divergence, and the steps after it (docs/decisions/divergence.md).
# After a rollback steps begin small, at lowered times ceiling of those that diverged, and grow to
# the ceiling, so one bad step among many good ones costs little.
DIVERGED = 2.0  # ratio of a loss to the least since the last change, above which it has diverged
STALLED = 1.5  # ratio of a loss to the least of all, above which it has stalled
STALLED_STEPS = 25  # steps for which a loss may have stalled before it counts as diverged
# Ratio of a stage's last loss to its least, above which the stage returns to its best state.
WORSE_AT_END = 1.2
CEILING = 0.5  # share of a diverged rate to which the rate grows again
CEILING_AGAIN = 0.1  # that share if the loss diverges again within AGAIN steps
AGAIN = 3  # accepted steps below which a divergence counts as a repeated one
LOWERED = 0.5  # share of the ceiling at which steps begin after a rollback
GROWTH = 1.1  # ratio of a step's rate to the one before, up to the ceiling
GENTLE = 0.25  # share of the ceiling at which a finished fit continues


class DivergenceGuard:
    """The best state of a fit so far, and how far its learning rate has been lowered.

    `reset` belongs to changes of the problem (another size or number of Gaussians, shared colours),
    `relocated` to changes of the state alone. learning_rate is that of FitOptions; rate is the
    share of it that is in use, least the loss of the best state.
    """

    def __init__(self, learning_rate: float = 1.0) -> None:
        self._usual = min(1 / learning_rate, 1.0)
        self.rate = self._ceiling = 1.0
        self.rollbacks = 0
        self._state: State | None = None  # the best one, and its shared colours
        self._shared: SharedColors | None = None
        self.least = self._recent = math.inf
        self._since = 0  # steps since the best state
        self._accepted = 0  # steps since the last rollback

    def reset(self) -> None:
        """Forget the best state, for later losses are not comparable; steps may grow again."""
        self._ceiling = max(self._ceiling, min(self._ceiling / CEILING, self._usual))
        self._state = self._shared = None
        self.least, self._recent, self._since = math.inf, math.inf, 0

    def begin_gently(self) -> None:
        """Continue with small steps that grow: full ones undo a drawing that is nearly exact."""
        self.rate = min(self.rate, GENTLE * self._ceiling)

    def relocated(self) -> None:
        """Allow a larger loss after a relocation."""
        self._recent = math.inf

    def accepts(self, loss: float, error: float, state: State, shared: SharedColors | None) -> bool:
        """Whether a state of this loss and mean squared error is sound; keeps the best one."""
        if not math.isfinite(loss):
            return False
        self._since += 1
        self._accepted += 1
        stalled = loss > STALLED * self.least and self._since > STALLED_STEPS
        if error > NEGLIGIBLE and (loss > DIVERGED * self._recent or stalled):
            return False
        self._recent = min(self._recent, loss)
        self.rate = min(self.rate * GROWTH, self._ceiling)
        if loss < self.least:
            self.least, self._since = loss, 0
            self._state, self._shared = state.copy(), None if shared is None else shared.copy()
        return True

    def ends_worse(self, loss: float, tolerant: bool) -> bool:
        """Whether a stage that ends at this loss should return to its best state.

        tolerant: only where the loss is a fifth larger. Where steps were too large before, that
        counts as another rollback.
        """
        diverged = not loss <= WORSE_AT_END * self.least
        if diverged and (self._usual < 1 or self.rollbacks > 0):
            self.roll_back()
        if tolerant:
            return diverged
        return not loss <= self.least * (1 + 1e-6)  # rounding of a sum in another order

    def roll_back(self) -> tuple[State, SharedColors | None] | None:
        """The best state, from which to continue in smaller steps; None if there is none."""
        self.rollbacks += 1
        again = self._accepted < AGAIN
        share = CEILING_AGAIN if again and self.rollbacks > 1 else CEILING
        # Steps far above the usual ones go half of the way back to those, in decades.
        self._ceiling = min(self.rate * share, math.sqrt(self.rate * self._usual))
        self._accepted = 0
        self.rate = self._ceiling * LOWERED
        self._recent, self._since = math.inf, 0
        return self.best()

    def best(self) -> tuple[State, SharedColors | None] | None:
        """A copy of the best state and its shared colours."""
        if self._state is None:
            return None
        return self._state.copy(), None if self._shared is None else self._shared.copy()


AsWritten = Callable[[Scene, float], Scene]

# px; under 0.3 px every SVG renderer loses mass (docs/decisions/renderers.md).
LEAST_SIGMA = 0.35

# Progress at which shapes may exchange their colours; later they hardly do.
_EXCHANGES = (0.855, 0.875, 0.895, 0.915, 0.935)


# Share of a Gaussian's part of the loss by which a unit of ln beta must lower it, so that shapes
# which gain nothing stay Gaussians (docs/decisions/fit.md).
BETA_PRICE = 0.06
# Opacity from which a shape becomes opaque, which saves bytes (docs/decisions/fit.md).
OPAQUE_FROM = 0.953
# Progress at which a fit resumes after its count has changed: some relocation, then decay
# (docs/decisions/fit.md).
RESUME_AT = 0.6
# Steps in the PSNR that a policy sees during refinement. One alone scatters
# (docs/decisions/fit.md).
STEPS_AVERAGED = 5


class FitSession:
    """One fit of a picture, which is refined again after a change of its count.

    pixels      (h, w, 3) float32 in 0..1, or (h, w, 4) with alpha
    policy      decides the number of Gaussians; None: it is that of config
    deadline    in s of time.perf_counter(), or None
    progress    called after every iteration, from this thread
    as_written  maps a scene and its PSNR in dB to the scene with the exponents and colours of its
                file; called before the last steps, which make up for the loss
    stop        polled before every step; True ends the fit with its present state
    targets     the pixels as targets of the same tune, where there are some already
    """

    def __init__(
        self,
        pixels: NDArray[np.float32],
        config: FitConfig,
        policy: DensificationPolicy | None = None,
        deadline: float | None = None,
        progress: Callable[[FitProgress], None] | None = None,
        as_written: AsWritten | None = None,
        stop: Callable[[], bool] | None = None,
        targets: TargetPyramid | None = None,
    ) -> None:
        self.config = config
        self.policy = policy or FixedCount(config)
        steps = config.steps(pixels.shape[1], pixels.shape[0])
        self.clock = Clock(
            steps, self.policy.rounds, deadline, config.densify.round_iterations, stop
        )
        self.population = Population(pixels, config, targets)
        self.guard = DivergenceGuard(config.fit.learning_rate)
        self.pixel_pairs = 0
        self._progress = progress or (lambda _: None)
        self._as_written = as_written
        self._adopted = self._quantized = False
        self._errors: deque[float] = deque(maxlen=STEPS_AVERAGED)
        self._rates: Rates = self.population.blending.rates
        self._shared: SharedColors | None = None
        self._stopwatch = Stopwatch()

    @property
    def state(self) -> State:
        """The Gaussians, in px of the current target."""
        return self.population.state

    def fit(self) -> None:
        """Grow and refine until the policy or the clock ends it."""
        with self._stopwatch:
            if self.population.target.is_blank:
                self.policy.stop_reason = "enough"
                return
            if not self._adopted:
                self._grow()
            total = self.clock.iterations
            self._refine(None if total is None else total - self.clock.iteration)

    def adopt(self, scene: Scene, count: int) -> None:
        """Begin with the Gaussians of an additive scene, alpha-composited, and add up to `count`.

        Call it before `fit`, which then only refines them.
        """
        self.population.adopt(scene)
        self.population.densify_or_prune(max(count, len(self.state)))
        self._adopted = True

    def prune_to(self, count: int) -> None:
        """Remove the least useful Gaussians of a finished fit, down to `count`."""
        self.population.densify_or_prune(min(count, len(self.state)))

    def resize(self, count: int, iterations: int) -> None:
        """Change the number of Gaussians of a finished fit, and refine them again."""
        with self._stopwatch:
            self.population.densify_or_prune(count)
            if self.config.fit.learned_falloff:  # exponents are no longer those of a file
                self.state.raw_beta = np.maximum(self.state.raw_beta, LEAST_RAW_BETA)
                self.state.drawn[:] = SOFT
            self._refine(iterations, again=True)

    def scene(self) -> Scene:
        """The Gaussians on the working canvas."""
        return self.population.scene()

    def result(self) -> FitResult:
        """The scene and the costs so far."""
        reason = "time_limit" if self.clock.out_of_time else self.policy.stop_reason
        return FitResult(
            scene=self.scene(),
            iterations=self.clock.iteration,
            rounds=self.population.rounds,
            wall_s=self._stopwatch.wall_s,
            cpu_s=self._stopwatch.cpu_s,
            pixel_pairs=self.pixel_pairs,
            stop_reason="interrupted" if self.clock.stopped else reason,
            rollbacks=self.guard.rollbacks,
            rate=self.config.fit.learning_rate * self.guard.rate,
        )

    def _grow(self) -> None:
        """Rounds of new Gaussians, then the full-size target."""
        index = 0
        while self._begin_round(index):
            while not self.clock.round_is_over(index):
                self._step(self.clock.growth_progress(index))
            self._restore_best(tolerant=not self.clock.stopped)
            index += 1

    def _begin_round(self, index: int) -> bool:
        """Change to the round's target and add its Gaussians; False if growth has ended."""
        population = self.population
        count = total = len(self.state)
        if not self.clock.stopped:
            total = self.policy.grow(
                self._snapshot(self.clock.growth_progress(index - 1), self._psnr_now)
            )
        self.guard.reset()
        if total <= count:
            population.reduce_to(population.reduction_at(schedule.GROWTH_SHARE))
            population.densify_or_prune(total)
            return False
        population.reduce_to(population.reduction_of_round(total))
        population.round_index = index
        population.densify_or_prune(total)
        return True

    def _refine(self, steps: int | None, again: bool = False) -> None:
        """Optimise all Gaussians; relocate, adjust, prune and quantise at their times.

        steps  number of iterations, None for as many as the time allows
        again  whether the fit was finished before and its count has changed since: then no count is
               adjusted, none is pruned for its gain, and the first steps are small
        """
        population = self.population
        if not len(self.state):
            return
        begun = RESUME_AT if again else schedule.GROWTH_SHARE
        self.clock.begin_refinement(steps, begun, population.reduction_at(begun) > 1)
        self._errors.clear()
        self.guard.reset()
        if again:
            self.guard.begin_gently()
        self._rates, self._shared = population.blending.rates, None
        self._quantized = False
        adjust_at = () if again else ADJUST_AT
        exchange_at, pruned = _EXCHANGES, again
        while (done := self.clock.refinement_progress()) < 1:
            self._change_size(done)
            if adjust_at and done >= adjust_at[0]:
                adjust_at = [at for at in adjust_at if at > done]
                count = self.policy.adjust(self._snapshot(done, self._recent_psnr))
                if count != len(self.state):
                    self._restore_best(tolerant=True)
                    population.densify_or_prune(count)
                    self.guard.reset()
            if done >= schedule.DECAY_START and not pruned:
                pruned = True
                self._restore_best(tolerant=True)
                population.prune(self.policy.least_gain())
                self.guard.reset()
            if done >= schedule.QUANTIZED_FROM and not self._quantized:
                self._quantize()
            if self._shared is not None and exchange_at and done >= exchange_at[0]:
                exchange_at = [at for at in exchange_at if at > done]
                self._shared.exchange(
                    self.state, population.splats, population.target, population.rng
                )
            self._step(done)
        self._change_size(1.0)
        if not self._quantized:  # no time or no steps were left for it
            self._quantize()
        self._restore_best()
        population.prune_invisible()
        self._shared = None

    def _change_size(self, done: float) -> None:
        """Continue on the target of this progress; losses of different sizes do not compare."""
        factor = self.population.reduction_at(done)
        if factor != self.population.reduction:
            self._restore_best(tolerant=True)
            self.population.reduce_to(factor, scale_moments=True)
            self._errors.clear()
            self.guard.reset()

    def _restore_best(self, tolerant: bool = False) -> None:
        """Return to the best state of a stage that ends worse.

        tolerant: only if it ends much worse; recent relocations may still pay.
        """
        if not len(self.state) or self.guard.least == math.inf:
            return
        population = self.population
        # Without a gradient it takes a third of the time.
        if self.config.fit.loss == DEFAULT_LOSS and self.config.enlarged == 1:
            loss = population.target.loss(population.splats())
        else:
            loss = self._evaluate(population.splats()).loss
        if self.guard.ends_worse(loss, tolerant) and (best := self.guard.best()) is not None:
            population.state, self._shared = best

    def _quantize(self) -> None:
        """Exponents become those of the file and stay; colours are shared from here on.

        Before that the least useful Gaussians beyond what may be written go.
        """
        self._restore_best()
        population = self.population
        most = self.policy.most(self._snapshot(schedule.QUANTIZED_FROM, self._recent_psnr))
        if most < len(self.state):
            population.densify_or_prune(most)
        if self._as_written is not None and len(self.state):
            least = math.log(OPAQUE_FROM / (1 - OPAQUE_FROM))
            self.state.raw_opacity[self.state.raw_opacity > least] = OPAQUE_LOGIT
            with self.clock.paused():
                scene = self._as_written(self.scene(), self._recent_psnr())
            population.state = self.state.quantized(scene)
            if population.inks is None:
                self._rates = self._shared_rates()
                self._shared = SharedColors.of(self.state, population.blending)
        self.guard.reset()
        self._quantized = True

    def _shared_rates(self) -> Rates:
        """Return the learning rates with shared parameters set to 0, which SharedColors steps."""
        return {**self._rates, **dict.fromkeys((p.name for p in PARAMETERS if p.shared), 0.0)}

    def _snapshot(self, done: float, psnr: Callable[[], float]) -> Snapshot:
        return Snapshot(len(self.state), done, psnr, self.scene)

    def _psnr_now(self) -> float:
        return psnr_of(self.population.error())

    def _recent_psnr(self) -> float:
        """Mean PSNR of the last steps, which ran at full size."""
        if not self._errors:
            return self._psnr_now()
        return psnr_of(float(np.mean(self._errors)))

    def _evaluate(self, splats: Splats) -> LossAndGradient:
        """Return the loss and its gradient, in the last steps also of the picture's own size."""
        options, times = self.config.fit, self.config.enlarged
        found = self.population.target.evaluate(splats, options.loss, options.ssim_weight)
        if times == 1 or not self._quantized:
            return found
        # Gradients are in each shape's own frame, so that they add up over sizes.
        own = self.population.evaluated_at(times)
        return found._replace(
            loss=(found.loss + times**2 * own.loss) / 2,
            moments=(found.moments + times**2 * own.moments) / 2,
            pairs=found.pairs + own.pairs,
        )

    def _step(self, done: float) -> None:
        """Relocate if it is time, then one optimiser step, or a rollback."""
        due = schedule.relocates(done, self.clock.iteration, self.config.sparse)
        due = due and (not self._errors or self._errors[-1] > NEGLIGIBLE)
        if due and self.config.densify.relocate and self.population.relocate():
            self.guard.relocated()
        if self.population.inks is not None and self.clock.iteration % EXCHANGED_EVERY == 0:
            self.population.exchange_inks()
        splats = self.population.splats()
        evaluated = self._evaluate(splats)
        if self.guard.accepts(evaluated.loss, evaluated.error, self.state, self._shared):
            self._errors.append(self.population.error_of(evaluated))
            if evaluated.error > EXACT:
                self._optimize(splats, evaluated, schedule.rate(done))
        else:
            self._roll_back()
        self.pixel_pairs += evaluated.pairs
        self.clock.iteration += 1
        self._report_progress(done)

    def _optimize(self, splats: Splats, evaluated: LossAndGradient, rate: float) -> None:
        """One optimiser step, at this share of the full learning rate."""
        state, target, blending = self.state, self.population.target, self.population.blending
        share = evaluated.loss / max(len(state), 1)
        gradient = adam.gradients(evaluated.moments, splats, BETA_PRICE * share)
        limits = adam.Limits(
            least_sigma=LEAST_SIGMA,
            most_sigma=float(max(target.width, target.height)),
            least_color=blending.least_color,
            most_color=blending.most_color,
        )
        size = self.config.fit.learning_rate * self.guard.rate * rate
        if not adam.step(state, gradient, self._rates, limits, size):
            self._roll_back()
        elif self._shared is not None:
            self._shared.step(state, gradient, size)

    def _roll_back(self) -> None:
        """Return to the best state and continue in smaller steps."""
        best = self.guard.roll_back()
        if best is not None:
            self.population.state, self._shared = best

    def _report_progress(self, done: float) -> None:
        elapsed = self.clock.elapsed_s
        self._progress(
            FitProgress(
                round=self.population.round_index + 1,
                iteration=self.clock.iteration,
                done=done,
                gaussians=len(self.state),
                psnr=self._recent_psnr() if not self._errors else psnr_of(self._errors[-1]),
                elapsed_s=elapsed,
                remaining_s=elapsed / max(done, 0.01) * (1 - done),
                scene=self.scene,
            )
        )
