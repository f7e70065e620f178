"""Golden pictures, made by an oracle that shares no code with the renderers.

    python -m pytest tests/render/test_golden.py --rewrite-golden

rewrites them from the scenes in tests/golden. The oracle composes the Gaussians in
float64, one pixel and one Gaussian at a time, from the formula in the scene's docs.
"""

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scenes import random_scene

from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import BETA_CLASSES

GOLDEN = Path(__file__).parents[1] / "golden"
CUT = 3.0
GAUSSIANS = (1.0, 1.0)

SCENES = {
    "scattered": random_scene(80, 96, 64, 20, (1.0, 30.0), GAUSSIANS),
    "needles": random_scene(40, 96, 64, 21, (0.5, 40.0), GAUSSIANS).replace(
        rho=np.tile([0.99, -0.99], 20)
    ),
    "opaque": random_scene(30, 96, 64, 22, (3.0, 12.0), GAUSSIANS).replace(opacity=np.ones(30)),
    # exponents of a file, rims that are a pixel wide and wider
    "crisp": random_scene(40, 96, 64, 23, (8.0, 30.0), GAUSSIANS).replace(
        rho=np.tile([0.5, -0.3], 20), beta=np.resize(BETA_CLASSES[:-1], 40)
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
def test_both_renderers_draw_the_golden_picture(name, request):
    files = [GOLDEN / f"{name}-{channel}.png" for channel in range(3)]
    if request.config.getoption("--rewrite-golden"):
        SCENES[name].save(GOLDEN / f"{name}.npz")
        levels = np.round(oracle(SCENES[name]) * 65535).astype(np.uint16)
        for channel, file in enumerate(files):
            Image.fromarray(levels[:, :, channel]).save(file)
    scene = Scene.load(GOLDEN / f"{name}.npz")
    picture = np.stack([np.asarray(Image.open(file)) for file in files], axis=2) / 65535
    np.testing.assert_allclose(render(scene), picture, atol=4e-5)
    pytest.importorskip("torch")
    from gauss2svg.render.reference import render_reference

    np.testing.assert_allclose(render_reference(scene).numpy(), picture, atol=1 / 65535)
