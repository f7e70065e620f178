"""The progressive fit: a background, then rounds of Gaussians where the error is.

Every round is optimised before the next one, from coarse to fine, and all Gaussians keep moving
until the end. Constants of this package come from ablations: docs/decisions/fit.md (rounds, rates,
relocation, exponents, additive blending), placement.md, palette.md, divergence.md and numbers.md.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import refusal
from gauss2svg.fit import DensifyOptions, FitConfig, FitProgress, FitResult
from gauss2svg.fit.session import FitSession
from gauss2svg.render import render
from gauss2svg.render.cpu import kernel_lock
from gauss2svg.scene import ADD, OVER, Scene


def fit(
    pixels: NDArray[np.float32],
    config: FitConfig | None = None,
    progress: Callable[[FitProgress], None] | None = None,
) -> FitResult:
    """Fit config.gaussians Gaussians to pixels (h, w, 3) float32 in 0..1, or (h, w, 4) with alpha.

    The same seed gives the same result. progress is called after every iteration, in this thread.
    """
    config = config or FitConfig()
    with kernel_lock:
        session = FitSession(pixels, config, progress=progress)
        session.fit()
        return session.result()


def convert_additive(
    scene: Scene,
    pixels: NDArray[np.float32] | None = None,
    config: FitConfig | None = None,
    progress: Callable[[FitProgress], None] | None = None,
) -> FitResult:
    """Convert an additive scene to the same number of alpha-composited shapes.

    Every renderer draws such shapes. They are fitted to pixels (h, w, 3) float32 in 0..1, by
    default to the render of the scene. The module gauss2svg.fit.population describes the method.
    config.gaussians and config.densify are not used. Raise InputError unless the scene is additive
    and config.fit.blend is "over".
    """
    config = dataclasses.replace(
        config or FitConfig(), gaussians=len(scene), densify=DensifyOptions()
    )
    blends = scene.blend, config.fit.blend
    if blends != (ADD, OVER):
        needed = f"additive, and fitted by a config of blend {OVER!r}"
        raise refusal("the scene", needed, f"blends {blends[0]!r} and {blends[1]!r}")
    if pixels is None:
        pixels = render(scene)
    with kernel_lock:
        session = FitSession(pixels, config, progress=progress)
        session.adopt(scene, len(scene))
        session.fit()
        return session.result()
