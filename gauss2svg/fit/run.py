"""A fit under way: rounds of growth, refinement, and changes of the count afterwards."""

from __future__ import annotations

import dataclasses
import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from gauss2svg.falloff import ADAPTIVE
from gauss2svg.fit import adam
from gauss2svg.fit.blending import blending
from gauss2svg.fit.clock import Clock
from gauss2svg.fit.convert import painted
from gauss2svg.fit.options import FitOptions, FitProgress, FitResult
from gauss2svg.fit.order import SegmentAt, SegmentOrder
from gauss2svg.fit.placement import FIRST_RAW_BETA, New, place
from gauss2svg.fit.rules import ADJUST_AT, Rule, Snapshot
from gauss2svg.fit.schedule import DECAY_START, GROWTH_SHARE, SETTLED_FROM, rate, reduction
from gauss2svg.fit.shared import SharedColors
from gauss2svg.fit.state import State
from gauss2svg.fit.target import Views
from gauss2svg.render.cpu import Splats
from gauss2svg.scene import ADD, Scene

AsWritten = Callable[[Scene, float], Scene]

# Under 0.3 px every SVG renderer loses mass: at 0.2 px 85 % of it is drawn, at 0.1 px 35 %.
LEAST_SIGMA = 0.35
# Fainter than this vanishes or is drawn 10 to 60 % wrong on 8-bit canvases.
LEAST_OPACITY = 0.02

# The squared error of flat areas counts up to 1 + this times in the mse loss. At 500
# Gaussians streaks over skies, walls and paper fade; see the ablation in loop.py for its price.
FLAT_WEIGHT = 8.0

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
_RELOCATION_SHARE = 0.08
_RELOCATION_FROM, _RELOCATION_TO = 0.2, 0.75
# Where a fit is taken up again after its count has changed: some relocation, then decay.
_RESUME_AT = 0.6
_STEPS_AVERAGED = 5  # of the PSNR that a rule is told while all are refined


class Run:
    """The Gaussians of one fit, in pixels of the present, perhaps reduced, picture.

    pixels    (h, w, 3) float32 in 0..1
    rule      how many Gaussians; deadline in s of time.perf_counter, or None
    progress  called once an iteration, from this thread
    as_written  the same shapes with the exponents and colours that a file has, from a scene
              and its PSNR in dB; asked for before the last steps, which make up for the loss
    segment_at  the segments by which each round's shapes are ordered, or None
    """

    def __init__(
        self,
        pixels: NDArray[np.float32],
        options: FitOptions,
        rule: Rule,
        deadline: float | None = None,
        progress: Callable[[FitProgress], None] | None = None,
        as_written: AsWritten | None = None,
        segment_at: SegmentAt | None = None,
    ) -> None:
        self.pixels = pixels
        self.options = options
        self.rule = rule
        self.clock = Clock(options.iterations, rule.rounds, deadline, options.round_iterations)
        self.state = State.empty()
        # On 8 bits already, as it will be written: the fit makes up for the rounding.
        self.background = np.round(pixels.mean(axis=(0, 1), dtype=np.float64) * 255) / 255
        self.pixel_pairs = 0
        self._progress = progress or (lambda _: None)
        self._as_written = as_written
        self._order = None if segment_at is None else SegmentOrder(segment_at)
        self._rng = np.random.default_rng(options.seed)
        self._round_index = 0
        self._adopted = False
        self._errors: deque[float] = deque(maxlen=_STEPS_AVERAGED)
        self._reduction = 1
        self._views = Views(pixels, options.dtype, FLAT_WEIGHT)
        self._target = self._views.reduced(1)
        self._manner = blending(options.blend)
        self._rates = self._manner.rates
        self._shared: SharedColors | None = None
        self._wall_s = self._cpu_s = 0.0

    @property
    def rounds(self) -> int:
        """Rounds that added Gaussians."""
        return self._round_index + 1 if len(self.state) else 0

    def fit(self) -> None:
        """Grow and refine until the rule and the clock are content."""
        with self._timed():
            if self._grow():
                total = self.options.iterations
                steps = None if total is None else total - self.clock.iteration
                self._refine(steps, GROWTH_SHARE)

    def adopt(self, scene: Scene, count: int) -> None:
        """Begin with a sum's Gaussians, painted over each other, and as many as make `count`.

        To be called before `fit`, which then only refines them.
        """
        self.state = painted(scene, self._target.planar, self.options)
        self._round_index = int(self.state.round_index.max(initial=0))
        self._adopted = True
        self._change_count(max(count, len(self.state)))

    def trim(self, count: int) -> None:
        """Remove the Gaussians that are missed least from a finished fit, down to `count`."""
        self._change_count(min(count, len(self.state)))

    def resize(self, count: int, iterations: int) -> None:
        """Change the number of Gaussians of a finished fit, and refine them again."""
        with self._timed():
            self._change_count(count)
            if self.options.falloff == ADAPTIVE:
                self.state.raw_beta = np.maximum(self.state.raw_beta, adam.LEAST_RAW_BETA)
            self._refine(iterations, _RESUME_AT, adjusting=False)

    def scene(self) -> Scene:
        """The Gaussians so far, on the whole working canvas."""
        size = self._target.width, self._target.height
        scene = self.state.scene(self.background, *size, self.options.blend)
        height, width = self.pixels.shape[:2]
        if (width, height) == (self._target.width, self._target.height):
            return scene
        return scene.scaled(width / self._target.width, height / self._target.height)

    def result(self) -> FitResult:
        """The scene and the numbers so far."""
        reason = "time_limit" if self.clock.out_of_time else self.rule.stop_reason
        return FitResult(
            scene=self.scene(),
            iterations=self.clock.iteration,
            rounds=self.rounds,
            wall_s=self._wall_s,
            cpu_s=self._cpu_s,
            pixel_pairs=self.pixel_pairs,
            stop_reason=reason,
        )

    @contextmanager
    def _timed(self) -> Iterator[None]:
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        self._wall_s += time.perf_counter() - wall
        self._cpu_s += time.process_time() - cpu

    def _grow(self) -> bool:
        """Rounds of new Gaussians, then the full picture; False if there is nothing to fit."""
        index = 0
        while not self._adopted:
            count = len(self.state)
            total = self.rule.grow(self._snapshot(self.clock.growing(index - 1), self._psnr_now))
            if total <= count:
                self._show_at(1)
                self._change_count(total)
                break
            self._begin(index, total)
            while not self.clock.round_is_over(index):
                self._step(self.clock.growing(index))
            index += 1
        return len(self.state) > 0

    def _refine(self, steps: int | None, done: float, adjusting: bool = True) -> None:
        """All Gaussians move; some are relocated, before the steps get smaller."""
        self.clock.refine(steps, done)
        self._errors.clear()
        pending = list(ADJUST_AT) if adjusting else []
        exchanges = list(_EXCHANGES)
        pruned, settled = not adjusting, False
        self._rates, self._shared = self._manner.rates, None
        while (done := self.clock.refining()) < 1:
            if pending and done >= pending[0]:
                pending = [at for at in pending if at > done]
                self._change_count(self.rule.adjust(self._snapshot(done, self._recent_psnr)))
            if done >= DECAY_START and not pruned:
                pruned = True
                self._prune()
            if done >= SETTLED_FROM and not settled:
                settled = True
                self._settle()
            if self._shared is not None and exchanges and done >= exchanges[0]:
                exchanges = [at for at in exchanges if at > done]
                self._shared.exchange(self.state, self._splats, self._target.planar, self._rng)
            self._step(done)
        if not settled:  # no time or no steps were left for it
            self._settle()
        if self._order is not None:
            self.state = self._order.kept(self.state, self._target.width, self._target.height)
        self._drop_undrawable()

    def _settle(self) -> None:
        """Exponents become those of a file and stay, colours are shared from here on."""
        if self._order is not None:
            self.state = self._order.settle(self.state, self._target.width, self._target.height)
        if self._as_written is not None and len(self.state):
            opaque = self.state.raw_opacity > math.log(_OPAQUE_FROM / (1 - _OPAQUE_FROM))
            self.state.raw_opacity[opaque] = _OPAQUE_LOGIT
            scene = self._as_written(self.scene(), self._recent_psnr())
            self.state = self.state.settled(scene)
            self._rates = dataclasses.replace(self._rates, beta=0.0, color=0.0)
            self._shared = SharedColors(self.state, self._manner)

    def _begin(self, index: int, total: int) -> None:
        """Change to the round's picture and add its Gaussians."""
        height, width = self.pixels.shape[:2]
        self._show_at(reduction(total, width, height) if self.options.reduce else 1)
        self._round_index = index
        self._add(self._target.rendered(self._splats()), total - len(self.state), total)

    def _show_at(self, factor: int) -> None:
        """Go on on a picture of 1 / factor the width and height."""
        if factor == self._reduction:
            return
        before, self._target = self._target, self._views.reduced(factor)
        self._reduction = factor
        self.state = self.state.scaled(
            self._target.width / before.width, self._target.height / before.height
        )

    def _splats(self) -> Splats:
        return self.state.splats(self.background, self.options.blend)

    def _snapshot(self, done: float, psnr: Callable[[], float]) -> Snapshot:
        return Snapshot(len(self.state), done, psnr, self.scene)

    def _psnr_now(self) -> float:
        """PSNR on the whole working picture, also where a round ran on a reduced one."""
        factor = self._reduction
        self._show_at(1)
        error = self._target.error(self._splats())
        self._show_at(factor)
        return _decibels(error)

    def _recent_psnr(self) -> float:
        """Of the last steps, which cost nothing more; they ran on the full picture."""
        return _decibels(float(np.mean(self._errors))) if self._errors else self._psnr_now()

    def _change_count(self, count: int) -> None:
        """Remove the Gaussians that are missed least, or add some where the error is."""
        surplus = len(self.state) - count
        if surplus > 0:
            _, cost = self._target.removal_cost(self._splats())
            kept = np.argsort(cost[:, 0], kind="stable")[surplus:]
            self.state = self.state.select(np.sort(kept))
        elif surplus < 0:
            self._add(self._target.rendered(self._splats()), -surplus, count)

    def _add(self, rendered: NDArray[np.floating], count: int, total: int) -> None:
        new = place(
            self.options.placement, self._target, rendered, count, total, self._rng,
            self._manner,
        )  # fmt: skip
        opacity = np.full(count, self._manner.first_opacity_logit)
        raw_beta = np.full(count, FIRST_RAW_BETA if self.options.falloff == ADAPTIVE else 0.0)
        color = new.color
        if self._manner.additive:
            color = color / self._crowd(new)[:, None]
        self.state = self.state.append(
            new.mean, new.factor, opacity, color, raw_beta, self._round_index
        )
        if self._order is not None:  # from the start, so that the fit makes up for it
            self.state = self._order.arranged(self.state, self._target.width, self._target.height)

    def _crowd(self, new: New) -> NDArray[np.float64]:
        """(n,) sum of all new falloffs at each new mean, at least 1.

        New Gaussians that overlap share what is missing there: if each added all of it, sums
        would overshoot, which draws more of them to the place, and the fit would run away.
        """
        alone = State.empty().append(
            new.mean, new.factor, np.zeros(len(new.mean)), np.ones((len(new.mean), 3)),
            np.zeros(len(new.mean)), 0,
        )  # fmt: skip
        target = self._target
        summed = target.rendered(alone.splats(np.zeros(3), ADD))[0]
        x, y = np.clip(new.mean.astype(np.intp), 0, [target.width - 1, target.height - 1]).T
        return np.maximum(summed[y, x].astype(np.float64), 1.0)

    def _step(self, done: float) -> None:
        """Relocate if it is time, then one step of the optimiser."""
        timely = _RELOCATION_FROM < done < _RELOCATION_TO
        if self.options.relocate and timely and self.clock.iteration % _RELOCATION_EVERY == 0:
            self._relocate()
        splats = self._splats()
        target = self._target
        judged = target.judged(splats, self.options.loss, self.options.ssim_weight)
        price = _BETA_PRICE * judged.loss / max(len(self.state), 1)
        gradient = adam.gradients(judged.moments, splats.paint[:, 0], splats.shape[:, 5], price)
        limits = adam.Limits(
            least_sigma=LEAST_SIGMA,
            most_sigma=float(max(target.width, target.height)),
            least_color=self._manner.least_color,
            most_color=self._manner.most_color,
        )
        adam.step(self.state, gradient, self._rates, limits, rate(done))
        if self._shared is not None:
            self._shared.step(self.state, gradient, rate(done))
        self.pixel_pairs += judged.pairs
        self._errors.append(judged.error)
        self.clock.iteration += 1
        elapsed = self.clock.elapsed_s
        self._progress(
            FitProgress(
                round=self._round_index + 1,
                iteration=self.clock.iteration,
                done=done,
                gaussians=len(self.state),
                psnr=_decibels(self._errors[-1]),
                elapsed_s=elapsed,
                remaining_s=elapsed / max(done, 0.01) * (1 - done),
            )
        )

    def _relocate(self) -> None:
        """Move the Gaussians that would be missed least to where the error is."""
        rendered, cost = self._target.removal_cost(self._splats())
        total = len(self.state)
        count = int(_RELOCATION_SHARE * total)
        if count:
            kept = np.sort(np.argsort(cost[:, 0], kind="stable")[count:])
            self.state = self.state.select(kept)
            if self._manner.additive:  # the sum of those gone may be missed more than each
                rendered = self._target.rendered(self._splats())
            self._add(rendered, count, total)

    def _prune(self) -> None:
        """Drop what is worth less than the rule asks for: all at once, measured in one pass."""
        least = self.rule.least_gain()
        if least == -math.inf or not len(self.state):
            return
        rendered, cost = self._target.removal_cost(self._splats())
        error = float(np.sum(np.square(rendered - self._target.planar), dtype=np.float64))
        # Taking one away turns the error e into e + cost: 10 log10(1 + cost / e) dB.
        worth = error * (10 ** (least / 10) - 1)
        self.state = self.state.select(cost[:, 0] > worth)

    def _drop_undrawable(self) -> None:
        """Drop what renderers would not draw: too faint, or nothing of it on the canvas."""
        splats = self._splats()
        _, cost = self._target.removal_cost(splats)
        self.state = self.state.select((splats.paint[:, 0] >= LEAST_OPACITY) & (cost[:, 1] > 0))


def _decibels(error: float) -> float:
    return -10 * math.log10(error) if error > 0 else math.inf
