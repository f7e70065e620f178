"""Properties of scenes and falloffs: what they refuse, and that what is selected or saved stays."""

import copy
import dataclasses
import io
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import random_areas, random_scene, random_sum, with_levels

from gauss2svg.errors import Gauss2SvgError, SceneError
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import LEAST_BETA, MOST_BETA, cut_radius, half_radius, profile
from gauss2svg.scene.scene import PARAMETERS

FIELDS = [field.name for field in dataclasses.fields(Scene)]
TWO = random_scene(2)
AREAS = random_areas(4, 2)


def through_a_file(scene):
    stream = io.BytesIO()
    scene.save(stream)
    stream.seek(0)
    return Scene.load(stream)


def halves_joined(scene):
    mask = np.arange(len(scene)) >= 8
    return scene.select(slice(0, 8)).concatenate(scene.select(mask))


@pytest.mark.parametrize("scene", [random_scene(20, beta=(1, 30)), random_sum(9, 20, 10, 3)])
@pytest.mark.parametrize(
    "again",
    [
        copy.deepcopy,
        lambda scene: pickle.loads(pickle.dumps(scene)),
        through_a_file,
        lambda scene: halves_joined(scene).replace(round_index=scene.round_index),
    ],
)
def test_a_scene_comes_back_to_the_last_bit_and_cannot_be_written(again, scene):
    if scene.blend == "over":
        scene = scene.replace(drawn=np.arange(20) % 3, transparent=True)
    other = again(scene)
    for name in FIELDS:
        one, two = np.asarray(getattr(scene, name)), np.asarray(getattr(other, name))
        assert one.tobytes() == two.tobytes()
        assert one.dtype == two.dtype
    for parameter in PARAMETERS:
        with pytest.raises(ValueError, match="read-only"):
            getattr(other, parameter.name)[...] = 0


@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_areas_come_back_exactly_and_follow_the_canvas(seed):
    scene = with_levels(random_scene(3).replace(areas=random_areas(5, seed)), seed)
    for other in (through_a_file(scene), copy.deepcopy(scene), pickle.loads(pickle.dumps(scene))):
        assert other.areas == scene.areas
        np.testing.assert_array_equal(other.level, scene.level)
    assert scene.scaled(2, 4).areas == tuple(area.scaled(2, 4) for area in scene.areas)
    assert scene.select([0]).areas == scene.concatenate(TWO).areas == scene.areas
    joined = scene.select([0, 2]).concatenate(TWO.replace(level=[0, -1]))
    assert joined.level.tolist() == [*scene.level[[0, 2]], -1, -1]
    assert "5 areas" in repr(scene)
    assert scene.inks is None
    with pytest.raises(SceneError, match="the upper scene must have no areas; got 5"):
        TWO.concatenate(scene)


REFUSALS = [
    ({"sigma": np.zeros((2, 2))}, r"sigma\[0, 0\] must be finite and in .* got 0.0. Try"),
    ({"color": np.full((2, 3), 200)}, r"color\[0, 0\] must be .* to divide by 255"),
    ({"mean": np.zeros((2, 3))}, r"mean must be of shape \(n, 2\); got \(2, 3\)"),
    ({"rho": np.ma.array([0.1, 0.2], mask=[0, 1])}, r"rho\[1\] .* got nan. Try to replace NaN"),
    ({"round_index": [1, 0]}, "round_index must not decrease"),
    ({"level": [0, 1]}, "level must be at most 0, the number of areas; got 1"),
    ({"blend": "multiply"}, "blend must be one of over, add; got 'multiply'"),
    ({"blend": "add", "opacity": [1, 1], "beta": [1, 2]}, r"beta\[1\] must be .* additive scene"),
    ({"areas": 5}, "areas must be Areas; got 5"),
    ({"blend": "add", "opacity": [1, 1], "beta": None, "areas": AREAS}, "blend must be 'over' if"),
]


@pytest.mark.parametrize(("change", "message"), REFUSALS)
def test_bad_scenes_are_refused_by_the_name_of_the_field(change, message):
    with pytest.raises(Gauss2SvgError, match=f"^scene {message}"):
        TWO.replace(**change)


def npz(**fields):
    """Return the content of an .npz file as a scene's, with other fields."""
    stream = io.BytesIO()
    stored = {name: getattr(TWO, name) for name in FIELDS} | {"areas": "[]"}
    np.savez(stream, **stored | fields)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"PK\x03\x04broken", "scene file must be"),
        (b"\x89PNG\r\n\x1a\n", "got another format"),
        (npz(format_version=2), "Scene.save, in version 1; got format version 2"),
        (npz(format_version=1, skew=np.zeros(2)), "unexpected keyword argument .skew"),
        (npz(format_version=1, blend=np.array(["over", "add"])), "scene blend must be one of"),
    ],
)
def test_other_files_are_refused(content, message):
    with pytest.raises(Gauss2SvgError, match=message):
        Scene.load(io.BytesIO(content))


@pytest.mark.parametrize("parameter", PARAMETERS, ids=lambda one: one.name)
@pytest.mark.parametrize("make", [random_scene, random_sum])
def test_every_value_outside_of_its_domain_is_refused_by_name(parameter, make):
    scene = make(3, 40, 30, 0)
    for beyond in np.array(parameter.domain(scene.blend)) + [-1, 1]:
        values = getattr(scene, parameter.name).astype(float)
        values[-1] = beyond
        with pytest.raises(SceneError, match=f"scene {parameter.name}.* must be"):
            scene.replace(**{parameter.name: values})


def test_covariance_and_axes_agree():
    scene = random_scene(50, seed=3)
    covariance = scene.covariance
    sx, sy = scene.sigma.T
    np.testing.assert_allclose(covariance[:, 0, 1], scene.rho * sx * sy, rtol=1e-12)
    np.testing.assert_allclose(covariance[:, 1, 1], sy**2, rtol=1e-12)
    axes, angle = scene.ellipse_axes
    values, vectors = np.linalg.eigh(covariance)
    np.testing.assert_allclose(axes[:, ::-1] ** 2, values, rtol=1e-9)
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    np.testing.assert_allclose(np.abs(np.sum(along * vectors[:, :, 1], axis=1)), 1, atol=1e-9)
    again = Scene.from_covariance(
        scene.width, scene.height, scene.mean, scene.covariance, scene.color, scene.opacity,
        background=scene.background,
    )  # fmt: skip
    for name in ("mean", "sigma", "rho", "color", "opacity", "background"):
        np.testing.assert_allclose(getattr(again, name), getattr(scene, name), rtol=1e-9)


@pytest.mark.parametrize(
    "matrix", [[[1, 0.2], [0.3, 1]], [[1, 2], [2, 1]], [[0, 0], [0, 1]], [[np.nan, 0], [0, 1]]]
)
def test_a_matrix_that_is_no_covariance_is_refused_with_its_number(matrix):
    line = r"covariance\[1\] must be finite, symmetric and positive definite; got \[\["
    with pytest.raises(SceneError, match=line):
        Scene.from_covariance(9, 9, np.ones((2, 2)), [np.eye(2), matrix], np.ones((2, 3)))


def test_joined_scenes_are_later_rounds_of_one_blend():
    twice = TWO.concatenate(TWO)
    assert twice.round_index[2] == TWO.round_index[1] + 1
    later = TWO.concatenate(TWO.replace(round_index=[7, 9]))
    assert later.round_index.tolist() == [*TWO.round_index, 7, 9]
    with pytest.raises(SceneError, match="blend of the upper scene must be 'over'"):
        TWO.concatenate(random_sum(2, 9, 9, 0))


def test_slices_masks_and_indices_select_the_same_of_copies():
    scene, mean = random_scene(5), np.ones((5, 2))
    mask = np.array([False, True, True, False, False])
    for index in (slice(1, 3), mask, [1, 2], np.array([-4, -3])):
        assert np.array_equal(scene.select(index).mean, scene.mean[1:3])
    assert len(scene.select(slice(9, 12))) == len(scene.select([])) == 0
    for index in ([5], [-6], [True], 1, "a", None):
        with pytest.raises((IndexError, SceneError)):
            scene.select(index)
    changed = scene.replace(mean=mean)
    mean[:] = 7
    assert (changed.mean == 1).all()


BETAS = (LEAST_BETA, 1.0, 6.0, MOST_BETA)


@pytest.mark.parametrize("beta", BETAS)
def test_profile_falls_from_one_at_the_mean_to_zero_at_the_cut_without_a_step(beta):
    radius = cut_radius(beta)
    assert profile(np.array(0.0), beta) == 1
    assert profile(half_radius(beta), beta) == pytest.approx(0.5, abs=1e-9)
    assert (profile(np.array([radius, radius + 1e-9, 100.0, 1e6]), beta) == 0).all()
    assert profile(np.array(0.999 * radius), beta) > 0
    values = profile(np.linspace(0, radius + 1, 500001), beta)
    assert -5e-3 < np.diff(values).min() <= np.diff(values).max() <= 0
