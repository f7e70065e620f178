"""Properties of colours that are solved: shifted ones come back, and hidden ones stay."""

import dataclasses

import numpy as np
import pytest
from scenes import random_scene

from gauss2svg.areas.find import FoundAreas
from gauss2svg.measure.metrics import psnr
from gauss2svg.photo.pixels import stacked
from gauss2svg.pipeline.found import with_shared_colors, with_solved_colors
from gauss2svg.render import render, render_rgba
from gauss2svg.scene import ABOVE, Scene
from gauss2svg.scene.areas import Area, LinearGradient, Outline, RadialGradient

WIDTH, HEIGHT = 60, 40
STOPS = (0.0, 0.4, 1.0), ((0.2, 0.6, 0.4), (0.8, 0.4, 0.2), (0.4, 0.2, 0.8))


def box(left, top, right, bottom, paint, opacity=1.0):
    corners = ((left, top), (right, top), (right, bottom), (left, bottom))
    return Area([Outline(corners, (False,) * 4)], paint, opacity)


# The first area is hidden by the second one.
AREAS = (
    box(6, 6, 18, 16, (0.6, 0.2, 0.2)),
    box(4, 4, 28, 30, LinearGradient(*STOPS, (4.0, 4.0), (28.0, 30.0))),
    box(30, 6, 56, 34, RadialGradient(*STOPS, (43.0, 20.0), (15.0, 15.0))),
    box(10, 20, 50, 28, (0.2, 0.4, 0.6), 0.6),
)


def scene_of(clear, level):
    gaussians = random_scene(5, WIDTH, HEIGHT, 3)
    gaussians = gaussians.replace(opacity=0.6 * gaussians.opacity, transparent=clear)
    background = [1.0, 1.0, 1.0] if clear else [0.8, 0.6, 0.4]
    return gaussians.replace(background=background, areas=AREAS, level=[level] * 5)


def shifted(scene, by):
    """Return a scene whose colours of areas and background are changed by up to `by`."""
    rng = np.random.default_rng(1)

    def moved(colors):
        return np.clip(np.array(colors) + rng.uniform(-by, by, np.shape(colors)), 0, 1)

    areas = []
    for area in scene.areas:
        paint = area.paint
        if isinstance(paint, tuple):
            paint = tuple(moved(paint).tolist())
        else:
            paint = dataclasses.replace(paint, colors=tuple(map(tuple, moved(paint.colors))))
        areas.append(dataclasses.replace(area, paint=paint))
    background = scene.background if scene.transparent else moved(scene.background)
    return scene.replace(areas=areas, background=background)


def colors_of(scene: Scene):
    paints = [area.paint for area in scene.areas]
    colors = [p if isinstance(p, tuple) else p.colors for p in paints]
    return np.concatenate([np.reshape(color, (-1, 3)) for color in colors])


@pytest.mark.parametrize("level", [ABOVE, 0, 3])
@pytest.mark.parametrize("clear", [False, True])
def test_shifted_colors_come_back_and_hidden_ones_stay(clear, level):
    scene, draw = scene_of(clear, level), render_rgba if clear else render
    picture, wrong = draw(scene), shifted(scene, 0.2)
    found = with_solved_colors(wrong, picture)
    assert psnr(stacked(draw(wrong)), stacked(picture)) < 30
    assert psnr(stacked(draw(found)), stacked(picture)) > 50
    colors = colors_of(found)
    np.testing.assert_allclose(colors[1:], colors_of(scene)[1:], atol=0.04)
    np.testing.assert_allclose(colors[0], colors_of(wrong)[0], atol=0.51 / 255)
    np.testing.assert_allclose(found.background, scene.background, atol=0.02)
    np.testing.assert_allclose(255 * colors, np.round(255 * colors), atol=1e-9)


def test_solved_colors_are_closer_than_any_nearby():
    scene, rng = scene_of(False, ABOVE), np.random.default_rng(2)
    picture = np.clip(render(scene) + rng.normal(0, 0.2, (HEIGHT, WIDTH, 3)), 0, 1)
    found = with_solved_colors(scene, picture.astype(np.float32))

    def error(one):
        return np.square(render(one) - picture).mean()

    best, channels = error(found), colors_of(found)
    assert ((channels > 0.05) & (channels < 0.95)).any()
    for by in (0.02, 0.05):
        assert error(shifted(found, by)) > best
    assert error(scene) > best


def test_equal_flat_colors_stay_equal_when_they_are_solved():
    scene = scene_of(False, ABOVE)
    one = tuple(np.round(255 * np.array([0.3, 0.5, 0.7])) / 255)
    areas = [a if k == 0 else dataclasses.replace(a, paint=one) for k, a in enumerate(scene.areas)]
    picture = np.clip(render(scene.replace(areas=areas)) + 0.1, 0, 1)
    found = with_solved_colors(scene.replace(areas=areas, background=one), picture)
    assert len({area.paint for area in found.areas[1:]} | {tuple(found.background)}) == 1
    assert found.areas[-1].paint != one


@pytest.mark.parametrize("is_noisy", [False, True])
def test_nearly_equal_colors_become_that_of_the_larger_area(is_noisy):
    def area(side, level):
        ring = Outline(((0, 0), (side, 0), (side, side), (0, side)), (False,) * 4)
        return Area((ring,), (level / 255, 0.5, 0.5))

    levels = {30: 100.0, 6: 115.0, 28: 108.0, 29: 101.0, 5: 200.0}
    areas = tuple(area(side, level) for side, level in levels.items())
    found = FoundAreas(areas, (100.9 / 255, 0.5, 0.5), 1.0, 40.0, 0.0, 0.0)
    shared = with_shared_colors(found, is_noisy)
    assert shared.background == found.background
    reds = [round(255 * one.paint[0], 6) for one in shared.areas]
    # 7 levels are little for 36 px of a picture with noise, but not for 784 px.
    assert reds == [100.9, 108 if is_noisy else 115, 108, 100.9, 200]
    assert with_shared_colors(shared, is_noisy) == shared
