"""Laws that hold for all transparent scenes of the domain: alpha, backdrops, files."""

from xml.etree import ElementTree

import numpy as np
import pytest
from extreme_scenes import extreme_scenes, rounding_of
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from gauss2svg.errors import SceneError
from gauss2svg.photo.pixels import BACKDROPS
from gauss2svg.pipeline.palette import quantize
from gauss2svg.render import render, render_rgba
from gauss2svg.scene import Scene
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import write_svg

ROUNDING = {np.float32: 6e-5, np.float64: 3e-7}  # of two renders, and of the float32 result
in_both = pytest.mark.parametrize("dtype", ROUNDING, ids=["float32", "float64"])
clear_scenes = extreme_scenes().map(lambda scene: scene.replace(transparent=True))
SVG = "{http://www.w3.org/2000/svg}"


def on_backdrop(scene: Scene, backdrop: float) -> Scene:
    return scene.replace(background=np.full(3, backdrop))


def shown_over(rgba: NDArray, backdrop: float) -> NDArray:
    color, alpha = rgba[:, :, :3].astype(np.float64), rgba[:, :, 3:].astype(np.float64)
    return color * alpha + (1 - alpha) * backdrop


@in_both
@given(clear_scenes)
def test_colour_and_alpha_are_finite_and_within_their_range(dtype, scene):
    rgba = render_rgba(scene, dtype=dtype)
    assert rgba.shape == (round(scene.height), round(scene.width), 4)
    assert np.isfinite(rgba).all()
    assert rgba.min() >= 0
    assert rgba.max() <= 1
    assert (rgba[rgba[:, :, 3] == 0] == 0).all()  # nothing has no colour


@in_both
@given(clear_scenes)
def test_over_a_backdrop_it_is_the_scene_on_that_background(dtype, scene):
    pytest.importorskip("torch")
    from gauss2svg.render.reference import render_reference

    rgba, allowed = render_rgba(scene, dtype=dtype), ROUNDING[dtype] + 2 * rounding_of(scene)
    for backdrop in BACKDROPS:
        expected = render(on_backdrop(scene, backdrop), dtype=dtype)
        np.testing.assert_allclose(shown_over(rgba, backdrop), expected, atol=allowed)
        oracle = render_reference(on_backdrop(scene, backdrop)).numpy()
        np.testing.assert_allclose(shown_over(rgba, backdrop), oracle, atol=allowed)


@given(clear_scenes, st.tuples(*[st.floats(0, 1)] * 3))
def test_the_background_changes_neither_colour_nor_alpha(scene, backdrop):
    other = scene.replace(background=np.array(backdrop))
    assert render_rgba(other).tobytes() == render_rgba(scene).tobytes()


@given(extreme_scenes(betas=(1.0, 1.0, 1.7, 6.0, 64.0)), st.sampled_from([0, 6]))
def test_its_file_has_no_background_and_is_read_back_transparent(scene, palette):
    scene = quantize(scene, palette=palette)
    try:
        opaque = write_svg(scene)
    except SceneError:
        with pytest.raises(SceneError):
            write_svg(scene.replace(transparent=True))
        return
    text = write_svg(scene.replace(transparent=True))
    before, after = (ElementTree.fromstring(one.encode()) for one in (opaque, text))
    assert len(list(before.iter(SVG + "rect"))) == 1
    assert not list(after.iter(SVG + "rect"))
    shapes = [[e.attrib for e in root.iter(SVG + "circle")] for root in (before, after)]
    assert shapes[0] == shapes[1]
    back, same = read_svg(text), read_svg(opaque)
    assert back.transparent
    assert not same.transparent
    for name in ("mean", "sigma", "rho", "color", "opacity", "beta"):
        assert getattr(back, name).tobytes() == getattr(same, name).tobytes()
