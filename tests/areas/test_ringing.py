"""Properties of drawings that were reduced by filters that overshoot beside edges."""

import numpy as np
import pytest
from flat import vectorize
from outlines import polygon
from PIL import Image
from test_clean import image_of, off
from test_find import DRAWINGS, RED, SIDE

from gauss2svg.areas.ringing import is_rung
from gauss2svg.render.areas import draw_areas
from gauss2svg.scene.areas import Area

BICUBIC, LANCZOS = Image.Resampling.BICUBIC, Image.Resampling.LANCZOS
WHITE = 1.0, 1.0, 1.0


def large(areas, times: int = 4):
    """Return an enlarged drawing on a white page, in 8 bits."""
    image = np.ones((times * SIDE, times * SIDE, 3))
    draw_areas(areas, image, (times, times))
    return image_of(image)


def rung(areas, resampling):
    """Return a drawing that was enlarged, and reduced by a filter."""
    small = large(areas).resize((SIDE, SIDE), resampling)
    return np.asarray(small, np.float32) / 255


@pytest.mark.parametrize(("name", "resampling"), [("a ring", LANCZOS), ("discs in discs", BICUBIC)])
def test_a_reduced_drawing_has_the_areas_of_its_source(name, resampling):
    areas, picture = DRAWINGS[name], rung(DRAWINGS[name], resampling)
    assert is_rung(picture)
    found = vectorize(picture).scene
    assert (len(found.areas), len(found)) == (len(areas), 0)
    assert off(areas, found.areas).max() < 0.3


def test_a_line_in_a_reduced_drawing_stays():
    block = Area((polygon((10, 10), (86, 10), (86, 51), (10, 51)),), RED)
    line = Area((polygon((10, 56), (86, 56), (86, 57), (10, 57)),), (0.9, 0.9, 0.9))
    assert len(vectorize(rung([block, line], LANCZOS)).scene.areas) == 2
