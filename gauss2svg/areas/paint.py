"""Paints of regions: one colour, or a linear or radial gradient with few stops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import find_objects

from gauss2svg.areas.arrays import LEVEL, Floats, Ints, parts_of, pixels_of
from gauss2svg.core import Kernel
from gauss2svg.portable import cos, dot, exp, hypot, least_squares, main_axis, product, sin, solve
from gauss2svg.scene.areas import LinearGradient, RadialGradient

EVEN = 2 * LEVEL  # largest difference from the median within a region of one colour
GOOD = 1.2 * LEVEL  # root mean square error at which a gradient gets no more stops
# A gradient must halve the error of one colour, and a radial one must be better than a linear one.
GAIN, ROUND_GAIN = 0.5, 0.8
ALIKE = 2.6 * LEVEL  # largest difference of two colours that become one
PRIOR, PRIOR_PER_PX = 0.5, 0.3  # weight of a colour's first value, and more for each pixel of it
LEAST_OPACITY = 1 / 255  # opacity of a colour that is drawn
LEAST_EVEN = 0.2  # share of a region's pixels with the colour into which gradients fade
LEAST_SHOWN = 1e-4  # share of a pixel below which a paint does not count for colours
SHADES = 1024  # colours of a gradient's table (gauss2svg/core/paints.h)

_explain_pixels = Kernel(
    "explain_pixels",
    "int int int float32 int32 int64 float64 float32 int int64 int64 float64 int int32 float32"
    " float32",
)

Gradient = LinearGradient | RadialGradient


class Paint:
    """The paint of regions. Regions of the same colour share one object.

    color     (c,) channels of the colour. That of a layer is multiplied by its opacity
    opacity   in 0..1
    gradient  gradient in px, or None
    prior     weight of `color` when colours are solved again
    """

    def __init__(
        self, color: Floats, gradient: Gradient | None = None, opacity: float = 1.0
    ) -> None:
        self.color, self.gradient = np.asarray(color, np.float64), gradient
        self.opacity, self.prior = opacity, PRIOR
        # As the kernels read them (gauss2svg/core/paints.h)
        self.form, self.place = 0, np.zeros(4)
        if isinstance(gradient, LinearGradient):
            axis = np.subtract(gradient.end, gradient.start)
            axis /= dot(axis, axis)
            self.form, self.place = 1, np.array([*axis, -dot(axis, gradient.start), 0.0])
        elif gradient is not None:
            self.form, self.place = 2, np.array([*gradient.center, *np.divide(1, gradient.radii)])

    @property
    def is_shaded(self) -> bool:
        """Whether the paint is a gradient."""
        return self.gradient is not None

    @property
    def table(self) -> Floats:
        """Colours (SHADES, c) at equal steps along the gradient. One colour is in all rows."""
        if self.gradient is None:
            return np.broadcast_to(self.color.astype(np.float32), (SHADES, len(self.color)))
        shades = self.gradient.colors_at(np.linspace(0, 1, SHADES))
        return np.concatenate([shades] * (len(self.color) // 3), axis=1).astype(np.float32)

    def at(self, xs: Ints, ys: Ints) -> Floats:
        """Return the colours (.., c) at the centres of pixels."""
        if self.gradient is None:
            return np.broadcast_to(self.color.astype(np.float32), (*np.shape(xs), len(self.color)))
        shades = np.empty((*np.shape(xs), 3), np.float32)
        for first in range(0, len(xs), 2**15):  # pixels at a time, to save memory
            few = slice(first, first + 2**15)
            shades[few] = self.gradient.at(xs[few] + 0.5, ys[few] + 0.5)
        return np.concatenate([shades] * (len(self.color) // 3), axis=-1)


def opacity_of(color: Floats) -> Floats:
    """Return the opacity (..) of colours (c, ..), 1 if they have three channels.

    Those with six are what shows over black and over white. A clear colour shows both.
    """
    over_black, over_white = color[:3], color[3:]
    if not len(over_white):
        return np.ones(color.shape[1:])
    return np.clip(1 - (over_white - over_black).mean(axis=0), 0, 1)


def paint_of(pixels: Floats, ys: Ints, xs: Ints) -> Paint:
    """Return the paint of the region at these pixels (n,).

    A region of fewer than 60 pixels has one colour, and one of fewer than 200 no radial gradient.
    """
    values = pixels[ys, xs].astype(np.float64)
    paint = Paint(np.median(values, axis=0))
    clear = np.abs(values[:, :3] - values[:, -3:]).max(axis=1) > EVEN
    # A soft shadow below an opaque region shows through at some pixels of its rim.
    opaque = np.count_nonzero(clear) <= 0.01 * len(ys)
    if np.abs(values - paint.color).max() <= EVEN or len(ys) < 60 or not opaque:
        return paint
    chosen = np.arange(len(ys))
    if len(ys) > 2500:  # enough for a gradient
        chosen = np.random.default_rng(1).choice(len(ys), 2500, replace=False)
    points, colors = np.stack([xs, ys], axis=1)[chosen] + 0.5, values[chosen][:, :3]
    even_error = np.sqrt(np.mean((colors - paint.color[:3]) ** 2))
    gradient, error = _linear(points, colors)
    if error > 1.25 * GOOD and len(ys) >= 200:
        radial, radial_error = _radial(pixels, ys[chosen], xs[chosen], colors)
        if radial_error < ROUND_GAIN * error:
            gradient, error = radial, radial_error
    return Paint(paint.color, gradient) if error < GAIN * even_error else paint


def _linear(points: Floats, colors: Floats) -> tuple[LinearGradient, float]:
    """Return the linear gradient that is closest to colours (n, 3) at points (n, 2), and its error.

    Its direction is that of the steepest common slope, turned a little to where the colours vary
    least across it.
    """
    mean = points.mean(axis=0)
    offset = points - mean
    basis = np.column_stack([offset, np.ones(len(points))])
    x, y = main_axis(least_squares(basis, colors)[:2].T)
    turns = np.linspace(-0.3, 0.3, 25)
    across, along = cos(turns), sin(turns)
    axes = np.stack([x * across - y * along, x * along + y * across], axis=1)
    axis = min(axes, key=lambda one: _spread(product(offset, one), colors))
    places, stops, error = _stops(product(offset, axis), colors)
    start, end = mean + places[0] * axis, mean + places[-1] * axis
    offsets = (places - places[0]) / (places[-1] - places[0])
    return LinearGradient(tuple(offsets), tuple(map(tuple, stops)), tuple(start), tuple(end)), error


def _radial(
    pixels: Floats, ys: Ints, xs: Ints, colors: Floats
) -> tuple[RadialGradient | None, float]:
    """Return the radial gradient that is closest to colours (n, 3) at pixels (n,), and its error.

    The slopes of the colours meet at its centre. A search then moves the centre, and stretches the
    circles to upright ellipses.
    """
    from scipy.optimize import minimize

    h, w, _ = pixels.shape
    down, across = (
        pixels[np.minimum(ys + a, h - 1), np.minimum(xs + b, w - 1), :3]
        - pixels[np.maximum(ys - a, 0), np.maximum(xs - b, 0), :3]
        for a, b in ((1, 0), (0, 1))
    )
    steep = np.abs(across) + np.abs(down)
    points = np.stack([xs, ys], axis=1) + 0.5
    inner = steep.max(axis=1) < 0.1  # an edge beside the region has a steeper slope over 2 px
    normal = np.stack([-down[inner], across[inner]], axis=-1).reshape(-1, 2)
    at = np.repeat(points[inner], 3, axis=0)
    matrix = product(normal.T, normal)
    (xx, xy), (_, yy) = matrix
    apart = hypot(xx - yy, 2 * xy)  # difference of the eigenvalues, whose ratio must be below 1e4
    if len(at) < 150 or not xx + yy + apart < 1e4 * (xx + yy - apart):
        return None, np.inf
    meeting = solve(matrix, product(normal.T, (normal * at).sum(axis=1)))
    scale = np.ptp(points, axis=0).max()

    def radius(v: Floats) -> Floats:
        return hypot(points[:, 0] - v[0] * scale, (points[:, 1] - v[1] * scale) * exp(v[2]))

    low, high = points.min(axis=0) - scale, points.max(axis=0) + scale
    results = []
    for first in (np.clip(meeting, low, high), points.mean(axis=0)):
        start = np.append(first / scale, 0.0)
        simplex = np.vstack([start, start + 0.1 * np.eye(3)])
        options = {"maxiter": 120, "initial_simplex": simplex}
        error = lambda v: _spread(radius(v), colors)  # noqa: E731
        results.append(minimize(error, start, method="Nelder-Mead", options=options))
    v = min(results, key=lambda result: result.fun).x
    if abs(v[2]) > 7:  # files have no radii of a billion px
        return None, np.inf
    v[2] = 0.0 if abs(v[2]) < 0.02 else v[2]
    places, stops, error = _stops(radius(v), colors)
    radii = places[-1], places[-1] * exp(-v[2])
    offsets = tuple(np.clip(places / places[-1], 0, 1))
    return RadialGradient(offsets, tuple(map(tuple, stops)), tuple(v[:2] * scale), radii), error


def _binned(place: Floats, colors: Floats, count: int) -> tuple[Floats, Floats, Ints, float]:
    """Return mean places, mean colours (k, 3) and sizes (k,) of bins, and the error within them."""
    low, high = place.min(), place.max()
    bins = ((place - low) / max(high - low, 1e-9) * count).astype(np.int64)
    bins = np.minimum(bins, count - 1)
    size = np.bincount(bins, minlength=count)
    columns = [np.bincount(bins, values, count) for values in (place, *colors.T)]
    mean = np.stack(columns, axis=1) / np.maximum(size, 1)[:, None]
    within = float((colors**2).sum() - (size[:, None] * mean[:, 1:] ** 2).sum())
    used = size > 0
    return mean[used, 0], mean[used, 1:], size[used], max(within, 0.0)


def _spread(place: Floats, colors: Floats) -> float:
    """Return the squared error of colours (n, 3) that depend only on their place (n,)."""
    return _binned(place, colors, 40)[3]


def _stops(place: Floats, colors: Floats) -> tuple[Floats, Floats, float]:
    """Return places of stops, their colours (k, 3), and the root mean square error of colours.

    Stops are added one by one, each where it lowers the error most.
    """
    low, high = place.min(), place.max()
    at, mean, size, within = _binned(place, colors, 200)
    weight = np.sqrt(size)[:, None]

    def fitted(knots: Floats) -> tuple[float, Floats]:
        basis = np.stack([np.interp(at, knots, row) for row in np.eye(len(knots))], axis=1)
        stops = least_squares(basis * weight, mean * weight)
        error = ((mean - product(basis, stops)) ** 2 * weight**2).sum() + within
        return float(np.sqrt(error / colors.size)), stops

    knots = np.array([low, high])
    error, stops = fitted(knots)
    while error > GOOD and len(knots) < 7:
        tried = [
            np.sort(np.append(knots, z))
            for z in np.linspace(low, high, 26)[1:-1]
            if np.abs(knots - z).min() > (high - low) / 40
        ]
        results = [(*fitted(one), one) for one in tried]
        error, stops, knots = min(results, key=lambda result: result[0])
    return knots, np.clip(stops, 0, 1), error


def paints_of(pixels: Floats, labels: Ints) -> list[Paint]:
    """Return the paint of each region. Regions of nearly the same colour share a paint.

    Parts of gradients become one region, so `labels` are changed.
    """
    boxes = find_objects(labels + 1)
    paints = [paint_of(pixels, *pixels_of(labels[box] == k, box)) for k, box in enumerate(boxes)]
    _split_off_ramps(pixels, labels, paints)
    sizes = np.bincount(labels[labels >= 0], minlength=len(paints))
    shared: list[Paint] = []
    for k in np.argsort(-sizes, kind="stable"):
        paint = paints[k]
        if paint.is_shaded:
            continue
        same = (one for one in shared if np.abs(one.color - paint.color).max() <= ALIKE)
        paints[k] = next(same, paint)
        if paints[k] is paint:
            shared.append(paint)
        paints[k].prior += PRIOR_PER_PX * sizes[k]
    _join_parts_of_gradients(pixels, labels, paints)
    return paints


def _split_off_ramps(pixels: Floats, labels: Ints, paints: list[Paint]) -> None:
    """Split regions of one colour and of gradients that begin at it without an edge.

    Where a gradient fades into the colour beside it, both are one core. If a part with another
    colour than most pixels has a gradient that draws it, it becomes a region. `labels` and `paints`
    are changed.
    """
    for k, box in enumerate(find_objects(labels + 1)):
        own = labels[box] == k
        ys, xs = pixels_of(own, box)
        if _is_drawn(pixels, ys, xs, paints[k]):
            continue
        levels = np.round(255 * pixels[ys, xs]).astype(np.int64)
        codes = levels @ 256 ** np.arange(levels.shape[1])[::-1]
        _, first, counts = np.unique(codes, return_index=True, return_counts=True)
        even = Paint(pixels[ys, xs][first[counts.argmax()]])
        differs = own & (np.abs(pixels[box] - even.color).max(axis=-1) > EVEN)
        if np.count_nonzero(differs) > (1 - LEAST_EVEN) * len(ys):
            continue
        part, part_boxes = parts_of(differs)
        count = len(paints)
        for name, inner in enumerate(part_boxes, 1):
            at = pixels_of(part[inner] == name, inner)
            at = at[0] + box[0].start, at[1] + box[1].start
            ramp = paint_of(pixels, *at)
            if ramp.is_shaded and _is_drawn(pixels, *at, ramp):
                labels[at] = len(paints)
                paints.append(ramp)
        if len(paints) > count:
            paints[k] = paint_of(pixels, *pixels_of(labels[box] == k, box))


def _is_drawn(pixels: Floats, ys: Ints, xs: Ints, paint: Paint) -> bool:
    """Return whether a paint draws nearly all of these pixels (n,)."""
    off = np.abs(pixels[ys, xs] - paint.at(xs, ys)).max(axis=1)
    return bool(np.count_nonzero(off > 4 * LEVEL) <= 0.05 * len(ys))


def _join_parts_of_gradients(pixels: Floats, labels: Ints, paints: list[Paint]) -> None:
    """Join regions to a larger one whose gradient draws them. `labels` and `paints` are changed.

    Where a gradient bends or is steep, as around the middle of a radial one, its pixels are not one
    core. Such parts are less than 3 px apart, and at most a 20th of their pixels differ.
    """
    boxes = find_objects(labels + 1)
    for k, paint in enumerate(paints):
        if not paint.is_shaded or boxes[k] is None:
            continue
        joined = False
        for j in range(k + 1, len(paints)):
            if boxes[j] is None or any(
                a.start >= b.stop + 3 or b.start >= a.stop + 3
                for a, b in zip(boxes[k], boxes[j], strict=True)
            ):
                continue
            ys, xs = pixels_of(labels[boxes[j]] == j, boxes[j])
            off = np.abs(pixels[ys, xs] - paint.at(xs, ys)).max(axis=1) > 4 * LEVEL
            if np.count_nonzero(off) <= 0.05 * len(ys):
                labels[ys, xs] = k
                boxes[j], joined = None, True
        if joined:
            paints[k] = paint_of(pixels, *np.nonzero(labels == k))


class Palette(NamedTuple):
    """The paints of regions, as the kernels read them (gauss2svg/core/paints.h).

    form, place, table  (k,), (k, 4) and (k, SHADES, c)
    """

    form: Ints
    place: Floats
    table: Floats

    @classmethod
    def of(cls, paints: Sequence[Paint]) -> Palette:
        """Return the palette of some paints."""
        return cls(*(np.array([getattr(p, name) for p in paints]) for name in cls._fields))

    def explain(
        self, pixels: Floats, labels: Ints, at: tuple[Ints, Ints], extra: Floats | None = None,
        name: int = -1,
    ) -> tuple[Ints, Floats, Floats]:  # fmt: skip
        """Return the labels (n, 3), shares (n, 3) and squared errors (n,) of mixtures at pixels.

        at     rows and columns (n,) of the pixels
        extra  (c,) one more colour, whose label is `name`
        """
        n = len(at[0])
        label = np.empty((n, 3), np.int32)
        share, error = np.empty((n, 3), np.float32), np.empty(n, np.float32)
        color = np.zeros(pixels.shape[2]) if extra is None else np.asarray(extra, np.float64)
        labels, (ys, xs) = labels.astype(np.int32, copy=False), np.array(at)
        _explain_pixels(
            *pixels.shape, pixels, labels, *self, n, ys, xs, color, name, label, share, error
        )
        return label, share, error


def solve_colors(parts: list[tuple[Paint, Floats, Ints]], error: Floats) -> None:
    """Set flat colours by least squares, given what shows of each.

    parts  paints with the share (h, w) of them that shows in the pixels of a box, and the left and
           the top of this box. A paint may have several
    error  (h, w, c) of the drawing. Sums of whole colours would lose levels in large pictures
    """
    from scipy.sparse import csr_array

    h, w, _ = error.shape
    # The pixels where each flat paint shows, and what shows of it there
    flat: dict[Paint, list[tuple[Ints, Floats]]] = {}
    for paint, share, (x, y) in parts:
        if not paint.is_shaded:
            ys, xs = np.nonzero(share > LEAST_SHOWN)
            at = ((ys + y) * w + xs + x).astype(np.int32)
            flat.setdefault(paint, []).append((at, share[ys, xs]))
    if not flat:
        return
    pieces = [piece for pieces in flat.values() for piece in pieces]
    sizes = [sum(len(at) for at, _ in pieces) for pieces in flat.values()]
    columns, values = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))
    ends = np.append(0, np.cumsum(sizes)).astype(np.int32)
    matrix = csr_array((values, columns, ends), shape=(len(flat), h * w))
    matrix.sum_duplicates()
    gram = (matrix @ matrix.T).toarray() + np.diag([paint.prior for paint in flat])
    change = solve(gram, matrix @ -error.reshape(h * w, -1))
    for paint, by in zip(flat, change, strict=True):
        paint.color = np.clip(paint.color + by, 0, 1)
