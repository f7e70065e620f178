"""The Gaussians of a fit on the current target, and how they are added, relocated and pruned.

An alpha-composited fit can begin with an additive scene, so that every renderer draws the result.
Additive Gaussians have no order and no opacity. The fit begins with the largest at the bottom, each
in the target's colour at its mean, and keeps their position, size and direction at first
(docs/decisions/fit.md).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit import FitConfig, FitOptions, adam
from gauss2svg.fit.adam import OPAQUE_LOGIT, blending_of
from gauss2svg.fit.colors import Inks, SharedColors
from gauss2svg.fit.placement import NewGaussians, first_raw_betas, place
from gauss2svg.fit.schedule import enlarged_reduction, reduction, refinement_reduction, totals
from gauss2svg.fit.state import State
from gauss2svg.fit.target import LossAndGradient, Target, TargetPyramid, psnr_of
from gauss2svg.photo.pixels import has_alpha
from gauss2svg.render.cpu import Splats
from gauss2svg.scene import ADD, PLAIN, SOFT, Scene
from gauss2svg.scene.inks import ink_colors, inks_of
from gauss2svg.scene.scene import LEAST_RAW_BETA

# Least opacity of a finished fit. Fainter shapes vanish on 8-bit canvases, or renderers draw them
# with errors of 10 to 60 % (docs/decisions/renderers.md).
LEAST_OPACITY = 0.02
RELOCATED = 0.08  # share of the Gaussians that a relocation moves (docs/decisions/fit.md)
# Each unit of ln beta must lower the loss by this share of the mean loss per Gaussian. So a shape
# stays a Gaussian if another exponent gains nothing (docs/decisions/fit.md).
BETA_PRICE = 0.06
# Opacity above which a shape becomes opaque, which saves bytes (docs/decisions/fit.md).
OPAQUE_FROM = 0.953
# The optical flow that moves the shapes of a scene to another picture (docs/decisions/refine.md).
FLOW_REDUCTION = 2  # divisor of the picture's width and height
FLOW = {"radius": 15, "num_warp": 4}  # px of the windows, number of refinements of the flow

AsWritten = Callable[[Scene, float], Scene]  # scene and its PSNR (dB) -> scene of its file
Backup = tuple[State, SharedColors | None]


class Population:
    """The Gaussians of a fit, in px of the current target, and how they change.

    pixels   (h, w, 3) float32 in 0..1, or (h, w, 4) with alpha
    targets  TargetPyramid of these pixels if the caller has one
    shared   colours that shapes share in the last steps; None before these steps
    """

    def __init__(
        self,
        pixels: NDArray[np.float32],
        config: FitConfig,
        targets: TargetPyramid | None = None,
    ) -> None:
        self.config = config
        self.blending = blending_of(config.fit, config.opaque)
        self.state = State.of(np.zeros((0, 2)), np.zeros((0, 3)), 0)
        self.shared: SharedColors | None = None
        self.round_index = 0
        self.rng = np.random.default_rng(config.fit.seed)
        self._photo = self._pyramid = targets or TargetPyramid(pixels, config.fit.tuned)
        self.inks: Inks | None = None
        if config.fit.inks is not None:
            inks: Any = config.fit.inks  # check_inks has checked them
            self.inks = Inks(ink_colors(inks_of(pixels, inks)))
            focus = self._photo.focus
            self._pyramid = TargetPyramid(
                pixels, config.fit.tuned, transform=self.inks.inked, focus=focus
            )
        self.reduction = 1
        self.target = self._pyramid.reduced(1)
        # The background is rounded to 8 bits as in the file, so that the fit corrects the rounding.
        self.background = np.round(pixels.mean(axis=(0, 1), dtype=np.float64) * 255) / 255
        if has_alpha(pixels):
            self.background = np.ones(3)  # white; the file has no background
        elif self.inks is not None:
            self.background = self.inks.background(self.target)

    def __len__(self) -> int:
        return len(self.state)

    def splats(self) -> Splats:
        """Return the Gaussians as the kernels read them."""
        return self.state.splats(self.background, self.config.fit.blend)

    def rendered(self) -> NDArray[np.floating]:
        """Return the render of the Gaussians, in the shape of target.planar."""
        return self.target.rendered(self.splats())

    def scene(self) -> Scene:
        """Return the Gaussians on the working canvas."""
        size = self.target.width, self.target.height
        scene = self.state.scene(self.background, *size, self.config.fit.blend)
        if self.target.is_transparent:
            scene = scene.replace(transparent=True)
        if self.inks is not None:  # the logits give only nearly 1
            scene = scene.replace(opacity=np.ones(len(scene)))
        height, width = self._pyramid.pixels.shape[:2]
        if (width, height) == size:
            return scene
        return scene.scaled(width / size[0], height / size[1])

    def psnr(self) -> float:
        """Return the PSNR in dB against the photo at full size, even if the target is reduced."""
        photo = self._photo.reduced(1)
        factors = photo.width / self.target.width, photo.height / self.target.height
        state = self._with_crisp_rims(self.state.scaled(*factors))
        return psnr_of(photo.error(state.splats(self.background, self.config.fit.blend)))

    def error_of(self, evaluated: LossAndGradient) -> float:
        """Return the mean squared error of evaluated renders against the photo, not its inks."""
        if self.inks is None:
            return evaluated.error
        return self._photo.reduced(self.reduction).error_of(evaluated.rendered)

    def evaluate(self, splats: Splats, at_both_sizes: bool = False) -> LossAndGradient:
        """Return the loss and its gradient.

        at_both_sizes: whether to average both over the enlarged and the original picture.
        """
        options, times = self.config.fit, self.config.enlarged
        evaluated = self.target.evaluate(splats, options.loss, options.ssim_weight)
        if not at_both_sizes or times == 1:
            return evaluated
        splats = self.state.scaled(1 / times, 1 / times).splats(self.background, options.blend)
        own = self._pyramid.reduced(times).evaluate(splats, options.loss, options.ssim_weight)
        # Gradients are in each shape's own frame, so those of both sizes can be added.
        return evaluated._replace(
            loss=(evaluated.loss + times**2 * own.loss) / 2,
            moments=(evaluated.moments + times**2 * own.moments) / 2,
            pairs=evaluated.pairs + own.pairs,
        )

    def backup(self) -> Backup:
        """Return a copy of the state and of the shared colours, for `restore`."""
        return self.state.copy(), copy(self.shared)

    def restore(self, backup: Backup) -> None:
        """Restore the state and the shared colours that backup() returned."""
        self.state, self.shared = backup[0].copy(), copy(backup[1])

    def step(self, splats: Splats, evaluated: LossAndGradient, rate: float) -> bool:
        """Take an Adam step; `rate` multiplies learning rates. Return whether all were finite."""
        share = evaluated.loss / max(len(self), 1)
        gradient = adam.gradients(evaluated.moments, splats, BETA_PRICE * share)
        most_sigma = float(max(self.target.width, self.target.height))
        blending = self.blending if self.shared is None else self.blending.sharing
        finite = adam.step(self.state, gradient, blending, most_sigma, rate)
        if finite and self.shared is not None:
            self.shared.step(self.state, gradient, rate)
        self._with_crisp_rims(self.state)
        return finite

    def reduce_to(self, factor: int, scale_moments: bool = False) -> None:
        """Change to the target of 1 / factor of the width and height. Scale the Gaussians.

        scale_moments: whether Adam's moments are scaled like gradients, which are sums over pixels.
        Scaling pays only in refinement (docs/decisions/few.md).
        """
        if factor == self.reduction:
            return
        area = (self.reduction / factor) ** 2 if scale_moments else 1.0
        before, self.target = self.target, self._pyramid.reduced(factor)
        self.reduction = factor
        factors = self.target.width / before.width, self.target.height / before.height
        self.state = state = self._with_crisp_rims(self.state.scaled(*factors))
        state.adam_m, state.adam_v = state.adam_m * area, state.adam_v * area**2

    def reduction_of_round(self, total: int) -> int:
        """Return the factor by which the target is reduced in a round up to `total` Gaussians."""
        height, width = self._pyramid.pixels.shape[:2]
        if self.config.enlarged > 1:
            return enlarged_reduction(0.0, width, height)
        return reduction(total, width, height) if self.config.reduce else 1

    def reduction_at(self, done: float) -> int:
        """Return the factor by which the target is reduced at progress `done` of refinement.

        It is 1 if config.gaussians is 0. A policy then decides the count by errors at full size.
        """
        if self.config.enlarged > 1:
            return enlarged_reduction(done, *self._pyramid.pixels.shape[1::-1])
        if not (self.config.reduce and self.config.gaussians):
            return 1
        height, width = self._pyramid.pixels.shape[:2]
        return refinement_reduction(done, len(self), width, height)

    def adopt(self, scene: Scene) -> None:
        """Replace the Gaussians by those of an additive scene, alpha-composited."""
        self.state = composited(scene, self.target, self.config.fit)
        self.round_index = int(self.state.round_index.max(initial=0))

    def begin_with(self, scene: Scene) -> None:
        """Begin with the shapes of a scene, scaled to the target, moved if that is closer to it.

        The optical flow from the scene's render to the target moves each shape.
        """
        from skimage.registration import optical_flow_ilk  # slow to import, seldom needed

        target, small = self.target, self._pyramid.reduced(FLOW_REDUCTION)
        if self.inks is None and not (scene.transparent or target.is_transparent):
            self.background = np.round(scene.background * 255) / 255
        self.round_index = int(scene.round_index.max(initial=0))
        size = small.width, small.height
        state = State.of_scene(scene.scaled(size[0] / scene.width, size[1] / scene.height))
        if not self.config.fit.learned_falloff:
            state.raw_beta[:], state.drawn[:] = 0.0, SOFT
        pictures = small.rendered(state.splats(self.background)), small.planar
        # A row and a column more, because the flow of a single one is not defined.
        grey = (np.pad(picture.mean(axis=0), (0, 1), "edge") for picture in pictures)
        flow = optical_flow_ilk(*grey, **FLOW)
        x, y = np.clip(state.mean.astype(np.intp), 0, np.array(size) - 1).T
        moved = dataclasses.replace(state, mean=state.mean + flow[::-1, y, x].T)
        factors = target.width / size[0], target.height / size[1]
        states = [self._inked(one.scaled(*factors)) for one in (state, moved)]
        self.state = min(states, key=lambda one: target.error(one.splats(self.background)))

    def densify_or_prune(self, count: int) -> None:
        """Add Gaussians where the error is, or remove the least useful, until there are `count`."""
        surplus = len(self) - count
        if surplus > 0:
            _, cost = self.target.removal_cost(self.splats())
            keep = np.argsort(cost[:, 0], kind="stable")[surplus:]
            self.state = self.state.select(np.sort(keep))
        elif surplus < 0:
            self._add(self.rendered(), -surplus, count)

    def relocate(self) -> bool:
        """Move the least useful Gaussians to where the error is; return whether any moved."""
        rendered, cost = self.target.removal_cost(self.splats())
        total = len(self)
        count = int(RELOCATED * total)
        if not count:
            return False
        keep = np.sort(np.argsort(cost[:, 0], kind="stable")[count:])
        self.state = self.state.select(keep)
        if self.config.fit.blend == ADD:  # removing several may cost more than the sum of costs
            rendered = self.rendered()
        self._add(rendered, count, total)
        return True

    def prune(self, least: float) -> None:
        """Remove each Gaussian whose removal costs at most `least` dB of weighted PSNR."""
        if least == -math.inf or not len(self):
            return
        rendered, cost = self.target.removal_cost(self.splats())
        error = self.target.weighted_squares(rendered)
        # Removal turns the error e into e + cost, so a Gaussian gains 10 log10(1 + cost / e) dB.
        least_cost = error * (10 ** (least / 10) - 1)
        self.state = self.state.select(cost[:, 0] > least_cost)

    def prune_invisible(self) -> None:
        """Remove Gaussians that do not show: too faint, covered, or off the canvas.

        On a target with alpha, also remove haze: Gaussians that do not lower the error.
        """
        splats = self.splats()
        _, cost = self.target.removal_cost(splats)
        keep = (splats.opacity >= LEAST_OPACITY) & (cost[:, 1] > 0)
        if self.target.is_transparent:
            keep &= cost[:, 0] > 0
        self.state = self.state.select(keep)

    def quantize(self, as_written: AsWritten, psnr: float) -> None:
        """Set exponents and colours to the file's, and high opacities to 1. Share the colours."""
        least = math.log(OPAQUE_FROM / (1 - OPAQUE_FROM))
        self.state.raw_opacity[self.state.raw_opacity > least] = OPAQUE_LOGIT
        self.state = self._with_crisp_rims(self.state.quantized(as_written(self.scene(), psnr)))
        if self.inks is None:
            self.shared = SharedColors.of(self.state, self.blending)

    def soften(self) -> None:
        """After `quantize`, let exponents be learned again, and let files draw shapes softly."""
        if self.config.fit.learned_falloff:
            self.state.raw_beta = np.maximum(self.state.raw_beta, LEAST_RAW_BETA)
            self.state.drawn[:] = SOFT

    def exchange(self, choices: SharedColors | Inks | None) -> None:
        """Let shapes change to their best shared colour or ink if this lowers the error.

        Overlapping shapes that change together may overshoot. Then only half of the shapes change,
        or none.
        """
        if choices is None or not len(self):
            return
        current = choices.current(self.state)
        before, moments = self.target.squares(self.splats())
        mass = self.target.removal_cost(self.splats())[1][:, 1]
        best = choices.best(self.state, moments, mass)
        changes = self.rng.random(len(current)) < 0.5
        half = np.where(changes if current.ndim == 1 else changes[:, None], best, current)
        for choice in (best, half):
            choices.assign(self.state, choice)
            if self.target.squares(self.splats())[0] < before:
                return
        choices.assign(self.state, current)

    def _with_crisp_rims(self, state: State) -> State:
        """In a fit to inks, set the exponents of crisp rims in the state. Return the state."""
        if self.inks is not None:
            state.raw_beta = self.inks.crisp_raw_betas(state.factor)
        return state

    def _inked(self, state: State) -> State:
        """In a fit to inks, make the shapes of the state opaque and of inks. Return the state."""
        if self.inks is not None:
            state.color, state.drawn[:] = self.inks.nearest(state.color), PLAIN
            state.raw_opacity[:] = OPAQUE_LOGIT
        return self._with_crisp_rims(state)

    def _add(self, rendered: NDArray[np.floating], count: int, total: int) -> None:
        if self.inks is not None:
            rendered = self.inks.reducible(self.target, rendered)
        additive = self.config.fit.blend == ADD
        new = place(
            self.config.densify.init, self.target, rendered, count, total, self.rng, additive
        )
        opacity = self.target.opacity_logits(new.mean, self.blending.initial_opacity_logit)
        color = new.color
        if additive:
            color = color / self._overlap(new)[:, None]
        added = State.of(
            new.mean, new.factor, self.round_index,
            raw_opacity=opacity, color=color, raw_beta=first_raw_betas(count, self.config.fit),
        )  # fmt: skip
        self.state = self.state.append(self._inked(added))

    def _overlap(self, new: NewGaussians) -> NDArray[np.float64]:
        """Return the sum (n,) of all new falloffs at each new mean, at least 1.

        New additive Gaussians that overlap share the residual. If each added the whole residual,
        they would overshoot and attract more Gaussians, and the fit would diverge.
        """
        alone = State.of(new.mean, new.factor, 0, color=np.ones((len(new.mean), 3)))
        target = self.target
        total = target.rendered(alone.splats(np.zeros(3), ADD))[0]
        x, y = np.clip(new.mean.astype(np.intp), 0, [target.width - 1, target.height - 1]).T
        return np.maximum(total[y, x].astype(np.float64), 1.0)


def composited(scene: Scene, target: Target, options: FitOptions) -> State:
    """Return the initial state of an alpha-composited fit to target, from an additive scene.

    options: those of the fit. New rounds, with the largest Gaussians first, replace the scene's
    rounds. Gaussians whose mean lies on an invisible pixel of the target are left out.
    """
    height, width = target.height, target.width
    scene = scene.scaled(width / scene.width, height / scene.height)
    order = np.argsort(-scene.sigma.prod(axis=1) * np.sqrt(1 - scene.rho**2), kind="stable")
    mean, factor = scene.mean[order], scene.factor[order]
    x, y = np.clip(mean.astype(np.intp), 0, [width - 1, height - 1]).T
    if target.visible is not None:
        visible = target.visible[y, x]
        mean, factor, x, y = mean[visible], factor[visible], x[visible], y[visible]
    count = len(mean)
    state = State.of(
        mean,
        np.stack([factor[:, 0, 0], factor[:, 1, 0], factor[:, 1, 1]], axis=1),
        0,
        raw_opacity=target.opacity_logits(mean, adam.INITIAL_OPACITY_LOGIT),
        color=target.source_color[:, y, x].T.astype(np.float64),
        raw_beta=first_raw_betas(count, options),
    )
    rounds = totals("exponential", count, None)[:-1]
    state.round_index = np.searchsorted(rounds, np.arange(count), side="right").astype(np.int32)
    return state
