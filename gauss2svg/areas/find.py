"""Find the areas and lines of a picture."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from gauss2svg.areas.layers import masks_of
from gauss2svg.areas.merge import merged
from gauss2svg.areas.outlines import contours_of, first_path
from gauss2svg.areas.paint import paints_of
from gauss2svg.areas.refine import Drawing, Layer
from gauss2svg.areas.thin import add_thin_regions, grouped, take_lines
from gauss2svg.areas.regions import Palette, cores_of, grown, shares_of, without_edge_shades

TIMES = {}


def clock(name, t=[0.0]):
    now = time.process_time()
    if t[0]:
        TIMES[name] = TIMES.get(name, 0) + now - t[0]
    t[0] = now


def contrast_of(pixels):
    """Return a function from points (n, 2) to the squared difference of colours across an edge."""
    h, w, _ = pixels.shape
    padded = np.pad(pixels, ((2, 2), (2, 2), (0, 0)), mode="edge")
    across = ((padded[2:-2, 4:] - padded[2:-2, :-4]) ** 2).sum(axis=-1)
    down = ((padded[4:, 2:-2] - padded[:-4, 2:-2]) ** 2).sum(axis=-1)
    contrast = np.maximum(np.maximum(across, down), 0.015)

    def weight_at(points):
        x = np.clip(np.floor(points[:, 0]).astype(int), 0, w - 1)
        y = np.clip(np.floor(points[:, 1]).astype(int), 0, h - 1)
        beyond = (points < 0).any(axis=1) | (points > [w, h]).any(axis=1)
        return np.where(beyond, 0.05, contrast[y, x])

    return weight_at


def bytes_of(layer: Layer, unit) -> float:
    total = 50 if layer.width else 20
    for path in layer.paths:
        d = np.abs(np.round((path.segments[:, 1:] - path.segments[:, :1]) / unit))
        digits = np.floor(np.log10(np.maximum(d, 1))) + 1
        total += np.where(path.curved, digits.sum(axis=(1, 2)) + 5.5, digits[:, 2].sum(axis=1) + 2).sum() + 7
    return total


def without_cheap(drawing: Drawing, unit, rate) -> list[Layer]:
    """Return the layers that lower the squared error by at least `rate` for each of their bytes."""
    if not drawing.layers:
        return []
    error = drawing.draw() - drawing.pixels
    below = drawing.below.copy()
    drawing.weigh()
    kept = []
    for l, layer in enumerate(drawing.current()):
        own = error[drawing.slices(l)]
        paint = drawing.paints[layer.paint].image(drawing.shape)[drawing.slices(l)]
        without = own - (paint - drawing.part(below, l)) * drawing.part(drawing.visible, l)[..., None]
        if (without**2).sum() - (own**2).sum() >= rate * bytes_of(layer, unit):
            kept.append(layer)
    return kept


def find(pixels, unit=1 / 16, rate=0.0025, steps=20, reach=2, ties=1):
    clock("")
    h, w, _ = pixels.shape
    cores, count = cores_of(pixels)
    cores, count = without_edge_shades(pixels, cores, count)
    clock("cores")
    paints = paints_of(pixels, cores, count)
    clock("paint")
    labels = grown(pixels, cores)
    clock("grow")
    palette = Palette(paints, pixels.shape)
    shares = shares_of(pixels, cores, labels, palette)
    clock("shares")
    weight_at = contrast_of(pixels)
    new = add_thin_regions(pixels, cores, labels, shares, paints, palette)
    clock('thin1')
    lines = take_lines(pixels, cores, labels, shares, paints, new, weight_at, unit, rate)
    count = len(paints)
    clock("thin")
    labels = shares.largest
    sizes = np.bincount(labels.ravel(), minlength=count)
    ground = paints[int(sizes.argmax())]
    is_ground = np.array([paint is ground for paint in paints])
    masks = masks_of(labels, shares, paints, is_ground, np.zeros(count, bool), reach)
    clock("layers")
    layers = []
    for mask in masks:
        contours = contours_of(mask.share, mask.left, mask.top, (h, w))
        paths = [first_path(c, weight_at, unit, rate) for c in contours]
        if paths:
            layers.append(Layer(mask.region, paths))
    layers += [Layer(*group) for group in grouped(lines, paints)]
    clock("fit")
    drawing = Drawing(pixels, ground, paints, layers, False)
    drawing = Drawing(pixels, ground, paints, without_cheap(drawing, unit, 0.01), False)
    clock("prune")
    drawing.refine(steps)
    clock("refine")
    for _ in range(2):
        drawing = Drawing(pixels, ground, paints, merged(drawing, unit, rate), bool(ties))
        clock("merge")
        drawing.refine(steps // 2)
        clock("refine")
    drawing = Drawing(pixels, ground, paints, without_cheap(drawing, unit, rate), bool(ties))
    drawing.refine(steps // 2)
    clock("refine")
    return drawing
