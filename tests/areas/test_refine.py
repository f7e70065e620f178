"""Properties of the refinement of outlines, and of kinks, which go where nothing needs them."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from gauss2svg.areas.merge import without_cusps, without_kinks
from gauss2svg.areas.outlines import Path
from gauss2svg.areas.paint import Paint
from gauss2svg.areas.refine import Drawing, Layer
from gauss2svg.raster import rasterize
from gauss2svg.render.areas import coverage_of
from gauss2svg.scene.areas import Area, Outline

OUTLINE = Outline(
    ((4.3, 5.2), (10.1, 1.7), (18.2, 3.3), (20.4, 9.1), (15.2, 20.7), (6.6, 16.4)),
    (True, False, False, False),
)


CANVAS = np.zeros((24, 24, 1), np.float32)


def drawing_of(outline: Outline, pixels, width: float = 0.0, page: float = 0, is_tied=False):
    """Return a drawing of a white area, or of a line, on a page."""
    path = Path(outline.segments, np.array(outline.curved), outline.closed)
    layers, paints = [Layer(0, [path], width)], [Paint(np.ones(1))]
    return Drawing(pixels, Paint(np.full(1, page)), paints, layers, is_tied)


def test_samples_are_the_gradient_of_the_readable_twin():
    drawing = drawing_of(OUTLINE, CANVAS)
    drawing.draw()
    drawing.weigh()
    pixel, owner, jacobian, _ = drawing.samples()
    sampled = np.zeros((24 * 24, len(drawing.point), 2))
    for place, segment, row in zip(pixel, owner, jacobian, strict=True):
        for point, move in zip(drawing.segment[segment], row[:8].reshape(4, 2), strict=True):
            sampled[place, point] += move
    exact = np.empty_like(sampled)
    for place in np.ndindex(6, 2):
        shift = np.zeros((6, 2))
        shift[place] = 1e-3
        more, less = (
            coverage_of(Area((replace(OUTLINE, points=points),), (0.0,) * 3), 0, 0, 24, 24)
            for points in (OUTLINE.points + shift, OUTLINE.points - shift)
        )
        exact[:, *place] = (more - less).ravel() / 2e-3
    assert np.abs(sampled - exact).max() < 0.15  # about half a sample of 1/4 px
    total = np.abs(exact).sum(axis=0)
    assert np.abs(sampled.sum(axis=0) - exact.sum(axis=0)).max() < 0.02 * total.max()


def test_refinement_finds_an_outline_that_was_moved():
    target = drawing_of(OUTLINE, CANVAS).draw()
    moved = Outline(tuple((x + 0.6, y - 0.5) for x, y in OUTLINE.points), OUTLINE.curved)
    drawing = drawing_of(moved, target)
    drawing.refine(20, colors=False)
    nodes = [0, 3, 4, 5]  # handles may slide along their tangents
    assert np.abs(drawing.point - np.array(OUTLINE.points))[nodes].max() < 0.05


@pytest.mark.parametrize("width", [1.5, 3.0])
def test_refinement_finds_the_width_and_the_ends_of_a_line(width):
    points = ((3.2, 6.1), (9.0, 1.5), (14.0, 20.0), (20.3, 17.2))
    moved = tuple((x + 0.3, y + 0.4) for x, y in points)
    target = drawing_of(Outline(points, (True,), False), CANVAS, width).draw()
    drawing = drawing_of(Outline(moved, (True,), False), target, 1.3 * width)
    drawing.refine(30, colors=False)
    assert drawing.width[0] == pytest.approx(width, abs=0.03)
    assert np.abs(drawing.point[[0, 3]] - np.array(points)[[0, 3]]).max() < 0.05


@pytest.mark.parametrize("seed", range(5))
def test_refinement_never_raises_the_error(seed):
    """No step does, even if the first outline crosses itself and is far from the right one."""
    target = drawing_of(OUTLINE, CANVAS).draw()
    points = np.array(OUTLINE.points) + np.random.default_rng(seed).normal(0, 6, (6, 2))
    drawing = drawing_of(replace(OUTLINE, points=tuple(map(tuple, points))), target)
    errors = [((drawing.draw() - target) ** 2).sum()]
    for _ in range(10):
        drawing.refine(1, colors=False)
        errors.append(((drawing.draw() - target) ** 2).sum())
    assert (np.diff(errors) <= 1e-6 * errors[0]).all()


def test_ties_keep_smooth_joins_smooth_and_level_lines_level():
    """A rounded rectangle stays one while it is fitted to another picture."""
    points = [(6, 4), (16, 4.02), (18, 4), (20, 6), (20, 8), (20.02, 16), (6, 16)]
    outline = Outline(tuple(points), (False, True, False, False, False))
    target = np.roll(drawing_of(outline, CANVAS).draw(), 1, axis=0)
    drawing = drawing_of(outline, target, is_tied=True)
    drawing.refine(10, colors=False)
    p = drawing.current()[0].paths[0].segments
    assert p[0, 0, 1] == p[0, 3, 1]
    assert p[2, 0, 0] == p[2, 3, 0]
    for u, v in ((p[0, 3] - p[0, 0], p[1, 1] - p[1, 0]), (p[1, 3] - p[1, 2], p[2, 3] - p[2, 0])):
        assert abs(u[0] * v[1] - u[1] * v[0]) < 1e-9 * np.hypot(*u) * np.hypot(*v)


@pytest.mark.parametrize(("size", "is_mirrored"), [(1, True), (20, False)])
def test_handles_about_equally_long_mirror_each_other_unless_one_moves_far(size, is_mirrored):
    points = size * np.array([(0, 3), (0, 1), (0, 0), (1, 0), (2.4, 0), (4, 1), (4, 3)])
    outline = Outline(tuple(map(tuple, points)), (True, True), closed=False)
    p = drawing_of(outline, CANVAS, 1.0, is_tied=True).current()[0].paths[0].segments
    join = p[0, 3]
    assert np.allclose(join - p[0, 2], p[1, 1] - join) == is_mirrored
    assert is_mirrored or np.allclose(p, outline.segments)


PICTURE = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 60 40">
<path fill="#fff" d="M0 0h60v40H0z"/><path d="M10 10H{0}a8 8 0 0 1 0 16H10z"/></svg>"""


def line(*nodes):
    return [np.array([a, a, b, b], float) for a, b in itertools.pairwise(nodes)]


def picture_of(segments, curved, svg):
    black, white = (Paint(np.full(3, level)) for level in (0.0, 1.0))
    layer = Layer(0, [Path(np.array(segments), np.array(curved))])
    return Drawing(rasterize(svg, 60, 40), white, [black], [layer])


def test_a_kink_beside_a_round_end_goes_and_the_raster_stays():
    cap = np.array([[40, 10], [49, 10], [51, 21], [42.2, 24.8]], float)
    wave = np.array([[42.2, 24.8], [41, 24.4], [42, 26], [40, 26]], float)
    rest = line((40, 26), (10, 26), (10, 10), (40, 10))
    drawing = picture_of([cap, wave, *rest], [True, True, *[False] * 3], PICTURE.format(40))
    smooth = drawing.with_layers(without_kinks(drawing))
    assert len(smooth.curved) == len(drawing.curved) - 1
    smooth.refine(20)
    assert ((smooth.draw() - drawing.pixels) ** 2).sum() < 0.2


def test_the_corners_of_a_small_star_stay():
    turns = np.pi * (0.1 + np.arange(10) / 5)
    size = np.where(np.arange(10) % 2, 1.5, 3.5)
    nodes = np.stack([30 + size * np.cos(turns), 20 + size * np.sin(turns)], axis=1)
    star = "L".join(f"{x:.4f} {y:.4f}" for x, y in nodes)
    svg = PICTURE.replace("M10 10H{0}a8 8 0 0 1 0 16H10z", f"M{star}z")
    ends = np.roll(nodes, -1, axis=0)
    ways = (ends - nodes) / 3
    curves = np.stack([nodes, nodes + ways, ends - ways, ends], axis=1)
    drawing = picture_of(curves, [True] * 10, svg)
    (layer,) = without_kinks(drawing)
    assert len(layer.paths[0].curved) == 10


def test_an_outline_that_got_a_cusp_is_as_it_was_before():
    bar = line((10, 10), (50, 10), (50, 30), (10, 30), (10, 10))
    (layer,) = picture_of(bar, [False] * 4, PICTURE.format(40)).layers

    def moved(*ends):
        nodes = line((10, 10), (50, 10), *ends, (10, 10))
        return layer.replace([layer.paths[0]._replace(segments=np.array(nodes))])

    sharp, other = moved((50, 38), (46, 12)), moved((50, 38), (20, 28))
    assert without_cusps([other, sharp], [layer, sharp]) is None
    layers = without_cusps([other, sharp], [layer, layer])
    assert [one.paths[0] for one in layers] == [other.paths[0], layer.paths[0]]


def test_colours_of_large_areas_are_exact():
    """A sum of 400 000 values in single precision would lose two levels of 255."""
    page, color = np.array([243, 244, 246]) / 255, np.array([22, 163, 74]) / 255
    picture = np.full((640, 640, 3), page, np.float32)
    picture[100:120, 100:160] = color
    segments = np.array(line((100.3, 100), (160, 100), (160, 120), (100.3, 120), (100.3, 100)))
    layer = Layer(0, [Path(segments, np.zeros(4, bool))])
    drawing = Drawing(picture, Paint(page), [Paint(color)], [layer])
    error = drawing.draw() - picture
    drawing.weigh()
    drawing.solve_colors(error)
    assert np.abs(drawing.ground.color - page).max() < 0.1 / 255
