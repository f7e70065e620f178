"""Files whose every byte is planned: a scene in whole numbers of a coarse unit.

shapes -> the most useful ones, in whole units -> colours by least squares, rounded to 3 or 6
digits -> minimal markup -> fewer shapes until the file has as many bytes as allowed
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError
from gauss2svg.fit.losses import psnr_of
from gauss2svg.measure.metrics import mean_squared_error
from gauss2svg.photo.alpha import has_alpha, shrunk, stacked
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.recolor import recolored
from gauss2svg.pipeline.search.outcome import SEEN_UP_TO
from gauss2svg.pipeline.search.subject import Subject
from gauss2svg.raster import rasterize_like
from gauss2svg.render import render, render_rgba
from gauss2svg.render.cpu import splats_of
from gauss2svg.scene import Scene
from gauss2svg.svg.file import file_bytes
from gauss2svg.svg.minimal import minimal_rounded, minimal_svg, whole_unit
from gauss2svg.svg.minimal_shapes import HEX_DIGITS

# dB of the enlarged picture that twice as many shapes must gain: more shapes follow further what is
# guessed between the pixels (docs/decisions/enlarged.md).
LEAST_GAIN = 1.0
EXACT = (0.5 / 255) ** 2  # mean squared error under which no level of 8 bits is wrong


# The unit of a small file's whole numbers (docs/decisions/small.md).
UNITS_PER_ROOT = 32.0  # units along the longest side of the file, per square root of the count
# Fewest units along the shortest side. Shapes under half a unit are not drawn.
ACROSS = 8
FINER = 10  # multiple of the wanted units up to which they are rounded to sides of whole units


@dataclass(frozen=True, eq=False)
class SmallFile:
    """A file, the scene that it draws on the photo's canvas, and its error.

    error           mean squared error at the working size, of the raster once it is drawn
    size            bytes, as they are counted
    enlarged_error  mean squared error of the model against the enlarged picture, NaN without one
    """

    svg: str
    scene: Scene
    error: float
    size: int
    enlarged_error: float = math.nan


def closeness(file: SmallFile) -> tuple[float, ...]:
    """Return a key by which the closer of two files is the larger.

    With an enlarged picture, differences at the working size count as far as they can be seen.
    Files that are equal by that are compared enlarged: twice as many shapes must gain LEAST_GAIN.
    """
    if math.isnan(file.enlarged_error):
        return -file.error, -file.size
    gain = psnr_of(file.enlarged_error) - LEAST_GAIN * math.log2(max(len(file.scene), 1))
    return min(psnr_of(file.error), SEEN_UP_TO), gain, -file.size


@dataclass(frozen=True)
class Writing:
    """How a fitted scene becomes a small file.

    each    bytes of a shape, until they are measured
    grids   units to try, times UNITS_PER_ROOT
    digits  of hex colours, 3 or 6, to try
    shared  share of the squared error for which shapes get colours in common
    """

    each: int
    grids: tuple[float, ...]
    digits: tuple[int, ...] = HEX_DIGITS
    shared: float = 0.0


class SmallFiles:
    """Writes scenes as files of at most the bytes of a plan.

    subject   its working picture is what files are compared with
    count     bytes of a file's text; None: of the file itself
    covering  whether plain ellipses are compared by how much of each pixel they cover
    flat      the shortest file without Gaussians
    large     the working picture enlarged, None if it is not known
    Raises InputError where that has more bytes.
    """

    def __init__(
        self,
        plan: Plan,
        subject: Subject,
        count: Callable[[str], int] | None = None,
        covering: bool = False,
    ) -> None:
        assert plan.byte_limit is not None
        self._bytes = count or (lambda svg: len(file_bytes(svg, plan.counts_gzipped)))
        self._covering = covering
        self.large: NDArray[np.float32] | None = None
        self._planned: Subject | None = None  # by which colours are solved, if not by the subject
        self._plan, self.subject, self._limit = plan, subject, plan.byte_limit
        self._flat = [self._flat_file(digits) for digits in HEX_DIGITS]
        self.flat = min(self._flat, key=lambda file: file.size)
        if self.flat.size > self._limit:
            raise InputError(
                f"max_bytes must be at least {self.flat.size}, the bytes of a file without "
                f"Gaussians; got {self._limit}. Try {self.flat.size}"
            )

    def without_gaussians(self) -> SmallFile:
        """The best file without Gaussians that fits."""
        flat = [self.drawn(file) for file in self._flat if file.size <= self._limit]
        return min(flat, key=lambda file: (file.error, file.size))

    def bytes_of(self, scene: Scene) -> int:
        """Bytes of a scene in units of its canvas and short colours."""
        return self._bytes(minimal_svg(scene, 1, HEX_DIGITS[0], self.subject.document))

    def drawn(self, file: SmallFile) -> SmallFile:
        """Return the file with the error of its raster, and of its model enlarged.

        A renderer would take seconds for the masks of an enlarged file.
        """
        working = self.subject.working
        raster = rasterize_like(file.svg, working, self._plan.options.run.renderer)
        file = dataclasses.replace(file, error=_error(raster, working))
        if (large := self.large) is None:
            return file
        draw = render_rgba if has_alpha(large) else render
        model = draw(file.scene, large.shape[1], large.shape[0], covering=self._covering)
        return dataclasses.replace(file, enlarged_error=_error(model, large))

    def enlarge(self, large: NDArray[np.float32], divisor: int) -> None:
        """Compare files with an enlarged picture too, and solve colours on it, reduced so much."""
        self.large = large
        height, width = large.shape[:2]
        picture = shrunk(large, height // divisor, width // divisor)
        self._planned = dataclasses.replace(self.subject, working=picture)

    def of(
        self, fitted: Scene, writing: Writing, stop: Callable[[], bool]
    ) -> tuple[SmallFile | None, tuple[int, int]]:
        """The best file of a fitted scene by the model, and (count, bytes) before any was left out.

        None where no Gaussian is left. stop is polled before each grid but the first.
        """
        planned = self._planned or self.subject
        width, height = planned.size
        scale = width / fitted.width, height / fitted.height
        splats = splats_of(fitted, scale, self._covering)
        cost = planned.target(self._plan.tune).removal_cost(splats)[1][:, 0]
        order = np.argsort(-cost, kind="stable")
        best, whole = None, (len(fitted), self.flat.size)
        for grid in writing.grids:
            if best is not None and stop():
                break
            units = math.ceil(grid * UNITS_PER_ROOT * math.sqrt(max(len(fitted), 1)))
            unit = self._unit(units)
            for digits in writing.digits:
                file, size = self._pruned(fitted, order, unit, digits, writing)
                if best is None or (file is not None and file.error < best.error):
                    best, whole = file, (len(fitted), size)
        return best, whole

    def _pruned(
        self, fitted: Scene, order: NDArray[np.intp], unit: float, digits: int, writing: Writing
    ) -> tuple[SmallFile | None, int]:
        """The file of the first Gaussians of an order that fit, and the bytes of all of them."""
        kept, whole, picture = len(fitted), 0, (self._planned or self.subject).working
        while kept > 0:
            scene = minimal_rounded(fitted.select(np.sort(order[:kept])), unit, digits)
            exact, error = recolored(scene, picture, digits, writing.shared, self._covering)
            file = self._file(exact, unit, digits, error)
            whole = whole or file.size
            if file.size <= self._limit:
                return file, whole
            each = max(writing.each, (file.size - self.flat.size) / kept)
            kept -= math.ceil((file.size - self._limit) / each)
        return None, whole

    def _file(self, scene: Scene, unit: float, digits: int, error: float) -> SmallFile:
        svg = minimal_svg(scene, unit, digits, self.subject.document)
        return SmallFile(svg, scene, error, self._bytes(svg))

    def _flat_file(self, digits: int) -> SmallFile:
        """A file without Gaussians, not yet drawn."""
        photo, (width, height) = self.subject.photo, self.subject.canvas
        transparent = has_alpha(photo)
        background = np.ones(3) if transparent else photo.mean(axis=(0, 1), dtype=np.float64)
        scene = Scene(width, height, background=background, transparent=transparent)
        unit = whole_unit(width, height)
        return self._file(minimal_rounded(scene, unit, digits), unit, digits, math.nan)

    def _unit(self, units: int) -> float:
        """A unit in px of which about so many are along the longest side.

        Both sides are whole numbers of it, so that the file needs no size, unless that takes many
        more of them.
        """
        width, height = self.subject.canvas
        longest = max(width, height)
        units = max(units, math.ceil(ACROSS * longest / min(width, height)))
        unit = whole_unit(width, height, units)
        return unit if longest / unit <= FINER * units else longest / units


def _error(drawn: NDArray[np.float32], picture: NDArray[np.float32]) -> float:
    return mean_squared_error(stacked(drawn), stacked(picture))
