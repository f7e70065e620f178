"""The progressive fit: a background, then rounds that each add Gaussians where the error is large.

The Gaussians of a round are optimised before the next round adds finer ones, and all Gaussians keep
moving until the end. The constants of this package come from ablations. docs/decisions/fit.md has
the ablations of rounds, rates, relocation, exponents and additive blending. The others are in
placement.md, palette.md, divergence.md and numbers.md in the same folder.
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

    The same seed gives the same result. `progress` is called after every iteration, in the thread
    that calls this function.
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

    Alpha-composited shapes are useful because every renderer draws them. They are fitted to
    `pixels`, which are (h, w, 3) float32 in 0..1, or to the render of the scene if `pixels` is
    None. The module gauss2svg.fit.population describes the method. The values of config.gaussians
    and config.densify are ignored. Raise InputError unless the scene is additive and
    config.fit.blend is "over".
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
