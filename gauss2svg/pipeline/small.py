"""Files of some hundred bytes to some thousand: every byte is planned with the fit.

    photo -> working picture of 96 to 256 px -> a few fits of as many opaque shapes as the bytes
    allow, with few exponents -> whole numbers of a coarse unit -> colours by least squares,
    rounded to 3 or 6 digits -> minimal markup -> the best raster that fits

All constants: docs/decisions/small.md.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, must_be, shown
from gauss2svg.fit.choices import PSNR, Tune
from gauss2svg.fit.fit import fixed_count
from gauss2svg.fit.options import DensifyOptions, FitConfig, FitOptions, FitProgress, FitResult
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.target import target_of
from gauss2svg.measure.metrics import mean_squared_error
from gauss2svg.photo.alpha import has_alpha, shrunk, stacked
from gauss2svg.pipeline.recolor import recolored
from gauss2svg.raster import DEFAULT_RENDERER, rasterize_like
from gauss2svg.render.cpu import kernel_lock, splats_of
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import BETA_CLASSES, MOST_BETA
from gauss2svg.svg.document import Document
from gauss2svg.svg.file import file_bytes
from gauss2svg.svg.minimal.shapes import HEX_DIGITS
from gauss2svg.svg.minimal.write import minimal_rounded, minimal_svg, whole_unit
from gauss2svg.svg.plain_ellipse import drawn_beta
from gauss2svg.svg.snap import with_exponents

# The longest side of the working picture in px, per square root of the count.
_SIDE, _SIDE_PER_ROOT = (96, 256), 12.0
# Units along the longest side of the file, per square root of the count.
_UNITS_PER_ROOT, _GRIDS = 32.0, (0.8, 1.2)
_ACROSS = 8  # units along the shortest side at least: shapes under half a unit are not drawn
# Times as many units as are wanted, up to which they are taken for sides of whole numbers of them.
_FINER = 10
# Bytes of a soft shape, a plain ellipse, and one of a drawing, until they are measured.
_EACH, _EACH_GZIPPED = (62, 44, 36), (22, 20, 18)
# Times shorter that shapes may turn out; where they seem shorter most were written as nothing.
_SHORTER = 3.0
# Exponents that are worth their definition in a file of so many bytes; plain ellipses need none.
_EXPONENTS: tuple[tuple[int, tuple[float, ...]], ...] = (
    (6000, BETA_CLASSES),
    (2200, (1.0, 3.0)),
    (0, (3.0,)),
)
_PLAIN_UNDER = 900  # bytes, where every second fit has plain ellipses alone, like cut paper
_COARSE_UNDER = 1100  # bytes, where a digit is a large part of a drawing's shape
EXACT = (0.5 / 255) ** 2  # mean squared error under which no level of 8 bits is wrong
_SOME = 60  # shapes up to which there are three fits on two grids, beyond two on one
_ITERATIONS = 200
# Of drawings: share of the pixels that the most frequent colours have, how many these are, and the
# longest side of the working picture in px.
_FLAT_SHARE, _FLAT_COLORS, _DRAWING_SIDE = 0.4, 4, 384
_FEW_OF_DRAWING = 12  # shapes or px of a side, under which half as many shapes are not tried


@dataclass(frozen=True)
class _Attempt:
    """A fit: how it begins, and how its file is written.

    init, rate, seed  placement, learning rate and seed
    exponents   of soft shapes; others are plain ellipses
    each        bytes of a shape, until they are measured
    grids       of the file, times _UNITS_PER_ROOT
    digits      of hex colours
    shared      share of the squared error for which shapes get colours in common
    """

    init: str
    rate: float = 1.0
    seed: int = 0
    exponents: tuple[float, ...] = ()
    iterations: int = _ITERATIONS
    each: int = _EACH[0]
    grids: tuple[float, ...] = _GRIDS
    digits: tuple[int, ...] = HEX_DIGITS
    shared: float = 0.0


_BEGINNINGS = (_Attempt("selective"), _Attempt("error"), _Attempt("selective", 1.5))
_DRAWING = tuple(
    _Attempt(init, iterations=600, grids=(4.0, 8.0), digits=(6,), shared=0.1)
    for init in ("selective", "error")
)


@dataclass(frozen=True, eq=False)
class SmallFile:
    """A file, the scene that it draws on the photo's canvas, and its error at the working size."""

    svg: str
    scene: Scene
    error: float
    gzipped: bool

    @cached_property
    def size(self) -> int:
        """Bytes of the file."""
        return len(file_bytes(self.svg, self.gzipped))


class SmallSearch:
    """The search for the best file of at most `limit` bytes.

    photo     (h, w, 3) or (h, w, 4) float32 in 0..1
    canvas    width and height in px of the photo, where it is reduced
    most      largest number of Gaussians
    options   of the fits, which are tuned for PSNR unless they say otherwise
    max_size  longest side in px of the working picture
    progress  called after every step; stop is polled before: True ends with the best so far
    Raises InputError where a file without Gaussians has more bytes.
    """

    def __init__(
        self,
        photo: NDArray[np.float32],
        limit: int,
        *,
        canvas: tuple[int, int] | None = None,
        document: Document | None = None,
        gzipped: bool = False,
        most: int | None = None,
        options: FitOptions | None = None,
        renderer: str = DEFAULT_RENDERER,
        max_size: int | None = None,
        progress: Callable[[FitProgress], None] | None = None,
        stop: Callable[[], bool] | None = None,
    ) -> None:
        self._photo, self._limit, self._gzipped = photo, limit, gzipped
        self._document = document or Document()
        self._options = options or FitOptions()
        self._tune: Tune = self._options.tune or PSNR
        self._renderer = renderer
        self._progress, self._stop = progress, stop or (lambda: False)
        self._each = _EACH_GZIPPED if gzipped else _EACH
        self.is_drawing = is_drawing(photo) and self._options.learned_falloff
        self._most = math.inf if most is None else most
        self._canvas = width, height = canvas or photo.shape[1::-1]
        self._flat = self._flat_files()
        self.flat = min(self._flat, key=lambda file: file.size)
        if self.flat.size > limit:
            needed = f"at least {self.flat.size}, the bytes of a file without Gaussians"
            raise InputError(must_be("max_bytes", needed, shown(f"{limit}"), f"{self.flat.size}"))
        count = max((limit - self.flat.size) / self._each[0], 1)
        low, high = (_DRAWING_SIDE,) * 2 if self.is_drawing else _SIDE
        side = min(max(_SIDE_PER_ROOT * math.sqrt(count), low), high, max_size or high)
        side = min(side, max(photo.shape[:2]))
        scale = side / max(width, height)
        self.working = shrunk(photo, *(max(1, round(length * scale)) for length in (height, width)))
        self.fits: list[FitResult] = []

    def run(self) -> SmallFile:
        """The best file found."""
        flat = [file for file in self._flat if file.size <= self._limit]
        flat = [dataclasses.replace(file, error=self._error(file.svg)) for file in flat]
        best = min(flat, key=lambda file: (file.error, file.size))
        if best.error < EXACT:
            return best
        sizes: dict[tuple[float, ...], tuple[int, int]] = {}
        with kernel_lock:
            attempts = self._attempts()
            for start, attempt in enumerate(attempts):
                count = self._count(attempt, sizes.get(attempt.exponents))
                if count < 1 or self._stop():
                    continue
                found, sizes[attempt.exponents] = self._made(count, attempt, start, len(attempts))
                best = min(best, found or best, key=lambda file: (file.error, file.size))
            # Edges that meet are drawn less exactly than they are fitted; thin pictures have few.
            fewer = len(best.scene) // 2 if self.is_drawing and not self._is_thin else 0
            while fewer >= _FEW_OF_DRAWING and not self._stop():
                found, _ = self._made(fewer, attempts[-1], len(attempts) - 1, len(attempts))
                if found is None or found.error >= best.error:
                    break
                best, fewer = found, fewer // 2
        return best

    @property
    def _is_thin(self) -> bool:
        return min(self.working.shape[:2]) < _FEW_OF_DRAWING

    def _made(
        self, count: int, attempt: _Attempt, start: int, starts: int
    ) -> tuple[SmallFile | None, tuple[int, int]]:
        """The best file of a fit of so many shapes, with its drawn error; see `_written`."""
        found, whole = self._written(self._fit(count, attempt, start, starts), attempt)
        if found is not None:
            found = dataclasses.replace(found, error=self._error(found.svg))
        return found, whole

    def _attempts(self) -> list[_Attempt]:
        """The fits to make."""
        soft, plain, drawn = self._each
        if self.is_drawing:
            attempts = [dataclasses.replace(a, each=drawn) for a in _DRAWING]
            if self._is_thin:
                attempts = [dataclasses.replace(a, iterations=_ITERATIONS) for a in attempts]
            if self._limit < _COARSE_UNDER:
                coarse = {"grids": _GRIDS + _DRAWING[0].grids, "digits": HEX_DIGITS}
                attempts = [dataclasses.replace(a, **coarse) for a in attempts]
            return attempts
        count = (self._limit - self.flat.size) / soft
        fits = _BEGINNINGS if count <= _SOME else _BEGINNINGS[:2]
        grids = _GRIDS if count <= _SOME else (1.0,)
        exponents = next(classes for least, classes in _EXPONENTS if self._limit >= least)
        if not self._options.learned_falloff:
            exponents = (1.0,)
        attempts = [
            dataclasses.replace(a, exponents=exponents, each=soft, grids=grids) for a in fits
        ]
        if self._limit < _PLAIN_UNDER and self._options.learned_falloff:
            for k in range(0, len(attempts), 2):
                attempts[k] = dataclasses.replace(attempts[k], exponents=(), each=plain)
        return attempts

    def _count(self, attempt: _Attempt, earlier: tuple[int, int] | None) -> int:
        """Gaussians that the bytes allow; earlier is (count, bytes) of a file of its exponents."""
        count, size = earlier or (0, 0)
        each = (size - self.flat.size) / max(count, 1)
        if each >= attempt.each / _SHORTER:
            by_bytes = count + (self._limit - size) / min(each, attempt.each)
        else:
            one = np.ones(len(attempt.exponents))
            probe = Scene(
                100, 100, np.full((len(one), 2), 50.0), np.full((len(one), 2), 20.0), 0 * one,
                np.full((len(one), 3), 0.4), one, beta=np.array(attempt.exponents),
            )  # fmt: skip
            size = len(file_bytes(minimal_svg(probe, 1, 3, self._document), self._gzipped))
            by_bytes = len(one) + (self._limit - size) / attempt.each
        # Whether one fits is seen when it is written.
        return int(min(max(by_bytes, 1), self._most, self.working[..., 0].size))

    def _fit(self, count: int, attempt: _Attempt, start: int, starts: int) -> Scene:
        """A fit of so many shapes, on the photo's canvas; plain ellipses have MOST_BETA."""
        options, transparent = self._options, has_alpha(self.working)
        config = FitConfig(
            gaussians=count,
            iterations=options.iterations or attempt.iterations,
            fit=dataclasses.replace(
                options,
                tune=self._tune,
                seed=options.seed + attempt.seed,
                learning_rate=options.learning_rate * attempt.rate,
            ),
            densify=DensifyOptions(init=attempt.init),  # pyright: ignore[reportArgumentType]
            reduce=False,
            opaque=not transparent,
        )

        def progress(now: FitProgress) -> None:
            if self._progress is not None:
                rest = now.remaining_s + (starts - 1 - start) * (now.elapsed_s + now.remaining_s)
                done = (start + now.done) / starts
                self._progress(dataclasses.replace(now, done=done, remaining_s=rest))

        session = FitSession(
            self.working,
            config,
            fixed_count(config),
            progress=progress,
            as_written=lambda scene, _: _with_few_exponents(scene, attempt.exponents),
            stop=self._stop,
        )
        session.fit()
        self.fits.append(session.result())
        scene = session.scene()
        plain = np.ones(len(scene), bool)  # exponents are stepped as logarithms
        for beta in attempt.exponents:
            plain &= ~np.isclose(scene.betas, beta)
        width, height = self._canvas
        scene = scene.scaled(width / scene.width, height / scene.height)
        scene = with_exponents(scene, np.where(plain, MOST_BETA, scene.betas))
        return scene.replace(width=width, height=height)

    def _written(
        self, fitted: Scene, attempt: _Attempt
    ) -> tuple[SmallFile | None, tuple[int, int]]:
        """The best file of a fitted scene by the model, and (count, bytes) before any was left out.

        None where no Gaussian is left.
        """
        height, width = self.working.shape[:2]
        splats = splats_of(fitted, (width / fitted.width, height / fitted.height))
        cost = target_of(self.working, np.float32, self._tune).removal_cost(splats)[1][:, 0]
        order = np.argsort(-cost, kind="stable")
        best, whole = None, (len(fitted), self.flat.size)
        for grid in attempt.grids:
            if best is not None and self._stop():
                break
            units = math.ceil(grid * _UNITS_PER_ROOT * math.sqrt(max(len(fitted), 1)))
            unit = self._unit(units)
            for digits in attempt.digits:
                file, size = self._pruned(fitted, order, unit, digits, attempt)
                if best is None or (file is not None and file.error < best.error):
                    best, whole = file, (len(fitted), size)
        return best, whole

    def _pruned(
        self,
        fitted: Scene,
        order: NDArray[np.intp],
        unit: float,
        digits: int,
        attempt: _Attempt,
    ) -> tuple[SmallFile | None, int]:
        """The file of the first Gaussians of an order that fit, and the bytes of all of them."""
        kept, whole = len(fitted), 0
        while kept > 0:
            scene = minimal_rounded(fitted.select(np.sort(order[:kept])), unit, digits)
            exact, error = recolored(scene, self.working, digits, attempt.shared)
            svg = minimal_svg(exact, unit, digits, self._document)
            file = SmallFile(svg, exact, error, self._gzipped)
            whole = whole or file.size
            if file.size <= self._limit:
                return file, whole
            each = max(attempt.each, (file.size - self.flat.size) / kept)
            kept -= math.ceil((file.size - self._limit) / each)
        return None, whole

    def _flat_files(self) -> list[SmallFile]:
        """Files without Gaussians, their colour in three digits and in six; not yet measured."""
        width, height = self._canvas
        transparent = has_alpha(self._photo)
        background = np.ones(3) if transparent else self._photo.mean(axis=(0, 1), dtype=np.float64)
        scene = Scene(width, height, background=background, transparent=transparent)

        unit = whole_unit(width, height)

        def file(digits: int) -> SmallFile:
            svg = minimal_svg(scene, unit, digits, self._document)
            return SmallFile(svg, minimal_rounded(scene, unit, digits), math.nan, self._gzipped)

        return [file(digits) for digits in HEX_DIGITS]

    def _unit(self, units: int) -> float:
        """A unit in px of which about so many are along the longest side.

        Both sides are whole numbers of it, so that the file needs no size, unless that takes many
        more of them.
        """
        height, width = self._photo.shape[:2]
        longest = max(width, height)
        units = max(units, math.ceil(_ACROSS * longest / min(width, height)))
        unit = whole_unit(width, height, units)
        return unit if longest / unit <= _FINER * units else longest / units

    def _error(self, svg: str) -> float:
        """Mean squared error of the drawn file at the working size."""
        raster = rasterize_like(svg, self.working, self._renderer)
        return mean_squared_error(stacked(raster), stacked(self.working))


def is_drawing(photo: NDArray[np.float32]) -> bool:
    """Whether a few colours make up much of a picture, as the flat ones of a drawing do."""
    weights = 256 ** np.arange(photo.shape[2])
    colors = (np.round(photo * 255).astype(np.int64) * weights).sum(axis=2)
    shares = np.sort(np.unique(colors, return_counts=True)[1])[-_FLAT_COLORS:] / colors.size
    return bool(shares.sum() >= _FLAT_SHARE)


def _with_few_exponents(scene: Scene, exponents: tuple[float, ...]) -> Scene:
    """The scene with the nearest of these exponents, or that of a plain ellipse."""
    classes = np.array([*exponents, BETA_CLASSES[-1]])
    logs = np.log(classes)
    nearest = np.abs(np.log(scene.betas)[:, None] - logs).argmin(axis=1)
    plain = nearest == len(exponents)
    beta = classes[nearest]
    beta[plain] = drawn_beta(scene, plain)
    return with_exponents(scene, beta)
