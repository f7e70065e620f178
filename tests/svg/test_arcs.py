"""Laws of plain ellipses as arcs of paths, and of painter's orders that draw the same."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.scene import PLAIN, Scene
from gauss2svg.scene.falloff import MOST_BETA
from gauss2svg.svg.minimal import minimal_rounded, minimal_svg
from gauss2svg.svg.minimal_shapes import arc_geometry, colors_together, path_data, shapes_of

SIDE = 90


def crisp_scene(count, seed=0, colors=3):
    """Opaque shapes with crisp rims, of so many colours."""
    rng = np.random.default_rng(seed)
    palette = np.round(rng.random((colors, 3)) * 15) / 15
    return Scene(
        SIDE, SIDE, rng.uniform(0, SIDE, (count, 2)), rng.uniform(2, 12, (count, 2)),
        rng.uniform(-0.9, 0.9, count), palette[rng.integers(colors, size=count)], np.ones(count),
        np.ones(3), beta=np.full(count, MOST_BETA),
    )  # fmt: skip


def drawn(element):
    return rasterize(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIDE} {SIDE}">{element}</svg>',
        4 * SIDE,
        4 * SIDE,
    )


@pytest.mark.parametrize("radii", [(20, 20), (30, 7), (6, 28), (1, 1), (25, 2), (3, 1)])
@pytest.mark.parametrize("tilt", [0, 45, -44, 17.5])
def test_an_arc_fills_the_ellipse_of_its_geometry(radii, tilt):
    numbers = np.array([[*radii, tilt, 45, 40]], float)
    (center,), (factor,) = arc_geometry(numbers)
    l11, l21, l22 = factor
    # Another way to draw it: the unit circle under the factor.
    matrix = f"{l11} {l21} 0 {l22} {center[0]} {center[1]}"
    circle = drawn(f'<circle r="1" transform="matrix({matrix})"/>')
    arc = drawn(f'<path d="{path_data(numbers)}"/>')
    assert circle.min() == 0
    # The chord cuts off three percent of a circle of one unit, and less of larger ones.
    assert np.abs(arc - circle).sum() < 0.035 * (1 - circle).sum() + 3 * 4


@given(st.floats(0.6, 300), st.floats(0.6, 300), st.floats(-math.pi, math.pi))
def test_rounded_numbers_are_their_own_rounding_and_near(major, minor, angle_rad):
    co, si = math.cos(angle_rad), math.sin(angle_rad)
    xx, yy = (major * co) ** 2 + (minor * si) ** 2, (major * si) ** 2 + (minor * co) ** 2
    rho = (major**2 - minor**2) * co * si / math.sqrt(xx * yy)
    scene = Scene(
        SIDE, SIDE, np.array([[40.0, 50.0]]), np.sqrt([[xx, yy]]), np.array([rho]),
        np.full((1, 3), 0.2), np.ones(1), beta=np.array([MOST_BETA]), drawn=[PLAIN],
    )  # fmt: skip
    rounded = minimal_rounded(scene, 1)
    assert minimal_svg(rounded, 1) == minimal_svg(scene, 1)
    assert np.abs(rounded.mean - scene.mean).max() <= 0.51
    near, far = (np.sort(s.ellipse_axes[0][0]) for s in (scene, rounded))
    np.testing.assert_allclose(near, far, atol=0.6, rtol=0.02)


def test_one_path_fills_the_union_of_its_ellipses():
    scene = crisp_scene(40, colors=1)
    assert minimal_svg(scene, 0.1).count("<path") == 2  # and the background
    numbers = shapes_of(scene, 1, 3, 2).numbers[:, :5]
    apart = drawn("".join(f'<path d="{path_data(row[None])}"/>' for row in numbers))
    together = drawn(f'<path d="{path_data(numbers)}"/>')
    # An antialiased edge within another ellipse may differ by a level or two.
    assert np.abs(apart - together).max() < 0.3
    assert np.mean(np.abs(apart - together) > 0.02) < 0.002


def order_of(scene):
    factor = scene.factor * 1.5
    entries = np.stack([factor[:, 0, 0], factor[:, 1, 0], factor[:, 1, 1]], axis=1)
    levels = np.round(scene.color * 255).astype(np.intp)
    return colors_together(scene.mean, entries, levels, scene.mean.T, 1.0)


def runs(scene):
    return 1 + np.count_nonzero(np.any(np.diff(scene.color, axis=0), axis=1))


@pytest.mark.parametrize("seed", range(3))
def test_the_order_by_colour_draws_the_same_with_fewer_changes_of_colour(seed):
    scene = crisp_scene(60, seed)
    ordered = scene.select(order_of(scene))
    assert np.abs(render(ordered) - render(scene)).max() < 1e-5
    assert runs(ordered) < 0.7 * runs(scene)
    again = ordered.select(order_of(ordered))
    np.testing.assert_array_equal(again.mean, ordered.mean)


def test_shapes_that_do_not_overlap_are_one_run_for_each_colour():
    x = np.arange(30) * 10.0 + 5
    scene = crisp_scene(30).replace(
        width=300, mean=np.stack([x, np.full(30, 20.0)], axis=1), sigma=np.full((30, 2), 2.0)
    )
    assert runs(scene.select(order_of(scene))) == len(np.unique(scene.color, axis=0))


def test_no_shapes_have_an_order():
    nothing = np.zeros((0, 3))
    assert not len(colors_together(nothing[:, :2], nothing, nothing.astype(int), nothing.T, 1.0))
