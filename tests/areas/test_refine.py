"""Properties of the refinement of outlines."""

from dataclasses import replace

import numpy as np

from gauss2svg.areas.outlines import Path
from gauss2svg.areas.paint import Paint
from gauss2svg.areas.refine import Drawing, Layer
from gauss2svg.render.areas import coverage_of
from gauss2svg.scene.areas import Area, Outline

OUTLINE = Outline(
    ((4.3, 5.2), (10.1, 1.7), (18.2, 3.3), (20.4, 9.1), (15.2, 20.7), (6.6, 16.4)),
    (True, False, False, False),
)


CANVAS = np.zeros((24, 24, 1), np.float32)


def drawing_of(outline: Outline, pixels, width: float = 0.0, page: float = 0, is_tied=False):
    """Return a drawing of a white area, or of a line, on a page."""
    path = Path(outline.segments, np.array(outline.curved), outline.closed)
    layers, paints = [Layer(0, [path], width)], [Paint(np.ones(1))]
    return Drawing(pixels, Paint(np.full(1, page)), paints, layers, is_tied)


def test_samples_are_the_gradient_of_the_readable_twin():
    drawing = drawing_of(OUTLINE, CANVAS)
    drawing.draw()
    drawing.weigh()
    pixel, owner, jacobian, _ = drawing.samples()
    sampled = np.zeros((24 * 24, len(drawing.point), 2))
    for place, segment, row in zip(pixel, owner, jacobian, strict=True):
        for point, move in zip(drawing.segment[segment], row[:8].reshape(4, 2), strict=True):
            sampled[place, point] += move
    exact = np.empty_like(sampled)
    for place in np.ndindex(6, 2):
        shift = np.zeros((6, 2))
        shift[place] = 1e-3
        more, less = (
            coverage_of(Area((replace(OUTLINE, points=points),), (0.0,) * 3), 0, 0, 24, 24)
            for points in (OUTLINE.points + shift, OUTLINE.points - shift)
        )
        exact[:, *place] = (more - less).ravel() / 2e-3
    assert np.abs(sampled - exact).max() < 0.15  # about half a sample of 1/4 px
    total = np.abs(exact).sum(axis=0)
    assert np.abs(sampled.sum(axis=0) - exact.sum(axis=0)).max() < 0.02 * total.max()


def test_refinement_never_raises_the_error():
    rng = np.random.default_rng(3)
    target = drawing_of(OUTLINE, CANVAS).draw()
    for _ in range(5):
        points = np.array(OUTLINE.points) + rng.normal(size=(6, 2))
        drawing = drawing_of(Outline(tuple(map(tuple, points)), OUTLINE.curved), target)
        before = ((drawing.draw() - target) ** 2).sum()
        drawing.refine(10, colors=False)
        assert ((drawing.draw() - target) ** 2).sum() <= before
