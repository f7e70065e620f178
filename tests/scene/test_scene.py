import copy
import dataclasses
import io
import math
import pickle

import numpy as np
import pytest
from conftest import random_scene, random_sum

from gauss2svg.errors import Gauss2SvgError, InputError, SceneError
from gauss2svg.render import render
from gauss2svg.scene import MOST_SIGNED, RHO_LIMIT, Scene, peaks_of

ARRAYS = ("mean", "sigma", "rho", "color", "opacity", "background", "beta", "round_index")


def test_arrays_cannot_be_written():
    scene = random_scene(3)
    for name in ARRAYS:
        with pytest.raises(ValueError, match="read-only"):
            getattr(scene, name)[...] = 0


@pytest.mark.parametrize(
    "again", [copy.copy, copy.deepcopy, lambda scene: pickle.loads(pickle.dumps(scene))]
)
def test_a_copied_or_pickled_scene_is_the_same_and_cannot_be_written(again):
    scene = random_scene(5)
    other = again(scene)
    for field in dataclasses.fields(scene):
        assert np.array_equal(getattr(other, field.name), getattr(scene, field.name))
    for name in ARRAYS:
        with pytest.raises(ValueError, match="read-only"):
            getattr(other, name)[...] = 0


def test_scene_does_not_share_the_arrays_it_was_given():
    mean = np.ones((1, 2))
    scene = Scene(4, 4, mean, np.ones((1, 2)), np.zeros(1), np.ones((1, 3)), np.ones(1))
    mean[:] = 7
    assert (scene.mean == 1).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sigma": np.zeros((2, 2))}, r"sigma\[0, 0\] must be .* got 0.0"),
        ({"rho": np.array([0.0, 1.0])}, r"rho\[1\] must be .* got 1.0"),
        ({"opacity": np.array([0.0, np.nan])}, r"opacity\[1\] must be .* got nan"),
        ({"color": np.full((2, 3), 1.5)}, r"color\[0, 0\] must be .* got 1.5"),
        ({"mean": np.zeros((2, 3))}, r"mean must be of shape \(2, 2\); got \(2, 3\)"),
        ({"color": np.full((2, 3), 200)}, r"color\[0, 0\] must be .* Try to divide by 255"),
        ({"color": np.full((2, 3), 1.1)}, r"color\[0, 0\] must be .* Try to clip it"),
        ({"background": (255, 0, 0)}, r"background\[0\] must be .* Try to divide by 255"),
        ({"mean": np.full((2, 2), np.inf)}, r"mean\[0, 0\] must be finite .* got inf"),
        ({"rho": np.zeros(3)}, r"rho must be of shape \(2,\); got \(3,\)"),
        ({"background": np.array([0, 0, 2])}, r"background\[2\]"),
        ({"round_index": np.array([1, 0])}, "round_index must be in painter.s order"),
        ({"width": 0}, "width must be a number .* got 0"),
        ({"height": np.nan}, "height must be a number .* got nan"),
        ({"round_index": np.array([0.0, 1.7])}, "whole numbers"),
        ({"blend": "multiply"}, "blend must be one of over, add; got 'multiply'"),
        ({"beta": np.ones(3)}, r"beta must be of shape \(2,\); got \(3,\)"),
        ({"beta": np.array([1, 0.4])}, r"beta\[1\] must be .* got 0.4"),
        ({"beta": np.array([300, 1])}, r"beta\[0\] must be .* got 300"),
        ({"color": "red"}, "color must be an array of real numbers"),
        ({"mean": np.ones((2, 2)) + 1j}, "mean must be an array of real numbers; got complex"),
        ({"mean": [[1, 2], [3]]}, "mean must be an array"),
        ({"rho": np.ma.array([0.1, 0.2], mask=[0, 1])}, "rho must be .* numbers; got masked ones"),
        ({"round_index": np.ma.masked_all(2, int)}, "round_index must be .*; got masked ones"),
        ({"background": [10**400, 0, 0]}, "background must be an array"),
        ({"round_index": [0, np.inf]}, "whole numbers up to 2147483647"),
        ({"round_index": [0, 2**40]}, "whole numbers up to 2147483647"),
        ({"round_index": [-1, 0]}, r"round_index\[0\] must be .* got -1"),
        ({"width": "x"}, "width must be a number .* got 'x'"),
        ({"width": [3, 4]}, r"width must be a number .* got \[3, 4\]"),
        ({"height": 1j}, "height must be a number .* got 1j"),
        ({"height": None}, "height must be a number .* got None"),
    ],
)
def test_bad_field_is_refused_with_its_name_and_place(change, message):
    with pytest.raises(SceneError, match=message):
        random_scene(2).replace(**change)


def test_covariance_conic_and_axes_agree():
    scene = random_scene(50, seed=3)
    covariance = scene.covariance
    sx, sy = scene.sigma.T
    np.testing.assert_allclose(covariance[:, 0, 1], scene.rho * sx * sy, rtol=1e-12)
    np.testing.assert_allclose(covariance[:, 1, 1], sy**2, rtol=1e-12)
    np.testing.assert_allclose(
        covariance @ scene.conic, np.broadcast_to(np.eye(2), (50, 2, 2)), atol=1e-9
    )
    axes, angle = scene.ellipse_axes
    values, vectors = np.linalg.eigh(covariance)
    np.testing.assert_allclose(axes[:, ::-1] ** 2, values, rtol=1e-9)
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    np.testing.assert_allclose(np.abs(np.sum(along * vectors[:, :, 1], axis=1)), 1, atol=1e-9)


def test_a_scene_of_its_own_covariance_is_itself():
    scene = random_scene(20)
    again = Scene.from_covariance(
        scene.width, scene.height, scene.mean, scene.covariance, scene.color, scene.opacity,
        background=scene.background,
    )  # fmt: skip
    for name in ("mean", "sigma", "rho", "color", "opacity", "background"):
        assert np.allclose(getattr(again, name), getattr(scene, name), rtol=1e-12), name
    single = Scene.from_covariance(
        9, 9, scene.mean, np.float32(scene.covariance), scene.color, 0.5, blend="over"
    )
    assert np.allclose(single.covariance, scene.covariance, rtol=1e-5)
    assert (single.opacity == 0.5).all()


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        ([[1, 0.2], [0.3, 1]], r"covariance\[1\] must be symmetric; got \[\[1.0, 0.2\]"),
        ([[1, 2], [2, 1]], r"covariance\[1\] must be positive definite"),
        ([[1, 1], [1, 1]], r"covariance\[1\] must be positive definite"),
        ([[0, 0], [0, 1]], r"covariance\[1\] must be positive definite"),
        ([[-1, 0], [0, -1]], r"covariance\[1\] must be positive definite"),
        ([[np.nan, 0], [0, 1]], r"covariance\[1\] must be finite"),
        ([[np.inf, 0], [0, 1]], r"covariance\[1\] must be finite"),
    ],
)
def test_a_matrix_that_is_no_covariance_is_refused_with_its_number(matrix, message):
    with pytest.raises(SceneError, match=message):
        Scene.from_covariance(9, 9, np.ones((2, 2)), [np.eye(2), matrix], np.ones((2, 3)))


@pytest.mark.parametrize("covariance", [np.eye(2), np.ones((2, 3)), "none", [["a"]]])
def test_what_is_no_array_of_matrices_is_refused(covariance):
    with pytest.raises(SceneError, match="covariance must be"):
        Scene.from_covariance(9, 9, np.ones((2, 2)), covariance, np.ones((2, 3)))


def test_a_tensor_that_requires_a_gradient_is_refused_by_name():
    torch = pytest.importorskip("torch")
    tensor = torch.ones((2, 2), requires_grad=True)
    with pytest.raises(SceneError, match=r"scene mean must be .* Try tensor\.detach\(\)"):
        Scene.from_covariance(9, 9, tensor, [np.eye(2)] * 2, np.ones((2, 3)))
    with pytest.raises(SceneError, match=r"^covariance must be .* Try tensor\.detach\(\)"):
        Scene.from_covariance(9, 9, np.ones((2, 2)), tensor[None], np.ones((2, 3)))


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


def test_axes_stay_positive_for_the_thinnest_shapes():
    scene = Scene(
        4, 4, np.zeros((2, 2)), np.array([[1e-6, 1e6], [1, 1]]), np.array([0.5, RHO_LIMIT]),
        np.zeros((2, 3)), np.ones(2),
    )  # fmt: skip
    assert (scene.ellipse_axes[0] > 0).all()
    assert np.isfinite(scene.conic).all()


@pytest.mark.parametrize("scene", [random_scene(20, seed=5), random_sum(9, 20, 10, 3)], ids=repr)
def test_saved_scene_comes_back_to_the_last_bit(scene, tmp_path):
    stream = io.BytesIO()
    scene.save(stream)
    stream.seek(0)
    scene.save(tmp_path / "scene with no suffix")
    for back in (Scene.load(stream), Scene.load(tmp_path / "scene with no suffix")):
        for name in ARRAYS:
            assert getattr(back, name).tobytes() == getattr(scene, name).tobytes()
        assert (back.width, back.height) == (scene.width, scene.height)
        assert back.blend == scene.blend


def test_another_format_is_refused_with_its_version():
    stream = io.BytesIO()
    np.savez(stream, format_version=2)
    stream.seek(0)
    with pytest.raises(InputError, match=r"version of a scene file must be 1; got 2"):
        Scene.load(stream)


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04broken"])
def test_file_that_is_no_scene_is_refused(content):
    with pytest.raises(InputError, match="scene file must be"):
        Scene.load(io.BytesIO(content))


def test_npz_without_the_fields_is_refused():
    stream = io.BytesIO()
    np.savez(stream, mean=np.zeros((0, 2)))
    stream.seek(0)
    with pytest.raises(InputError, match="scene file must be"):
        Scene.load(stream)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width": np.array([40.0, 30.0])}, "must be one written by Scene.save"),
        ({"transparent": np.array([True, False])}, "must be one written by Scene.save"),
        ({"blend": np.array(["over", "add"])}, "must be one written by Scene.save"),
        ({"transparent": "yes"}, "transparent must be True or False; got 'yes'"),
        ({"height": "x"}, "height must be a number .* got 'x'"),
        ({"height": 1j}, "height must be a number .* got 1j"),
    ],
)
def test_npz_with_fields_of_another_form_is_refused(change, message):
    scene, stream = random_scene(2), io.BytesIO()
    fields = {f.name: getattr(scene, f.name) for f in dataclasses.fields(scene)} | change
    np.savez(stream, format_version=1, **fields)
    stream.seek(0)
    with pytest.raises(Gauss2SvgError, match=message):
        Scene.load(stream)


def test_halves_put_together_are_the_whole():
    scene = random_scene(20, seed=6)
    joined = scene.select(slice(0, 8)).concatenate(scene.select(np.arange(20) >= 8))
    for name in ("mean", "sigma", "rho", "color", "opacity"):
        assert (getattr(joined, name) == getattr(scene, name)).all()
    assert (np.diff(joined.round_index) >= 0).all()


@pytest.mark.parametrize(
    "index",
    [
        np.array([5]), np.array([-6]), np.array([True]), np.array([1.0]), np.array([[1]]), 1, "a",
        None, slice("a"), (slice(None), 0), [[1], [1, 2]],
    ],
    ids=str,
)  # fmt: skip
def test_gaussians_that_are_not_there_cannot_be_selected(index):
    with pytest.raises(InputError, match=r"^index must be a slice, a mask of 5 or indices in -5"):
        random_scene(5).select(index)


def test_slices_masks_and_indices_select_the_same():
    scene = random_scene(5)
    mask = np.array([False, True, True, False, False])
    for index in (slice(1, 3), mask, [1, 2], np.array([-4, -3])):
        assert np.array_equal(scene.select(index).mean, scene.mean[1:3])
    assert len(scene.select(slice(9, 12))) == len(scene.select([])) == 0


def test_scene_has_no_resolution():
    scene = random_scene(10, seed=7)
    larger = scene.scaled(3)
    assert (larger.width, larger.height) == (3 * scene.width, 3 * scene.height)
    np.testing.assert_allclose(render(scene, 80, 60), render(larger, 80, 60), atol=1e-6)
