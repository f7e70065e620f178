"""From Gaussians that are summed to Gaussians painted over each other, for every renderer.

A sum has no order and no opacity. Its Gaussians are painted largest first, each in the target's
colour at its mean; a fit then moves all of them, and relocates some, as it would have after
growth. What is kept of the sum is where Gaussians are, how large and how turned. Against a fit
over each other from the start, mean PSNR of the model on the eight Kodak photos, 5000 shapes:
33.21 instead of 32.99 dB, for twice the CPU seconds (examples/sums.py).
"""

from __future__ import annotations

import numpy as np

from gauss2svg.fit.blending import blending
from gauss2svg.fit.options import FitOptions
from gauss2svg.fit.placement import FIRST_RAW_BETA
from gauss2svg.fit.schedule import totals
from gauss2svg.fit.state import State
from gauss2svg.fit.target import Target
from gauss2svg.scene import OVER, Scene


def painted(scene: Scene, target: Target, options: FitOptions) -> State:
    """The beginning of a fit over each other: a sum's Gaussians on its target.

    options are those of that fit; its rounds take the place of the sum's, coarse first. Gaussians
    whose mean lies where nothing of the target shows are left out.
    """
    height, width = target.height, target.width
    scene = scene.scaled(width / scene.width, height / scene.height)
    order = np.argsort(-scene.sigma.prod(axis=1) * np.sqrt(1 - scene.rho**2), kind="stable")
    mean, factor = scene.mean[order], scene.factor[order]
    x, y = np.clip(mean.astype(np.intp), 0, [width - 1, height - 1]).T
    if target.visible is not None:
        shown = target.visible[y, x]
        mean, factor, x, y = mean[shown], factor[shown], x[shown], y[shown]
    learns = options.learned_falloff
    count = len(mean)
    state = State.empty().append(
        mean,
        np.stack([factor[:, 0, 0], factor[:, 1, 0], factor[:, 1, 1]], axis=1),
        target.opacity_logits(mean, blending(OVER).first_opacity_logit),
        target.paint[:, y, x].T.astype(np.float64),
        np.full(count, FIRST_RAW_BETA if learns else 0.0),
        0,
    )
    rounds = totals("exponential", count, None)[:-1]
    state.round_index = np.searchsorted(rounds, np.arange(count), side="right").astype(np.int32)
    return state
