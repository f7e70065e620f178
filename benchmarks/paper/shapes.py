"""Claims c and d: Gaussians against crisp ellipses of one colour each, in the same engine.

Both are alpha-composited and have the same nine parameters, the same initial values, Adam with the
same step sizes and the same number of iterations. An ellipse is the shape exp(-(r^2 / 2)^beta)
whose beta makes its rim a pixel wide, like an antialiased edge; it differs from a Gaussian in
nothing else.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from gauss2svg.measure import metrics
from gauss2svg.render.autograd import fast_composite
from gauss2svg.scene.falloff import RIM_WIDTH

from .photos import Pixels, Smoothness, smoothness
from .settings import Settings

GAUSSIANS, ELLIPSES = "Gaussians", "crisp ellipses"
_RIM_PX = 1.0
# A shape too small for such a rim is still flatter than a Gaussian; above 64 gradients vanish.
_LEAST_BETA, _MOST_BETA = 4.0, 64.0
# Step sizes of Adam: of the mean in spacings, of ln sigma, atanh rho, and the logits.
_STEPS = {"mean": 0.04, "sigma": 0.04, "rho": 0.04, "color": 0.06, "opacity": 0.06}
_SIGMA_SHARE = 0.6  # initial sigma as a share of the spacing sqrt(area / (pi n))
_LEAST_SIGMA = 0.35  # px, as in the product
_MOST_RHO = 0.95


@dataclass(frozen=True, eq=False)
class ShapeFit:
    """One fit: dB and seconds after 0, 1, 2, .. iterations, and its final image."""

    photo: str
    kind: str
    seed: int
    step_size: float
    psnr: list[float]
    seconds: list[float]
    image: Pixels
    smoothness: Smoothness


@dataclass(frozen=True)
class Pair:
    """Gain in dB of Gaussians over ellipses, each at its best step size, for one photo and seed.

    by_iterations  after all iterations; by_seconds  after the time of the faster fit
    """

    photo: str
    seed: int
    by_iterations: float
    by_seconds: float


def crisp_fit(
    name: str, pixels: Pixels, kind: str, shapes: int, iterations: int, seed: int, step_size: float
) -> ShapeFit:
    """Fit shapes of a kind, GAUSSIANS or ELLIPSES, by plain Adam on the squared error."""
    target = torch.from_numpy(pixels)
    height, width = pixels.shape[:2]
    background = target.mean(dim=(0, 1))
    spacing = math.sqrt(height * width / (math.pi * shapes))
    raw = _first(pixels, shapes, spacing, seed)
    optimizer = torch.optim.Adam(
        [{"params": [raw[n]], "lr": step_size * step} for n, step in _STEPS.items()]
    )

    def image() -> torch.Tensor:
        sigma = raw["sigma"].exp().clamp(min=_LEAST_SIGMA)
        rho = _MOST_RHO * raw["rho"].tanh()
        beta = _crisp_beta(sigma, rho) if kind == ELLIPSES else None
        return fast_composite(
            raw["mean"] * spacing, sigma, rho, raw["color"].sigmoid(), raw["opacity"].sigmoid(),
            background, height, width, beta,
        )  # fmt: skip

    # The loss of a step is that of the model before the step.
    psnr, seconds = [], [0.0]
    begun = time.perf_counter()
    for _ in range(iterations):
        optimizer.zero_grad()
        loss = torch.nn.functional.mse_loss(image(), target)
        loss.backward()
        optimizer.step()
        psnr.append(-10 * math.log10(float(loss.detach())))
        seconds.append(time.perf_counter() - begun)
    with torch.no_grad():
        final = image().numpy()
    psnr.append(metrics.psnr(final, pixels))
    return ShapeFit(
        name, kind, seed, step_size, psnr, seconds, final, smoothness(final, pixels)
    )  # fmt: skip


def _first(pixels: Pixels, shapes: int, spacing: float, seed: int) -> dict[str, torch.Tensor]:
    """Raw initial values: random positions, circles, the photo's colour there, half opaque."""
    rng = np.random.default_rng(seed)
    height, width = pixels.shape[:2]
    mean = rng.random((shapes, 2)) * [width, height]
    x, y = np.minimum(mean.astype(np.intp), [width - 1, height - 1]).T
    color = np.clip(pixels[y, x], 0.02, 0.98)
    values = {
        "mean": mean / spacing,
        "sigma": np.full((shapes, 2), math.log(_SIGMA_SHARE * spacing)),
        "rho": np.zeros(shapes),
        "color": np.log(color / (1 - color)),
        "opacity": np.zeros(shapes),
    }
    return {n: torch.tensor(v, dtype=torch.float32, requires_grad=True) for n, v in values.items()}


def _crisp_beta(sigma: torch.Tensor, rho: torch.Tensor) -> torch.Tensor:
    """(n,) exponents at which the rim across the minor axis is _RIM_PX wide; no gradient."""
    squares = sigma.detach() ** 2
    trace, rho = squares.sum(dim=1), rho.detach()
    determinant = squares.prod(dim=1) * (1 - rho) * (1 + rho)
    major = 0.5 * (trace + (trace**2 - 4 * determinant).clamp(min=0).sqrt())
    return (RIM_WIDTH * (determinant / major).sqrt() / _RIM_PX).clamp(_LEAST_BETA, _MOST_BETA)


def compared(photos: dict[str, Pixels], settings: Settings) -> list[ShapeFit]:
    """The fit with the best step size for each photo, kind and seed."""
    best = []
    for name, pixels in photos.items():
        for kind in (GAUSSIANS, ELLIPSES):
            crisp_fit(name, pixels, kind, settings.shapes, 2, 0, 1.0)  # loads the kernels
            for seed in settings.shape_seeds:
                tried = [
                    crisp_fit(
                        name, pixels, kind, settings.shapes, settings.shape_iterations, seed, size
                    )
                    for size in settings.step_sizes
                ]
                best.append(max(tried, key=lambda fit: fit.psnr[-1]))
    return best


def pairs(fits: Sequence[ShapeFit]) -> list[Pair]:
    """Gains of Gaussians over ellipses, photo by photo and seed by seed."""
    by_key = {(f.photo, f.seed, f.kind): f for f in fits}
    return [
        Pair(
            photo,
            seed,
            own.psnr[-1] - by_key[photo, seed, ELLIPSES].psnr[-1],
            _lead_by_seconds(own, by_key[photo, seed, ELLIPSES]),
        )
        for (photo, seed, kind), own in by_key.items()
        if kind == GAUSSIANS
    ]


def iterations_to(fit: ShapeFit, psnr: float) -> float:
    """Iterations after which a fit first reaches a PSNR in dB, infinity if it never does."""
    return next((i for i, reached in enumerate(fit.psnr) if reached >= psnr), math.inf)


def _lead_by_seconds(one: ShapeFit, other: ShapeFit) -> float:
    end = min(one.seconds[-1], other.seconds[-1])
    reached = [
        f.psnr[max(int(np.searchsorted(f.seconds, end, "right")) - 1, 0)] for f in (one, other)
    ]
    return reached[0] - reached[1]
