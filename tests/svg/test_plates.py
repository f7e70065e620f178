"""Properties of files for printers, plotters and cutters: groups, plates, regions and outlines."""

import gzip
import pickle
import re
from xml.etree.ElementTree import fromstring as parse

import numpy as np
import pytest
import shapely
from flat import vectorize
from outlines import box, polygon, polyline
from scenes import random_scene
from scipy.ndimage import maximum_filter, minimum_filter

from gauss2svg.cli.main import main
from gauss2svg.files import as_png
from gauss2svg.raster import rasterize
from gauss2svg.scene import PLAIN, Scene, whitening_of
from gauss2svg.scene.areas import Area, Outline
from gauss2svg.scene.falloff import half_radius
from gauss2svg.scene.inks import ink_colors, printed_colors
from gauss2svg.svg import Document, SvgFormat
from gauss2svg.svg.encode import outline_svg
from gauss2svg.svg.plates import Regions, grouped_by_ink, plate_of
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import plate_svg, with_marks, write_svg

SVG = "{http://www.w3.org/2000/svg}"
INKS = "#f7c306,#c0322c,#17324d"
COUNT = 90
BY_INK = SvgFormat(layers="inks", precision=0.01)


def scene_in_inks(seed: int = 3, count: int = COUNT, sigma: tuple = (2, 8)) -> Scene:
    colors = ink_colors(INKS)
    return random_scene(count, 90, 70, seed, sigma, (20, 40)).replace(
        opacity=np.ones(count),
        color=colors[np.random.default_rng(seed).integers(0, 3, count)],
        drawn=np.full(count, PLAIN),
        background=colors[0],
    )


def raster_of(scene: Scene) -> np.ndarray:
    return rasterize(write_svg(scene, SvgFormat(precision=0.01)), 180, 140)


@pytest.mark.parametrize("seed", range(2))
def test_grouped_by_ink_looks_the_same_in_fewer_runs_and_is_read_back(seed):
    scene = scene_in_inks(seed)
    grouped = grouped_by_ink(scene)
    np.testing.assert_allclose(raster_of(grouped), raster_of(scene), atol=2 / 255)
    assert grouped.round_index[-1] < (np.diff(scene.color, axis=0) != 0).any(axis=1).sum()
    again = grouped_by_ink(grouped)
    np.testing.assert_array_equal(again.mean, grouped.mean)
    svg = write_svg(scene, BY_INK)
    assert svg.count("<g ") == grouped.round_index[-1] + 1
    assert svg.count(" fill=") == svg.count("<g ") + 1  # and the background's
    assert write_svg(grouped, BY_INK) == svg
    # A scene without areas may have Gaussians of level 0 below others, which changes nothing.
    level = np.where(np.arange(COUNT) < 40, 0, -1)
    assert write_svg(scene.replace(level=level), BY_INK) == svg
    back = read_svg(svg)
    for name in ("color", "round_index", "inks"):
        np.testing.assert_array_equal(getattr(back, name), getattr(grouped, name))
    np.testing.assert_allclose(back.mean, grouped.mean, atol=0.01)


def test_plates_add_up_to_the_picture_and_leave_out_what_changes_nothing():
    scene = scene_in_inks()
    picture, total = raster_of(scene), np.zeros((140, 180, 3))
    for ink in INKS.split(","):
        plate = 1 - rasterize(plate_svg(scene, ink), 180, 140)[:, :, :1]
        total += plate * ink_colors(ink)
    same = maximum_filter(picture, (3, 3, 1)) == minimum_filter(picture, (3, 3, 1))
    inside = same.all(axis=2)  # edges are antialiased several times
    assert inside.mean() > 0.5
    np.testing.assert_allclose(total[inside], picture[inside], atol=1 / 255)
    assert np.abs(total - picture).mean() < 0.01
    one = np.where(np.arange(COUNT)[:, None] == 5, [1.0, 0, 0], ink_colors(INKS)[1])
    assert len(plate_of(scene.replace(color=one), {"#ff0000": 1.0})) < COUNT


@pytest.mark.parametrize(
    ("sigma", "rho", "beta"),
    [((20, 4), 0.0, 1.0), ((9, 21), 0.6, 3.0), ((15, 15), -0.8, 16.0)],
)
def test_a_stroke_of_one_width_lies_where_the_falloff_is_half(sigma, rho, beta):
    scene = Scene(
        120, 100, mean=[[61, 47]], sigma=[sigma], rho=[rho], color=[[0, 0, 0]], opacity=[1],
        beta=[beta],
    )  # fmt: skip
    y, x = np.mgrid[:400, :480] / 4 + 0.125
    ink = 1 - rasterize(outline_svg(scene), 480, 400)[:, :, 0]
    w11, w21, w22 = whitening_of(scene.sigma, scene.rho)[0]
    r = np.hypot(w11 * (x - 61), w21 * (x - 61) + w22 * (y - 47))
    # Off the contour by no more than half the width and a pixel of this finer raster.
    gradient = np.hypot(*np.gradient(r, 0.25))
    distance = np.abs(r - half_radius(beta)) / np.maximum(gradient, 1e-9)
    assert distance[ink > 0.5].max() < 0.25 + 0.25
    assert (ink[distance < 0.1] > 0.5).all()


def test_plates_and_outlines_are_files_beside_the_picture(photo, tmp_path, capsys):
    source, lines = tmp_path / "photo.png", tmp_path / "lines.svgz"
    source.write_bytes(as_png(photo[:60, :90]))
    inks = ["#00ff00", "#202020", "#d0d0d0"]  # a green of which nothing is
    given = [source, "-o", tmp_path / "o.svg", "--inks", ",".join(inks), "--gaussians", 20]
    given += ["--iterations", 8, "--separations", tmp_path / "p.svgz", "--outline", lines]
    assert main([*map(str, given)]) == 0
    said = capsys.readouterr().err
    assert f"{tmp_path / 'p-1.svgz'} is not written, because #00ff00 is visible nowhere" in said
    result = vectorize(source, gaussians=20, iterations=8, inks=",".join(inks))
    assert (tmp_path / "o.svg").read_text() == result.svg
    plates = [tmp_path / "p-2.svgz", tmp_path / "p-3.svgz"]
    assert sorted(tmp_path.glob("p-*")) == plates
    written = [gzip.decompress(path.read_bytes()).decode() for path in plates]
    assert written == list(result.plates().values())
    for plate, ink in zip(written, inks[1:], strict=True):
        assert f"<title>Vectorised photo: {ink}</title>" in plate
    assert gzip.decompress(lines.read_bytes()).decode() == result.outline()
    assert result.outline().count("<ellipse") == len(result.scene)


def test_plates_that_overprint_multiply_to_the_picture_on_its_paper(photo):
    inks, paper = "#0078bf,#ff48b0", "#f5f0e6"
    given = {"gaussians": 30, "iterations": 8, "inks": inks, "paper": paper, "overprint": 2}
    result = vectorize(photo[:60, :90], **given)
    assert {result.report[name] for name in ("inks", "paper", "overprint")} == {inks, paper, 2}
    product = ink_colors(paper)[0]
    for ink, plate in result.plates().items():
        product = product * (1 - (1 - rasterize(plate, 90, 60)) * (1 - ink_colors(ink)[0]))
    picture = rasterize(result.svg, 90, 60)
    assert np.abs(product - picture).mean() < 0.005
    assert result.scene.inks is not None
    assert len(result.scene.inks) > 3


def test_marks_are_at_the_same_places_around_all_plates_and_move_no_ink():
    scene = scene_in_inks()
    document = Document(size="90mm", title="A & B")
    plates = {ink: plate_svg(scene, ink, document) for ink in INKS.split(",")}
    seen = set()
    for ink, plate in plates.items():
        marked = with_marks(plate, scene, document, f"{ink} < 2")
        root = parse(marked)
        assert (root.get("width"), root.get("height")) == ("114mm", "94mm")
        assert root.find(f"{SVG}svg/{SVG}title").text == "A & B"
        assert root.find(f"{SVG}text").text == f"{ink} < 2"
        sheet = rasterize(marked, 228, 188)
        # resvg rounds the sides of a page to whole px of 1/96 inch.
        assert np.abs(sheet[24:-24, 24:-24] - rasterize(plate, 180, 140)).mean() < 0.005
        seen.add(root.find(f"{SVG}path[@id='marks']").get("d"))
        assert sheet[:24].min() < 0.7
    assert len(seen) == 1


def test_cut_plates_are_files_of_closed_paths_beside_the_picture(photo, tmp_path, capsys):
    source = tmp_path / "photo.png"
    source.write_bytes(as_png(photo[:60, :90]))
    given = [source, "-o", tmp_path / "o.svg", "--inks", "#202020,#909090", "--gaussians", 20]
    given += ["--iterations", 8, "--separations", tmp_path / "p.svg", "--marks", "--cut"]
    given += ["--trap", "0.3", "--outline", tmp_path / "l.svg", "--overwrite"]
    assert main([*map(str, given), "--size", "9000mm"]) == 0
    assert "too thin" not in capsys.readouterr().err
    assert main([*map(str, given)]) == 0
    assert "too thin to cut (0.3 mm), and left to the ink beside" in capsys.readouterr().err
    result = vectorize(source, gaussians=20, iterations=8, inks="#202020,#909090")
    assert result.thin_parts() == pickle.loads(pickle.dumps(result)).thin_parts()
    plates = [(tmp_path / f"p-{k}.svg").read_text() for k in (1, 2)]
    assert plates == list(result.plates(cut=True, trap=0.3, marks=True).values())
    lines = (tmp_path / "l.svg").read_text()
    assert lines == result.outline(cut=True, trap=0.3)
    paths = re.findall(r'<path[^>]* stroke="([^"]*)"[^>]* d="([^"]*)"', lines)
    assert [color for color, _ in paths] == ["#909090", "#202020"]
    assert all(data.endswith("z") for _, data in paths)
    assert not any("<circle" in one or "<ellipse" in one for one in (*plates, lines))


MM = 0.5  # size of a px on paper


def drawing_in_inks(seed: int) -> Scene:
    """Forty ellipses above a ring, a bow of curves that crosses itself, and lines with all caps."""
    colors = ink_colors(INKS)
    bow = Outline(((10, 10), (60, 60), (60, 10), (10, 60), (40, 70), (0, 60)), (True, True), True)
    curve = Outline(((-5, 30), (30, -20), (60, 90), (95, 40)), (True,), False)
    shapes = [
        Area((box(20, 10, 70, 60), polygon(*box(30, 20, 60, 50).points[::-1])), tuple(colors[1])),
        Area((bow,), tuple(colors[0])),
        Area((polyline((10, 64), (30, 20), (45, 64)),), tuple(colors[2]), width=9, cap="butt"),
        Area((curve,), tuple(colors[1]), width=4, cap="round"),
        Area((box(60, 40, 80, 60),), tuple(colors[2]), width=3, cap="square"),
    ]
    return scene_in_inks(seed, 40, (1, 7)).replace(areas=shapes)


def region_of(scene: Scene) -> shapely.Geometry:
    """Return the region that the filled areas of a scene have by the rule "evenodd"."""
    region = shapely.Polygon()
    for area in scene.areas:
        for outline in area.outlines:
            assert outline.closed
            assert not area.is_line
            region = region.symmetric_difference(shapely.Polygon(outline.points))
    return region


@pytest.mark.parametrize(("seed", "ellipses"), [(0, 0), (1, 40)])
def test_regions_are_what_is_seen_of_inks_and_cover_the_page_once(seed, ellipses):
    scene = drawing_in_inks(seed).select(slice(ellipses))
    regions = Regions(scene, MM)
    parts = {ink: region_of(regions.plate({ink: 1.0})) for ink in INKS.split(",")}
    for ink, part in parts.items():
        plate = rasterize(plate_svg(scene, ink), 540, 420).astype(float)
        seen = (1 - plate[:, :, 0]).mean() * 90 * 70
        assert part.area == pytest.approx(seen, rel=0.003)
        cut = rasterize(write_svg(regions.plate({ink: 1.0})), 540, 420)
        alpha = cut[:, :, 3] if cut.shape[2] == 4 else 1 - cut[:, :, 0]
        assert (np.abs(alpha - (1 - plate[:, :, 0])) > 0.5).mean() < 0.001
    assert sum(part.area for part in parts.values()) == pytest.approx(90 * 70, rel=1e-5)
    assert shapely.union_all(list(parts.values())).area == pytest.approx(90 * 70, rel=1e-5)


def test_what_no_cutter_can_cut_belongs_to_the_region_beside_it():
    light, middle, dark = (tuple(ink) for ink in ink_colors(INKS))
    strip = 0.2 / MM  # px
    page, side = box(0, 0, 90, 70), box(10, 10, 50, 50)
    areas = [
        Area((page,), light),
        Area((side,), middle),
        Area((polygon((50, 10), (50 + strip, 10), (50, 50)),), dark),  # beside it
        Area((polyline((20, 10 + strip), (50, 10 + strip)),), dark, width=strip / 2),
        Area((box(70, 20, 75, 25),), dark),
    ]
    regions = Regions(Scene(90, 70, background=light, areas=areas), MM)
    parts = {ink: region_of(regions.plate({ink: 1.0})) for ink in INKS.split(",")}
    assert [part.area for part in parts.values()] == pytest.approx([4675, 1600, 25], abs=10 * strip)
    assert parts[INKS.split(",")[2]].area == pytest.approx(25, abs=0.01)
    assert sum(part.area for part in parts.values()) == pytest.approx(90 * 70, rel=1e-6)
    assert regions.thin_parts == 1  # the wedge and the line, which touch
    for part in parts.values():
        assert not any(one.buffer(-0.14 / MM).is_empty for one in shapely.get_parts(part))


def test_a_trap_spreads_below_darker_inks_alone_and_as_far_as_it_says():
    scene = drawing_in_inks(1).replace(transparent=True)
    regions, reach = Regions(scene, MM), 0.8 / MM
    plain, wide = (
        {ink: region_of(regions.plate({ink: 1.0}, trap)) for ink in INKS.split(",")}
        for trap in (0.0, 0.8)
    )
    light, middle, dark = INKS.split(",")
    assert wide[dark].symmetric_difference(plain[dark]).area < 0.01
    assert wide[light].area > plain[light].area + 5
    for ink, darker in ((light, plain[middle].union(plain[dark])), (middle, plain[dark])):
        grown = wide[ink].difference(plain[ink].buffer(0.01))
        assert grown.difference(darker.buffer(0.02)).area < 0.01
        assert grown.difference(plain[ink].buffer(reach + 0.02)).area < 0.01
        whole = plain[ink].buffer(reach - 0.02).intersection(darker)
        assert whole.difference(wide[ink].buffer(0.02)).area < 0.01


def test_plates_of_overprints_have_a_region_for_each_strength():
    colors = printed_colors("#0078bf,#ff48b0", "#f5f0e6", 2)
    names = list(colors)
    picked = ink_colors(",".join(names))[np.random.default_rng(2).integers(0, len(names), 40)]
    scene = drawing_in_inks(2).replace(areas=(), color=picked, background=ink_colors(names[0])[0])
    regions = Regions(scene, MM)
    for k in (0, 1):
        tones = {color: strength[k] for color, strength in colors.items()}
        plate = regions.plate(tones)
        assert [area.paint[0] for area in plate.areas] == [0.5, 0.0]
        raster = rasterize(plate_svg(scene, tones), 540, 420).astype(float)
        cut = rasterize(write_svg(plate.replace(transparent=False)), 540, 420)
        assert np.abs(raster - cut).mean() < 0.002
