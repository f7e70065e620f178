"""Properties of the raster of areas and lines: the kernels, their readable twin and resvg."""

import numpy as np
import pytest
from both_renderers import drawn, in_both, tensors_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import random_scene, with_levels
from with_torch import render_reference, torch

from gauss2svg.photo.pixels import over
from gauss2svg.raster import rasterize
from gauss2svg.render import render, render_rgba
from gauss2svg.render.areas import coverage_of, draw_areas, ground_of
from gauss2svg.scene import ABOVE, PLAIN, SOFT, Scene
from gauss2svg.scene.areas import CAPS, Area, LinearGradient, Outline, RadialGradient

BOX = (-2, 3, 11, 8)  # left, top, width, height
BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)


def star(seed: int, left: float) -> Outline:
    """A closed outline of curves around (left + 5, 5) that does not cross itself."""
    rng = np.random.default_rng(seed)
    count = 3 * int(rng.integers(3, 7))
    angle, radius = 2 * np.pi * np.arange(count) / count, rng.uniform(2, 4.5, count)
    points = 5 + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return Outline(tuple(map(tuple, points + [left, 0])), (True,) * (count // 3))


SHARP = ((4, 6), (56, 10.3), (28, 19.8), (40, 54.5))  # the first corner is beyond the mitre limit
CURVES = ((20, 60.3), (50, 50), (60, 30), (40, -10), (8, 5))  # a line, then a curve
LOOP = ((5, 5), (40, -10), (60, 30), (50, 50), (20, 60.3), (10, 20))
HOLE = ((30, 20), (22, 34), (30, 44), (40, 34))
PICTURES = {
    "hole": Area((Outline(LOOP, (True, False, False, False)), Outline(HOLE, (False,) * 4)), BLACK),
    "inside out": Area((Outline(LOOP[::-1], (False, False, True, False)),), BLACK),
}
OUTLINES = {
    "corners": Outline(SHARP, (False,) * 3, False),
    "curve": Outline(CURVES, (False, True), False),
    "closed": Outline(LOOP, (True, False, False, False)),
    "closed corners": Outline(SHARP, (False,) * 4),
    "equal points": Outline((SHARP[0], *SHARP[:2], *SHARP[1:]), (False,) * 5, False),
    "handle on node": Outline(((9, 9), (9, 9), (50, 8), (50, 50), (20, 50)), (True, False), False),
    "dot": Outline(((30.2, 20.4), (30.2, 20.4)), (False,), False),
}
for _k, (_name, _outline) in enumerate(OUTLINES.items()):
    for _cap in CAPS if _name == "corners" else [CAPS[_k % 3]]:
        _width = {"butt": 5.3, "round": 4.0, "square": 0.7}[_cap]
        PICTURES[f"{_name}, {_cap}"] = Area((_outline,), BLACK, width=_width, cap=_cap)


def markup(area: Area) -> str:
    path = ""
    for outline in area.outlines:
        path += "M{} {}".format(*outline.points[0])
        for segment, is_curve in zip(outline.segments, outline.curved, strict=True):
            values = segment[1:] if is_curve else segment[3:]
            path += ("C" if is_curve else "L") + " ".join(map(str, values.ravel().tolist()))
        path += "Z" * outline.closed
    join = "round" if area.cap == "round" else "miter"
    stroke = (
        f'fill="none" stroke="#000" stroke-width="{area.width}" stroke-linecap="{area.cap}" '
        f'stroke-linejoin="{join}" '
    )
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 64 64">'
        f'<path fill="#fff" d="M0 0H64V64H0"/><path {stroke * area.is_line}d="{path}"/></svg>'
    )


@pytest.mark.parametrize("name", PICTURES)
def test_areas_and_lines_cover_what_resvg_covers(name):
    large = 1 - rasterize(markup(PICTURES[name]), 1024, 1024)[:, :, 0]
    exact = large.reshape(64, 16, 64, 16).mean(axis=(1, 3))
    np.testing.assert_allclose(coverage_of(PICTURES[name], 0, 0, 64, 64), exact, atol=0.02)


@pytest.mark.parametrize(("scale", "width"), [(1.0, 1e9), (1e9 / 64, 0.0), (1e-9, 1e-6)])
def test_extreme_areas_cover_shares(scale, width):
    for area in PICTURES.values():
        if width == 0 and not all(outline.closed for outline in area.outlines):
            continue
        drawn = Area(area.scaled(scale, scale).outlines, BLACK, width=width, cap=area.cap)
        covered = coverage_of(drawn, *BOX)
        assert ((covered >= 0) & (covered <= 1)).all()


def scene_of(seed: int) -> Scene:
    rng = np.random.default_rng(seed)
    stops = ((0.2, 0.9), ((1.0, 0.5, 0.0), (0.0, 0.25, 1.0)))
    small = [star(seed + k, k) for k in range(3)]
    areas = (
        Area((small[0],), tuple(rng.random(3)), 0.7),
        Area((small[1],), LinearGradient(*stops, (2.0, 1.0), (7.0, 8.0))),
        Area((small[2],), RadialGradient(*stops, (5.0, 4.0), (3.0, 6.0)), 0.6, width=1.5),
    )
    return random_scene(4, 9, 8, seed).replace(areas=areas)


@in_both
@settings(max_examples=5)
@given(st.integers(0, 2**16))
def test_a_gaussian_lies_over_the_areas_of_its_level_and_under_the_others(dtype, seed):
    scene = with_levels(scene_of(seed), seed).replace(drawn=[PLAIN, SOFT, PLAIN, SOFT])
    # Each area and each Gaussian is drawn over the picture of what is below it.
    image, rest = np.full((8, 9, 3), scene.background), list(scene.areas)
    for i, level in enumerate(scene.level.tolist()):
        below = rest[: len(rest) if level == ABOVE else level - len(scene.areas) + len(rest)]
        draw_areas(below, image)
        rest = rest[len(below) :]
        one = scene.select([i]).replace(areas=(), level=None)
        shown = [render(one.replace(background=b), 9, 8, np.float64) for b in (BLACK, WHITE)]
        image = shown[0] + (shown[1] - shown[0]) * image
    draw_areas(rest, image)
    np.testing.assert_allclose(render(scene, dtype=dtype), image, atol=1e-5)
    np.testing.assert_allclose(render_reference(scene), image, atol=1e-9)


def drawn_by_levels(scene: Scene, tensors: list[torch.Tensor], fast: bool) -> torch.Tensor:
    """The picture of tensors in place of the parameters of all Gaussians, those below areas too."""
    *shapes, image, beta = tensors
    first = 0
    for level in [*np.unique(scene.level[scene.level != ABOVE]).tolist(), ABOVE]:
        last = len(scene.areas) if level == ABOVE else level
        areas = Scene(9, 8, areas=scene.areas[first:last])
        grounds = (ground_of(areas, 8, 9, np.float64, grey) for grey in (0.0, 1.0))
        black, white = (torch.from_numpy(one).movedim(0, -1) for one in grounds)
        own, first = torch.from_numpy(scene.level == level), last
        parts = [tensor[own] for tensor in shapes]
        image = drawn(scene, [*parts, black + (white - black) * image, beta[own]], fast)
    return image


@pytest.mark.parametrize(("fast", "seed"), [(False, 0), (True, 1)])
def test_gradients_of_gaussians_above_and_below_areas_are_finite_differences(seed, fast):
    scene = scene_of(seed).replace(level=[1, 2, ABOVE, ABOVE], sigma=np.full((4, 2), 2.0))
    tensors = tensors_of(scene)
    image = drawn_by_levels(scene, tensors, fast).detach()
    np.testing.assert_allclose(image, render(scene, dtype=np.float64), atol=1e-12)
    assert torch.autograd.gradcheck(
        lambda *args: drawn_by_levels(scene, list(args), fast), tensors, fast_mode=True
    )


@settings(max_examples=5)
@given(st.integers(0, 2**16))
def test_alpha_of_areas_is_that_of_both_backgrounds(seed):
    scene = with_levels(scene_of(seed), seed).replace(transparent=True, drawn=[PLAIN, SOFT] * 2)
    rgba = render_rgba(scene)
    for backdrop in (BLACK, WHITE, (1.0, 0.0, 1.0)):
        shown = render(scene.replace(background=backdrop))
        np.testing.assert_allclose(over(rgba, backdrop), shown, atol=1e-5)


@settings(max_examples=5)
@given(st.integers(0, 2**16), st.sampled_from([(18, 16), (45, 8), (7, 600)]))
def test_a_scaled_scene_has_scaled_areas(seed, size):
    scene = with_levels(scene_of(seed), seed)
    scaled = scene.scaled(size[0] / 9, size[1] / 8)
    np.testing.assert_allclose(render(scaled, *size), render(scene, *size), atol=1e-4)


def test_a_gradient_has_its_colors_at_the_centres_of_pixels():
    page = Outline(((0, 0), (8, 0), (8, 8), (0, 8)), (False,) * 4)
    across = LinearGradient((0.0, 1.0), (BLACK, WHITE), (0.0, 0.0), (8.0, 0.0))
    picture = render(Scene(8, 8, background=WHITE, areas=(Area((page,), across),)), 8, 8)
    assert np.abs(picture - ((np.arange(8) + 0.5) / 8)[:, None]).max() < 0.01
