"""Conversion of additive Gaussians to alpha-composited ones, which every renderer draws.

An additive scene has no order and no opacity: its Gaussians are composited largest first, each in
the target's colour at its mean, as the initial state of another fit. What is kept of them is
position, size and direction (docs/decisions/fit.md has what that gains).
"""

from __future__ import annotations

import numpy as np

from gauss2svg.fit.blending import blending
from gauss2svg.fit.options import FitOptions
from gauss2svg.fit.placement import first_raw_betas
from gauss2svg.fit.schedule import totals
from gauss2svg.fit.state import State
from gauss2svg.fit.target import Target
from gauss2svg.scene import OVER, Scene


def composited(scene: Scene, target: Target, options: FitOptions) -> State:
    """The initial state of an alpha-composited fit to target, from an additive scene.

    options are those of that fit; its rounds replace the scene's, largest Gaussians first.
    Gaussians whose mean lies on an invisible pixel of the target are left out.
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
        raw_opacity=target.opacity_logits(mean, blending(OVER).initial_opacity_logit),
        color=target.source_color[:, y, x].T.astype(np.float64),
        raw_beta=first_raw_betas(count, options),
    )
    rounds = totals("exponential", count, None)[:-1]
    state.round_index = np.searchsorted(rounds, np.arange(count), side="right").astype(np.int32)
    return state
