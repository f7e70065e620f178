"""Move all outlines, widths and colours together until the raster matches the picture.

The raster changes only along outlines. If a point of an outline moves by one px along its normal,
the pixel that contains it changes by the difference between the colour of the layer and what lies
below it, times what shows of it. Such samples, RATE for each px, are the Jacobian of the raster.
Each step of Gauss-Newton solves its damped normal equations by conjugate gradients. Paths are
damped one by one: a path whose own pixels would get worse stays where it is.

Handles at smooth joins and ends of upright lines are no free parameters (Ties).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.areas.kernels import inner, kernel, shade_index
from gauss2svg.areas.outlines import Path
from gauss2svg.areas.paint import Paint
from gauss2svg.areas.regions import Palette
from gauss2svg.render.coverage import add_outline, add_stroke, point_at

Floats = NDArray[np.float64]
RATE = 4.0  # samples for each px of an outline
ACROSS = 6  # samples along the end of a stroke
CG_STEPS = 40
COLOR_STEPS = (3, 11)  # steps of the refinement before which colours are solved again
BASE = 0.01  # damping of every parameter, in squared error for a px^2
MOST_STEP, MOST_WIDENING = 0.7, 0.3  # px in one step
# Damping of a path, as a share of the diagonal of the normal equations, and that of widths.
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING, WIDTH_DAMPING = 0.03, 1e-3, 1e5, 0.1
# A step is tried again if the paths that became worse lost more than this share of the whole gain.
MOST_RISE = 0.2
# The refinement ends after MOST_QUIET steps that lower the error by less than this share.
LEAST_GAIN, MOST_QUIET = 1e-3, 3
LEAST_WIDTH = 0.1  # px


def squared(error: NDArray[np.float32]) -> float:
    """Return the sum of squares."""
    return float(np.dot(error.ravel(), error.ravel()))


@dataclass
class Layer:
    """Paths of one paint. A line has a width, an area has the width 0.

    paint  index into the paints of a drawing
    cap    index into CAPS
    is_opaque  whether it hides what is below it. If not, its paint is what shows over the ground
    """

    paint: int
    paths: list[Path]
    width: float = 0.0
    cap: int = 0
    is_opaque: bool = True

    def replace(self, paths: list[Path]) -> Layer:
        return dataclasses.replace(self, paths=paths)


@dataclass
class Ties:
    """Parameters that follow from others.

    same    (2 n,) for each coordinate of n points, the coordinate to which it is equal
    handle, node, master  (t,) handle = node + ratio (node - master), which are indices of points
    ratio   (t,)
    """

    same: NDArray[np.int64]
    handle: NDArray[np.int64]
    node: NDArray[np.int64]
    master: NDArray[np.int64]
    ratio: Floats


@inner
def _expand(free, same, handle, node, master, ratio, full):
    for i in range(len(same)):
        full[i] = free[same[i]]
    for i in range(len(same), len(free)):
        full[i] = free[i]
    for t in range(len(handle)):
        for c in range(2):
            n, m = full[2 * node[t] + c], full[2 * master[t] + c]
            full[2 * handle[t] + c] = n + ratio[t] * (n - m)


@inner
def _reduce(full, same, handle, node, master, ratio, free):
    """Write the gradient by free parameters, and 0 for the others. `full` is changed."""
    for t in range(len(handle)):
        for c in range(2):
            g = full[2 * handle[t] + c]
            full[2 * handle[t] + c] = 0.0
            full[2 * node[t] + c] += (1.0 + ratio[t]) * g
            full[2 * master[t] + c] -= ratio[t] * g
    free[:] = 0.0
    for i in range(len(same)):
        free[same[i]] += full[i]
    for i in range(len(same), len(free)):
        free[i] = full[i]


@kernel
def compose(
    segment, curved, path_start, closed, layer_start, width, cap, form, place, table, box, offset,
    sums, canvas, cover, below,
):  # fmt: skip
    """Draw layers over `canvas` (h, w, c), and keep their coverage and what lies below them.

    segment, curved  (k, 4, 2) and (k,) of all paths
    path_start   (p + 1,) first segment of each path; closed (p,)
    layer_start  (l + 1,) first path of each layer; width, cap (l,)
    form, place, table  (l,), (l, 4), (l, SHADES, c) paints of the layers (shade_index)
    box, offset  (l, 4) left, top, width and height of a layer, and where its pixels are in `cover`
                 (m,) and `below` (m, c)
    sums         (rows, columns) buffer
    """
    channels = canvas.shape[2]
    for l in range(len(width)):
        x0, y0, w, h = box[l]
        row = 0
        part = sums[:h, : w + 2]
        part[:] = 0.0
        for p in range(layer_start[l], layer_start[l + 1]):
            a, b = path_start[p], path_start[p + 1]
            if width[l] > 0:
                add_stroke(
                    part, segment[a:b], curved[a:b], closed[p], width[l], cap[l], float(x0),
                    float(y0),
                )  # fmt: skip
            else:
                add_outline(part, segment[a:b], curved[a:b], float(x0), float(y0))
        at = offset[l]
        for y in range(h):
            winding = 0.0
            for x in range(w):
                winding += part[y, x]
                share = min(abs(winding), 1.0)
                cover[at] = share
                if share > 0.0:
                    row = shade_index(form[l], place[l], x0 + x + 0.5, y0 + y + 0.5)
                for c in range(channels):
                    value = canvas[y0 + y, x0 + x, c]
                    below[at, c] = value
                    if share > 0.0:
                        own = table[l, row, c]
                        canvas[y0 + y, x0 + x, c] = value + share * (own - value)
                at += 1


@kernel
def weigh(opacity, form, place, table, box, offset, cover, below, above, visible):
    """Turn `below` into the derivative of pixels by coverage, and write what shows of each layer.

    above    (h, w) ones. Changed to the share of each pixel that no layer hides
    visible  (m,) output
    """
    channels = below.shape[1]
    for l in range(len(box) - 1, -1, -1):
        x0, y0, w, h = box[l]
        at = offset[l]
        for y in range(y0, y0 + h):
            for x in range(x0, x0 + w):
                shows = above[y, x]
                row = shade_index(form[l], place[l], x + 0.5, y + 0.5)
                for c in range(channels):
                    own = table[l, row, c]
                    below[at, c] = (own - below[at, c]) * shows
                visible[at] = shows * cover[at]
                above[y, x] = shows * (1.0 - cover[at])
                at += 1


@kernel
def list_samples(
    segment, curved, first_of, last_of, layer_of, sign, width, box, offset, weight, columns, pixel,
    owner, jacobian, weights,
):  # fmt: skip
    """List what a move of outlines changes, one entry for each pixel that a segment runs through.

    first_of, last_of  (k,) whether a segment begins or ends an open path
    layer_of, sign  (k,) layer of a segment, and 1 or -1 for the side on which its area lies
    pixel, owner  (n,) outputs: pixel y * columns + x, and segment
    jacobian  (n, 9) output: derivatives of its coverage by the segment's four control points, and
              by the width
    weights   (n, c) output: derivative of the pixel by its coverage
    Return the number of entries.
    """
    n = 0
    channels = weight.shape[1]
    basis = np.empty(4)
    for s in range(len(segment)):
        p, l = segment[s], layer_of[s]
        length = math.hypot(p[3, 0] - p[0, 0], p[3, 1] - p[0, 1])
        if curved[s]:
            length = 0.0
            for i in range(3):
                length += math.hypot(p[i + 1, 0] - p[i, 0], p[i + 1, 1] - p[i, 1])
        count = max(int(RATE * length), 4)
        is_stroke = width[l] > 0
        for side in range(4 if is_stroke else 1):
            if (side == 2 and not first_of[s]) or (side == 3 and not last_of[s]):
                continue
            steps = ACROSS if side >= 2 else count
            last = -1
            for i in range(steps):
                t = (i + 0.5) / steps
                if side >= 2:
                    t = float(side - 2)
                u = 1.0 - t
                if curved[s]:
                    basis[0], basis[1], basis[2], basis[3] = (
                        u * u * u,
                        3 * u * u * t,
                        3 * u * t * t,
                        t * t * t,
                    )
                else:
                    basis[0], basis[1], basis[2], basis[3] = u, 0.0, 0.0, t
                x, y, tx, ty = point_at(p, curved[s], t)
                wider = 0.0
                if not is_stroke:
                    nx, ny = sign[s] * ty / count, -sign[s] * tx / count
                else:
                    speed = math.hypot(tx, ty) + 1e-12
                    if side < 2:
                        e = 1.0 if side == 0 else -1.0
                        x += e * 0.5 * width[l] * ty / speed
                        y -= e * 0.5 * width[l] * tx / speed
                        nx, ny = e * ty / count, -e * tx / count
                        wider = 0.5 * speed / count
                    else:
                        off = ((i + 0.5) / steps - 0.5) * width[l]
                        x += off * ty / speed
                        y -= off * tx / speed
                        e = (-1.0 if side == 2 else 1.0) * width[l] / steps / speed
                        nx, ny = e * tx, e * ty
                px, py = int(math.floor(x)), int(math.floor(y))
                if not (
                    box[l, 0] <= px < box[l, 0] + box[l, 2]
                    and box[l, 1] <= py < box[l, 1] + box[l, 3]
                ):
                    last = -1
                    continue
                if py * columns + px != last:
                    last = py * columns + px
                    at = offset[l] + (py - box[l, 1]) * box[l, 2] + px - box[l, 0]
                    pixel[n], owner[n] = last, s
                    jacobian[n, :] = 0.0
                    for c in range(channels):
                        weights[n, c] = weight[at, c]
                    n += 1
                for k in range(4):
                    jacobian[n - 1, 2 * k] += basis[k] * nx
                    jacobian[n - 1, 2 * k + 1] += basis[k] * ny
                jacobian[n - 1, 8] += wider
    return n


@inner
def _transposed(place, owner, jacobian, weights, points, widths, layer_of, image, full):
    """Write the gradient by all parameters of a gradient by pixels, image (pixels, c)."""
    full[:] = 0.0
    for r in range(len(place)):
        s = owner[r]
        g = 0.0
        for c in range(weights.shape[1]):
            g += image[place[r], c] * weights[r, c]
        full[widths + layer_of[s]] += g * jacobian[r, 8]
        for k in range(4):
            q = 2 * points[s, k]
            full[q] += g * jacobian[r, 2 * k]
            full[q + 1] += g * jacobian[r, 2 * k + 1]


@kernel
def solve(
    place, owner, jacobian, weights, points, widths, layer_of, residual, damping, base, steps, same,
    handle, node, master, ratio, step,
):  # fmt: skip
    """Solve (J'J + D) step = -J' residual by preconditioned conjugate gradients.

    place     (n,) row of each entry's pixel in `residual` (m, c)
    points    (k, 4) points of segments
    widths    index of the first width among the parameters, after the coordinates of all points
    damping   (u,) D as a share of the diagonal of J'J, to which `base` is added
    step      (u,) output, for all parameters; those that follow from others are set as well
    """
    size = len(step)
    full, grad, diagonal = np.zeros(size), np.zeros(size), np.zeros(size)
    image = np.zeros(residual.shape)
    channels = weights.shape[1]
    _transposed(place, owner, jacobian, weights, points, widths, layer_of, residual, full)
    _reduce(full, same, handle, node, master, ratio, grad)
    full[:] = 0.0
    for r in range(len(place)):
        square = 0.0
        for c in range(channels):
            square += weights[r, c] ** 2
        s = owner[r]
        full[widths + layer_of[s]] += square * jacobian[r, 8] ** 2
        for k in range(4):
            q = 2 * points[s, k]
            full[q] += square * jacobian[r, 2 * k] ** 2
            full[q + 1] += square * jacobian[r, 2 * k + 1] ** 2
    for t in range(len(handle)):
        for c in range(2):
            d = full[2 * handle[t] + c]
            full[2 * node[t] + c] += (1.0 + ratio[t]) ** 2 * d
            full[2 * master[t] + c] += ratio[t] ** 2 * d
            full[2 * handle[t] + c] = 0.0
    for i in range(size):
        diagonal[same[i] if i < widths else i] += full[i]
    damp = np.empty(size)
    for i in range(0, widths, 2):
        mean = 0.5 * (diagonal[i] + diagonal[i + 1])
        for c in range(2):
            damp[i + c] = damping[i + c] * 0.5 * (diagonal[i + c] + mean) + base
    for i in range(widths, size):
        damp[i] = damping[i] * diagonal[i] + base
    r, p, product = np.empty(size), np.empty(size), np.empty(size)
    rz = 0.0
    for i in range(size):
        step[i], r[i] = 0.0, -grad[i]
        p[i] = r[i] / (diagonal[i] + damp[i])
        rz += r[i] * p[i]
    first = rz
    for _ in range(steps):
        if rz < 1e-8 * first or rz < 1e-18:
            break
        _expand(p, same, handle, node, master, ratio, full)
        image[:] = 0.0
        for e in range(len(place)):
            s = owner[e]
            move = jacobian[e, 8] * full[widths + layer_of[s]]
            for k in range(4):
                q = 2 * points[s, k]
                move += jacobian[e, 2 * k] * full[q] + jacobian[e, 2 * k + 1] * full[q + 1]
            for c in range(channels):
                image[place[e], c] += move * weights[e, c]
        _transposed(place, owner, jacobian, weights, points, widths, layer_of, image, full)
        _reduce(full, same, handle, node, master, ratio, product)
        curvature = 0.0
        for i in range(size):
            product[i] += damp[i] * p[i]
            curvature += p[i] * product[i]
        new = 0.0
        for i in range(size):
            step[i] += rz / curvature * p[i]
            r[i] -= rz / curvature * product[i]
            new += r[i] * r[i] / (diagonal[i] + damp[i])
        for i in range(size):
            p[i] = r[i] / (diagonal[i] + damp[i]) + new / rz * p[i]
        rz = new


class Buffers:
    """Memory that drawings of one picture share, because new memory takes longer to fill.

    cover, visible, below  (m,), (m,) and (m, c) for the pixels of all layers' boxes
    sums                   (h, w + 2) for the coverage of one layer
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self._channels = shape[2]
        self.sums = np.empty((shape[0], shape[1] + 2))
        self.cover = np.empty(0, np.float32)

    def reserve(self, count: int) -> None:
        """Make room for this number of pixels."""
        if len(self.cover) < count:
            room = count + count // 16
            self.cover = self.visible = self.below = np.empty(0, np.float32)  # frees the old ones
            self.cover, self.visible = np.empty(room, np.float32), np.empty(room, np.float32)
            self.below = np.empty((room, self._channels), np.float32)


class Drawing:
    """Layers over a ground, as arrays, and the picture to which they are fitted.

    pixels, ground  (h, w, c) picture, and what lies below all layers
    paints          of the layers; regions of one colour share a paint
    """

    def __init__(
        self, pixels: Floats, ground: Paint, paints: list[Paint], layers: list[Layer], is_tied: bool
        = True, buffers: Buffers | None = None,
    ) -> None:  # fmt: skip
        self.pixels = pixels.astype(np.float32, copy=False)
        self.ground, self.paints = ground, paints
        self.layers = layers
        self.noise = 0.0  # mean squared distance in px by which outlines seem to be off
        self.shape = pixels.shape
        point: list[Floats] = []
        segment, first_of, last_of = [], [], []
        self.path_layer, path_start, layer_start, closed = [], [0], [0], []
        for l, layer in enumerate(layers):
            for path in layer.paths:
                start = len(point)
                point.append(path.segments[0, 0])
                node = start
                for i, (p, is_curve) in enumerate(zip(path.segments, path.curved, strict=True)):
                    is_last = i + 1 == len(path.segments)
                    handles = node, node
                    if is_curve:
                        handles = len(point), len(point) + 1
                        point += [p[1], p[2]]
                    end = start
                    if not (is_last and path.closed):
                        end = len(point)
                        point.append(p[3])
                    segment.append((node, *(handles if is_curve else (node, end)), end))
                    first_of.append(i == 0 and not path.closed)
                    last_of.append(is_last and not path.closed)
                    node = end
                self.path_layer.append(l)
                closed.append(path.closed)
                path_start.append(len(segment))
            layer_start.append(len(closed))
        self.point = np.array(point, np.float64).reshape(-1, 2)
        self.segment = np.array(segment, np.int64).reshape(-1, 4)
        self.curved = np.array(
            [c for layer in layers for path in layer.paths for c in path.curved], bool
        )
        self.first_of, self.last_of = np.array(first_of, bool), np.array(last_of, bool)
        self.path_start, self.layer_start = np.array(path_start), np.array(layer_start)
        self.closed, self.path_layer = np.array(closed, bool), np.array(self.path_layer, np.int64)
        self.path_of = np.repeat(np.arange(len(closed)), np.diff(self.path_start))
        self.layer_of = self.path_layer[self.path_of]
        self.width = np.array([layer.width for layer in layers])
        self.cap = np.array([layer.cap for layer in layers], np.int64)
        self.point_path = np.zeros(len(self.point), np.int64)
        self.point_path[self.segment] = self.path_of[:, None]
        self._paint = np.array([layer.paint for layer in layers], np.int64)
        palette = Palette([paints[k] for k in self._paint]) if layers else None
        self._palette = palette
        y, x = np.indices(self.shape[:2])
        self._buffers = buffers or Buffers(self.shape)
        self._canvas = ground.at(x, y) if ground.is_shaded else None
        self.sign = self._turns()[self.layer_of]
        self.ties = self._tied() if is_tied else self._untied()
        self.point = self._moved(self.point, 0.0)

    def with_layers(self, layers: list[Layer], is_tied: bool = True) -> Drawing:
        """Return a drawing of the same picture with other layers."""
        return Drawing(self.pixels, self.ground, self.paints, layers, is_tied, self._buffers)

    def color_in_box(self, l: int) -> Floats:
        """Return the colours (h, w, c) of a layer in its box."""
        x, y, w, h = self.box[l]
        rows, columns = np.indices((h, w))
        return self.paints[self._paint[l]].at(columns + x, rows + y)

    def _turns(self) -> Floats:
        """Return for each layer 1 or -1, the way in which its outer outlines run."""
        p = self.point[self.segment]
        area = (p[:, :-1, 0] * p[:, 1:, 1] - p[:, :-1, 1] * p[:, 1:, 0]).sum(axis=1)
        return np.where(np.bincount(self.layer_of, area, len(self.layers)) > 0, 1.0, -1.0)

    def _untied(self):
        none = np.zeros(0, np.int64)
        return Ties(np.arange(self.point.size), none, none, none, np.zeros(0))

    def _tied(self) -> Ties:
        """Return the ties of smooth joins and of upright lines."""
        return tied(self.point, self.segment, self.curved, self.path_start, self.closed)

    def boxes(self):
        """Return the boxes (l, 4) of the layers, left, top, width and height in px."""
        h, w, _ = self.shape
        p = self.point[self.segment]
        first = self.path_start[self.layer_start[:-1]]
        half = 2.0 * self.width[:, None]  # as far as a mitre may reach
        low = np.minimum.reduceat(p.min(axis=1), first) - half
        high = np.maximum.reduceat(p.max(axis=1), first) + half
        start = np.clip(np.floor(low).astype(np.int64) - 1, 0, [w - 1, h - 1])
        end = np.clip(np.ceil(high).astype(np.int64) + 1, start + 1, [w, h])
        return np.concatenate([start, end - start], axis=1)

    def draw(self) -> NDArray[np.float32]:
        """Return the raster (h, w, c), and keep the coverage of each layer and what is below it."""
        if self._canvas is None:
            canvas = np.empty(self.shape, np.float32)
            canvas[:] = self.ground.color
        else:
            canvas = self._canvas.copy()
        if not self.layers:
            return canvas
        self.box = self.boxes()
        sizes = self.box[:, 2] * self.box[:, 3]
        self.offset = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        total = int(sizes.sum())
        self._buffers.reserve(total)
        self.cover, self.below = self._buffers.cover[:total], self._buffers.below[:total]
        self._set_colors()
        compose(
            self.point[self.segment], self.curved, self.path_start, self.closed, self.layer_start,
            self.width, self.cap, self._palette.form, self._palette.place, self._palette.table, self.box,
            self.offset, self._buffers.sums, canvas, self.cover, self.below,
        )  # fmt: skip
        return canvas

    def _set_colors(self) -> None:
        for l, k in enumerate(self._paint):
            if not self.paints[k].is_shaded:
                self._palette.table[l, 0] = self.paints[k].color

    def weigh(self) -> None:
        """Compute `visible` (m,) and the derivatives `weight` (m, c), after `draw`."""
        self.above = np.ones(self.shape[:2], np.float32)
        self.visible = self._buffers.visible[: len(self.cover)]
        weigh(
            self.width, self._palette.form, self._palette.place, self._palette.table, self.box, self.offset,
            self.cover, self.below, self.above, self.visible,
        )  # fmt: skip
        self.weight = self.below

    def part(self, values, l: int):
        """Return the values (h, w, ..) of a layer in its box."""
        _, _, w, h = self.box[l]
        return values[self.offset[l] : self.offset[l] + w * h].reshape(h, w, *values.shape[1:])

    def slices(self, l: int):
        x, y, w, h = self.box[l]
        return np.s_[y : y + h, x : x + w]

    def samples(self):
        """List the samples of all outlines, after `weigh`."""
        p = self.point[self.segment]
        length = np.hypot(*np.diff(p, axis=1).transpose(2, 0, 1)).sum(axis=1)
        room = int((2 * RATE * length + 60).sum())
        pixel, owner = np.empty(room, np.int64), np.empty(room, np.int64)
        jacobian, weights = np.empty((room, 9)), np.empty((room, self.shape[2]))
        n = list_samples(
            p, self.curved, self.first_of, self.last_of, self.layer_of, self.sign, self.width,
            self.box, self.offset, self.weight, self.shape[1], pixel, owner, jacobian, weights,
        )  # fmt: skip
        return pixel[:n], owner[:n], jacobian[:n], weights[:n]

    def solve_colors(self) -> None:
        """Set flat colours by least squares, given what shows of each, after `weigh`."""
        from scipy.sparse import csr_array

        shaded = np.array([paint.is_shaded for paint in self.paints])
        h, w, channels = self.shape
        groups: dict[int, int] = {}
        flat: list[Paint] = []
        for paint in [self.ground, *(self.paints[k] for k in self._paint)]:
            if not paint.is_shaded and id(paint) not in groups:
                groups[id(paint)] = len(flat)
                flat.append(paint)
        rest = self.pixels.reshape(-1, channels)
        ground = self.above.ravel()
        rows, columns, values = [], [], []
        fixed = np.zeros_like(rest)

        def add(paint: Paint, at, shows):
            if paint.is_shaded:
                fixed[at] += shows[:, None] * paint.at(at % w, at // w)
            else:
                rows.append(np.full(len(at), groups[id(paint)]))
                columns.append(at)
                values.append(shows)

        at = np.flatnonzero(ground > 1e-4)
        add(self.ground, at, ground[at])
        for l, k in enumerate(self._paint):
            shows = self.part(self.visible, l)
            ys, xs = np.nonzero(shows > 1e-4)
            x, y = self.box[l, :2]
            add(self.paints[k], (ys + y) * w + xs + x, shows[ys, xs])
        if not flat:
            return
        matrix = csr_array(
            (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
            shape=(len(flat), h * w),
        )
        old = np.array([paint.color for paint in flat])
        prior = np.diag([paint.prior for paint in flat])
        gram = (matrix @ matrix.T).toarray() + prior
        new = np.linalg.solve(gram, matrix @ (rest - fixed) + prior @ old)
        for paint, color in zip(flat, new, strict=True):
            paint.color = np.clip(color, 0, 1)

    def refine(
        self, steps: int, colors: bool = True, on_step: Callable[[int], None] | None = None
    ) -> None:
        """Move outlines and widths for at most `steps` steps, and solve colours again.

        on_step  function that is called after each step with the number of steps
        """
        if not self.layers:
            return
        error = self.draw() - self.pixels
        damping, quiet = np.full(len(self.closed), FIRST_DAMPING), 0
        for n in range(steps):
            before = squared(error)
            self.weigh()
            if colors and n in COLOR_STEPS:
                error = self._with_new_colors(error)
                self.weigh()
            error, damping = self._stepped(error, damping)
            quiet = quiet + 1 if squared(error) > before * (1 - LEAST_GAIN) else 0
            if on_step is not None:
                on_step(n + 1)
            if quiet >= MOST_QUIET:
                break

    def _with_new_colors(self, error: NDArray[np.float32]) -> NDArray[np.float32]:
        """Solve the colours again, and return the new error, unless it is larger than `error`."""
        kept = [paint.color for paint in self.paints]
        self.solve_colors()
        new = self.draw() - self.pixels
        if squared(new) <= squared(error):
            return new
        for paint, color in zip(self.paints, kept, strict=True):
            paint.color = color
        self.draw()
        return error

    def _stepped(
        self, error: NDArray[np.float32], damping: Floats
    ) -> tuple[NDArray[np.float32], Floats]:
        """Make a step, and return the error after it, and the damping (p,) of paths for the next.

        A step that does not lower the error is undone. It is tried once more without the paths
        whose own pixels became worse.
        """
        pixel, owner, jacobian, weights = self.samples()
        places, place = np.unique(pixel, return_inverse=True)
        rows = error.reshape(-1, self.shape[2])
        move, widen = self._solved(place, owner, jacobian, weights, rows[places], damping)
        loss = squared(error)
        # Each entry has the pixels through which the outlines of a path run.
        pairs = np.unique(self.path_of[owner] * len(places) + place)
        path, own = pairs // len(places), places[pairs % len(places)]
        before = self._path_errors(error, path, own)
        # Each sample stands for 1 / RATE px of an outline.
        lengths = (np.abs(jacobian[:, c:8:2].sum(axis=1)) for c in (0, 1))
        seen = float(((weights**2).sum(axis=1) * np.hypot(*lengths)).sum())
        self.noise = loss / max(seen, 1e-9)
        point, width, moves = self.point, self.width, np.ones(len(self.closed), bool)
        for attempt in range(2):
            self.point = self._moved(point, move * moves[self.point_path][:, None])
            still = np.bincount(self.path_layer, ~moves, len(width)) > 0
            wider = np.maximum(width + np.where(still, 0, widen), LEAST_WIDTH)
            self.width = np.where(width > 0, wider, 0)
            new = self.draw() - self.pixels
            gain, rise = loss - squared(new), self._path_errors(new, path, own) - before
            worse = rise > 1e-6 * before
            if attempt == 0:
                damping = np.where(worse, damping * 6, damping / 3)
                damping = np.clip(damping, LEAST_DAMPING, MOST_DAMPING)
            if gain > 0 and (attempt == 1 or rise[worse].sum() <= MOST_RISE * gain):
                return new, damping
            moves &= ~worse
        if gain > 0:
            return new, damping
        self.point, self.width = point, width
        self.draw()
        return error, np.minimum(damping * 4, MOST_DAMPING)

    def _solved(self, place, owner, jacobian, weights, rows, damping: Floats):
        """Return the moves (n, 2) of points and the changes (l,) of widths of a step."""
        ties, widths = self.ties, self.point.size
        damp = np.repeat(damping[self.point_path], 2)
        damp = np.concatenate([damp, np.full(len(self.width), WIDTH_DAMPING)])
        step = np.empty(len(damp))
        solve(
            place, owner, jacobian, weights, self.segment, widths, self.layer_of,
            rows.astype(np.float64), damp, BASE, CG_STEPS, ties.same, ties.handle, ties.node,
            ties.master, ties.ratio, step,
        )  # fmt: skip
        move = step[:widths].reshape(-1, 2)
        move *= np.minimum(1, MOST_STEP / np.maximum(np.hypot(*move.T), 1e-9))[:, None]
        return move, np.clip(step[widths:], -MOST_WIDENING, MOST_WIDENING)

    def _path_errors(self, error: NDArray[np.float32], path, pixel) -> Floats:
        """Return the squared error (p,) of the pixels of each path."""
        rows = error.reshape(-1, self.shape[2])[pixel].astype(np.float64)
        return np.bincount(path, (rows**2).sum(axis=1), len(self.closed))

    def _moved(self, point: Floats, move: Floats) -> Floats:
        """Return points that moved, with the ties kept."""
        ties = self.ties
        free = (point + move).ravel()
        moved = free[ties.same].reshape(-1, 2)
        node, master = moved[ties.node], moved[ties.master]
        moved[ties.handle] = node + ties.ratio[:, None] * (node - master)
        return moved

    def current(self) -> list[Layer]:
        """Return the layers as they are now."""
        layers = []
        for l, layer in enumerate(self.layers):
            paths = []
            for p in range(self.layer_start[l], self.layer_start[l + 1]):
                part = slice(self.path_start[p], self.path_start[p + 1])
                paths.append(
                    Path(self.point[self.segment[part]], self.curved[part], bool(self.closed[p]))
                )
            layers.append(dataclasses.replace(layer, paths=paths, width=float(self.width[l])))
        return layers


SMOOTH_RAD = np.radians(12)  # largest turn at a join that is smooth
MIRROR = 1.5  # largest ratio of the handles of a smooth join that become equally long
UPRIGHT = 0.02  # largest ratio of the sides of a line that becomes upright


def tied(point: Floats, segment, curved, path_start, closed) -> Ties:
    """Return the ties of a drawing.

    The handles on both sides of a smooth join lie on a line through it. If they are about equally
    long, they mirror each other, which a file writes in fewer bytes. A handle beside a straight line
    lies in its direction. The ends of a nearly upright line have the same coordinate.
    """
    same = np.arange(point.size)

    def root(i: int) -> int:
        while same[i] != i:
            i = same[i]
        return i

    handle, node, master, ratio = [], [], [], []
    used = set()
    for p in range(len(closed)):
        a, b = path_start[p], path_start[p + 1]
        for s in range(a, b):
            if not curved[s]:
                first, last = segment[s, 0], segment[s, 3]
                across, down = np.abs(point[last] - point[first])
                for c, (small, large) in enumerate(((across, down), (down, across))):
                    if small < UPRIGHT * large or small < 0.03 and large > 1:
                        same[root(2 * last + c)] = root(2 * first + c)
        for s in range(a, b):
            before = s - 1 if s > a else (b - 1 if closed[p] else -1)
            if before < 0:
                continue
            at = segment[s, 0]
            one, other = (
                segment[before, 2 if curved[before] else 0],
                segment[s, 1 if curved[s] else 3],
            )
            if not (curved[before] or curved[s]):
                continue
            u, v = point[at] - point[one], point[other] - point[at]
            long_u, long_v = np.hypot(*u), np.hypot(*v)
            if min(long_u, long_v) < 0.3:
                continue
            turn = abs(np.arctan2(u[0] * v[1] - u[1] * v[0], u @ v))
            if turn > SMOOTH_RAD:
                continue
            # The handle of the longer arm leads, because its direction is more exact.
            leads = one if (not curved[before] or (curved[s] and long_u >= long_v)) else other
            follows = other if leads == one else one
            if follows in used or leads in used and curved[before] and curved[s]:
                continue
            r = long_v / long_u if leads == one else long_u / long_v
            if curved[before] and curved[s]:
                if 1 / MIRROR <= r <= MIRROR:
                    r = 1.0
                # Both handles turn to their mean direction.
                way = u / long_u + v / long_v
                way /= np.hypot(*way)
                size = long_u if leads == one else long_v
                point[leads] = point[at] + (-size if leads == one else size) * way
            used |= {follows}
            handle.append(follows)
            node.append(at)
            master.append(leads)
            ratio.append(r)
    same = np.array([root(i) for i in range(len(same))], np.int64)
    columns = (np.array(values, np.int64) for values in (handle, node, master))
    return Ties(same, *columns, np.array(ratio, np.float64))
