"""The progressive fit: a background, then rounds of Gaussians where the error is.

Coarse first; every round is optimised before the next, all Gaussians move until the
end. What was measured at 5000 Gaussians and 300 iterations, one change at a time, mean
PSNR of the model in dB. On Kodak 04, 13 and 20, with placement by error and relocation
from 32 % of the run on (the prototype that is the bar to beat reaches
31.40 there, at 2.6 times the CPU seconds):

    aspect bounded by 100 / 50 / 25 / 12              31.52 / 31.49 / 31.42 / 31.27
    first sigma 0.30 / 0.35 / 0.42 of the spacing     31.54 / 31.49 / 31.46
    step of the mean 0.16 / 0.24 / 0.36 sigma         31.47 / 31.49 / 31.52
    step of the shape 0.10 / 0.15 / 0.22              31.48 / 31.49 / 31.50
    relocation of 5 / 8 / 12 % every 10 iterations    31.48 / 31.49 / 31.48
    growth ends at 20 / 30 / 40 %                     31.49 / 31.49 / 31.46
    decay starts at 50 / 60 / 70 %                    31.48 / 31.49 / 31.51
    stratified instead of independent draws           31.50, and cheaper
    first 15 / 30 % of the iterations at half size    31.51 / 31.51, 7 / 16 % fewer pairs

On all eight development photos, placement by error / selective: 32.45 / 32.60 at 5000,
26.94 / 27.09 at 1000. On Kodak 04, 08, 13 and 20, selective, from 30.40 / 25.56 dB at
5000 / 1000:

    second-moment decay 0.95 / 0.995 instead of 0.99  30.47 / 25.56, 30.43 / 25.58
    relocation from 20 % instead of 32 %              30.44 / 25.58
    both (0.95)                                       30.49 / 25.58
    and decay from 75 / 85 % instead of 60 %          30.50 / 25.60, 30.50 / 25.60 <- 75 %
    and first opacity logit 0 / 2 instead of 1        30.50 / 25.59, 30.50 / 25.60
    and relocation every 6 iterations                 30.48 / 25.57
    weight of flat areas 0 / 4 / 15                   30.50, 30.48, 30.47 / 25.60, 25.60, 25.53

What more iterations buy, all eight, selective, mean PSNR of the model; the prototype ends at
32.30 dB after 300 (in brackets CPU seconds as shares of its own, run right after each):

    160 iterations 32.31 (0.17), 200 32.43, 300 32.56 (0.29), 1000 32.80 (0.94)

What is left to win is not in more steps, but in where Gaussians are. On Kodak 04, 08, 13 and
20, 200 iterations, from 30.35 dB:

    growth in 3 / 11 rounds instead of 6              30.37 / 30.37
    optimiser's memory wiped at every round           30.32

An exponent for each shape, 200 iterations, PSNR of the drawn SVG in dB. Against Gaussians alone,
all eight photos: 1000 shapes 27.55 instead of 26.86, 5000 32.78 / 32.26, 10 000 35.68 / 35.29. One
change at a time, on Kodak 04, 13 and 20 (1000 / 5000 shapes; scatter 0.03) and on drawings
(scatter 0.3):

    least exponent 1 / 0.95 / 0.9 / 0.75              27.52, 27.55, 27.52, 27.51 / 31.81, 31.77,
                                                      31.77, 31.74
    least rim 0.35 / 0.5 / 0.7 px                     27.51, 27.52, 27.53 / 31.76, 31.77, 31.79;
                                                      1.2 px: 0.14 less of the model at 5000
    step of ln beta 0.05 / 0.1 / 0.2                  five drawings of 512 shapes 39.9, 38.6, 38.1
    colours and exponents settled after the fit       27.33 / 31.53 instead of 27.48 / 31.75
    weight of flat areas 8 / 16 / 24                  27.51, 27.47, 27.43 / 31.84, 31.72, 31.74
    aspect bounded by 12 / 30 / 60                    seven drawings of 128 shapes 30.1, 30.3, 31.0;
                                                      their flat_error 9.9, 11.7, 12.5 levels

Sums, from 25.36 / 30.08 dB of the model on Kodak 04, 08, 13 and 20 (1000 / 5000 Gaussians, 200
iterations, selective, colours within 0.6; scatter 0.05):

    step of colours 0.012 / 0.025 / 0.045             25.29, 25.36, 25.38 / 30.04, 30.08, 29.94
    step of the mean 0.2 / 0.3 / 0.45 sigma           25.35, 25.36, 25.34 / 30.02, 30.08, 30.01
    step of the shape 0.1 / 0.15 / 0.22               25.35, 25.36, 25.37 / 30.04, 30.08, 30.07
    colours within 0.3 / 0.5 / 0.6 / 1 either way     25.02, 25.29, 25.36, 25.30 / 29.68, 30.05,
                                                      30.08, 30.13; Kodak 08 drawn by Chromium is
                                                      42.2 dB from the model with 0.5, 42.0 with 0.6
    coefficients of normal densities instead of peaks 25.23 / 30.00, steps of colours in peaks
    weight of flat areas 0                            25.40 / 30.05
    placement live / error / random                   25.29, 25.15, 23.70 / 30.02, 29.89, 27.88
    first sigma 0.3 / 0.4 / 0.55, by error             25.15, 25.03, 24.92 / 29.89, 29.83, 29.73
    no relocation                                     24.91 / 29.21
    linear / all at once                              25.41, 25.33 / 30.17, 30.11
    new ones do not share what is missing             25.38 / 30.04; one of Kodak 04, placed by
                                                      error, ran away to -27 dB and ended at 28
    thirty steps of conjugate gradients for all       0.01 more, 3000 Gaussians
    colours at the end

Threads that sleep instead of spinning while they wait (render/threads.py) took 1.1 s instead of
0.85 s on idle cores, and 1.9 s instead of 12.5 s beside two busy programs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, must_be
from gauss2svg.fit.densification import FixedCount
from gauss2svg.fit.options import DensifyOptions, FitConfig, FitProgress, FitResult
from gauss2svg.fit.session import FitSession
from gauss2svg.render import render
from gauss2svg.render.cpu import kernel_lock
from gauss2svg.scene import ADD, OVER, Scene


def fit(
    pixels: NDArray[np.float32],
    config: FitConfig | None = None,
    progress: Callable[[FitProgress], None] | None = None,
) -> FitResult:
    """Fit a given number of Gaussians to pixels (h, w, 3) float32 in 0..1, or (h, w, 4) with alpha.

    Deterministic in the seed. progress is called once an iteration, from this thread.
    """
    config = config or FitConfig()
    with kernel_lock:
        session = FitSession(pixels, config, fixed_count(config), progress=progress)
        session.fit()
        return session.result()


def convert_additive(
    scene: Scene,
    pixels: NDArray[np.float32] | None = None,
    config: FitConfig | None = None,
    progress: Callable[[FitProgress], None] | None = None,
) -> FitResult:
    """Convert an additive scene to as many alpha-composited shapes, which every renderer draws.

    Fitted from the additive Gaussians to pixels (h, w, 3) float32 in 0..1, by default to the
    additive render itself; see gauss2svg.fit.convert. Of config the count and the schedule are
    not used. Raises InputError for a scene or a config of the other blending.
    """
    if scene.blend != ADD:
        raise InputError(must_be("scene.blend", repr(ADD), scene.blend))
    config = dataclasses.replace(
        config or FitConfig(), gaussians=len(scene), densify=DensifyOptions()
    )
    if config.fit.blend != OVER:
        raise InputError(must_be("blend", repr(OVER), config.fit.blend))
    if pixels is None:
        pixels = render(scene)
    with kernel_lock:
        session = FitSession(pixels, config, fixed_count(config), progress=progress)
        session.adopt(scene, len(scene))
        session.fit()
        return session.result()


def fixed_count(config: FitConfig) -> FixedCount:
    """The policy of a given number of Gaussians."""
    densify = config.densify
    return FixedCount(densify.schedule, config.gaussians, config.iterations, densify.per_round)
