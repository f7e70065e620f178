"""Properties of areas that are fitted to what a renderer draws."""

import pytest
from test_find import scene_of

from gauss2svg.areas.find import find_areas
from gauss2svg.areas.scenes import as_rasterized
from gauss2svg.photo.pixels import over
from gauss2svg.raster import rasterize
from gauss2svg.svg import MINIMAL, Document, SvgFormat
from gauss2svg.svg.write import write_svg

SIDE = 128
SHAPES = """<g fill="none" stroke="#123"><path stroke-width=".8" d="M8 20C48-12 80 60 120 16"/>
<path stroke-width="2.4" d="M8 60C48 50 80 76 120 66"/><circle cx="70" cy="84" r="30"/></g>
<path fill="#b32" d="M12 92 54 70l6 40z"/>"""
FRAME = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIDE} {SIDE}">{{}}</svg>'
OPAQUE = FRAME.format(f'<path fill="#fff" d="M0 0h{SIDE}v{SIDE}H0z"/>{SHAPES}')
CLEAR = FRAME.format(SHAPES)


def fitted(picture):
    """Return the areas found in a picture, the same fitted to its raster, and the rasters."""
    found = find_areas(picture)

    def raster(areas):
        scene = scene_of(areas, found.background, SIDE, SIDE)
        svg = write_svg(scene, SvgFormat(markup=MINIMAL), Document())
        return rasterize(svg, SIDE, SIDE, alpha=picture.shape[2] == 4)

    areas = as_rasterized(picture, found.areas, found.background, raster)
    errors = [((over(raster(some)) - over(picture)) ** 2).mean() for some in (found.areas, areas)]
    return found.areas, areas, errors


@pytest.mark.parametrize(
    "picture",
    [rasterize(OPAQUE, SIDE, SIDE), rasterize(CLEAR, SIDE, SIDE, alpha=True)],
    ids=["opaque", "alpha"],
)
def test_areas_of_a_picture_that_the_renderer_made_draw_it_closer(picture):
    _, areas, (before, after) = fitted(picture)
    assert after < 0.6 * before
    widths = sorted(area.width for area in areas if area.is_line)
    assert widths == pytest.approx([0.8, 1, 2.4], abs=0.06)
