"""Kinks of outlines go where the picture does not need them."""

import itertools

import numpy as np

from gauss2svg.areas.merge import without_kinks
from gauss2svg.areas.outlines import Path
from gauss2svg.areas.paint import Paint
from gauss2svg.areas.refine import Drawing, Layer
from gauss2svg.raster import rasterize

PICTURE = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 60 40">
<path fill="#fff" d="M0 0h60v40H0z"/><path d="M10 10H40a8 8 0 0 1 0 16H10z"/></svg>"""


def test_a_kink_beside_a_round_end_goes_and_the_raster_stays():
    """Which kinks the areas of a picture have depends on all steps before."""
    cap = np.array([[40, 10], [49, 10], [51, 21], [42.2, 24.8]], float)
    wave = np.array([[42.2, 24.8], [41, 24.4], [42, 26], [40, 26]], float)
    corners = np.array([[40, 26], [10, 26], [10, 10], [40, 10]], float)
    rest = [np.array([a, a, b, b]) for a, b in itertools.pairwise(corners)]
    path = Path(np.array([cap, wave, *rest]), np.array([True, True, *[False] * 3]))
    black, white = (Paint(np.full(3, level)) for level in (0.0, 1.0))
    drawing = Drawing(rasterize(PICTURE, 60, 40), white, [black], [Layer(0, [path])])
    smooth = drawing.with_layers(without_kinks(drawing))
    assert len(smooth.curved) == len(drawing.curved) - 1
    smooth.refine(20)
    assert ((smooth.draw() - drawing.pixels) ** 2).sum() < 0.2
