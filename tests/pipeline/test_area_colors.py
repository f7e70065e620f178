"""Properties of colours that are solved: shifted ones come back, and hidden ones stay."""

import dataclasses

import numpy as np
import pytest
from scenes import random_scene

from gauss2svg.measure.metrics import psnr
from gauss2svg.photo.pixels import stacked
from gauss2svg.pipeline.area_colors import with_solved_colors
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
