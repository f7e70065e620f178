"""A fit under way: rounds of growth, refinement, and changes of the count afterwards."""

from __future__ import annotations

import dataclasses
import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, number_within
from gauss2svg.fit import adam
from gauss2svg.fit.clock import Clock
from gauss2svg.fit.densification import ADJUST_AT, DensificationPolicy, Snapshot
from gauss2svg.fit.divergence import DivergenceGuard
from gauss2svg.fit.losses import DEFAULT_LOSS
from gauss2svg.fit.options import FitConfig, FitProgress, FitResult
from gauss2svg.fit.order import SegmentAt
from gauss2svg.fit.population import Population
from gauss2svg.fit.schedule import DECAY_START, GROWTH_SHARE, SETTLED_FROM, rate, reduction
from gauss2svg.fit.shared import SharedColors
from gauss2svg.fit.stage import GROWING, OVER, REFINING, Stage
from gauss2svg.fit.state import State
from gauss2svg.fit.target import LossAndGradient
from gauss2svg.render.cpu import Splats
from gauss2svg.scene import Scene

AsWritten = Callable[[Scene, float], Scene]

# Under 0.3 px every SVG renderer loses mass: at 0.2 px 85 % of it is drawn, at 0.1 px 35 %.
LEAST_SIGMA = 0.35

# A unit of ln beta must buy this share of a Gaussian's part of the loss. On Kodak 04, 13 and
# 20, 1000 / 5000 shapes, with 0, 0.02, 0.06, 0.2, 0.6 a share of 0.17, 0.26, 0.40, 0.69, 0.91
# (1000) stays at beta = 1, and the drawn SVG has 27.52 / 31.81, 27.55 / 31.78, 27.54 / 31.83,
# 27.42 / 31.77, 27.19 / 31.54 dB.
_BETA_PRICE = 0.06
# A shape more opaque than this becomes opaque, which the file need not say: 2.8 bytes a shape
# of 5000 for 0.002 dB; from 0.93 on 3.7 bytes for 0.006.
_OPAQUE_FROM = 0.953
_OPAQUE_LOGIT = 12.0
# When shapes may exchange their colours, as shares of the fit; later they hardly do.
_EXCHANGES = (0.855, 0.875, 0.895, 0.915, 0.935)

_RELOCATION_EVERY = 10
_RELOCATION_FROM, _RELOCATION_TO = 0.2, 0.75
# Where a fit is taken up again after its count has changed: some relocation, then decay.
_RESUME_AT = 0.6
_STEPS_AVERAGED = 5  # of the PSNR that a policy is told while all are refined


class FitSession:
    """The Gaussians of one fit, and where it stands.

    pixels    (h, w, 3) float32 in 0..1, or (h, w, 4) with alpha
    policy      how many Gaussians; deadline in s of time.perf_counter, or None
    progress  called once an iteration, from this thread
    as_written  the same shapes with the exponents and colours that a file has, from a scene
              and its PSNR in dB; asked for before the last steps, which make up for the loss
    segment_at  the segments by which each round's shapes are ordered, or None
    stop      asked before every step: True ends the fit with what it has
    """

    def __init__(
        self,
        pixels: NDArray[np.float32],
        config: FitConfig,
        policy: DensificationPolicy,
        deadline: float | None = None,
        progress: Callable[[FitProgress], None] | None = None,
        as_written: AsWritten | None = None,
        segment_at: SegmentAt | None = None,
        stop: Callable[[], bool] | None = None,
    ) -> None:
        self.config = config
        self.policy = policy
        self.clock = Clock(
            config.iterations, policy.rounds, deadline, config.densify.round_iterations, stop
        )
        self.population = Population(pixels, config, segment_at)
        self.guard = DivergenceGuard(config.fit.learning_rate)
        self.pixel_pairs = 0
        self._size = pixels.shape[1], pixels.shape[0]
        self._progress = progress or (lambda _: None)
        self._as_written = as_written
        self._stage = Stage()
        self._errors: deque[float] = deque(maxlen=_STEPS_AVERAGED)
        self._rates = self.population.blending.rates
        self._shared: SharedColors | None = None
        self._wall_s = self._cpu_s = 0.0
        self._since: tuple[float, float] | None = None

    @property
    def state(self) -> State:
        """The Gaussians, in pixels of the present picture."""
        return self.population.state

    def fit(self) -> None:
        """Grow and refine until the policy and the clock are content; or go on, after `load_state_dict`."""
        with self._timed():
            if self.population.target.is_blank:
                self.policy.stop_reason, self._stage = "enough", Stage(OVER)
            if self._stage.name == GROWING:
                self._grow()
            if self._stage.name == REFINING:
                self._refine()

    def adopt(self, scene: Scene, count: int) -> None:
        """Begin with a sum's Gaussians, painted over each other, and as many as make `count`.

        To be called before `fit`, which then only refines them.
        """
        self.population.adopt(scene)
        self.population.densify_or_prune(max(count, len(self.state)))
        self._after_growth()

    def trim(self, count: int) -> None:
        """Remove the Gaussians that are missed least from a finished fit, down to `count`."""
        self.population.densify_or_prune(min(count, len(self.state)))

    def resize(self, count: int, iterations: int) -> None:
        """Change the number of Gaussians of a finished fit, and refine them again."""
        with self._timed():
            self.population.densify_or_prune(count)
            if self.config.fit.learned_falloff:
                self.state.raw_beta = np.maximum(self.state.raw_beta, adam.LEAST_RAW_BETA)
            self._begin_refining(iterations, _RESUME_AT, adjusting=False)
            self._refine()

    def scene(self) -> Scene:
        """The Gaussians so far, on the whole working canvas."""
        return self.population.scene()

    def result(self) -> FitResult:
        """The scene and the numbers so far."""
        reason = "time_limit" if self.clock.out_of_time else self.policy.stop_reason
        return FitResult(
            scene=self.scene(),
            iterations=self.clock.iteration,
            rounds=self.population.rounds,
            wall_s=self._wall_s,
            cpu_s=self._cpu_s,
            pixel_pairs=self.pixel_pairs,
            stop_reason="interrupted" if self.clock.stopped else reason,
            rollbacks=self.guard.rollbacks,
            rate=self.config.fit.learning_rate * self.guard.rate,
        )

    def state_dict(self) -> dict[str, Any]:
        """What `load_state_dict` needs to go on from between two steps, to the last bit; for a checkpoint.

        Numbers, text, None, arrays, and lists and dictionaries of these.
        """
        wall_s, cpu_s = self._seconds()
        return {
            "population": self.population.state_dict(),
            "guard": self.guard.state_dict(),
            "clock": self.clock.state_dict(),
            "rule": self.policy.state_dict(),
            "stage": dataclasses.asdict(self._stage),
            "errors": list(self._errors),
            "shared": None if self._shared is None else self._shared.state_dict(),
            "pixel_pairs": self.pixel_pairs,
            "wall_s": wall_s,
            "cpu_s": cpu_s,
        }

    def load_state_dict(self, memory: dict[str, Any]) -> None:
        """Stand where a run of the same picture, options and policy stood; `fit` goes on.

        Raises InputError, or what plain Python raises, for a memory that no run can give.
        """
        self.population.load_state_dict(memory["population"])
        self.guard.load_state_dict(memory["guard"], self.population.blending)
        self.clock.load_state_dict(memory["clock"])
        self.policy.load_state_dict(memory["rule"])
        self._stage = Stage.from_state_dict(memory["stage"])
        self._errors.extend(number_within("error", e, 0, math.inf) for e in memory["errors"])
        if memory["shared"] is not None:
            self._share_colors()
            self._shared = SharedColors.from_state_dict(memory["shared"], self.population.blending)
            if len(self._shared.entry) != len(self.state):
                raise InputError("a checkpoint's colours are not those of its shapes; begin anew")
        self.pixel_pairs = memory["pixel_pairs"]
        self._wall_s, self._cpu_s = memory["wall_s"], memory["cpu_s"]

    @contextmanager
    def _timed(self) -> Iterator[None]:
        self._since = time.perf_counter(), time.process_time()
        try:
            yield
        finally:
            self._wall_s, self._cpu_s = self._seconds()
            self._since = None

    def _seconds(self) -> tuple[float, float]:
        """Of the wall and of the CPU, that the fit has taken so far."""
        if self._since is None:
            return self._wall_s, self._cpu_s
        wall, cpu = self._since
        return (
            self._wall_s + time.perf_counter() - wall,
            self._cpu_s + time.process_time() - cpu,
        )

    def _grow(self) -> None:
        """Rounds of new Gaussians, then the full picture."""
        stage = self._stage
        while True:
            if not stage.begun:
                if not self._begin_round(stage.index):
                    break
                stage.begun = True
            while not self.clock.round_is_over(stage.index):
                self._step(self.clock.growing(stage.index))
            self._end_at_best(far=not self.clock.stopped)
            stage.index, stage.begun = stage.index + 1, False
        self._after_growth()

    def _begin_round(self, index: int) -> bool:
        """Change to the round's picture and add its Gaussians; False if growth is over."""
        population = self.population
        count = total = len(self.state)
        if not self.clock.stopped:
            total = self.policy.grow(self._snapshot(self.clock.growing(index - 1), self._psnr_now))
        self.guard.begin()
        if total <= count:
            population.show_at(1)
            population.densify_or_prune(total)
            return False
        width, height = self._size
        population.show_at(reduction(total, width, height) if self.config.reduce else 1)
        population.round_index = index
        population.densify_or_prune(total)
        return True

    def _after_growth(self) -> None:
        total = self.config.iterations
        steps = None if total is None else total - self.clock.iteration
        self._begin_refining(steps, GROWTH_SHARE)

    def _begin_refining(self, steps: int | None, done: float, adjusting: bool = True) -> None:
        if not len(self.state):
            self._stage = Stage(OVER)
            return
        self.clock.refine(steps, done)
        self._errors.clear()
        self.guard.begin()
        self._stage = Stage(
            REFINING,
            adjust_at=list(ADJUST_AT) if adjusting else [],
            exchange_at=list(_EXCHANGES),
            pruned=not adjusting,
        )
        self._rates, self._shared = self.population.blending.rates, None

    def _refine(self) -> None:
        """All Gaussians move; some are relocated, before the steps get smaller."""
        stage, population = self._stage, self.population
        while (done := self.clock.refining()) < 1:
            if stage.adjust_at and done >= stage.adjust_at[0]:
                stage.adjust_at = [at for at in stage.adjust_at if at > done]
                count = self.policy.adjust(self._snapshot(done, self._recent_psnr))
                if count != len(self.state):
                    self._end_at_best(far=True)
                    population.densify_or_prune(count)
                    self.guard.begin()
            if done >= DECAY_START and not stage.pruned:
                stage.pruned = True
                self._end_at_best(far=True)
                population.prune(self.policy.least_gain())
                self.guard.begin()
            if done >= SETTLED_FROM and not stage.settled:
                stage.settled = True
                self._settle()
            if self._shared is not None and stage.exchange_at and done >= stage.exchange_at[0]:
                stage.exchange_at = [at for at in stage.exchange_at if at > done]
                self._shared.exchange(
                    self.state, population.splats, population.target, population.rng
                )
            self._step(done)
        if not stage.settled:  # no time or no steps were left for it
            self._settle()
        self._end_at_best()
        population.keep_in_segments()
        population.drop_undrawable()
        stage.name, self._shared = OVER, None

    def _end_at_best(self, far: bool = False) -> None:
        """Back to the best state of a stage that ends, where the last steps have left it.

        far: only if they left it far behind; what was relocated lately may still pay.
        """
        if not len(self.state) or self.guard.least == math.inf:
            return
        population = self.population
        if self.config.fit.loss == DEFAULT_LOSS:  # without a gradient, in a third of the time
            loss = population.target.loss(population.splats())
        else:
            loss = self._evaluate(population.splats()).loss
        if self.guard.is_worse(loss, far) and (best := self.guard.best()) is not None:
            population.state, self._shared = best

    def _settle(self) -> None:
        """Exponents become those of a file and stay, colours are shared from here on."""
        self._end_at_best()
        population = self.population
        population.settle_segments()
        if self._as_written is not None and len(self.state):
            opaque = self.state.raw_opacity > math.log(_OPAQUE_FROM / (1 - _OPAQUE_FROM))
            self.state.raw_opacity[opaque] = _OPAQUE_LOGIT
            scene = self._as_written(self.scene(), self._recent_psnr())
            population.state = self.state.quantized(scene)
            self._share_colors()
        self.guard.begin()

    def _share_colors(self) -> None:
        self._rates = dataclasses.replace(self._rates, beta=0.0, color=0.0)
        self._shared = SharedColors(self.state, self.population.blending)

    def _snapshot(self, done: float, psnr: Callable[[], float]) -> Snapshot:
        return Snapshot(len(self.state), done, psnr, self.scene)

    def _psnr_now(self) -> float:
        return _decibels(self.population.error())

    def _recent_psnr(self) -> float:
        """Of the last steps, which cost nothing more; they ran on the full picture."""
        return _decibels(float(np.mean(self._errors))) if self._errors else self._psnr_now()

    def _evaluate(self, splats: Splats) -> LossAndGradient:
        options = self.config.fit
        return self.population.target.evaluate(splats, options.loss, options.ssim_weight)

    def _step(self, done: float) -> None:
        """Relocate if it is time, then one step of the optimiser, or back from a bad one."""
        timely = _RELOCATION_FROM < done < _RELOCATION_TO
        timely = timely and self.clock.iteration % _RELOCATION_EVERY == 0
        if timely and self.config.densify.relocate and self.population.relocate():
            self.guard.moved()
        splats = self.population.splats()
        evaluated = self._evaluate(splats)
        if self.guard.accepts(evaluated.loss, evaluated.error, self.state, self._shared):
            self._errors.append(evaluated.error)
            self._move(splats, evaluated, rate(done))
        else:
            self._go_back()
        self.pixel_pairs += evaluated.pairs
        self.clock.iteration += 1
        self._tell(done)

    def _move(self, splats: Splats, evaluated: LossAndGradient, share: float) -> None:
        """One step of the optimiser, of this share of the full size."""
        state, target, blending = self.state, self.population.target, self.population.blending
        price = _BETA_PRICE * evaluated.loss / max(len(state), 1)
        gradient = adam.gradients(evaluated.moments, splats.paint[:, 0], splats.shape[:, 5], price)
        limits = adam.Limits(
            least_sigma=LEAST_SIGMA,
            most_sigma=float(max(target.width, target.height)),
            least_color=blending.least_color,
            most_color=blending.most_color,
        )
        size = self.config.fit.learning_rate * self.guard.rate * share
        if not adam.step(state, gradient, self._rates, limits, size):
            self._go_back()
        elif self._shared is not None:
            self._shared.step(state, gradient, size)

    def _go_back(self) -> None:
        """To the best state, and on from there in smaller steps."""
        best = self.guard.back()
        if best is not None:
            self.population.state, self._shared = best

    def _tell(self, done: float) -> None:
        elapsed = self.clock.elapsed_s
        self._progress(
            FitProgress(
                round=self.population.round_index + 1,
                iteration=self.clock.iteration,
                done=done,
                gaussians=len(self.state),
                psnr=self._recent_psnr() if not self._errors else _decibels(self._errors[-1]),
                elapsed_s=elapsed,
                remaining_s=elapsed / max(done, 0.01) * (1 - done),
            )
        )


def _decibels(error: float) -> float:
    return -10 * math.log10(error) if error > 0 else math.inf
