"""Figure 4: the same Gaussians with fixed windows, adaptive windows and none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from gauss2svg.measure import metrics
from gauss2svg.scene import Scene

from .kernel_window import GRID_REACH, WIDEST_UNCROPPED_SIGMA, reaches, sum_in_windows
from .photos import Pixels

_NO_WINDOW = 1e9  # px: no photo is as wide
_LEVELS = 255


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
        jump=(float(jumps[0].max(initial=0)) * _LEVELS, float(jumps[1].max(initial=0)) * _LEVELS),
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
