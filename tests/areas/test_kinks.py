"""Kinks of outlines go where the picture does not need them, and corners stay."""

import itertools

import numpy as np

from gauss2svg.areas.merge import without_kinks
from gauss2svg.areas.outlines import Path
from gauss2svg.areas.paint import Paint
from gauss2svg.areas.refine import Drawing, Layer
from gauss2svg.raster import rasterize

PICTURE = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 60 40">
<path fill="#fff" d="M0 0h60v40H0z"/><path d="M10 10H{0}a8 8 0 0 1 0 16H10z"/></svg>"""


def line(*nodes):
    return [np.array([a, a, b, b], float) for a, b in itertools.pairwise(nodes)]


def drawing_of(segments, curved, svg):
    black, white = (Paint(np.full(3, level)) for level in (0.0, 1.0))
    layer = Layer(0, [Path(np.array(segments), np.array(curved))])
    return Drawing(rasterize(svg, 60, 40), white, [black], [layer])


def test_a_kink_beside_a_round_end_goes_and_the_raster_stays():
    cap = np.array([[40, 10], [49, 10], [51, 21], [42.2, 24.8]], float)
    wave = np.array([[42.2, 24.8], [41, 24.4], [42, 26], [40, 26]], float)
    rest = line((40, 26), (10, 26), (10, 10), (40, 10))
    drawing = drawing_of([cap, wave, *rest], [True, True, *[False] * 3], PICTURE.format(40))
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
    drawing = drawing_of(curves, [True] * 10, svg)
    (layer,) = without_kinks(drawing)
    assert len(layer.paths[0].curved) == 10
