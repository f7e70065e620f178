"""Move all outlines, widths and colours together until the raster matches the picture.

The raster changes only along outlines. If a point of an outline moves by one px along its normal,
the pixel that contains it changes by the difference between the colour of the layer and what lies
below it, times what shows of it. Such samples, RATE for each px, are the Jacobian of the raster.
Each step of Gauss-Newton solves its damped normal equations by conjugate gradients. Paths are
damped one by one: a path whose own pixels would get worse stays where it is. The kernels are in
gauss2svg/core/composition.c.

Some coordinates are no free parameters, but follow from others, so that smooth joins stay smooth,
and level and upright lines stay so (`Ties`).
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.areas import arrays
from gauss2svg.areas.arrays import Bools, Box, Content, Floats, Ints, squared
from gauss2svg.areas.outlines import Path, angles_of, lengths_of, upright
from gauss2svg.areas.paint import Paint, Palette, solve_colors
from gauss2svg.core import Kernel

RATE = 4.0  # samples for each px of an outline
LEAST_SOFT = 0.042  # weight beside the centre of a window from which edges are soft
MOST_LEFT = 0.95  # largest share of the error that the window of a soft picture leaves

_compose_layers = Kernel(
    "compose_layers",
    "int int int float64 bool int64 bool int64 float64 int64 float64 int64 float64 float32 int64"
    " int64 float64 float32 float32 float32",
)
_weigh_layers = Kernel(
    "weigh_layers",
    "int int int float64 int64 float64 float32 int64 int64 float32 float32 float32",
)
_list_samples = Kernel(
    "list_samples",
    "int int int float64 bool int64 bool bool int64 float64 float64 int64 int64 float32 int64 int64"
    " float64 float64",
)
_project_samples = Kernel(
    "project_samples",
    "int int int int int int64 int64 float64 float64 int64 int64 float64 float64 float64 float64",
)


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


class Drawing:
    """Layers over a ground, as arrays, and the picture to which they are fitted.

    pixels, ground  (h, w, c) picture, and what lies below all layers
    picture         (h, w, c) the same with its texture, which no layer follows
    paints          of the layers; regions of one colour share a paint
    content         where the pixels are in a whole picture
    """

    def __init__(
        self, pixels: Floats, ground: Paint, paints: list[Paint], layers: list[Layer], is_tied: bool
        = True, picture: Floats | None = None, memory: dict[str, Floats] | None = None,
        content: Content | None = None,
    ) -> None:  # fmt: skip
        self.pixels = pixels.astype(np.float32, copy=False)
        self.picture = self.pixels if picture is None else picture
        self.content = content or Content.whole(pixels.shape)
        self.ground, self.paints = ground, paints
        self.layers = layers
        # Function that rasterises the drawing as its file will be. None: coverage is exact
        self.rasterize: Callable[[], NDArray[np.float32]] | None = None
        # (h, w) weights of errors, for which nodes and layers are left out. None: all are 1
        self.focus: Floats | None = None
        # Half of the window that makes the edges of the picture soft. None: they are crisp
        self.window: Floats | None = None
        self.is_clean = False  # whether neither JPEG nor a filter that overshoots made the picture
        self.noise = 0.0  # mean squared distance in px by which outlines seem to be off
        self.scatter = 0.0  # median squared error of the pixels along outlines
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
        is_first = np.diff(self.path_of, prepend=-1) > 0
        is_last = np.diff(self.path_of, append=-1) != 0
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
        self._memory = {} if memory is None else memory
        if ground.is_shaded and "ground" not in self._memory:
            # One row at a time needs little memory.
            colors, across = self._memory_of("ground", *self.shape), np.arange(self.shape[1])
            for y, row in enumerate(colors):
                row[:] = ground.at(across, np.full(len(across), y))
        # The outer outlines of a layer run one way, so the sign of its whole area is theirs.
        p = self.point[self.segment]
        area = (p[:, :-1, 0] * p[:, 1:, 1] - p[:, :-1, 1] * p[:, 1:, 0]).sum(axis=1)
        self.sign = np.where(np.bincount(self.layer_of, area, len(layers)) > 0, 1.0, -1.0)
        self.ties = Ties(np.arange(self.point.size), np.empty((3, 0), np.int64), np.empty((2, 0)))
        if is_tied:
            self.point, self.ties = tied(
                self.point, self.segment, self.curved, self.path_start, self.closed
            )
        # Parameters of the nine derivatives of each segment
        coordinates = 2 * self.segment[:, :, None] + np.arange(2)
        column = self.ties.same[coordinates].reshape(-1, 8)
        self._column = np.column_stack([column, self.point.size + self.layer_of])

    def _memory_of(self, name: str, *shape: int) -> Floats:
        """Return an array of this shape in memory that drawings of one picture share.

        New memory takes longer to fill.
        """
        size = math.prod(shape)
        if name not in self._memory or self._memory[name].size < size:
            self._memory.pop(name, None)
            self._memory[name] = np.empty(size + size // 16, np.float32)
        return self._memory[name][:size].reshape(shape)

    def with_layers(self, layers: list[Layer], is_tied: bool = True) -> Drawing:
        """Return a drawing of the same picture with other layers."""
        same = self.picture, self._memory, self.content
        new = Drawing(self.pixels, self.ground, self.paints, layers, is_tied, *same)
        new.focus, new.is_clean, new.window = self.focus, self.is_clean, self.window
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
        h, w, channels = self.shape
        canvas = np.empty(self.shape, np.float32)
        is_shaded = self.ground.is_shaded
        canvas[:] = self._memory_of("ground", *self.shape) if is_shaded else self.ground.color
        if not self.layers:
            return canvas
        self.box = self.boxes()
        end = np.cumsum(self.box[:, 2] * self.box[:, 3])
        self.offset = np.append(0, end[:-1])
        self.cover = self._memory_of("cover", end[-1])
        self.below = self._memory_of("below", end[-1], channels)
        form, place, table = self._palette
        for layer, paint in enumerate(self._paint):
            if not paint.is_shaded:
                table[layer, 0] = paint.color
        _compose_layers(
            len(self.layers), w, channels, self.point[self.segment], self.curved, self.path_start,
            self.closed, self.layer_start, self.width, self.cap, self._opacity, form, place, table,
            self.box, self.offset, np.empty((h, w + 2)), canvas, self.cover, self.below,
        )  # fmt: skip
        if self.window is not None:
            return np.clip(arrays.filtered(canvas, self.window), 0, 1)
        if self.rasterize is None:
            return canvas
        del canvas  # a raster takes much memory
        return self.rasterize()

    def soften(self) -> None:
        """Set the window to that which brings the drawing closest, if the picture is soft."""
        if self.layers:
            drawn = self.draw()
            window = arrays.window_between(drawn, self.pixels)
            soft = np.clip(arrays.filtered(drawn, window), 0, 1)
            left = squared(soft - self.pixels)
            if window[1] >= LEAST_SOFT and left <= MOST_LEFT * squared(drawn - self.pixels):
                self.window = window

    def weigh(self) -> None:
        """Write what shows of layers, `visible` (m,), and the derivatives `weight` (m, c).

        `draw` comes first. Its `cover` and `below` are replaced by them.
        """
        self.above = np.ones(self.shape[:2], np.float32)
        self.visible, self.weight = self.cover, self.below
        _weigh_layers(
            len(self.layers), *self.shape[1:], self._opacity, *self._palette, self.box, self.offset,
            self.cover, self.below, self.above,
        )  # fmt: skip

    def part(self, values: Floats, layer: int) -> Floats:
        """Return the values (h, w, ..) of a layer in its box."""
        _, _, w, h = self.box[layer]
        start = self.offset[layer]
        return values[start : start + w * h].reshape(h, w, *values.shape[1:])

    def focused(self, errors: Floats, box: Box = np.s_[:, :]) -> Floats:
        """Return squared errors (h, w), of the picture or of a box, with their weights."""
        return errors if self.focus is None else errors * self.focus[box]

    def slices(self, layer: int) -> Box:
        """Return the rows and the columns of a layer's box."""
        x, y, w, h = self.box[layer]
        return slice(y, y + h), slice(x, x + w)

    def samples(self) -> tuple[Ints, Ints, Floats, Floats]:
        """Return pixels (n,), segments (n,), Jacobian (n, 9) and weights (n, c) of all outlines.

        `weigh` comes first.
        """
        p = self.point[self.segment]
        count = np.maximum((RATE * lengths_of(p)).astype(np.int64), 4)
        most = int((2 * count + 12).sum())  # 12: ACROSS of composition.c at both ends of a stroke
        pixel, owner = np.empty(most, np.int64), np.empty(most, np.int64)
        jacobian, weights = np.empty((most, 9)), np.empty((most, self.shape[2]))
        n = _list_samples(
            len(p), *self.shape[1:], p, self.curved, count, self.is_first, self.is_last,
            self.layer_of, self.sign, self.width, self.box, self.offset, self.weight, pixel, owner,
            jacobian, weights,
        )  # fmt: skip
        return pixel[:n], owner[:n], jacobian[:n], weights[:n]

    def solve_colors(self, error: NDArray[np.float32]) -> None:
        """Set flat colours by least squares. `weigh` comes first.

        error  (h, w, c) of the drawing
        """
        parts = [(self.ground, self.above, np.zeros(2, int))]
        for k, paint in enumerate(self._paint):
            parts.append((paint, self.part(self.visible, k), self.box[k, :2]))
        solve_colors(parts, error)

    def refine(
        self, steps: int, colors: bool = True, on_step: Callable[[int], None] | None = None
    ) -> None:
        """Move outlines and widths for at most `steps` steps, and solve colours again.

        on_step  function that is called after each step with the number of steps
        """
        if not self.layers:
            return
        error = self.draw() - self.pixels
        loss, damping, quiet = squared(error), np.full(len(self.closed), 0.03), 0
        for n in range(steps):
            before = loss
            self.weigh()
            if colors and n in (3, 11):
                self.solve_colors(error)
                error = self.draw() - self.pixels
                loss = squared(error)
                self.weigh()
            error, loss, damping = self._stepped(error, loss, damping)
            # Three steps that lower the error by less than a thousandth are the last ones.
            quiet = quiet + 1 if loss > 0.999 * before else 0
            if on_step is not None:
                on_step(n + 1)
            if quiet >= 3:
                break

    def _stepped(
        self, error: NDArray[np.float32], loss: float, damping: Floats
    ) -> tuple[NDArray[np.float32], float, Floats]:
        """Make a step. Return the error after it, its square, and the damping (p,) for the next.

        A step that does not lower the error is undone. It is tried once more without the paths
        whose own pixels became worse, and so is one of whose gain they took over a fifth.
        """
        pixel, owner, jacobian, weights = self.samples()
        is_along = np.zeros(math.prod(self.shape[:2]), bool)
        is_along[pixel] = True
        places, order = np.flatnonzero(is_along), np.empty(is_along.size, np.int64)
        order[places] = np.arange(len(places))
        place = order[pixel]
        rows = error.reshape(-1, self.shape[2])
        samples = place, owner, jacobian, weights
        along = rows[places].astype(np.float64)
        if len(along):
            self.scatter = float(np.median((along**2).sum(axis=1)))
        if self.window is not None:  # the gradient of a filtered raster
            smooth = arrays.filtered(error, self.window)
            along = smooth.reshape(rows.shape)[places].astype(np.float64)
        move, widen = self._solved(samples, along, damping)
        # Each entry has the pixels through which the outlines of a path run.
        pairs = np.unique(self.path_of[owner] * len(places) + place)
        path, own = pairs // len(places), places[pairs % len(places)]

        def path_errors(error: NDArray[np.float32]) -> Floats:
            rows = error.reshape(-1, self.shape[2])[own].astype(np.float64)
            return np.bincount(path, (rows**2).sum(axis=1), len(self.closed))

        before = path_errors(error)
        # Each sample stands for 1 / RATE px of an outline.
        lengths = (np.abs(jacobian[:, c:8:2].sum(axis=1)) for c in (0, 1))
        seen = float(((weights**2).sum(axis=1) * portable.hypot(*lengths)).sum())
        self.noise = loss / max(seen, 1e-9)
        point, width, moves = self.point, self.width, np.ones(len(self.closed), bool)
        for attempt in range(2):
            self.point = self.ties.kept(point + move * moves[self.point_path][:, None])
            still = np.bincount(self.path_layer, ~moves, len(width)) > 0
            wider = np.maximum(width + np.where(still, 0, widen), 0.1)
            self.width = np.where(width > 0, wider, 0)
            new = self.draw() - self.pixels
            left, rise = squared(new), path_errors(new) - before
            gain = loss - left
            worse = rise > 1e-6 * before
            if attempt == 0:
                damping = np.where(worse, damping * 6, damping / 3)
                damping = np.clip(damping, 1e-3, 1e5)
            if gain > 0 and (attempt == 1 or rise[worse].sum() <= 0.2 * gain):
                return new, left, damping
            moves &= ~worse
        self.point, self.width = point, width
        self.draw()
        return error, loss, np.minimum(damping * 4, 1e5)

    def _solved(
        self, samples: tuple[Ints, Ints, Floats, Floats], rows: Floats, damping: Floats
    ) -> tuple[Floats, Floats]:
        """Return the moves (n, 2) of points and the changes (l,) of widths of a step.

        samples  rows (n,) of their pixels in `rows`, and the other arrays as in `samples`
        rows     (m, c) error of the pixels
        damping  (p,) of the paths
        """
        place, owner, jacobian, weights = samples
        widths, (_, ties, factors) = self.point.size, self.ties
        linear = place, owner, jacobian, weights, self._column, ties, factors
        squares = place, owner, jacobian**2, weights**2, self._column, ties, factors**2
        count = widths + len(self.width)

        def gradient(arrays: tuple, image: Floats, p: Floats | None = None) -> Floats:
            """Return the gradient (u,) by the parameters of a gradient by pixels, image (m, c).

            p: (u,) a move, whose pixels are written to `image` first. Its tied parameters are
            replaced. None: `image` stays as it is.
            """
            result = np.empty(count)
            sizes = len(place), self.shape[2], len(image), count, ties.shape[1]
            _project_samples(*sizes, *arrays, p, image, result)
            return result

        r, diagonal = gradient(linear, -rows), gradient(squares, np.ones_like(rows))
        # Both coordinates of a point are damped, even if its outline runs along one of them.
        by_point = diagonal[:widths].reshape(-1, 2)
        by_point = 0.5 * (by_point + by_point.mean(axis=1, keepdims=True))
        damp = np.append(damping[self.point_path][:, None] * by_point, 0.1 * diagonal[widths:])
        damp += 0.01
        # Solve (J'J + D) step = r by conjugate gradients, preconditioned by the diagonal.
        diagonal, image = diagonal + damp, np.empty_like(rows)
        step, p = np.zeros_like(r), r / diagonal
        rz = first = portable.dot(r, p)
        for _ in range(40):
            # So no division is by 0: D is positive, and p is not 0 if rz is not.
            if rz < 1e-8 * first or rz < 1e-18:
                break
            product = gradient(linear, image, p.copy()) + damp * p
            length = rz / portable.dot(p, product)
            step += length * p
            r = r - length * product
            new = portable.dot(r, r / diagonal)
            p = r / diagonal + new / rz * p
            rz = new
        move = step[:widths].reshape(-1, 2)
        # A step is at most .7 px long, and widens a line by at most .3 px.
        move *= np.minimum(1, 0.7 / np.maximum(portable.hypot(*move.T), 1e-9))[:, None]
        return move, np.clip(step[widths:], -0.3, 0.3)

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


class Ties(NamedTuple):
    """Coordinates, x and y of points in turns, that follow from others.

    same      (2 n,) for each coordinate, the one to which it is equal
    ties      (3, t) coordinates: follower, node and master
    factors   (2, t): follower = factors[0] node + factors[1] master
    """

    same: Ints
    ties: Ints
    factors: Floats

    def kept(self, point: Floats) -> Floats:
        """Return points (n, 2) whose coordinates follow from the free ones of `point`."""
        value = point.ravel()[self.same]
        follower, node, master = self.ties
        value[follower] = self.factors[0] * value[node] + self.factors[1] * value[master]
        return value.reshape(-1, 2)


MOST_TURNED = 2.0  # px by which a handle may move to lie in a direction, or to mirror another


def tied(
    point: Floats, segment: Ints, curved: Bools, path_start: Ints, closed: Bools
) -> tuple[Floats, Ties]:
    """Return the points (n, 2) of a drawing with ties, and the ties.

    The handles on both sides of a smooth join lie on a line through it. If they are about equally
    long, they mirror each other, which a file writes in fewer bytes. A handle beside a straight
    line lies in its direction. Handles of less than .3 px have no sure direction. The ends of a
    nearly upright line have the same coordinate.
    """
    same = upright(point, segment[~curved])
    before = np.arange(len(segment)) - 1
    before[path_start[:-1]] = np.where(closed, path_start[1:] - 1, -1)
    was_curved = curved[before]
    node = segment[:, 0]
    one = np.where(was_curved, segment[before, 2], segment[before, 0])
    other = np.where(curved, segment[:, 1], segment[:, 3])
    u, v = point[node] - point[one], point[other] - point[node]
    long_u, long_v = portable.hypot(*u.T), portable.hypot(*v.T)
    angle = angles_of(u, v)
    is_smooth = (angle <= np.radians(12)) & (np.minimum(long_u, long_v) >= 0.3)
    # A long handle would move far to lie in the direction of a short line.
    handle = np.where(was_curved, long_u, long_v)
    is_smooth &= (was_curved & curved) | (handle * angle <= MOST_TURNED)
    at = np.flatnonzero(is_smooth & (before >= 0) & (was_curved | curved))
    node, one, other, u, v, long_u, long_v = (
        values[at] for values in (node, one, other, u, v, long_u, long_v)
    )
    # The handle of the longer arm leads, because its direction is more exact.
    both, leads = (was_curved & curved)[at], curved[at]
    leads &= ~both | (long_u >= long_v)
    master, follower = np.where(leads, [one, other], [other, one])
    ratio = np.where(leads, long_v / long_u, long_u / long_v)
    alike = (ratio >= 1 / 1.5) & (ratio <= 1.5) & (np.abs(long_u - long_v) <= MOST_TURNED)
    ratio[both & alike] = 1.0
    # Two handles turn to a common direction, the longer one less, because its curve would bulge.
    way = u / np.sqrt(long_u)[:, None] + v / np.sqrt(long_v)[:, None]
    way *= (np.where(leads, -long_u, long_v) / portable.hypot(*way.T))[:, None]
    point = point.copy()
    point[master[both]] = (point[node] + way)[both]
    of_node = np.repeat(1.0 + ratio, 2)
    follower, node, master = (
        (2 * index[:, None] + [0, 1]).ravel() for index in (follower, node, master)
    )
    factors = np.array([of_node, 1.0 - of_node])
    ties = Ties(same, np.array([follower, same[node], same[master]]), factors)
    return ties.kept(point), ties
