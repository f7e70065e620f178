"""Laws of the table of shape parameters, and of what follows from it."""

import dataclasses
import io

import numpy as np
import pytest
from conftest import random_scene, random_sum

from gauss2svg import Scene, SvgFormat, read_svg, write_svg
from gauss2svg.errors import SceneError
from gauss2svg.fit.state import COLUMNS, GEOMETRY, STEPS, State
from gauss2svg.render import render
from gauss2svg.render.kernels import MOMENTS
from gauss2svg.scene import BLURRED, PLAIN, SOFT
from gauss2svg.scene.parameters import PARAMETERS, STEPPED, logistic, logit
from gauss2svg.svg.minimal.write import minimal_svg
from gauss2svg.svg.snap import snapped


def test_every_parameter_is_a_field_of_scenes_and_every_stepped_one_of_fits():
    scene = {field.name for field in dataclasses.fields(Scene)}
    others = {"width", "height", "background", "blend", "transparent"}
    assert scene - others == {parameter.name for parameter in PARAMETERS}
    state = {field.name for field in dataclasses.fields(State)}
    of_fits = {"mean", "factor", "round_index", "drawn", "first", "second", "age"}
    assert state - of_fits == {raw.name for _, raw in STEPPED}


def test_columns_are_the_moments_of_the_kernels_and_then_what_they_lack():
    ends = [columns.stop for columns in COLUMNS.values()]
    assert [len(GEOMETRY), *ends[:-1]] == [columns.start for columns in COLUMNS.values()]
    assert MOMENTS in ends
    assert ends[-1] == STEPS


@pytest.mark.parametrize("name", [raw.name for _, raw in STEPPED])
def test_raw_values_are_the_inverse_of_what_they_activate_to(name):
    parameter, raw = next(pair for pair in STEPPED if pair[1].name == name)
    values = np.linspace(raw.least, raw.most, 50)
    np.testing.assert_allclose(raw.inverse(raw.activated(values)), values, atol=1e-9)
    least, most = parameter.least, parameter.most
    assert ((raw.activated(values) >= least) & (raw.activated(values) <= most)).all()
    assert logit(logistic(0.3)) == pytest.approx(0.3)


@pytest.mark.parametrize("name", [parameter.name for parameter in PARAMETERS])
@pytest.mark.parametrize("make", [random_scene, random_sum])
def test_every_value_outside_of_its_domain_is_refused_by_name(name, make):
    scene = make(3, 40, 30, 0)
    parameter = next(p for p in PARAMETERS if p.name == name)
    for beyond in np.array(parameter.domain(scene.blend)) + [-1, 1]:
        values = getattr(scene, name).astype(float)
        values[-1] = beyond
        if np.isfinite(beyond):
            with pytest.raises(SceneError, match=f"scene {name}.* must be"):
                scene.replace(**{name: values})


def test_every_parameter_is_selected_joined_saved_and_kept_by_a_fit():
    scene = random_scene(12, beta=(1, 30)).replace(drawn=np.arange(12) % 3)
    kept, rest = scene.select(slice(5)), scene.select(slice(5, 12))
    stream, joined = io.BytesIO(), kept.concatenate(rest)
    scene.save(stream)
    stream.seek(0)
    loaded = Scene.load(stream)
    state = State.of(scene.mean, np.ones((12, 3)), 0).quantized(scene)
    for parameter in PARAMETERS:
        name = parameter.name
        assert getattr(loaded, name).tobytes() == getattr(scene, name).tobytes()
        assert getattr(loaded, name).dtype == parameter.dtype
        if name != "round_index":  # the upper scene's rounds are later ones
            np.testing.assert_array_equal(getattr(joined, name), getattr(scene, name))
    np.testing.assert_array_equal(state.drawn, scene.drawn)


@pytest.mark.parametrize("scale", [(-1.0, 1.0), (1.0, -1.0), (-2.0, -2.0)])
def test_parameters_that_follow_a_mirror_draw_the_mirrored_picture(scale):
    scene = random_scene(20, 40, 30, 3)
    width, height = np.abs(scale) * [scene.width, scene.height]
    followed = {
        p.name: p.followed(getattr(scene, p.name), np.array(scale))
        for p in PARAMETERS
        if p.followed
    }
    followed["mean"] += np.where(np.array(scale) < 0, [width, height], 0)
    mirrored = scene.replace(width=width, height=height, **followed)
    expected = render(scene, int(width), int(height))
    expected = expected[:: int(np.sign(scale[1])), :: int(np.sign(scale[0]))]
    assert np.abs(render(mirrored) - expected).max() < 1e-4


def test_plain_shapes_are_plain_ellipses_at_any_size_and_come_back_so():
    scene = Scene(200, 200, [[100, 100]], [[40, 30]], [0.2], [[1, 0, 0]], [1], beta=[2.0])
    plain = scene.replace(drawn=[PLAIN])
    for size in (1, 10):
        soft, flat = scene.scaled(size), plain.scaled(size)
        assert "radialGradient" in write_svg(soft)
        assert "radialGradient" in minimal_svg(soft, size)
        assert "radialGradient" not in write_svg(flat)
        assert "radialGradient" not in minimal_svg(flat, size)
    assert read_svg(write_svg(plain)).drawn.tolist() == [PLAIN]
    assert read_svg(write_svg(scene)).drawn.tolist() == [SOFT]


def test_blurred_shapes_are_blurred_in_their_form_alone_and_come_back_so():
    scene = random_scene(20, 200, 200, 1, sigma=(10, 20), beta=(1, 3)).replace(
        opacity=np.full(20, 0.5)
    )
    blurred = snapped(scene, "blur")
    assert (blurred.drawn == BLURRED).any()
    back = read_svg(write_svg(blurred, SvgFormat(form="blur")))
    np.testing.assert_array_equal(back.drawn, blurred.drawn)
    assert (snapped(blurred, "gradient").drawn == SOFT).all()
    assert "filter" not in write_svg(blurred)
