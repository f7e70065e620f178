"""Properties of the estimate of what a browser spends on a file."""

import numpy as np
import pytest

from gauss2svg.measure.roundtrip import drawn_pixels, paint_ms
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import cut_radius


def one(mean, sigma=(4.0, 2.0), copies=1, **given):
    """A scene of 100x80 px with copies of a shape."""
    repeated = np.ones((copies, 1))
    return Scene(
        100, 80, mean * repeated, sigma * repeated, np.zeros(copies), repeated * np.ones(3) / 2,
        np.ones(copies), **given,
    )  # fmt: skip


@pytest.mark.parametrize(("beta", "rho"), [(1.0, 0.0), (3.0, 0.9)])
def test_a_shape_is_drawn_over_the_part_of_its_ellipse_that_is_on_the_canvas(beta, rho):
    scene = one((50, 40), beta=np.array([beta])).replace(rho=np.array([rho]))
    area = np.pi * cut_radius(beta) ** 2 * np.sqrt(np.linalg.det(scene.covariance[0]))
    assert drawn_pixels(scene) == pytest.approx(area)
    assert drawn_pixels(scene.replace(mean=[[-500, 40]])) == 0
    assert drawn_pixels(scene.replace(mean=[[0, 40]])) == pytest.approx(area / 2)
    assert drawn_pixels(scene.replace(sigma=[[1e4, 1e4]])) <= 100 * 80


def cost(scene, svg="<svg/>", width=100.0) -> float:
    return paint_ms(scene, svg, width)


def test_cost_grows_with_shapes_pixels_and_masks():
    once = cost(one((50, 40)))
    assert cost(Scene(100, 80)) == 0
    assert cost(one((50, 40)), "<svg><filter/></svg>") is None
    assert cost(one((50, 40), copies=30)) == pytest.approx(30 * once)
    assert cost(one((50, 40), sigma=(8.0, 4.0))) > once
    masks = cost(one((50, 40)), "<svg><mask/></svg>")
    half = cost(one((50, 40)), '<svg><style/><mask/><use href="#a"/><circle r="1"/></svg>')
    assert masks > once
    assert half == pytest.approx((once + masks) / 2)  # of the shapes one is under a mask
