"""Properties of the estimate of what a browser spends on a file."""

import numpy as np
import pytest

from gauss2svg.measure.roundtrip import paint_ms
from gauss2svg.scene import Scene


def one(mean, sigma=(4.0, 2.0), copies=1, **given):
    """A scene of 100x80 px with copies of a shape."""
    repeated = np.ones((copies, 1))
    return Scene(
        100, 80, mean * repeated, sigma * repeated, np.zeros(copies), repeated * np.ones(3) / 2,
        np.ones(copies), **given,
    )  # fmt: skip


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
