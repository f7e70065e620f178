"""Properties of cut files: closed regions of inks, clear of each other, which are what is seen."""

from xml.etree.ElementTree import fromstring as parse

import numpy as np
import pytest
import shapely
from scenes import random_scene

from gauss2svg.raster import rasterize
from gauss2svg.scene import PLAIN, Scene
from gauss2svg.scene.areas import Area, Outline
from gauss2svg.scene.inks import ink_colors, printed_colors
from gauss2svg.svg.plates import Regions
from gauss2svg.svg.write import plate_svg, write_svg

INKS = "#f7c306,#c0322c,#17324d"
MM = 0.5  # size of a px on paper


def square(side: float, x: float, y: float, turned: bool = False) -> Outline:
    points = ((x, y), (x + side, y), (x + side, y + side), (x, y + side))
    return Outline(points[::-1] if turned else points, (False,) * 4)


def drawing_in_inks(seed: int) -> Scene:
    """Forty ellipses above a ring, a bow of curves that crosses itself, and lines with all caps."""
    colors = ink_colors(INKS)
    bow = Outline(((10, 10), (60, 60), (60, 10), (10, 60), (40, 70), (0, 60)), (True, True), True)
    line = Outline(((10, 64), (30, 20), (45, 64)), (False, False), False)
    curve = Outline(((-5, 30), (30, -20), (60, 90), (95, 40)), (True,), False)
    shapes = [
        Area((square(50, 20, 10), square(30, 30, 20, turned=True)), tuple(colors[1])),
        Area((bow,), tuple(colors[0])),
        Area((line,), tuple(colors[2]), width=9, cap="butt"),
        Area((curve,), tuple(colors[1]), width=4, cap="round"),
        Area((square(20, 60, 40),), tuple(colors[2]), width=3, cap="square"),
    ]
    return random_scene(40, 90, 70, seed, (1, 7), (20, 40)).replace(
        opacity=np.ones(40),
        color=colors[np.random.default_rng(seed).integers(0, 3, 40)],
        drawn=np.full(40, PLAIN),
        background=colors[0],
        level=None,
        areas=shapes,
    )


def region_of(scene: Scene) -> shapely.Geometry:
    """Return the region that the filled areas of a scene have by the rule "evenodd"."""
    region = shapely.Polygon()
    for area in scene.areas:
        for outline in area.outlines:
            assert outline.closed
            assert not area.is_line
            region = region.symmetric_difference(shapely.Polygon(outline.points))
    return region


@pytest.mark.parametrize(("seed", "ellipses"), [(0, 0), (0, 40), (1, 40), (2, 40)])
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


def test_outlines_for_cutters_are_one_path_for_each_ink_from_light_to_dark():
    scene = drawing_in_inks(0)
    cut = Regions(scene, MM).outlines(INKS.split(","))
    np.testing.assert_allclose([area.paint for area in cut.areas], ink_colors(INKS))
    assert sum(path.tag.endswith("path") for path in parse(write_svg(cut)).iter()) == 3
