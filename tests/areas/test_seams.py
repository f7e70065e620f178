"""The page does not show through between areas that touch, at any size of the file."""

import re

import numpy as np
import pytest
from outlines import polygon
from scipy import ndimage
from test_find import BLACK, BLUE, GREEN, RED, SIDE, disc, drawn

from gauss2svg.areas.find import find_areas
from gauss2svg.raster import rasterize
from gauss2svg.scene import Area, Scene
from gauss2svg.svg import SvgFormat
from gauss2svg.svg.write import write_svg

SQUARE = polygon((10, 12), (86, 12), (86, 84), (10, 84))
DRAWINGS = {
    "three side by side": [
        SQUARE,
        polygon((38, 12), (86, 12), (86, 84), (30, 84)),
        polygon((62, 12), (86, 12), (86, 84), (70, 84)),
    ],
    "junctions like a T": [
        SQUARE,
        polygon((10, 50), (86, 44), (86, 84), (10, 84)),
        polygon((46, 47.2), (86, 44), (86, 84), (52, 84)),
    ],
    "discs in discs": [disc(48, 48, 40), disc(44, 50, 28), disc(40, 52, 14), disc(40, 52, 5)],
    "discs that overlap": [disc(36, 36, 24), disc(60, 40, 24), disc(46, 60, 24)],
}
FAR = 2.0  # px of the picture from the page, and pixels of the raster, within which it may show
MOST = 2.5 / 255  # of the page


def share_of_page(found, markup, scale: float):
    """Return the share (n, n) in which the page shows through a file without its background."""
    page = np.ones(3) if found.background is None else np.array(found.background)
    scene = Scene(
        SIDE, SIDE, background=page, transparent=found.background is None, areas=found.areas
    )
    svg = write_svg(scene, SvgFormat(markup=markup, precision=1 / 24))
    background = r'<rect [^>]*id="background"[^>]*/>|<path( fill="[^"]*")? d="M[^"]*"/>'
    svg, count = re.subn(background, "", svg)
    assert count == (found.background is not None)
    drawings = []
    for color in ("#000", "#f0f"):
        below = f'<rect width="100%" height="100%" fill="{color}"/>'
        on_color = re.sub("<svg[^>]*>", lambda root, below=below: root[0] + below, svg, count=1)
        side = round(SIDE * scale)
        drawings.append(rasterize(on_color, side, side))
    return (drawings[1] - drawings[0])[..., [0, 2]].max(axis=-1)


def covered(areas, scale: float):
    """Return the opacity (n, n) of areas at pixels that lie far from where it changes, else NaN."""
    fine = 4
    alpha = drawn([area.scaled(fine, fine) for area in areas], 4, SIDE * fine)[..., 3]
    changes = ndimage.maximum_filter(alpha, 3) - ndimage.minimum_filter(alpha, 3) > 0.02
    far = ndimage.distance_transform_edt(~changes) / fine > max(FAR, FAR / scale)
    side = round(SIDE * scale)
    place = ((np.arange(side) + 0.5) / side * SIDE * fine).astype(int)
    return np.where(far, alpha, np.nan)[np.ix_(place, place)]


@pytest.mark.parametrize("name", DRAWINGS)
def test_no_page_shows_between_areas_that_touch(name):
    colors = RED, GREEN, BLUE, BLACK
    areas = [Area((o,), color) for o, color in zip(DRAWINGS[name], colors, strict=False)]
    channels = 4 if name == "discs that overlap" else 3
    found = find_areas(drawn(areas, channels))
    for markup, scale in (("minimal", 0.37), ("editable", 1.3), ("minimal", 3.7)):
        alpha = covered(areas, scale)
        shown = share_of_page(found, markup, scale)
        assert (alpha > 0.99).sum() > 100
        assert shown[alpha > 0.99].max() < MOST, (markup, scale)


def test_through_a_transparent_area_the_page_shows_by_its_opacity():
    areas = [Area((SQUARE,), RED, 0.5), Area((disc(40, 45, 18),), BLUE)]
    found = find_areas(drawn(areas, 4))
    for markup, scale in (("editable", 0.37), ("minimal", 3.7)):
        alpha = covered(areas, scale)
        shown = share_of_page(found, markup, scale)
        known = ~np.isnan(alpha)
        assert {round(float(a), 1) for a in alpha[known]} == {0.0, 0.5, 1.0}
        np.testing.assert_allclose(shown[known], 1 - alpha[known], atol=MOST)
