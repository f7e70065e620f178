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
import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.areas.composition import (
    ACROSS,
    Samples,
    compose_layers,
    list_samples,
    weigh_layers,
)
from gauss2svg.areas.kernels import Floats, Ints
from gauss2svg.areas.outlines import Path, lengths_of
from gauss2svg.areas.paint import Paint
from gauss2svg.areas.regions import Palette
from gauss2svg.areas.ties import Ties, tied

RATE = 4.0  # samples for each px of an outline
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
LEAST_SHOWN = 1e-4  # share of a pixel below which a layer does not count for colours


def squared(error: NDArray[np.float32]) -> float:
    """Return the sum of squares."""
    return float(np.square(error).sum())


@dataclass
class Layer:
    """Paths of one paint. A line has a width, an area has the width 0.

    paint  index into the paints of a drawing
    cap    index into CAPS
    """

    paint: int
    paths: list[Path]
    width: float = 0.0
    cap: int = 0

    @property
    def is_line(self) -> bool:
        """Whether the paths are drawn as strokes."""
        return self.width > 0

    def replace(self, paths: list[Path]) -> Layer:
        """Return the layer with other paths."""
        return dataclasses.replace(self, paths=paths)


class Buffers:
    """Memory that drawings of one picture share, because new memory takes longer to fill.

    cover, below  (m,) and (m, c) for the pixels of all layers' boxes
    sums          (h, w + 2) for the coverage of one layer
    ground        (h, w, c) colours of a ground that is a gradient, else None
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self._channels = shape[2]
        self.sums = np.empty((shape[0], shape[1] + 2))
        self.cover = np.empty(0, np.float32)
        self.ground: NDArray[np.float32] | None = None

    def reserve(self, count: int) -> None:
        """Make room for this number of pixels."""
        if len(self.cover) < count:
            room = count + count // 16
            self.cover = self.below = np.empty(0, np.float32)  # frees the old ones
            self.cover = np.empty(room, np.float32)
            self.below = np.empty((room, self._channels), np.float32)


def _shaded(paint: Paint, shape: tuple[int, int, int]) -> NDArray[np.float32]:
    """Return the colours (h, w, c) of a gradient. One row at a time needs little memory."""
    colors, across = np.empty(shape, np.float32), np.arange(shape[1])
    for y in range(shape[0]):
        colors[y] = paint.at(across, np.full(shape[1], y))
    return colors


class Drawing:
    """Layers over a ground, as arrays, and the picture to which they are fitted.

    pixels, ground  (h, w, c) picture, and what lies below all layers
    picture         (h, w, c) the same with its texture, which no layer follows
    paints          of the layers; regions of one colour share a paint
    """

    def __init__(
        self, pixels: Floats, ground: Paint, paints: list[Paint], layers: list[Layer], is_tied: bool
        = True, buffers: Buffers | None = None, picture: Floats | None = None,
    ) -> None:  # fmt: skip
        self.pixels = pixels.astype(np.float32, copy=False)
        self.picture = self.pixels if picture is None else picture
        self.ground, self.paints = ground, paints
        self.layers = layers
        # Function that rasterises the drawing as its file will be. None: coverage is exact
        self.rasterize: Callable[[], NDArray[np.float32]] | None = None
        # (h, w) weights of errors, for which nodes and layers are left out. None: all are 1
        self.focus: Floats | None = None
        self.noise = 0.0  # mean squared distance in px by which outlines seem to be off
        self.shape = pixels.shape
        paths = [path for layer in layers for path in layer.paths]
        segments = np.concatenate([np.empty((0, 4, 2)), *(path.segments for path in paths)])
        self.curved = np.concatenate([np.empty(0, bool), *(path.curved for path in paths)])
        self.closed = np.array([path.closed for path in paths], bool)
        self.path_start = np.cumsum([0, *(len(path.curved) for path in paths)])
        self.layer_start = np.cumsum([0, *(len(layer.paths) for layer in layers)])
        self.path_layer = np.repeat(np.arange(len(layers)), np.diff(self.layer_start))
        self.path_of = np.repeat(np.arange(len(paths)), np.diff(self.path_start))
        self.layer_of = self.path_layer[self.path_of]
        # A path has a point for its start, and for each segment its handles and its end. The end
        # of a closed path is its start.
        is_first, is_last = (
            np.diff(self.path_of, prepend=-1) > 0,
            np.diff(self.path_of, append=-1) != 0,
        )
        is_loop = self.closed[self.path_of]
        has = np.stack([is_first, self.curved, self.curved, ~(is_last & is_loop)], axis=1)
        self.point = segments[has]
        index = np.cumsum(has).reshape(-1, 4) - 1
        end = np.where(has[:, 3], index[:, 3], index[self.path_start[self.path_of], 0])
        node = np.where(is_first, index[:, 0], np.roll(end, 1))
        handles = np.where(self.curved, index[:, 1:3].T, [node, end])
        self.segment = np.stack([node, *handles, end], axis=1)
        self.is_first, self.is_last = is_first & ~is_loop, is_last & ~is_loop
        self.width = np.array([layer.width for layer in layers])
        self.cap = np.array([layer.cap for layer in layers], np.int64)
        self.point_path = np.zeros(len(self.point), np.int64)
        self.point_path[self.segment] = self.path_of[:, None]
        self._paint = [paints[layer.paint] for layer in layers]
        self._palette = Palette.of(self._paint)
        self._opacity = np.array([paint.opacity for paint in self._paint])
        self._buffers = buffers or Buffers(self.shape)
        if ground.is_shaded and self._buffers.ground is None:
            self._buffers.ground = _shaded(ground, self.shape)
        # The outer outlines of a layer run one way, so the sign of its whole area is theirs.
        p = self.point[self.segment]
        area = (p[:, :-1, 0] * p[:, 1:, 1] - p[:, :-1, 1] * p[:, 1:, 0]).sum(axis=1)
        self.sign = np.where(np.bincount(self.layer_of, area, len(layers)) > 0, 1.0, -1.0)
        self.ties = Ties.none(self.point.size)
        if is_tied:
            self.point, self.ties = tied(
                self.point, self.segment, self.curved, self.path_start, self.closed
            )
        # Parameters of the nine derivatives of each segment
        coordinates = 2 * self.segment[:, :, None] + np.arange(2)
        column = self.ties.same[coordinates].reshape(-1, 8)
        self._column = np.column_stack([column, self.point.size + self.layer_of])

    def with_layers(self, layers: list[Layer], is_tied: bool = True) -> Drawing:
        """Return a drawing of the same picture with other layers."""
        new = Drawing(
            self.pixels, self.ground, self.paints, layers, is_tied, self._buffers, self.picture
        )  # fmt: skip
        new.focus = self.focus
        return new

    def boxes(self) -> Ints:
        """Return the boxes (l, 4) of the layers, left, top, width and height in px."""
        h, w, _ = self.shape
        p = self.point[self.segment]
        first = self.path_start[self.layer_start[:-1]]
        half = 2.0 * self.width[:, None]  # a mitre reaches so far
        low = np.minimum.reduceat(p.min(axis=1), first) - half
        high = np.maximum.reduceat(p.max(axis=1), first) + half
        start = np.clip(np.floor(low).astype(np.int64) - 1, 0, [w - 1, h - 1])
        end = np.clip(np.ceil(high).astype(np.int64) + 1, start + 1, [w, h])
        return np.concatenate([start, end - start], axis=1)

    def draw(self) -> NDArray[np.float32]:
        """Return the raster (h, w, c), and keep the coverage of each layer and what is below it."""
        canvas = np.empty(self.shape, np.float32)
        canvas[:] = self.ground.color if self._buffers.ground is None else self._buffers.ground
        if not self.layers:
            return canvas
        self.box = self.boxes()
        end = np.cumsum(self.box[:, 2] * self.box[:, 3])
        self.offset = np.append(0, end[:-1])
        self._buffers.reserve(end[-1])
        self.cover, self.below = self._buffers.cover[: end[-1]], self._buffers.below[: end[-1]]
        form, place, table = self._palette
        for layer, paint in enumerate(self._paint):
            if not paint.is_shaded:
                table[layer, 0] = paint.color
        compose_layers(
            len(self.layers), *self.shape[1:], self.point[self.segment], self.curved,
            self.path_start, self.closed, self.layer_start, self.width, self.cap, self._opacity,
            form, place, table, self.box, self.offset, self._buffers.sums, canvas, self.cover,
            self.below,
        )  # fmt: skip
        if self.rasterize is None:
            return canvas
        del canvas  # a raster takes much memory
        return self.rasterize()

    def weigh(self) -> None:
        """Write what shows of layers, `visible` (m,), and the derivatives `weight` (m, c).

        `draw` comes first. Its `cover` and `below` are replaced by them.
        """
        self.above = np.ones(self.shape[:2], np.float32)
        self.visible, self.weight = self.cover, self.below
        weigh_layers(
            len(self.layers), *self.shape[1:], self._opacity, *self._palette, self.box, self.offset,
            self.cover, self.below, self.above,
        )  # fmt: skip

    def part(self, values: Floats, layer: int) -> Floats:
        """Return the values (h, w, ..) of a layer in its box."""
        _, _, w, h = self.box[layer]
        start = self.offset[layer]
        return values[start : start + w * h].reshape(h, w, *values.shape[1:])

    def focused(self, errors: Floats, layer: int | None = None) -> Floats:
        """Return squared errors (h, w), of the picture or of a layer's box, with their weights."""
        if self.focus is None:
            return errors
        return errors * (self.focus if layer is None else self.focus[self.slices(layer)])

    def slices(self, layer: int) -> tuple[slice, slice]:
        """Return the rows and the columns of a layer's box."""
        x, y, w, h = self.box[layer]
        return slice(y, y + h), slice(x, x + w)

    def samples(self) -> tuple[Ints, Ints, Floats, Floats]:
        """Return pixels (n,), segments (n,), Jacobian (n, 9) and weights (n, c) of all outlines.

        `weigh` comes first.
        """
        p = self.point[self.segment]
        count = np.maximum((RATE * lengths_of(p)).astype(np.int64), 4)
        most = int((2 * count + 2 * ACROSS).sum())
        pixel, owner = np.empty(most, np.int64), np.empty(most, np.int64)
        jacobian, weights = np.empty((most, 9)), np.empty((most, self.shape[2]))
        n = list_samples(
            len(p), *self.shape[1:], p, self.curved, count, self.is_first, self.is_last,
            self.layer_of, self.sign, self.width, self.box, self.offset, self.weight, pixel, owner,
            jacobian, weights,
        )  # fmt: skip
        return pixel[:n], owner[:n], jacobian[:n], weights[:n]

    def solve_colors(self) -> None:
        """Set flat colours by least squares, given what shows of each. `weigh` comes first."""
        from scipy.sparse import csr_array

        h, w, _ = self.shape
        parts = [
            (paint, self.part(self.visible, k), self.box[k, :2])
            for k, paint in enumerate(self._paint)
        ]
        rest = self.pixels.reshape(h * w, -1).copy()
        if self._buffers.ground is None:
            parts.insert(0, (self.ground, self.above, np.zeros(2, np.int64)))
        else:
            seen = np.where(self.above > LEAST_SHOWN, self.above, 0).reshape(-1, 1)
            rest -= seen * self._buffers.ground.reshape(h * w, -1)
        # The pixels where each flat paint shows, and what shows of it there
        flat: dict[Paint, list[tuple[Ints, Floats]]] = {}
        for paint, share, (x, y) in parts:
            ys, xs = np.nonzero(share > LEAST_SHOWN)
            at, seen = ((ys + y) * w + xs + x).astype(np.int32), share[ys, xs]
            if paint.is_shaded:
                rest[at] -= seen[:, None] * paint.at(xs + x, ys + y)
            else:
                flat.setdefault(paint, []).append((at, seen))
        if not flat:
            return
        pieces = [piece for pieces in flat.values() for piece in pieces]
        sizes = [sum(len(at) for at, _ in pieces) for pieces in flat.values()]
        columns, values = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))
        ends = np.append(0, np.cumsum(sizes)).astype(np.int32)
        matrix = csr_array((values, columns, ends), shape=(len(flat), h * w))
        matrix.sum_duplicates()
        prior = np.array([paint.prior for paint in flat])
        gram = (matrix @ matrix.T).toarray() + np.diag(prior)
        old = np.array([paint.color for paint in flat])
        new = portable.solve(gram, matrix @ rest + prior[:, None] * old)
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
        seen = float(((weights**2).sum(axis=1) * portable.hypot(*lengths)).sum())
        self.noise = loss / max(seen, 1e-9)
        point, width, moves = self.point, self.width, np.ones(len(self.closed), bool)
        for attempt in range(2):
            self.point = self.ties.kept(point + move * moves[self.point_path][:, None])
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
        self.point, self.width = point, width
        self.draw()
        return error, np.minimum(damping * 4, MOST_DAMPING)

    def _solved(
        self, place: Ints, owner: Ints, jacobian: Floats, weights: Floats, rows: Floats,
        damping: Floats,
    ) -> tuple[Floats, Floats]:  # fmt: skip
        """Return the moves (n, 2) of points and the changes (l,) of widths of a step.

        rows     (m, c) error of the pixels to which `place` leads
        damping  (p,) of the paths
        """
        widths = self.point.size
        count = widths + len(self.width)
        samples = Samples(
            place, owner, jacobian, weights, self._column, np.array(self.ties[1:4]),
            np.array(self.ties[4:6]),
        )  # fmt: skip
        rows = rows.astype(np.float64)
        r = samples.gradient(-rows, count)
        diagonal = samples.squared().gradient(np.ones_like(rows), count)
        # Both coordinates of a point are damped, even if its outline runs along one of them.
        by_point = diagonal[:widths].reshape(-1, 2)
        by_point = 0.5 * (by_point + by_point.mean(axis=1, keepdims=True))
        damp = np.append(
            damping[self.point_path][:, None] * by_point, WIDTH_DAMPING * diagonal[widths:]
        )
        damp += BASE
        step = samples.solve(np.empty_like(rows), r, diagonal + damp, damp, CG_STEPS)
        move = step[:widths].reshape(-1, 2)
        move *= np.minimum(1, MOST_STEP / np.maximum(portable.hypot(*move.T), 1e-9))[:, None]
        return move, np.clip(step[widths:], -MOST_WIDENING, MOST_WIDENING)

    def _path_errors(self, error: NDArray[np.float32], path: Ints, pixel: Ints) -> Floats:
        """Return the squared error (p,) of the pixels of each path."""
        rows = error.reshape(-1, self.shape[2])[pixel].astype(np.float64)
        return np.bincount(path, (rows**2).sum(axis=1), len(self.closed))

    def current(self) -> list[Layer]:
        """Return the layers as they are now."""
        parts = [slice(*ends) for ends in itertools.pairwise(self.path_start)]
        paths = [
            Path(self.point[self.segment[part]], self.curved[part], bool(closed))
            for part, closed in zip(parts, self.closed, strict=True)
        ]
        return [
            dataclasses.replace(layer, paths=paths[start:end], width=float(width))
            for layer, width, (start, end) in zip(
                self.layers, self.width, itertools.pairwise(self.layer_start), strict=True
            )
        ]
