"""Both renderers against an oracle that shares no code with them.

The oracle composes the Gaussians in float64, one pixel and one Gaussian at a time, from the formula
in the scene's docs.
"""

import math

import numpy as np
import pytest
from scenes import random_scene
from with_torch import render_reference

from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import BETA_CLASSES

CUT = 3.0
GAUSSIANS = (1.0, 1.0)

SIZE = 24, 16
SCENES = {
    "scattered": random_scene(20, *SIZE, 20, (1.0, 15.0), GAUSSIANS),
    "needles": random_scene(10, *SIZE, 21, (0.5, 20.0), GAUSSIANS).replace(
        rho=np.tile([0.99, -0.99], 5)
    ),
    "opaque": random_scene(9, *SIZE, 22, (3.0, 12.0), GAUSSIANS).replace(opacity=np.ones(9)),
    # exponents of a file, rims that are a pixel wide and wider
    "crisp": random_scene(10, *SIZE, 23, (4.0, 15.0), GAUSSIANS).replace(
        rho=np.tile([0.5, -0.3], 5), beta=np.resize(BETA_CLASSES[:-1], 10)
    ),
}


def oracle(scene: Scene) -> np.ndarray:
    """The picture of a scene in float64, by plain loops."""
    height, width = int(scene.height), int(scene.width)
    image = np.empty((height, width, 3))
    rim = math.exp(-CUT * CUT / 2)
    for row in range(height):
        for column in range(width):
            pixel = [float(v) for v in scene.background]
            for k in range(len(scene)):
                u = (column + 0.5 - scene.mean[k, 0]) / scene.sigma[k, 0]
                v = (row + 0.5 - scene.mean[k, 1]) / scene.sigma[k, 1]
                rho = scene.rho[k]
                q = (u * u - 2 * rho * u * v + v * v) / (1 - rho * rho)
                power = (q / 2) ** scene.beta[k]
                if power >= CUT * CUT / 2:
                    continue
                alpha = scene.opacity[k] * (math.exp(-power) - rim) / (1 - rim)
                pixel = [p + alpha * (c - p) for p, c in zip(pixel, scene.color[k], strict=True)]
            image[row, column] = pixel
    return image


@pytest.mark.parametrize("name", SCENES)
def test_both_renderers_draw_what_the_oracle_draws(name):
    picture = oracle(SCENES[name])
    np.testing.assert_allclose(render(SCENES[name]), picture, atol=4e-5)
    np.testing.assert_allclose(render_reference(SCENES[name]).numpy(), picture, atol=1e-9)
