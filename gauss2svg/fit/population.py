"""The Gaussians of a fit on the picture of the present: added, moved elsewhere, removed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, whole_number
from gauss2svg.fit.blending import blending
from gauss2svg.fit.convert import painted
from gauss2svg.fit.options import FitConfig
from gauss2svg.fit.order import SegmentAt, SegmentOrder
from gauss2svg.fit.placement import FIRST_RAW_BETA, New, place
from gauss2svg.fit.schedule import LARGEST_REDUCTION
from gauss2svg.fit.state import State
from gauss2svg.fit.target import Views
from gauss2svg.photo.alpha import has_alpha
from gauss2svg.render.cpu import Splats
from gauss2svg.scene import ADD, Scene

# Fainter than this vanishes or is drawn 10 to 60 % wrong on 8-bit canvases.
LEAST_OPACITY = 0.02

# The squared error of flat areas counts up to 1 + this times in the mse loss. At 500
# Gaussians streaks over skies, walls and paper fade; see the ablation in loop.py for its price.
FLAT_WEIGHT = 8.0

_RELOCATION_SHARE = 0.08


class Population:
    """Gaussians in pixels of a perhaps reduced picture, and the ways in which their number changes.

    pixels      (h, w, 3) float32 in 0..1, or (h, w, 4) with alpha
    segment_at  the segments by which each round's shapes are ordered, or None
    """

    def __init__(
        self, pixels: NDArray[np.float32], config: FitConfig, segment_at: SegmentAt | None = None
    ) -> None:
        self.config = config
        self.blending = blending(config.fit.blend)
        self.state = State.empty()
        self.round_index = 0
        # On 8 bits already, as it will be written: the fit makes up for the rounding.
        self.background = np.round(pixels.mean(axis=(0, 1), dtype=np.float64) * 255) / 255
        if has_alpha(pixels):
            self.background = np.ones(3)  # the page; none of it is written
        self.rng = np.random.default_rng(config.fit.seed)
        self._views = Views(pixels, config.dtype, FLAT_WEIGHT)
        self._reduction = 1
        self.target = self._views.reduced(1)
        self._order = None if segment_at is None else SegmentOrder(segment_at)

    def __len__(self) -> int:
        return len(self.state)

    @property
    def rounds(self) -> int:
        """Rounds that added Gaussians."""
        return self.round_index + 1 if len(self) else 0

    def splats(self) -> Splats:
        """As the kernels read them."""
        return self.state.splats(self.background, self.config.fit.blend)

    def rendered(self) -> NDArray[np.floating]:
        """As they are drawn on the present picture."""
        return self.target.rendered(self.splats())

    def scene(self) -> Scene:
        """The Gaussians so far, on the whole working canvas."""
        size = self.target.width, self.target.height
        scene = self.state.scene(self.background, *size, self.config.fit.blend)
        if self.target.is_transparent:
            scene = scene.replace(transparent=True)
        height, width = self._views.pixels.shape[:2]
        if (width, height) == size:
            return scene
        return scene.scaled(width / size[0], height / size[1])

    def error(self) -> float:
        """Mean squared, on the whole working picture, also where a round ran on a reduced one."""
        factor = self._reduction
        self.show_at(1)
        error = self.target.error(self.splats())
        self.show_at(factor)
        return error

    def show_at(self, factor: int) -> None:
        """Go on on a picture of 1 / factor the width and height."""
        if factor == self._reduction:
            return
        before, self.target = self.target, self._views.reduced(factor)
        self._reduction = factor
        self.state = self.state.scaled(
            self.target.width / before.width, self.target.height / before.height
        )

    def adopt(self, scene: Scene) -> None:
        """Begin with a sum's Gaussians, painted over each other."""
        self.state = painted(scene, self.target, self.config.fit)
        self.round_index = int(self.state.round_index.max(initial=0))

    def densify_or_prune(self, count: int) -> None:
        """Remove the Gaussians that are missed least, or add some where the error is."""
        surplus = len(self) - count
        if surplus > 0:
            _, cost = self.target.removal_cost(self.splats())
            kept = np.argsort(cost[:, 0], kind="stable")[surplus:]
            self.state = self.state.select(np.sort(kept))
        elif surplus < 0:
            self._add(self.rendered(), -surplus, count)

    def relocate(self) -> bool:
        """Move what would be missed least to where the error is; whether anything moved."""
        rendered, cost = self.target.removal_cost(self.splats())
        total = len(self)
        count = int(_RELOCATION_SHARE * total)
        if not count:
            return False
        kept = np.sort(np.argsort(cost[:, 0], kind="stable")[count:])
        self.state = self.state.select(kept)
        if self.blending.additive:  # the sum of those gone may be missed more than each
            rendered = self.rendered()
        self._add(rendered, count, total)
        return True

    def prune(self, least: float) -> None:
        """Drop what is worth less than `least` dB: all at once, measured in one pass."""
        if least == -math.inf or not len(self):
            return
        rendered, cost = self.target.removal_cost(self.splats())
        error = float(np.sum(np.square(rendered - self.target.planar), dtype=np.float64))
        # Taking one away turns the error e into e + cost: 10 log10(1 + cost / e) dB.
        worth = error * (10 ** (least / 10) - 1)
        self.state = self.state.select(cost[:, 0] > worth)

    def drop_undrawable(self) -> None:
        """Drop what renderers would not draw: too faint, or nothing of it on the canvas.

        And haze: what a picture with alpha is nearer without.
        """
        splats = self.splats()
        _, cost = self.target.removal_cost(splats)
        kept = (splats.paint[:, 0] >= LEAST_OPACITY) & (cost[:, 1] > 0)
        if self.target.is_transparent:
            kept &= cost[:, 0] > 0
        self.state = self.state.select(kept)

    def settle_segments(self) -> None:
        """From here on shapes stay in their segments, where there are any."""
        if self._order is not None:
            self.state = self._order.settle(self.state, self.target.width, self.target.height)

    def keep_in_segments(self) -> None:
        """Pull back what has left its segment."""
        if self._order is not None:
            self.state = self._order.kept(self.state, self.target.width, self.target.height)

    def _add(self, rendered: NDArray[np.floating], count: int, total: int) -> None:
        new = place(
            self.config.densify.init, self.target, rendered, count, total, self.rng, self.blending
        )
        opacity = self.target.opacity_logits(new.mean, self.blending.first_opacity_logit)
        raw_beta = np.full(count, FIRST_RAW_BETA if self.config.fit.learned_falloff else 0.0)
        color = new.color
        if self.blending.additive:
            color = color / self._crowd(new)[:, None]
        self.state = self.state.append(
            new.mean, new.factor, opacity, color, raw_beta, self.round_index
        )
        if self._order is not None:  # from the start, so that the fit makes up for it
            self.state = self._order.grouped_by_segment(
                self.state, self.target.width, self.target.height
            )

    def _crowd(self, new: New) -> NDArray[np.float64]:
        """(n,) sum of all new falloffs at each new mean, at least 1.

        New Gaussians that overlap share what is missing there: if each added all of it, sums
        would overshoot, which draws more of them to the place, and the fit would run away.
        """
        alone = State.empty().append(
            new.mean, new.factor, np.zeros(len(new.mean)), np.ones((len(new.mean), 3)),
            np.zeros(len(new.mean)), 0,
        )  # fmt: skip
        target = self.target
        summed = target.rendered(alone.splats(np.zeros(3), ADD))[0]
        x, y = np.clip(new.mean.astype(np.intp), 0, [target.width - 1, target.height - 1]).T
        return np.maximum(summed[y, x].astype(np.float64), 1.0)

    def state_dict(self) -> dict[str, Any]:
        """What `load_state_dict` needs to go on from here, to the last bit."""
        return {
            "state": self.state.state_dict(),
            "round_index": self.round_index,
            "reduction": self._reduction,
            "rng": self.rng.bit_generator.state,
            "home": None if self._order is None else self._order.home,
        }

    def load_state_dict(self, memory: dict[str, Any]) -> None:
        """Become as one was that gave this memory; raises InputError for what none can give."""
        self._reduction = whole_number("reduction", memory["reduction"], 1, LARGEST_REDUCTION)
        self.target = self._views.reduced(self._reduction)
        self.state = State.from_state_dict(memory["state"])
        self.round_index = whole_number("round_index", memory["round_index"], 0, 2**31 - 1)
        self.rng.bit_generator.state = memory["rng"]
        if self._order is not None:
            home = memory["home"]
            if home is not None and (home.shape != (len(self), 2) or not np.isfinite(home).all()):
                raise InputError("home of a checkpoint is not that of its shapes; begin anew")
            self._order.home = home
