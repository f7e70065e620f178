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
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.areas.composition import compose, weigh
from gauss2svg.areas.newton import RATE, list_samples, solve
from gauss2svg.areas.outlines import Path
from gauss2svg.areas.paint import Paint
from gauss2svg.areas.regions import Palette
from gauss2svg.areas.ties import Ties, tied

Floats = NDArray[np.float64]
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
