"""The paper's renderer and what it crops, figure 4: normal densities, each on a square window.

    C(x) = background + sum_k w_k phi_k(x) [max(|u|, |v|) <= h_k],   (u, v) = x - mean_k,
    w_k phi_k(x) = c_k exp(-r_k(x)^2 / 2),

with phi_k the normal density, w_k its signed coefficient and c_k what it adds at its mean:
gauss2svg.scene.scene.Scene.densities and peaks_of convert one into the other. A kernel with
`s` samples a side spans -5..5 in its own unit, which is s / 10 px, so that the window reaches
h = s / 2 px:

    fixed     h_k = s / 2 whatever the sigma: one of 2 units ends at 2.5 sigma, a wider one is
              cropped where it is still bright
    adaptive  h_k = s / 2 max(1, max(sx, sy) / 2 units): above 2 units the window grows with the
              sigma, so that 2.5 sigma of each are always inside

From "Investigation into 2D Gaussian Splatting for Image Representation", whose public
implementation has the fixed window. The product's own renderer never crops: its falloff ends at
0 (gauss2svg.scene.falloff), where this one jumps from edge_values to 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from gauss2svg.errors import InputError, quoted
from gauss2svg.measure import metrics
from gauss2svg.scene import Scene

from .photos import Pixels

# Both ways from the mean, in the kernel's unit: the grid of the public implementation.
GRID_REACH = 5.0
# Units. 2.5 of these sigmas fill the grid; the paper scales the window from here on.
WIDEST_UNCROPPED_SIGMA = 2.0
_NO_WINDOW = 1e9  # px: no photo is as wide


def reaches(sigma: torch.Tensor, kernel_size: float, adaptive: bool) -> torch.Tensor:
    """(n,) px from the mean to the edge of each window, for sigma (n, 2) in px.

    kernel_size is the width in px of a window that is not scaled, > 0; else InputError.
    """
    if not kernel_size > 0:
        raise InputError(f"kernel_size must be a width above 0 px; got {quoted(kernel_size)}")
    unit = kernel_size / (2 * GRID_REACH)
    growth = torch.ones_like(sigma[:, 0])
    if adaptive:
        growth = (sigma.amax(dim=1) / (WIDEST_UNCROPPED_SIGMA * unit)).clamp(min=1)
    return growth * unit * GRID_REACH


def edge_values(sigma: torch.Tensor, kernel_size: float, adaptive: bool) -> torch.Tensor:
    """(n,) largest exp(-r^2 / 2) on each window's edge: the jump there, as a share of the peak.

    exp(-(h / max(sx, sy))^2 / 2) whatever the correlation: the least r on the line u = h is
    h / sx. Adaptive windows have exp(-3.125) = 0.044 at most.
    """
    return torch.exp(-0.5 * (reaches(sigma, kernel_size, adaptive) / sigma.amax(dim=1)) ** 2)


def sum_in_windows(
    mean: torch.Tensor,
    sigma: torch.Tensor,
    rho: torch.Tensor,
    color: torch.Tensor,
    background: torch.Tensor,
    height: int,
    width: int,
    kernel_size: float,
    adaptive: bool,
) -> torch.Tensor:
    """Image (height, width, 3) of n densities on fixed or adaptive windows, unclipped.

    mean (n, 2) and sigma (n, 2) in px, rho (n,), color (n, 3) signed peaks, background (3,),
    all of one dtype and device, which the image shares; kernel_size in px as in `reaches`.
    Sampled at pixel centres. Gradients flow to all five; an edge's own motion has none.
    """
    y = torch.arange(height, dtype=mean.dtype, device=mean.device) + 0.5
    x = torch.arange(width, dtype=mean.dtype, device=mean.device) + 0.5
    reach = reaches(sigma, kernel_size, adaptive)
    image = background.expand(height, width, 3)
    for k in range(len(mean)):
        u, v = x - mean[k, 0], (y - mean[k, 1])[:, None]
        z1 = u / sigma[k, 0]
        z2 = (v / sigma[k, 1] - rho[k] * z1) / torch.sqrt((1 - rho[k]) * (1 + rho[k]))
        inside = (u.abs() <= reach[k]) & (v.abs() <= reach[k])
        bell = torch.exp(-0.5 * (z1 * z1 + z2 * z2)) * inside
        image = image + bell[:, :, None] * color[k]
    return image


@dataclass(frozen=True)
class Crop:
    """What windows of `kernel_size` px crop from a scene.

    cropped  Gaussians with a sigma above the threshold; count  all of them
    jump     largest at any window's edge within the picture, in levels of 255, of one Gaussian
    psnr     dB against the image without windows, clipped to 0..1
    largest  error against it, in levels
    The last three are for the fixed window and for the adaptive one.
    """

    kernel_size: float
    cropped: int
    count: int
    jump: tuple[float, float]
    psnr: tuple[float, float]
    largest: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Windowed:
    """The three images (h, w, 3), clipped to 0..1, and the numbers."""

    whole: Pixels
    fixed: Pixels
    adaptive: Pixels
    crop: Crop


def windowed(scene: Scene, kernel_size: float) -> Windowed:
    """An additive scene rendered with both windows."""
    names = ("mean", "sigma", "rho", "color", "background")
    tensors = {name: torch.tensor(getattr(scene, name)) for name in names}
    height, width = round(scene.height), round(scene.width)

    def image(size: float, adaptive: bool) -> Pixels:
        pixels = sum_in_windows(
            **tensors, height=height, width=width, kernel_size=size, adaptive=adaptive
        )
        return pixels.clamp(0, 1).numpy().astype(np.float32)

    whole = image(_NO_WINDOW, False)
    sides = image(kernel_size, False), image(kernel_size, True)
    sigma = tensors["sigma"]
    peak = np.abs(scene.color).max(axis=1, initial=0)
    jumps = [
        peak * edges_inside(scene, reaches(sigma, kernel_size, adaptive).numpy())
        for adaptive in (False, True)
    ]
    widest = WIDEST_UNCROPPED_SIGMA * kernel_size / (2 * GRID_REACH)
    crop = Crop(
        kernel_size=kernel_size,
        cropped=int((scene.sigma.max(axis=1) > widest).sum()),
        count=len(scene),
        jump=(
            float(jumps[0].max(initial=0)) * metrics.LEVELS,
            float(jumps[1].max(initial=0)) * metrics.LEVELS,
        ),
        psnr=(metrics.psnr(sides[0], whole), metrics.psnr(sides[1], whole)),
        largest=(
            metrics.largest_error(sides[0], whole),
            metrics.largest_error(sides[1], whole),
        ),
    )
    return Windowed(whole, *sides, crop)


def edges_inside(scene: Scene, reach: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) largest exp(-r^2 / 2) on the edges of windows mean +- reach that cross the canvas.

    On the line u = h the maximum lies at v = rho h sy / sx, clipped to the canvas. 0 where no edge
    is inside.
    """
    highest = np.zeros(len(scene))
    size = np.array([scene.width, scene.height])
    for a, b in ((0, 1), (1, 0)):  # the edges across axis a, along axis b
        low = np.maximum(-reach, -scene.mean[:, b])
        high = np.minimum(reach, size[b] - scene.mean[:, b])
        for side in (-reach, reach):
            at = scene.mean[:, a] + side
            v = np.clip(scene.rho * side * scene.sigma[:, b] / scene.sigma[:, a], low, high)
            z = side / scene.sigma[:, a]
            w = v / scene.sigma[:, b] - scene.rho * z
            value = np.exp(-0.5 * (z**2 + w**2 / ((1 - scene.rho) * (1 + scene.rho))))
            highest = np.where(
                (at > 0) & (at < size[a]) & (low <= high), np.maximum(highest, value), highest
            )
    return highest


def bell(side: int, kernel_size: float, sigma_in_units: float = 4.0) -> Scene:
    """One white Gaussian on black in the middle of a square, wider than the threshold."""
    unit = kernel_size / (2 * GRID_REACH)
    return Scene(
        side,
        side,
        mean=np.full((1, 2), side / 2),
        sigma=np.full((1, 2), sigma_in_units * unit),
        rho=np.zeros(1),
        color=np.ones((1, 3)),
        opacity=np.ones(1),
        background=np.zeros(3),
        blend="add",
    )
