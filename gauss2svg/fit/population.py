"""The Gaussians of a fit on the current target, and how they are added, relocated and pruned.

An alpha-composited fit can begin with the Gaussians of an additive scene, to convert the scene to
shapes that every renderer draws. Additive Gaussians have no order and no opacity. So the fit puts
the largest Gaussian at the bottom, and gives each Gaussian the target's colour at its mean. Their
positions, sizes and directions start as in the additive scene (docs/decisions/fit.md).
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.core import Floats, Reals
from gauss2svg.fit import ADAPTIVE, DEFAULT_LOSS, FitConfig
from gauss2svg.fit.colors import InkColors, best_colors
from gauss2svg.fit.placement import FIRST_RAW_BETA, NewGaussians, place
from gauss2svg.fit.schedule import ROUNDS, doubled, reduction, refinement_reduction
from gauss2svg.fit.state import COLUMNS, LEAST_FITTED_SIGMA, OPAQUE_LOGIT, State, columns_of, step
from gauss2svg.fit.target import LossAndGradient, Target, joined
from gauss2svg.photo.pixels import has_alpha, psnr_of
from gauss2svg.render.cpu import Splats
from gauss2svg.scene import ADD, PLAIN, SOFT, Scene
from gauss2svg.scene.inks import ink_colors, inks_of
from gauss2svg.scene.scene import LEAST_RAW_BETA

# Least opacity of a shape in a finished fit. Renderers that composite in 8 bits omit fainter shapes
# or draw them with errors of 10 to 60 % (docs/decisions/renderers.md).
LEAST_OPACITY = 0.02
# Least semi-axis in px above areas, in place of LEAST_FITTED_SIGMA. Smaller shapes draw what the
# outlines miss of single pixels, which makes an enlarged drawing worse (docs/decisions/areas.md).
LEAST_SIGMA_ABOVE_AREAS = 0.8
INITIAL_OPACITY_LOGIT = 1.0  # logit of the opacity of a new shape (docs/decisions/fit.md)

# A function that takes a scene and its PSNR in dB, and returns the scene as its file would hold it.
AsWritten = Callable[[Scene, float], Scene]


class Population:
    """The Gaussians of a fit, in px of the current target, with the methods that change them.

    photo    target of the photo at full size
    shared   (n,) during the last steps, the same number for shapes that share a colour and an
             exponent, else None. Shared colours take the step of the sum of their gradients, which
             regains part of the PSNR that a palette of colours costs (docs/decisions/palette.md)
    """

    def __init__(self, photo: Target, config: FitConfig) -> None:
        self.config = config
        columns = columns_of(config.fit, config.opaque)
        # Without a rate, the opacity keeps its first value.
        has_rate = columns[COLUMNS["opacity"], 0].all()
        self._first_raw_opacity = INITIAL_OPACITY_LOGIT if has_rate else OPAQUE_LOGIT
        self._first_raw_beta = FIRST_RAW_BETA if config.fit.shaped == ADAPTIVE else 0.0
        self.state = State.of(np.zeros((0, 2)), np.zeros((0, 3)), 0)
        self.shared: NDArray[np.intp] | None = None
        self.round_index = 0
        self.rng = np.random.default_rng(config.fit.seed)
        self._photo = self.target = photo
        pixels, self._least_sigma = photo.pixels, LEAST_FITTED_SIGMA
        # The background is rounded to 8 bits, because it is rounded in the file too. So the fit can
        # make up for the rounding error.
        self.background = np.round(pixels.mean(axis=(0, 1), dtype=np.float64) * 255) / 255
        self.inks: InkColors | None = None
        if config.fit.inks is not None:
            inks: Any = config.fit.inks  # already checked by check_inks
            self.inks = InkColors(ink_colors(inks_of(pixels, inks)))
            tune, transform = config.fit.tuned, self.inks.inked
            self.target = Target(pixels, tune, transform=transform, mask=photo.mask)
            self.background = self.inks.background(self.target)
        if has_alpha(pixels):
            # The file of a picture with alpha has no background. But every scene must have one, so
            # it is white.
            self.background = np.ones(3)
        self._whole, self.reduction, self._ground = self.target, 1, photo.ground
        if self._ground is not None:
            self.background = self._ground.background
            self._least_sigma = LEAST_SIGMA_ABOVE_AREAS

    def __len__(self) -> int:
        return len(self.state)

    def splats(self) -> Splats:
        """Return the Gaussians as the arrays that the kernels read."""
        return self.state.splats(self.background, self.config.fit.blend)

    def rendered(self) -> Reals:
        """Return the render of the Gaussians, an array of the shape of target.planar."""
        return self.target.rendered(self.splats())

    def scene(self) -> Scene:
        """Return the Gaussians on the working canvas."""
        size = self.target.width, self.target.height
        scene = self.state.scene(self.background, *size, self.config.fit.blend)
        if self.target.is_transparent:
            scene = scene.replace(transparent=True)
        # All shapes of a fit to inks are opaque, but a logit always stands for an opacity slightly
        # below 1. So set the opacities to 1.
        if self.inks is not None:
            scene = scene.replace(opacity=np.ones(len(scene)))
        width, height = self._whole.width, self._whole.height
        if (width, height) != size:
            scene = scene.scaled(width / size[0], height / size[1])
        if (ground := self._ground) is None:
            return scene
        ground = ground.scaled(width / ground.width, height / ground.height)
        return ground.replace(width=scene.width, height=scene.height).concatenate(scene)

    def psnr(self) -> float:
        """Return the PSNR in dB against the photo.

        It is measured at the full size of the photo, even if the current target is smaller.
        """
        photo = self._photo
        factors = photo.width / self.target.width, photo.height / self.target.height
        state = self._with_crisp_rims(self.state.scaled(*factors))
        splats = state.splats(self.background, self.config.fit.blend)
        return psnr_of(photo.error_of(photo.rendered(splats)))

    def error_of(self, evaluated: LossAndGradient) -> float:
        """Return the mean squared error between the photo and the renders in `evaluated`.

        In a fit to inks, this is not evaluated.error, which is the error between the picture in
        inks and the renders.
        """
        if self.inks is None:
            return evaluated.error
        return self._photo.reduced(self.reduction).error_of(joined(evaluated.rendered))

    def evaluate(self, splats: Splats) -> LossAndGradient:
        """Return the loss of the Gaussians and its gradient."""
        return self.target.evaluate(splats, self.config.fit.loss)

    def step(self, splats: Splats, evaluated: LossAndGradient, rate: float) -> bool:
        """Take an Adam step. Return whether the steps of all Gaussians were finite.

        rate: factor by which all learning rates are multiplied.
        """
        # A shape stays a Gaussian if another exponent gains nothing: a unit of ln beta must lower
        # the loss by 0.06 of a Gaussian's share of it (docs/decisions/fit.md).
        price = 0.06 * (evaluated.loss / max(len(self), 1))
        most_sigma = float(max(self.target.width, self.target.height))
        columns = columns_of(self.config.fit, self.config.opaque, self.shared is not None)
        moments = evaluated.moments
        if self.shared is not None:
            color = moments[:, COLUMNS["color"]]
            sums = [np.bincount(self.shared, column) for column in color.T]
            color[:] = np.stack(sums, axis=1)[self.shared]
        finite = step(
            self.state, moments, splats, columns, most_sigma, price, rate, self._least_sigma
        )
        self._with_crisp_rims(self.state)
        return finite

    def reduce_to(self, factor: int, scale_moments: bool = False) -> None:
        """Change to a target with 1 / factor of the full width and height, and scale the Gaussians.

        scale_moments: whether to scale Adam's moments too.

        Gradients are sums over pixels, so they are smaller on a smaller target. If the moments
        are scaled too, they match the new gradients. This improves the result in refinement but
        not in growth (docs/decisions/few.md).
        """
        if factor == self.reduction:
            return
        area = (self.reduction / factor) ** 2 if scale_moments else 1.0
        before, self.target = self.target, self._whole.reduced(factor)
        self.reduction = factor
        factors = self.target.width / before.width, self.target.height / before.height
        self.state = state = self._with_crisp_rims(self.state.scaled(*factors))
        state.adam_m, state.adam_v = state.adam_m * area, state.adam_v * area**2

    def reduction_of_round(self, total: int) -> int:
        """Return the factor by which the target is reduced in a round of growth.

        total: number of Gaussians at the end of the round.
        """
        return reduction(total, self._whole.width, self._whole.height) if self.config.reduce else 1

    def reduction_at(self, done: float) -> int:
        """Return the factor by which the target is reduced in refinement, at progress `done`.

        refinement_reduction gives the factor, except in two cases in which it is 1. The first case
        is that config.reduce is False. The second is that config.gaussians is 0: then a policy
        decides the number of Gaussians, and the policy needs the errors at full size.
        """
        if not (self.config.reduce and self.config.gaussians):
            return 1
        return refinement_reduction(done, len(self), self._whole.width, self._whole.height)

    def adopt(self, scene: Scene) -> None:
        """Convert an additive scene to alpha-composited Gaussians, with which the fit begins.

        Gaussians whose mean lies on an invisible pixel of the target are left out. The others are
        sorted from the largest, which is at the bottom, to the smallest. They get new round numbers
        in this order: the largest ones belong to the first round.
        """
        target = self.target
        width, height = target.width, target.height
        scene = scene.scaled(width / scene.width, height / scene.height)
        order = np.argsort(-scene.sigma.prod(axis=1) * np.sqrt(1 - scene.rho**2), kind="stable")
        x, y = np.clip(scene.mean[order].astype(np.intp), 0, [width - 1, height - 1]).T
        if target.visible is not None:
            visible = target.visible[y, x]
            order, x, y = order[visible], x[visible], y[visible]
        self.state = State.of(
            scene.mean[order], scene.cholesky[order], 0,
            raw_opacity=target.opacity_logits(scene.mean[order], INITIAL_OPACITY_LOGIT),
            color=target.source_color[:, y, x].T.astype(np.float64), raw_beta=self._first_raw_beta,
        )  # fmt: skip
        rounds, numbers = doubled(len(order), ROUNDS), np.arange(len(order))
        self.state.round_index[:] = np.searchsorted(rounds, numbers, side="right")
        self.round_index = int(self.state.round_index.max(initial=0))

    def begin_with(self, scene: Scene) -> None:
        """Begin with the shapes of a scene, scaled to the size of the target.

        The optical flow from the scene's render to the target says how far each shape should move.
        The shapes are moved by it only if this lowers the error.
        """
        from skimage.registration import optical_flow_ilk  # slow to import, seldom needed

        target, small = self.target, self._whole.reduced(2)
        if self.inks is None and not (scene.transparent or target.is_transparent):
            self.background = np.round(scene.background * 255) / 255
        self.round_index = int(scene.round_index.max(initial=0))
        size = small.width, small.height
        state = State.of_scene(scene.scaled(size[0] / scene.width, size[1] / scene.height))
        if self.config.fit.shaped != ADAPTIVE:
            state.raw_beta[:], state.drawn[:] = 0.0, SOFT
        pictures = small.rendered(state.splats(self.background)), small.planar
        # optical_flow_ilk needs at least two rows and two columns. So the last row and the last
        # column are repeated.
        grey = (np.pad(picture.mean(axis=0), (0, 1), "edge") for picture in pictures)
        flow = optical_flow_ilk(*grey, radius=15, num_warp=4)  # docs/decisions/refine.md
        x, y = np.clip(state.mean.astype(np.intp), 0, np.array(size) - 1).T
        moved = dataclasses.replace(state, mean=state.mean + flow[::-1, y, x].T)
        factors = target.width / size[0], target.height / size[1]
        states = [self._inked(one.scaled(*factors)) for one in (state, moved)]
        errors = [target.error_of(target.rendered(s.splats(self.background))) for s in states]
        self.state = states[int(np.argmin(errors))]

    def densify_or_prune(self, count: int) -> None:
        """Change the number of Gaussians to `count`.

        New Gaussians are added where the error is large. Surplus Gaussians are removed, the least
        useful first. The others keep the colours that they share.
        """
        surplus = len(self) - count
        if surplus > 0:
            self._remove(surplus)
            if self.shared is not None:
                self._share()
        elif surplus < 0:
            self._add(self.rendered(), -surplus, count)

    def relocate(self) -> bool:
        """Move the least useful Gaussians to where the error is large. Return whether any moved."""
        total = len(self)
        count = int(0.08 * total)  # docs/decisions/fit.md
        if not count:
            return False
        rendered = self._remove(count)
        # With additive blending, removing several Gaussians may raise the error by more than the
        # sum of their costs, so the remaining Gaussians are rendered anew.
        if self.config.fit.blend == ADD:
            rendered = self.rendered()
        self._add(rendered, count, total)
        return True

    def _remove(self, count: int) -> Reals:
        """Remove the `count` least useful Gaussians. Return the render with them."""
        rendered, cost = self.target.removal_cost(self.splats())
        keep = np.argsort(cost[:, 0], kind="stable")[count:]
        self.state = self.state.select(np.sort(keep))
        return rendered

    def prune(self, least: float) -> None:
        """Remove each Gaussian that raises the weighted PSNR by at most `least` dB.

        This gain is computed for each Gaussian as if it were the only one to be removed.
        """
        if least == -math.inf or not len(self):
            return
        rendered, cost = self.target.removal_cost(self.splats())
        error = self.target.weighted_squares(rendered)
        # If a Gaussian were removed, the error e would become e + cost. So this Gaussian raises the
        # PSNR by 10 log10(1 + cost / e) dB.
        least_cost = error * (portable.power(10, least / 10) - 1)
        self.state = self.state.select(cost[:, 0] > least_cost)

    def prune_invisible(self) -> None:
        """Remove Gaussians that cannot be seen: too faint, covered by others, or off the canvas.

        If the target has alpha, also remove Gaussians that do not lower the error, because they
        would be visible as haze.
        """
        splats = self.splats()
        _, cost = self.target.removal_cost(splats)
        keep = (splats.opacity_color[:, 0] >= LEAST_OPACITY) & (cost[:, 1] > 0)
        if self.target.is_transparent:
            keep &= cost[:, 0] > 0
        self.state = self.state.select(keep)

    def quantize(self, as_written: AsWritten, psnr: float) -> None:
        """Give the Gaussians the values that the file will hold, before the last steps of the fit.

        Opacities above 0.953 become 1, because opaque shapes take fewer bytes
        (docs/decisions/fit.md), and exponents and colours become those of the file. From here on,
        shapes share the colours of the file, except in a fit to inks.

        as_written  function that returns the scene as its file would hold it
        psnr        PSNR of the present scene in dB, which `as_written` needs
        """
        least = portable.log(0.953 / (1 - 0.953))
        self.state.raw_opacity[self.state.raw_opacity > least] = OPAQUE_LOGIT
        written = as_written(self.scene(), psnr)
        # The shapes of the ground are first.
        written = written.select(slice(len(written) - len(self), None))
        self.state = self._with_crisp_rims(self.state.quantized(written))
        if self.inks is None:
            self._share()

    def _share(self) -> None:
        """Let shapes of the same colour and exponent share them from now on."""
        keys = np.column_stack([self.state.color, self.state.raw_beta])
        self.shared = np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)
        self.state.age[:] = self.state.age.max(initial=0)  # so that all take the same step

    def soften(self) -> None:
        """Undo the limits that `quantize` has set, so that the fit can be continued.

        If the fit learns exponents, all exponents may then change again, and files may draw all
        shapes with soft edges again.
        """
        if self.config.fit.shaped == ADAPTIVE:
            self.state.raw_beta = np.maximum(self.state.raw_beta, LEAST_RAW_BETA)
            self.state.drawn[:] = SOFT

    def exchange_inks(self, inks: InkColors) -> None:
        """Let each shape change to its best ink, if this lowers the total error.

        Shapes that overlap and change together may overshoot, so that the error rises. In this case
        only a random half of the shapes change. If the error rises even then, no shape changes.
        """
        if not len(self):
            return
        current, splats = self.state.color, self.splats()
        rendered, cost = self.target.removal_cost(splats)
        before = self.target.weighted_squares(rendered)
        moments = self.target.evaluate(splats, DEFAULT_LOSS).moments
        best = inks.nearest(best_colors(self.state, moments, cost[:, 1]))
        changes = self.rng.random((len(current), 1)) < 0.5
        for color in (best, np.where(changes, best, current)):
            self.state.color = color
            if self.target.weighted_squares(self.rendered()) < before:
                return
        self.state.color = current

    def _with_crisp_rims(self, state: State) -> State:
        """In a fit to inks, set the exponents of `state` so that rims are crisp. Return `state`."""
        if self.inks is not None:
            state.raw_beta = self.inks.crisp_raw_betas(state.factor)
        return state

    def _inked(self, state: State) -> State:
        """In a fit to inks, make each shape an opaque ellipse in its nearest ink. Return `state`.

        Files draw such an ellipse without a falloff. In other fits the state is not changed.
        """
        if self.inks is not None:
            state.color, state.drawn[:] = self.inks.nearest(state.color), PLAIN
            state.raw_opacity[:] = OPAQUE_LOGIT
        return self._with_crisp_rims(state)

    def _add(self, rendered: Reals, count: int, total: int) -> None:
        if self.inks is not None:
            rendered = self.inks.reducible(self.target, rendered)
        additive = self.config.fit.blend == ADD
        new = place(self.config.fit.init, self.target, rendered, count, total, self.rng, additive)
        opacity = self.target.opacity_logits(new.mean, self._first_raw_opacity)
        color = new.color
        if additive:
            color = color / self._overlap(new)[:, None]
        added = State.of(
            new.mean, new.factor, self.round_index,
            raw_opacity=opacity, color=color, raw_beta=self._first_raw_beta,
        )  # fmt: skip
        self.state = self.state.append(self._inked(added))

    def _overlap(self, new: NewGaussians) -> Floats:
        """Return numbers (n,) >= 1 by which the colours of new additive Gaussians are divided.

        The number of a Gaussian is the sum of the falloffs of all new Gaussians at its mean, but at
        least 1. So new Gaussians that overlap share the residual. If each of them added the whole
        residual, the picture would overshoot, the error would attract more Gaussians, and the fit
        would diverge.
        """
        alone = State.of(new.mean, new.factor, 0, color=np.ones((len(new.mean), 3)))
        target = self.target
        total = target.rendered(alone.splats(np.zeros(3), ADD))[0]
        x, y = np.clip(new.mean.astype(np.intp), 0, [target.width - 1, target.height - 1]).T
        return np.maximum(total[y, x].astype(np.float64), 1.0)
