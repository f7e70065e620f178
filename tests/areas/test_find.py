"""Properties of the areas that are found in a picture."""

import dataclasses

import numpy as np
import pytest
from outlines import cubic, polygon
from scipy.spatial import KDTree

from gauss2svg.areas.find import find_areas
from gauss2svg.areas.paint import paint_of
from gauss2svg.raster import rasterize
from gauss2svg.render import render, render_rgba
from gauss2svg.render.areas import draw_areas
from gauss2svg.scene import Scene
from gauss2svg.scene.areas import Area, LinearGradient, Outline, RadialGradient

SIDE = 96
RED, BLUE, GREEN, BLACK = (
    (red / 255, green / 255, blue / 255)
    for red, green, blue in ((204, 26, 26), (26, 77, 204), (51, 153, 77), (20, 20, 20))
)
ROUND = 0.5522847  # length of a handle of a quarter of a circle


def disc(x: float, y: float, radius: float, is_hole: bool = False) -> Outline:
    """Return a circle. The outline of a hole runs the other way."""
    k = ROUND
    ways = [(1, 0), (1, k), (k, 1), (0, 1), (-k, 1), (-1, k), (-1, 0), (-1, -k), (-k, -1)]
    ways += [(0, -1), (k, -1), (1, -k)]
    points = [(x + radius * u, y + radius * v) for u, v in ways]
    if is_hole:
        points = points[:1] + points[:0:-1]
    return Outline(tuple(points), (True,) * 4)


WAVE = Outline(((15, 70), (30, 20), (60, 90), (82, 25)), (True,), closed=False)
DRAWINGS = {
    "a disc": [Area((disc(40.3, 45.7, 22.2),), RED)],
    "a polygon": [Area((polygon((20.2, 15.1), (70.7, 22.3), (60.1, 70.9), (28.4, 60.2)),), BLUE)],
    "a ring": [Area((disc(48, 48, 30), disc(48, 48, 15, True)), GREEN)],
    "discs in discs": [
        Area((disc(48, 48, 36),), RED),
        Area((disc(48, 48, 24),), GREEN),
        Area((disc(48, 48, 12),), BLUE),
    ],
    "up to the border": [Area((polygon((-10, 60), (106, 40), (106, 120), (-10, 120)),), GREEN)],
    "a line": [Area((WAVE,), BLACK, width=2.5)],
    "two apart": [Area((disc(25, 30, 14),), RED), Area((disc(70, 62, 17),), BLUE)],
}


def over(areas, page: float, side: int = SIDE):
    """Return the picture (side, side, 3) of areas on a white or a black page."""
    image = np.full((side, side, 3), page)
    draw_areas(areas, image)
    return image


def drawn(areas, channels: int = 3, side: int = SIDE):
    """Return the picture of areas on a white or, with 4 channels, on a transparent page."""
    black, white = over(areas, 0.0, side), over(areas, 1.0, side)
    if channels == 3:
        return white.astype(np.float32)
    alpha = 1 - (white - black).mean(axis=-1, keepdims=True)
    color = black / np.maximum(alpha, 1e-6)
    return np.concatenate([color, alpha], axis=-1).astype(np.float32)


def scene_of(areas, background, width: int = SIDE, height: int = SIDE) -> Scene:
    """Return the scene of areas, which is transparent if they have no background."""
    page, clear = (1, 1, 1) if background is None else background, background is None
    return Scene(width, height, background=page, transparent=clear, areas=areas)


def color_of(area: Area):
    """Return the colour (3,) of an area without a gradient."""
    assert isinstance(area.paint, tuple)
    return np.array(area.paint)


def points_of(areas):
    """Return points (n, 2) inside the picture along all outlines, at most .05 px apart."""
    points = np.concatenate(
        [
            cubic(p, 1500) if is_curve else np.linspace(p[0], p[3], 1500)
            for area in areas
            for outline in area.outlines
            for p, is_curve in zip(outline.segments, outline.curved, strict=True)
        ]
    )
    return points[((points > 0.5) & (points < SIDE - 0.5)).all(axis=1)]


def distance(first, second) -> float:
    """Return the largest distance in px of points from the nearest one of the others."""
    return max(KDTree(a).query(b)[0].max() for a, b in ((first, second), (second, first)))


@pytest.mark.parametrize("name", DRAWINGS)
def test_areas_that_were_drawn_are_found_again(name):
    areas = DRAWINGS[name]
    found = find_areas(drawn(areas))
    assert found.background == (1, 1, 1)
    assert len(found.areas) == len(areas)
    assert [area.is_line for area in found.areas] == [area.is_line for area in areas]
    by_paint = [
        sorted(some, key=lambda area: tuple(color_of(area))) for some in (areas, found.areas)
    ]
    for area, other in zip(*by_paint, strict=True):
        assert color_of(area) == pytest.approx(color_of(other), abs=1e-9)
        assert other.width == pytest.approx(area.width, abs=0.1)
    assert distance(points_of(areas), points_of(found.areas)) < 0.1
    assert found.explained > 0.99


@pytest.mark.parametrize("name", ["a ring", "a line"])
def test_a_mirrored_or_turned_picture_has_mirrored_or_turned_areas(name):
    picture = drawn(DRAWINGS[name])
    points = points_of(find_areas(picture).areas)
    for turns in (1, 2):
        picture, points = picture[:, ::-1], points * [-1, 1] + [SIDE, 0]
        for _ in range(turns):
            picture, points = np.rot90(picture), points[:, ::-1] * [1, -1] + [0, SIDE]
        found = find_areas(np.ascontiguousarray(picture))
        assert distance(points, points_of(found.areas)) < 0.05


GRADIENTS = {
    "linear": LinearGradient((0, 1), (RED, BLUE), (20, 20), (76, 60)),
    "radial": RadialGradient((0, 1), ((1, 0.9, 0.5), GREEN), (45, 44), (34, 34)),
}
IN_MARGINS = {
    **DRAWINGS,
    "a linear gradient": [Area((disc(48, 48, 34),), GRADIENTS["linear"])],
    "a radial gradient": [Area((disc(48, 48, 34),), GRADIENTS["radial"])],
    "a card up to three sides": [
        Area((polygon((-300, -300), (400, -300), (400, 75), (-300, 75)),), BLUE),
        Area((disc(48, 48, 16),), RED),
    ],
}


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("name", IN_MARGINS)
def test_margins_have_their_color_and_do_not_change_areas(name, channels):
    areas, side = IN_MARGINS[name], 260
    moved = [
        dataclasses.replace(
            area,
            outlines=tuple(
                dataclasses.replace(one, points=tuple((x + 90, y + 70) for x, y in one.points))
                for one in area.outlines
            ),
            paint=area.paint if isinstance(area.paint, tuple) else area.paint.moved(90, 70),
        )
        for area in areas
    ]
    found = find_areas(drawn(moved, channels, side))
    assert len(found.areas) == len(find_areas(drawn(areas, channels)).areas)
    scene, errors = scene_of(found.areas, found.background, side, side), []
    for page in (0.0, 1.0):
        wanted = over(moved, page if channels == 4 else 1.0, side)
        page = np.full(3, page) if scene.transparent else scene.background
        shown = render(scene.replace(transparent=False, background=page), side, side)
        errors.append(((shown - wanted) ** 2).mean())
        for edge in (np.s_[:4], np.s_[-4:], np.s_[:, :4], np.s_[:, -4:]):
            assert np.abs(shown[edge] - wanted[edge]).max() < 0.5 / 255
    psnr = -10 * np.log10(np.mean(errors))
    assert psnr > 38
    assert min(found.psnr, 60) == pytest.approx(min(psnr, 60), abs=1)


@pytest.mark.parametrize(("far", "width"), [(150, 150), (230, 150)])
def test_a_gradient_that_fades_into_a_margin_is_drawn_as_without_one(far, width):
    share = np.clip((np.arange(400) - (400 - far)) / width, 0, 1)[::-1, None]
    levels = np.round(255 * (1 - share * (1 - np.array([0, 0.2, 0.6])))) / 255
    picture = np.tile(levels.astype(np.float32), (300, 1, 1))
    found = find_areas(picture)
    scene = scene_of(found.areas, found.background, 400, 300)
    assert -10 * np.log10(((render(scene, 400, 300) - picture) ** 2).mean()) > 48


def test_an_opaque_page_around_a_hole_reaches_to_the_edges():
    picture = np.ones((200, 200, 4), np.float32)
    picture[80:120, 90:130, 3] = 0
    found = find_areas(picture)
    scene = scene_of(found.areas, found.background, 200, 200)
    np.testing.assert_allclose(render_rgba(scene, 200, 200)[..., 3], picture[..., 3], atol=0.01)


def test_the_page_shows_through_holes_and_no_area_is_white():
    areas = [Area((disc(48, 48, 40), disc(48, 48, 20, True)), RED), Area((disc(48, 48, 10),), BLUE)]
    for channels in (3, 4):
        found = find_areas(drawn(areas, channels))
        assert found.background == ((1, 1, 1) if channels == 3 else None)
        assert sorted(len(area.outlines) for area in found.areas) == [1, 2]
        assert all(color_of(area).min() < 0.5 for area in found.areas)


def test_a_transparent_part_keeps_its_opacity():
    areas = [Area((disc(30, 48, 20),), RED, 0.5), Area((disc(74, 48, 16),), BLUE)]
    found = find_areas(drawn(areas, 4))
    assert {area.opacity for area in found.areas} == {0.5, 1.0}
    for area in found.areas:
        expected = RED if area.opacity < 1 else BLUE
        assert np.abs(color_of(area) - expected).max() < 2.01 / 255
    assert distance(points_of(areas), points_of(found.areas)) < 0.1


@pytest.mark.parametrize("name", GRADIENTS)
def test_a_gradient_is_one_area(name):
    gradient = GRADIENTS[name]
    picture = drawn([Area((disc(48, 48, 34),), gradient)])
    found = find_areas(picture)
    assert [type(area.paint) for area in found.areas] == [type(gradient)]
    raster = over(found.areas, 1.0)
    assert np.sqrt(np.mean((raster - picture) ** 2)) < 1 / 255


def test_nearly_equal_colors_become_one():
    other = (RED[0] + 1 / 255, RED[1] + 1 / 255, RED[2] + 1 / 255)
    found = find_areas(drawn([Area((disc(25, 30, 14),), RED), Area((disc(70, 62, 17),), other)]))
    assert len({area.paint for area in found.areas}) == 1


def word(x: float, y: float, stroke: float) -> list[Outline]:
    """Return letters of 10 px whose bars have the width `stroke`: I, E, O, V, N and L."""
    s, h = stroke, 10.0
    e = [(0, 0), (5, 0), (5, s), (s, s), (s, 4), (4, 4), (4, 4 + s), (s, 4 + s), (s, h - s)]
    shapes = [
        [(0, 0), (s, 0), (s, h), (0, h)],
        [*e, (5, h - s), (5, h), (0, h)],
        [(0, 0), (6, 0), (6, h), (0, h)],
        [(0, 0), (s, 0), (3, h - 2 * s), (6 - s, 0), (6, 0), (3 + s / 2, h), (3 - s / 2, h)],
        [(0, 0), (s, 0), (6 - s, 7), (6 - s, 0), (6, 0), (6, h), (6 - s, h), (s, 3), (s, h),
         (0, h)],
        [(0, 0), (s, 0), (s, h - s), (5, h - s), (5, h), (0, h)],
    ]  # fmt: skip
    outlines = []
    for shape in shapes:
        outlines.append(polygon(*((x + u, y + v) for u, v in shape)))
        if len(shape) == 4 and shape[1][0] == 6:
            hole = [(s, s), (s, h - s), (6 - s, h - s), (6 - s, s)]
            outlines.append(polygon(*((x + u, y + v) for u, v in hole)))
        x += max(u for u, _ in shape) + 2.3
    return outlines


# At .5 px, level bars lie between two rows, and no pixel of theirs is darker than a half.
@pytest.mark.parametrize(("stroke", "shift"), [(1.0, 0.5), (2.2, 0.3)])
def test_small_letters_have_one_color_and_are_close(stroke, shift):
    text = [Area(tuple(word(8.2, 20 + shift, stroke)), BLUE)]
    found = find_areas(drawn(text))
    assert len({area.paint for area in found.areas}) == 1
    assert np.abs(color_of(found.areas[0]) - BLUE).max() < 0.1
    first, second = (
        drawn([area.scaled(4, 4) for area in areas], side=4 * SIDE) for areas in (text, found.areas)
    )
    assert found.psnr > 45
    assert -10 * np.log10(((first - second) ** 2).mean()) > 36


def test_a_higher_price_of_bytes_gives_fewer_nodes():
    rng = np.random.default_rng(0)
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    radius = 30 + rng.normal(size=60)
    star = polygon(*zip(48 + radius * np.cos(angle), 48 + radius * np.sin(angle), strict=True))
    picture = drawn([Area((star,), BLUE)])
    few, many = (sum(a.nodes for a in find_areas(picture, rate).areas) for rate in (0.05, 0.0005))
    assert few < many


SIZES = [(1, 1), (1, 40), (3, 2), (40, 1), (96, 96)]


@pytest.mark.parametrize("radius", [2.5, 3.0, 4.0])
@pytest.mark.parametrize("has_rim", [False, True])
def test_small_discs_are_round(radius, has_rim):
    middles = [(20.13 * k + 10, 20.29 * j + 10) for k in range(4) for j in range(4)]
    areas, page = [], np.full((SIDE, SIDE, 3), (0.9, 0.93, 0.965))
    for x, y in middles:
        rim = Area((disc(x, y, radius + 0.5),), (0.97, 0.96, 0.99))
        areas += [rim] * has_rim + [Area((disc(x, y, radius),), (0.74, 0.55, 0.97))]
    draw_areas(areas, page)
    found = find_areas(page.astype(np.float32), is_clean=True)
    discs = points_of([area for area in found.areas if color_of(area)[1] < 0.7])
    away = np.hypot(*(discs[:, None] - middles).transpose(2, 0, 1)).min(axis=1)
    assert np.abs(away - radius).max() < 0.25


def test_small_hexagons_keep_their_corners():
    turns = np.arange(6) * np.pi / 3
    middles = [(16.13 * k + 10, 16.29 * j + 10) for k in range(5) for j in range(5)]
    areas = [
        Area((polygon(*zip(x + 4 * np.cos(turns), y + 4 * np.sin(turns), strict=True)),), RED)
        for x, y in middles
    ]
    paths = "".join(
        f'<path fill="#cc1a1a" d="M{" ".join(map(str, area.outlines[0].nodes.ravel()))}z"/>'
        for area in areas
    )
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIDE} {SIDE}">{paths}</svg>'
    found = find_areas(rasterize(svg, SIDE, SIDE), is_clean=True)
    assert distance(points_of(found.areas), points_of(areas)) < 0.3


def test_nodes_do_not_follow_antialiasing():
    path = "M46 20c-5-12-28-12-28 2c0 13 28 9 28 21c0 14-24 13-28 2"
    svg = (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 64 64"><rect width="64" height="64"'
        f' fill="#fff8e1"/><path d="{path}" fill="none" stroke="#e65100" stroke-width="7"'
        ' stroke-linecap="round"/></svg>'
    )
    picture, large = rasterize(svg, 64, 64), rasterize(svg, 512, 512)

    def nodes_and_error(is_clean: bool) -> tuple[int, float]:
        found = find_areas(picture, is_clean=is_clean)
        canvas = np.full(large.shape, found.background)
        draw_areas([area.scaled(8, 8) for area in found.areas], canvas)
        return sum(area.nodes for area in found.areas), float(((canvas - large) ** 2).mean())

    (nodes, error), (most, other) = nodes_and_error(True), nodes_and_error(False)
    assert nodes < 0.8 * most
    assert error < 1.1 * other


@pytest.mark.parametrize("rise", [1.0, 2.0, 3.5])
def test_long_edges_that_are_nearly_level_keep_their_slope(rise):
    corners = (20, 40), (270, 40 + rise), (280, 200), (20, 200 - rise)
    frame = Area((polygon(*corners), disc(150, 120, 40, True)), BLUE)
    found = find_areas(drawn([frame], side=300))
    assert found.psnr > 50


@pytest.mark.parametrize("size", SIZES)
def test_a_plain_picture_has_no_areas(size):
    even = find_areas(np.full((*size, 3), 0.25, np.float32))
    assert even.areas == ()
    assert even.background == pytest.approx((0.25,) * 3, abs=0.002)


def extremes():
    """Return pictures without pixels of pure colours, without margins, or without a colour."""
    y, x = np.mgrid[:SIDE, :SIDE]
    random = lambda size: np.random.default_rng(1).random((*size, 3))  # noqa: E731
    quarters = np.array([[RED, GREEN], [BLUE, BLACK]])[y // (SIDE // 2), x // (SIDE // 2)]
    soft = np.clip((30 - np.hypot(x - 47.5, y - 47.5)) / 8, 0, 1)
    return {
        "squares of one pixel": (np.array([RED, BLUE])[(x + y) % 2], 0),
        "areas at every border": (quarters, 3),
        "a row of pixels": (np.where(y == 20, 0.0, 1.0)[..., None] * np.ones(3), 1),
        "the last row of pixels": (np.where(y == SIDE - 1, 0.0, 1.0)[..., None] * np.ones(3), 1),
        "all transparent": (np.zeros((SIDE, SIDE, 4)), 0),
        "a soft edge of alpha": (np.dstack([quarters, soft]), 16),
        **{f"noise of {size}": (random(size), 3) for size in SIZES},
    }


@pytest.mark.parametrize("name", extremes())
def test_extreme_pictures_have_few_finite_areas(name):
    picture, most = extremes()[name]
    areas = find_areas(picture.astype(np.float32)).areas
    assert len(areas) <= most
    assert all(np.isfinite(o.points).all() for area in areas for o in area.outlines)
    if name in {"areas at every border", "a row of pixels", "the last row of pixels"}:
        assert np.abs(over(areas, 1.0) - picture).max() < 0.02 or len(areas) == 3


@pytest.mark.parametrize("radii", [(40, 20), (20, 40)])
def test_a_radial_gradient_is_as_wide_and_as_high_as_that_of_the_picture(radii):
    ys, xs = np.mgrid[:60, :60]
    distance = np.hypot((xs - 29.5) / radii[0], (ys - 29.5) / radii[1])
    picture = np.exp(-(distance**2))[..., None] * np.array([0.9, 0.6, 0.3])
    paint = paint_of(picture, ys.ravel(), xs.ravel())
    assert np.abs(paint.at(xs, ys) - picture).max() < 8 / 255


@pytest.mark.parametrize("color", ["#f0f0ff", "#f2f2f2", "#f3f3f3"])
@pytest.mark.parametrize("middle", [30, 64])
def test_pale_shapes_are_areas_of_their_own(color, middle):
    # Their antialiased rims climb by few levels for each px, as shading does.
    shape = f'<ellipse fill="{color}" cx="64" cy="{middle}" rx="60" ry="30.3"/>'
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 128 128">{shape}</svg>'
    found = find_areas(rasterize(svg, 128, 128))
    assert [isinstance(area.paint, tuple) for area in found.areas] == [True]
    assert found.psnr > 60


def test_lines_of_two_colors_that_cross_on_a_transparent_page_keep_both():
    picture = np.zeros((SIDE, SIDE, 4), np.float32)
    for k in range(0, SIDE, 19):
        picture[k] = picture[:, k] = *GREEN, 1
    for k in range(9, SIDE, 38):
        # Over black, yellow differs more from the page than green does.
        picture[k] = 1, 1, 0, 1
    found = find_areas(picture)
    assert found.psnr > 30
