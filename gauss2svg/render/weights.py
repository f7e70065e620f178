"""Weights that the colours of the shapes have in each pixel.

A picture depends linearly on the colours. With alpha compositing a pixel is sum_k w_k c_k, where
w_k is alpha_k times the transmittance of all shapes above shape k, and k = 0 is the background.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.render.cpu import removal_cost, splats_of
from gauss2svg.scene import PLAIN, Scene
from gauss2svg.scene.falloff import coverage, covered_radius, cut_radius, profile

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# Visible masses are computed on a canvas whose longer side is at most this number of px.
_LARGEST_SIDE = 768
# If the weight of a colour in a pixel is at most this value, the weight is left out of W.
_LEAST_WEIGHT = 1e-9


def color_weights(scene: Scene, height: int, width: int) -> tuple[csr_array, NDArray[np.float64]]:
    """Return the weights W (n + 1, h w) of the colours in the pixels, and W W^T (n + 1, n + 1).

    The first row is that of the background. W is sparse, because only few shapes are visible in
    each pixel. A plain ellipse (scene.drawn) has no falloff: its alpha is its opacity times the
    share of the pixel that it covers.
    """
    # This import takes a third of a second, and few runs need it.
    from scipy.sparse import csr_array

    covers, radius = scene.drawn == PLAIN, covered_radius(scene.beta)
    reach = scene.sigma * cut_radius(scene.beta)[:, None] + covers[:, None]
    low = np.clip(np.floor(scene.mean - reach - 0.5), 0, [width, height]).astype(np.intp)
    high = np.clip(np.ceil(scene.mean + reach + 0.5), 0, [width, height]).astype(np.intp)
    transmittance, whitening = np.ones((height, width)), scene.whitening
    pixel = np.arange(height * width).reshape(height, width)
    values, pixels = [np.zeros(0)] * (len(scene) + 1), [pixel[0, :0]] * (len(scene) + 1)
    for k in range(len(scene) - 1, -1, -1):
        (x0, y0), (x1, y1) = low[k], high[k]
        u = np.arange(x0, x1) + 0.5 - scene.mean[k, 0]
        v = np.arange(y0, y1)[:, None] + 0.5 - scene.mean[k, 1]
        w11, w21, w22 = whitening[k]
        z = np.stack(np.broadcast_arrays(w11 * u, w21 * u + w22 * v), axis=-1)
        if covers[k]:
            share = coverage(z, whitening[k], radius[k])
        else:
            share = profile(np.sqrt(np.square(z).sum(axis=-1)), scene.beta[k])
        alpha = scene.opacity[k] * share
        box = transmittance[y0:y1, x0:x1]
        weight = alpha * box
        shows = weight > _LEAST_WEIGHT
        values[k + 1], pixels[k + 1] = weight[shows], pixel[y0:y1, x0:x1][shows]
        box *= 1 - alpha
    shows = transmittance > _LEAST_WEIGHT
    values[0], pixels[0] = transmittance[shows], pixel[shows]
    starts = np.cumsum([0, *map(len, values)])
    weights = csr_array(
        (np.concatenate(values), np.concatenate(pixels), starts), (len(values), height * width)
    )
    return weights, (weights @ weights.T).toarray()


def visible_mass(
    scene: Scene, weight: NDArray[np.floating] | None = None
) -> tuple[NDArray[np.float64], int]:
    """Return the visible mass (n,) of each shape, and the number of pixels over which it is summed.

    The visible mass is the sum of weight (alpha transmittance)^2 over all pixels. It is computed on
    a smaller canvas if the canvas is large. If the colour of a shape is optimal, changing it by d
    raises the weighted squared error by visible_mass d^2.

    weight  (h, w) > 0 of any size and with a mean of 1, or None for 1 everywhere
    """
    reduced = min(1.0, _LARGEST_SIDE / max(scene.width, scene.height))
    width, height = (max(1, round(side * reduced)) for side in (scene.width, scene.height))
    splats = splats_of(scene, (width / scene.width, height / scene.height))
    if weight is not None:
        image = Image.fromarray(np.asarray(weight, np.float32))
        weight = np.asarray(image.resize((width, height), Image.Resampling.NEAREST))
    blank = np.zeros((3, height, width), np.float32)
    return np.maximum(removal_cost(splats, blank, weight)[1][:, 1], 0.0), width * height
