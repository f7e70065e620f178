"""Laws of additive Gaussians beside those of both blends (test_render.py)."""

import math

import numpy as np
import pytest
from both_renderers import planar
from conftest import random_sum
from hypothesis import given
from hypothesis import strategies as st

from gauss2svg.errors import SceneError
from gauss2svg.render import render
from gauss2svg.scene import MOST_SIGNED, Scene, peaks_of


@given(st.integers(0, 2**32 - 1))
def test_order_does_not_matter_in_additive_blending(seed):
    scene = random_sum(20, 33, 17, seed).replace(round_index=None)
    turned = scene.select(np.random.default_rng(seed).permutation(20))
    np.testing.assert_allclose(planar(turned, np.float64), planar(scene, np.float64), atol=1e-12)


def test_densities_are_the_papers_coefficients():
    scene = random_sum(6, 30, 30, 1)
    for k in range(6):
        determinant = float(np.linalg.det(scene.covariance[k]))
        phi = 1 / (2 * math.pi * math.sqrt(determinant))  # the normal density at its mean
        np.testing.assert_allclose(scene.densities[k] * phi, scene.color[k], rtol=1e-9)
    back = peaks_of(scene.densities, scene.sigma, scene.rho)
    np.testing.assert_allclose(back, scene.color, rtol=1e-12)


def test_bad_additive_scenes_are_refused():
    scene = random_sum(3, 20, 20, 2)
    with pytest.raises(SceneError, match=r"opacity.* additive"):
        scene.replace(opacity=np.array([1.0, 0.5, 1.0]))
    with pytest.raises(SceneError, match=r"beta.* additive"):
        scene.replace(beta=np.full(3, 2.0))
    with pytest.raises(SceneError, match="color"):
        scene.replace(color=np.full((3, 3), 1.01 * MOST_SIGNED))
    with pytest.raises(SceneError, match=r"color.*0\.\.1"):
        scene.replace(color=np.full((3, 3), -0.1), blend="over")
    with pytest.raises(SceneError, match=r"blend (as|of)"):
        scene.concatenate(Scene(20, 20))


def test_an_additive_scene_is_saved_and_loaded_bit_for_bit(tmp_path):
    scene = random_sum(9, 20, 10, 3)
    scene.save(tmp_path / "additive.npz")
    back = Scene.load(tmp_path / "additive.npz")
    assert back.blend == "add"
    np.testing.assert_array_equal(back.color, scene.color)
    np.testing.assert_array_equal(render(back), render(scene))
