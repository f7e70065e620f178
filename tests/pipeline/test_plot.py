"""Properties of the strokes of a pen plotter: where they are, and how much paper they cover."""

import re
from itertools import pairwise
from xml.etree.ElementTree import fromstring as parse

import numpy as np
import outlines
import pytest
from outlines import polygon, polyline
from scenes import random_scene

from gauss2svg.cli.main import main
from gauss2svg.files import as_png
from gauss2svg.pipeline.plot import plotted
from gauss2svg.raster import rasterize
from gauss2svg.scene import Area, Scene
from gauss2svg.scene.inks import ink_colors, printed_colors
from gauss2svg.svg import Document, Plotter

SVG = "{http://www.w3.org/2000/svg}"
LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
BLACK, GREY = (0.0, 0.0, 0.0), (0.5, 0.5, 0.5)
PHOTO = random_scene(60, 90, 70, 5, (4, 40), (1, 8))


def box(left, top, right, bottom, paint=BLACK, **look):
    return Area([outlines.box(left, top, right, bottom)], paint, **look)


def line(*points):
    return Area([polyline(*points)], BLACK, width=1.0)


def plot_of(scene, inks=None, **options):
    """A plot at one mm for each px of a scene of 100x100 px, unless options say otherwise."""
    options = {"sheet": "100.6x100.6mm", "margin": 0.0, "pen_width": 0.6} | options
    return plotted(scene, Plotter(**options), Document(), inks)


def points_of(plot):
    return np.concatenate([stroke for pen in plot.pens for stroke in pen.strokes])


def of_areas(*areas, background=(1.0, 1.0, 1.0)):
    return Scene(100, 100, areas=areas, background=background)


def ink_of(plot, px_per_mm=5):
    """The share of ink of each pixel of a plot."""
    size = [round(side * px_per_mm) for side in plot.sheet]
    return 1 - rasterize(plot.svg, *size)[:, :, 0]


@pytest.mark.parametrize(
    ("options", "sheet"),
    [
        ({"pen_width": 2.0}, (297, 210)),
        ({"sheet": "50x200mm", "margin": 0.0, "hatch": 2.0}, (50, 200)),
    ],
)
def test_ink_fills_the_sheet_to_its_margins_and_its_width_is_in_mm(options, sheet):
    plotter = Plotter(**options)
    plot = plotted(PHOTO.replace(background=np.zeros(3)), plotter, Document())
    root = parse(plot.svg)
    assert [root.get(side) for side in ("width", "height")] == [f"{side}mm" for side in sheet]
    assert root.get("viewBox") == f"0 0 {sheet[0]} {sheet[1]}"
    assert float(root.get("stroke-width")) == plotter.pen_width
    points, margin = points_of(plot), plotter.margin + 0.5 * plotter.pen_width
    assert (points.min(axis=0) >= margin - 0.01).all()
    assert (points.max(axis=0) <= np.array(sheet) - margin + 0.01).all()
    reach = np.ptp(points, axis=0) / (np.array(sheet) - 2 * margin)
    assert reach.max() == pytest.approx(1, abs=0.02)
    assert np.ptp(points, axis=0)[1] / np.ptp(points, axis=0)[0] == pytest.approx(70 / 90, abs=0.02)


@pytest.mark.parametrize(("distance", "most", "angle"), [(1.2, 0.875, 45.0), (2.4, 0.578, 10.0)])
def test_hatching_covers_the_paper_in_proportion_to_the_tone(distance, most, angle):
    tones = np.linspace(0.04, 0.96, 5)
    covered = []
    for tone in tones:
        scene = Scene(40, 40, background=np.full(3, 1 - tone))
        plot = plot_of(scene, sheet="60x60mm", hatch=distance, hatch_angle=angle)
        covered.append(ink_of(plot)[30:-30, 30:-30].mean())
    assert (np.diff(covered) >= -0.005).all()
    np.testing.assert_allclose(covered, most * tones, atol=0.14)
    assert np.mean(covered - most * tones) == pytest.approx(0, abs=0.05)


def test_light_tones_are_hatched_in_the_direction_that_is_asked_for():
    plot = plot_of(of_areas(background=np.full(3, 0.7)), hatch_angle=20.0, hatch=2.0)
    ways = np.concatenate([np.diff(stroke, axis=0) for stroke in plot.pens[0].strokes])
    ways = ways[np.hypot(*ways.T) > 20]
    assert len(ways) > 20
    np.testing.assert_allclose(np.degrees(np.arctan2(*ways.T[::-1])) % 180, 20, atol=0.5)


def test_no_point_of_an_outline_is_hidden_and_a_common_edge_is_drawn_once():
    lower, upper = box(10, 10, 60, 60), box(40, 40, 90, 90, GREY)
    beside = box(10, 60, 40, 90, (0.2, 0.0, 0.0))
    plot = plot_of(of_areas(lower, beside, upper))
    points = points_of(plot) - 0.3
    in_upper = ((points > 40.4) & (points < 89.6)).all(axis=1)
    assert not in_upper.any()
    # The upper box has 200 mm, the lower one 160 outside of it, and the third 60 of its own.
    assert plot.drawn_mm == pytest.approx(200 + 160 + 60, abs=2)
    assert plot_of(of_areas(beside, lower)).drawn_mm == pytest.approx(200 + 90, abs=2)
    clear = plot_of(of_areas(lower, box(40, 40, 90, 90, GREY, opacity=0.5)))
    assert clear.drawn_mm == pytest.approx(400, abs=2)


def test_an_outline_ends_where_the_picture_ends():
    plot = plot_of(of_areas(box(-10, 0, 100, 50)))
    assert plot.drawn_mm == pytest.approx(100, abs=3)
    assert points_of(plot)[:, 1] - 0.3 == pytest.approx(50, abs=0.1)
    points = points_of(plot_of(of_areas(line((-9, 40), (109, 70))))) - 0.3
    assert points.min() >= -0.001
    assert points.max() <= 100.001


@pytest.mark.parametrize(
    ("areas", "length", "lifts"),
    [
        ([line((10, 50), (50, 50)), box(50, 49.5, 90, 50.5)], 80, 1),
        ([box(10, 45, 90, 55)], 180, 1),
        ([line((10, 50), (90, 50)), line((50, 10), (50, 90))], 160, 2),
        ([box(20, 20, 80, 80, GREY), line((10, 50), (90, 50))], 320, 2),
    ],
)  # fmt: skip
def test_narrow_parts_are_drawn_along_their_middle_and_wide_ones_around(areas, length, lifts):
    plot = plot_of(of_areas(*areas))
    assert plot.drawn_mm == pytest.approx(length, abs=0.03 * length)
    assert plot.lifts == lifts


def test_nearly_equal_colours_are_one_line_and_have_no_border():
    almost = (0.03, 0.03, 0.03)
    pieces = [box(10 * k, 49, 10 * k + 10, 51, (BLACK, almost)[k % 2]) for k in range(1, 9)]
    [[stroke]] = [pen.strokes for pen in plot_of(of_areas(*pieces)).pens]
    assert np.abs(stroke[:, 1] - 50.3).max() < 0.2
    fills = of_areas(box(10, 10, 50, 90), box(40, 20, 90, 80, almost))
    assert plot_of(fills).drawn_mm == pytest.approx(320, abs=3)


def away(points, stroke):
    """The least distance in mm of points to a stroke."""
    dense = np.concatenate([np.linspace(*ends, 2000) for ends in pairwise(stroke)])
    return np.hypot(*(points[:, None] - dense).transpose(2, 0, 1)).min()


@pytest.mark.parametrize("angle_deg", [15, 25, 30])
def test_strokes_of_lines_that_touch_meet(angle_deg):
    end = 50 - 40 * np.array([np.sin(np.radians(angle_deg)), np.cos(np.radians(angle_deg))])
    lines = [polyline((50, 10), (50, 90)), polyline((50, 50), end)]
    plot = plot_of(of_areas(*(Area([one], BLACK, width=1.5) for one in lines)))
    one, other = plot.pens[0].strokes
    assert min(away(one[[0, -1]], other), away(other[[0, -1]], one)) < 0.1


def test_an_outline_leads_to_the_line_that_leaves_its_area():
    flare = [(50, 27.8), (53, 29.5), (95, 29.5), (95, 30.5), (53, 30.5), (50, 32.2)]
    shape = Area([polygon((10, 10), (50, 10), *flare, (50, 50), (10, 50))], BLACK)
    line, outline = sorted(plot_of(of_areas(shape)).pens[0].strokes, key=len)
    assert max(away(end[None], line) for end in outline[[0, -1]]) < 0.1


def test_short_lines_that_branch_off_are_drawn():
    long = Area([polyline((14, 86), (86, 14))], BLACK, width=0.75)
    shorts = [polyline((x, 100 - x), (x, 98.3 - x)) for x in (30, 50, 70)]
    assert plot_of(of_areas(long, Area(shorts, BLACK, width=0.6))).lifts == 4


def test_small_loops_of_thin_lines_are_drawn():
    turn = np.linspace(0, 2 * np.pi, 40)
    loops = [
        [(left, 50), *np.transpose([left + 3 + 0.3 * np.sin(turn), 49.7 + 0.3 * np.cos(turn)])]
        for left in (10, 40, 70)
    ]
    scene = of_areas(*(Area([polyline(*loop)], BLACK, width=0.13) for loop in loops))
    plot = plot_of(scene, sheet="100.1x100.1mm", pen_width=0.1)
    strokes = [stroke for pen in plot.pens for stroke in pen.strokes]
    for loop in loops:
        near = np.array(loop)[1::3] + 0.05  # the margin of the sheet
        assert max(min(away(point[None], one) for one in strokes) for point in near) < 0.1


def test_a_wedge_is_drawn_around():
    wedge = np.array([(50.0, 90.0), (48.7, 10.0), (51.3, 10.0)])
    plot = plot_of(of_areas(Area([polygon(*wedge)], BLACK)))
    [[stroke]] = [pen.strokes for pen in plot.pens]
    assert np.abs(np.diff(stroke, axis=0)).sum() > 150  # its middle has 80 mm
    assert np.abs(stroke - 0.3 - wedge[:, None]).max(axis=2).min(axis=1).max() < 0.3


def test_a_drawing_is_hatched_only_if_it_is_asked_for_and_its_lines_never():
    scene = of_areas(box(10, 10, 60, 60), line((70, 10), (70, 90)))
    bare, hatched = plot_of(scene), plot_of(scene, hatch=1.0)
    assert hatched.drawn_mm > 4 * bare.drawn_mm
    x = points_of(hatched)[:, 0] - 0.3
    assert (np.abs(x[x > 61] - 70) < 0.2).all()


@pytest.mark.parametrize(
    "scene",
    [
        of_areas(Area([polygon((-1e7, -1e7), (1e7, 0), (0, 1e7))], BLACK)),
        of_areas(line((-1e6, 30), (1e6, 60)), line((5, 5), (5, 5))),
        random_scene(9, 100, 100, 1).replace(sigma=np.full((9, 2), 1e8)),
        Scene(1, 1, background=np.zeros(3)), Scene(1, 5000, background=np.zeros(3)),
    ],
)  # fmt: skip
def test_extreme_scenes_are_drawn_within_the_sheet(scene):
    plot = plot_of(scene, hatch=1.0)
    points = np.concatenate([*(s for pen in plot.pens for s in pen.strokes), np.ones((1, 2))])
    assert points.min() >= 0.29
    assert points.max() <= 100.31


def test_strokes_come_in_an_order_that_saves_travel():
    plot = plot_of(PHOTO.replace(width=100, height=100))
    strokes = plot.pens[0].strokes
    assert plot.lifts == len(strokes) > 60
    mixed = [strokes[k] for k in np.random.default_rng(1).permutation(len(strokes))]
    shuffled = plot._replace(pens=[plot.pens[0]._replace(strokes=mixed)])
    assert plot.travel_mm < 0.2 * shuffled.travel_mm


def test_each_ink_but_white_has_a_pen_that_gives_its_colour_with_the_paper():
    inks = "#ffffff,#e0a070,#203060"
    _, brown, blue = ink_colors(inks)
    areas = [box(0, 0, 50, 100, tuple(brown)), box(50, 0, 100, 100, tuple(blue))]
    plot = plot_of(of_areas(*areas), inks, hatch=1.2)
    layers = parse(plot.svg).findall(SVG + "g")
    assert [layer.get(LABEL).split(":")[0] for layer in layers] == ["1 #e0a070", "2 #203060"]
    assert all(min(ink_colors(layer.get("stroke"))[0]) == 0 for layer in layers)
    drawn = rasterize(plot.svg, 503, 503)
    for x, ink in ((125, brown), (375, blue)):
        part = drawn[50:450, x - 75 : x + 75].mean(axis=(0, 1))
        np.testing.assert_allclose(part, 1 - 0.875 * (1 - ink), atol=0.1)


def test_the_paper_is_not_drawn_and_inks_that_overprint_are_drawn_over_each_other():
    inks, paper = "#ff48b0,#0078bf", "#f5f0e6"
    mixes = printed_colors(inks, paper, 1)
    paints = [tuple(color) for color in ink_colors(",".join(mixes))]
    boxes = [box(20 * k, 0, 20 * k + 20, 100, paint) for k, paint in enumerate(paints)]
    options = Plotter(sheet="100.6x100.6mm", margin=0, hatch=1.2, pen_width=0.6)
    ground = tuple(ink_colors(paper)[0])
    plot = plotted(of_areas(*boxes, background=ground), options, Document(), inks, paper, 1)
    for pen in plot.pens:
        ends = np.concatenate([one for one in pen.strokes if one.shape[0] > 2]) - 0.3
        hatched = np.bincount((ends[:, 0] // 20).astype(int), minlength=6)[:4] > 25
        k = inks.split(",").index(pen.name)
        assert hatched.tolist() == [strength[k] > 0 for strength in mixes.values()]


def test_the_command_says_what_the_plot_takes(photo, tmp_path, capsys):
    source, path = tmp_path / "photo.png", tmp_path / "plot.svg"
    source.write_bytes(as_png(photo))
    given = [source, "-o", tmp_path / "o.svg", "--gaussians", 40, "--iterations", 20]
    given += ["--pen-width", 2]
    assert main([*map(str, [*given, "--plot", path, "--sheet", "letter"])]) == 0
    said = re.search(rf"{path}: (.* min)$", capsys.readouterr().err, re.MULTILINE)
    svg = path.read_text()
    assert said[1] == parse(svg).findtext(SVG + "desc")
    assert re.fullmatch(r"[\d.]+ m in [\d,]+ strokes, [\d.]+ m with the pen up, .*", said[1])
    assert svg.count("<path") == int(said[1].split()[3].replace(",", ""))
