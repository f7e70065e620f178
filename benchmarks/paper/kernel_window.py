"""The paper's renderer: a sum of normal densities, each evaluated on a square window alone.

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

import torch

from gauss2svg.errors import InputError, quoted

# Both ways from the mean, in the kernel's unit: the grid of the public implementation.
GRID_REACH = 5.0
# Units. 2.5 of these sigmas fill the grid; the paper scales the window from here on.
WIDEST_UNCROPPED_SIGMA = 2.0


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
