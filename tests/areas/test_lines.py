"""Properties of the lines that are found in pictures of known lines."""

import numpy as np
import pytest
from outlines import box, polygon
from outlines import polyline as line
from test_find import disc, over

from gauss2svg.areas.centrelines import chains_of
from gauss2svg.areas.find import find_areas
from gauss2svg.scene.areas import CAPS, Area, Outline

INK, PALE_INK = (0.07, 0.07, 0.07), (0.94, 0.82, 0.38)


def curve(*points: tuple[float, float]) -> Outline:
    return Outline(points, (True,), closed=False)


def found(areas, page: float = 1.0):
    """Return the areas that are found in the picture of some areas on a grey page."""
    return find_areas(over(areas, page, 128).astype(np.float32)).areas


def strokes(areas):
    """Return the width of each stroke, its cap and its two ends, from left to right."""
    assert all(area.is_line for area in areas)
    rows = []
    for area in areas:
        for outline in area.outlines:
            ends = sorted((outline.points[0], outline.points[-1]))
            rows.append((area.width, area.cap, *ends))
    return sorted(rows, key=lambda row: row[2:])


def check(areas, others, within: float = 0.6) -> None:
    """Check that there are the same strokes: widths within a tenth, and ends within some px."""
    expected, rows = strokes(areas), strokes(others)
    assert len(rows) == len(expected)
    for width, _, *ends in expected:
        away, k = min((np.abs(np.array(ends) - row[2:]).max(), k) for k, row in enumerate(rows))
        assert away < within
        assert rows.pop(k)[0] == pytest.approx(width, rel=0.1)


FOUR = (
    line((10.3, 20.7), (116, 34.2)),
    line((12, 62), (76.5, 12)),
    curve((15, 108), (45, 48), (75, 132), (115, 70)),
    curve((30, 12), (52, 85), (84, 28), (104, 118)),
)
TWO_WIDTHS = {
    line((10, 40), (118, 52.3)): 3,
    curve((20, 10), (30, 70), (80, 80), (100, 14)): 1.5,
}
AT_ANOTHER = line((10, 30.3), (118, 31)), line((62.4, 30.6), (58.1, 110))


def two_at(degrees: float) -> list[Outline]:
    """Return two lines that cross at an angle."""
    x, y = 50 * np.cos(np.radians(degrees / 2)), 50 * np.sin(np.radians(degrees / 2))
    return [line((64.2 - x, 64.2 - y), (64.2 + x, 64.2 + y)) for y in (y, -y)]


# Lines with their widths, and the px within which their ends are found
CROSSINGS = {
    **{f"four of {w} px": (dict.fromkeys(FOUR, w), 0.6) for w in (1.5, 3)},
    **{
        f"two of {w} px at {degrees}": (dict.fromkeys(two_at(degrees), w), 0.6)
        for w, degrees in ((1.5, 25), (2.5, 65), (4, 90))
    },
    "of two widths": (TWO_WIDTHS, 0.6),
    "one that ends at another": (dict.fromkeys(AT_ANOTHER, 2), 1.2),
}


@pytest.mark.parametrize("name", CROSSINGS)
def test_a_line_goes_on_through_crossings(name):
    lines, within = CROSSINGS[name]
    for color, page in ((INK, 1.0), (PALE_INK, 0.12))[: 1 + name.startswith("four")]:
        areas = [Area((outline,), color, width=width) for outline, width in lines.items()]
        others = found(areas, page)
        check(areas, others, within)
        # Nearly equal widths are equal.
        assert len({area.width for area in others}) == len(set(lines.values()))


def test_ends_are_round_or_butt_as_they_are():
    width = 3
    areas = [
        Area((line((20, y), (104, y + 9)),), INK, width=width, cap=cap)
        for y, cap in zip((20, 45.3, 70.2), CAPS, strict=True)
    ]
    rows = sorted(strokes(found(areas)), key=lambda row: row[2][1])
    # A square end is a butt end that is longer by half of the width.
    assert [row[1] for row in rows] == ["butt", "round", "butt"]
    for area, (_, _, (x, _), _) in zip(areas, rows, strict=True):
        assert x == pytest.approx(20 - (area.cap == "square") * width / 2, abs=0.35)


@pytest.mark.parametrize(("cap", "width"), [("butt", 2), ("round", 3)])
def test_corners_of_a_line_are_round_or_mitred_as_its_ends_are(cap, width):
    zigzag = Outline(((10, 100), (40, 20), (64, 100), (90, 20), (118, 100)), (False,) * 4, False)
    areas = found([Area((zigzag,), INK, width=width, cap=cap)])
    assert [(area.is_line, area.cap) for area in areas] == [(True, cap)]


@pytest.mark.parametrize(("width", "dash", "gap"), [(1.5, 7, 5), (3, 12, 8)])
def test_dashes_stay_dashes(width, dash, gap):
    way = np.array([np.cos(0.2), np.sin(0.2)])
    starts = [np.array([12.0, 40.3]) + k * (dash + gap) * way for k in range(5)]
    outlines = tuple(line(tuple(a), tuple(a + dash * way)) for a in starts)
    areas = [Area(outlines, INK, width=width)]
    others = found(areas)
    check(areas, others, 0.5)
    assert len(others) == 1


@pytest.mark.parametrize(("least", "most"), [(1.5, 4.5), (2, 3)])
def test_a_line_whose_width_changes_is_an_area(least, most):
    t = np.linspace(0, 1, 60)
    middle = np.stack([12 + 104 * t, 50 + 12 * np.sin(3 * t)], axis=1)
    half = 0.5 * (least + (most - least) * np.sin(np.pi * t) ** 2)[:, None]
    across = np.gradient(middle, axis=0)[:, ::-1] * [-1, 1]
    across /= np.hypot(*across.T)[:, None]
    sides = np.concatenate([middle + half * across, (middle - half * across)[::-1]])
    others = found([Area((polygon(*map(tuple, sides)),), INK)])
    assert [area.is_line for area in others] == [False]


def test_a_corner_of_a_line_is_a_node():
    zigzag = line((12, 100), (40.3, 40), (60, 84), (84.2, 30), (112, 100))
    (area,) = found([Area((zigzag,), INK, width=3)])
    nodes = np.array(area.outlines[0].points)
    assert len(area.outlines) == 1
    for corner in zigzag.points:
        assert np.hypot(*(nodes - corner).T).min() < 0.4


BLACK, GREY, PALE = (0.0,) * 3, (187 / 255,) * 3, (221 / 255,) * 3
BLUE = (0.73, 0.87, 0.98)


def level(y: float) -> Outline:
    return line((20, y), (108, y))


def upright(x: float) -> Outline:
    return line((x, 12), (x, 100))


# Lines as they are drawn, with their colour and width, and what lies below and above them
IN_TWO_ROWS = {
    "between two rows": ([level(y) for y in (20, 45, 70)], GREY, 1, [], []),
    "of one row, and between columns": (
        [*(level(y + 0.5) for y in (20, 45)), *map(upright, (60, 90))], GREY, 1, [], [],
    ),
    "with crossings": ([*map(level, (20, 45, 70)), *map(upright, (60, 90))], GREY, 1, [], []),
    "on two grounds": (
        [level(y) for y in (20, 45, 85, 100)], GREY, 1, [Area((box(10, 60, 118, 116),), BLUE)], [],
    ),
    "black": ([level(y) for y in (20, 45)], BLACK, 1, [], []),
    "2 px wide, beside an area of their colour": (
        [level(y) for y in (20, 45)], PALE, 2, [], [Area((box(30, 70, 80, 100),), PALE)],
    ),
    "2 px wide, beside a wider line of their colour": (
        [level(y) for y in (20, 45)], PALE, 2, [], [Area((level(80),), PALE, width=4)],
    ),
    "2 px wide, too dark to be half of a colour": (
        [level(y) for y in (20, 45)], (0.3,) * 3, 2, [], [],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", IN_TWO_ROWS)
def test_lines_in_two_rows_have_their_width_and_colour(case):
    outlines, color, width, below, above = IN_TWO_ROWS[case]
    others = [
        area
        for area in found([*below, Area(tuple(outlines), color, width=width), *above])
        if area.is_line and area.width < 3
    ]
    length = 0.0
    for area in others:
        assert area.width == pytest.approx(width, rel=0.1)
        assert area.paint == pytest.approx(color, abs=3 / 255)
        length += sum(np.hypot(*np.subtract(o.points[-1], o.points[0])) for o in area.outlines)
    drawn = sum(np.hypot(*np.subtract(o.points[-1], o.points[0])) for o in outlines)
    assert length == pytest.approx(drawn, rel=0.05)


def test_a_grey_line_that_meets_darker_ones_has_its_own_colour():
    """Violet and white mix to nearly this grey."""
    violet, grey = (63 / 255, 61 / 255, 86 / 255), (0.8, 0.8, 0.8)
    stems = Area((line((30, 30), (33, 70)), line((100, 30), (90, 70))), violet, width=2.2)
    areas = [Area((line((20, 70.6), (120, 70.6)),), grey, width=1.9), stems]
    areas.append(Area((box(50, 30, 80, 60),), violet))
    widths = [area.width for area in found(areas) if np.allclose(area.paint, grey, atol=0.05)]
    assert widths == [pytest.approx(1.9, rel=0.1)]


def test_rails_that_meet_a_darker_area_keep_their_colour():
    violet = (63 / 255, 61 / 255, 86 / 255)
    rails = [curve((12, y + 6), (36, y - 2), (60, y - 2), (84, y + 6)) for y in (20, 28, 36)]
    posts = [Outline(((x, 14), (x, 54)), (False,), closed=False) for x in (24.3, 47.8, 71.1)]
    areas = [Area((outline,), violet, width=2.1) for outline in (*rails, *posts)]
    areas.append(Area((box(10, 53.4, 86, 90),), (0.0, 0.0, 0.0)))
    result = found(areas)
    for area in result:
        if max(area.paint) < 0.2:  # it is black
            assert min(y for outline in area.outlines for _, y in outline.points) > 48
    assert len(result) < 6


@pytest.mark.parametrize("page", [(1.0, 0.6, 0.3), (0.1, 0.1, 0.2)])
def test_points_between_digits_stay_though_no_pixel_has_their_colour(page):
    places = [(30.0, 20.0), (60.0, 45.5), (30.5, 70.5)]
    areas = [Area((box(-9, -9, 137, 137),), page)]
    for x, y in places:
        rings = (disc(x - 6, y - 3, 3.2), disc(x + 6, y - 3, 3.2))
        areas.append(Area(rings, (1.0, 1.0, 1.0), width=1.3))
        areas.append(Area((disc(x, y, 0.56),), (1.0, 1.0, 1.0)))
    picture = over(areas, 0.0, 128)
    result = find_areas(picture.astype(np.float32))
    drawn = over(result.areas, result.background, 128)
    for x, y in places:
        around = np.s_[int(y) - 2 : int(y) + 2, int(x) - 2 : int(x) + 2]
        light, expected = ((one[around] - np.array(page)).sum() for one in (drawn, picture))
        assert light == pytest.approx(expected, rel=0.5)


@pytest.mark.parametrize(
    ("ink", "cell", "side"), [(1.0, (0.4, 0.55, 0.75), 1.1), (0.0, (1.0, 1.0, 1.0), 1.5)]
)
@pytest.mark.parametrize("x", [30.0, 30.3])
def test_minus_signs_and_points_beside_digits_stay(ink, cell, side, x):
    areas, places = [Area((box(10.5, 10.5, 117.5, 117.5),), cell)], []
    for y in (20, 45, 70, 95):
        marks = box(x, y + 5.2, x + 3.2, y + 6.1), box(x + 10, y + 9, x + 10 + side, y + 9 + side)
        digits = box(x + 6, y, x + 7, y + 10), box(x + 14, y, x + 15, y + 10)
        areas += [Area((one,), (ink,) * 3) for one in (*marks, *digits)]
        places += [np.s_[y + 4 : y + 8, 29:35], np.s_[y + 8 : y + 12, 39:43]]
    # White marks have the colour of the page, so they are holes.
    picture = over(areas, 1.0, 128)
    result = find_areas(picture.astype(np.float32), is_clean=True)
    drawn = over(result.areas, result.background, 128)
    for around in places:
        left, expected = (np.abs(one[around] - picture[15, 15]).sum() for one in (drawn, picture))
        assert left == pytest.approx(expected, rel=0.3)


def test_faint_lines_of_a_grid_are_drawn_as_they_are():
    """They are nearly black mixed with white, so they might be lines of .13 px in black."""
    rows = [line((20, y), (120, y)) for y in (30.5, 50.5, 70.5)]
    columns = [line((x, 20), (x, 90)) for x in (40.5, 60.5, 80.5)]
    frame = box(20, 20, 120, 90)
    grid = Area(tuple(rows + columns), (0.87, 0.87, 0.87), width=1.0)
    picture = over([grid, Area((frame,), INK, width=1.4)], 1.0, 128)
    result = find_areas(picture.astype(np.float32))
    drawn = over(result.areas, result.background, 128)
    assert np.abs(drawn - picture)[24:86, 24:116].max() < 0.05


def test_a_faint_line_along_an_edge_is_drawn_as_it_is():
    """A coast in grey is nearly a mixture of the two sides and of a much thinner black line."""
    coast = ((-5, 40.3), (30, 45), (52.6, 80), (90, 71.2), (133, 98))
    sea = Area((Outline((*coast, (133, 133), (-5, 133)), (False,) * 7),), (0.7, 0.85, 0.95))
    rim = Area((Outline(coast, (False,) * 4, closed=False),), (0.53, 0.53, 0.53), width=1.2)
    route = Area((line((60, 20), (110, 35)), line((70, 10), (75, 100))), (0, 0, 0), width=1.5)
    picture = over([sea, rim, route], (0.93, 0.91, 0.83), 128)
    assert find_areas(picture.astype(np.float32)).psnr > 45


def test_a_line_ends_where_it_becomes_much_wider():
    """Stems of notes are no ends of their beam, although they meet it at its corners."""
    beam = Area((Outline(((30, 22), (92, 14), (92, 18), (30, 26)), (False,) * 4),), INK)
    stems = Area(tuple(line((x, 20), (x, 100.4)) for x in (30.4, 91.6)), INK, width=0.8)
    share = (1 - over([beam, stems], 1.0, 128)[..., 0]) / (1 - INK[0])
    *thin, wide = sorted(chains_of(share > 0.25, share), key=lambda chain: chain.width)
    assert wide.points[:, 1].max() < 27
    assert [chain.width for chain in thin] == pytest.approx([0.8, 0.8], rel=0.1)


def test_a_part_of_one_row_with_a_gap_has_lines_without_a_warning():
    share = np.repeat([[1.0, 0.0, 1.0]], (8, 3, 9), axis=1)
    with np.errstate(all="raise"):
        assert chains_of(share > 0, share)
