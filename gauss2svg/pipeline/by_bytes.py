"""The search by bytes. It makes files of hundreds to thousands of bytes that fill a limit.

    photo -> working picture of 96 to 256 px -> a few fits of as many opaque shapes as the bytes
    allow, with few exponents -> small files -> the file with the closest raster

For example, take Kodak 20, 768 x 512 px, and a limit of 250 bytes. A file without Gaussians has 98
bytes. The other 152 bytes suffice for 3 plain ellipses of about 44 bytes each, which are fitted at
96 x 64 px. Each fit is written in units of two sizes, with colours of 6 and of 3 hex digits, until
all of its shapes fit. Of these files, the one whose model is closest is rasterised:

    <svg xmlns=".." viewBox="0 0 66 44"><path fill="#c3b8a0" d="M0 0h66v44H0"/>
    <path fill="#504c34" d="M86 27a93 10-1.8 101 0"/>
    <path fill="#fbf9e8" d="M1-19a91 20 7.2 101 0"/>
    <path fill="#736031" d="M11 18a10 4 32 101 0"/></svg>

docs/decisions/small.md explains the constants.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable

import numpy as np

from gauss2svg.fit import DensifyOptions, FitConfig, FitProgress, FitResult
from gauss2svg.fit.session import FitSession
from gauss2svg.measure.roundtrip import raster_error, round_trip
from gauss2svg.photo.pixels import elongation, has_alpha, shrunk
from gauss2svg.pipeline import small_file
from gauss2svg.pipeline.outcome import Outcome, Subject, without_gaussians
from gauss2svg.pipeline.plan import SHAPE_BYTES, SHAPE_GZIPPED_BYTES, WHOLE_SIDE, Plan
from gauss2svg.pipeline.run import Run
from gauss2svg.pipeline.small_file import EXACT_UNDER, SmallFile, error_and_size, flat_scene
from gauss2svg.scene import PLAIN, SOFT, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, covered_radius
from gauss2svg.svg.file import file_bytes
from gauss2svg.svg.forms import plain_beta, with_falloffs
from gauss2svg.svg.minimal import as_written, minimal_svg
from gauss2svg.svg.minimal_shapes import HEX_DIGITS

# Exponents that soft shapes may have. All other shapes are plain ellipses.
Exponents = tuple[float, ...]
BytesOf = Callable[[str], int]

# Each pair is a size in bytes and a tuple of exponents. Soft shapes may have the exponents of the
# first pair whose size is at most the limit. Small files have few exponents, because the definition
# of each exponent takes bytes.
EXPONENTS = (6000, BETA_CLASSES), (2200, (1.0, 3.0)), (0, (3.0,))
DEFINITION = 5  # an exponent's definition takes as many bytes as this number of shapes
# If most shapes of a fit are too small or too faint to be written, the file has very few bytes per
# shape. The next fit must not rely on this, so it assumes that a shape takes at least its expected
# bytes divided by this number.
SHORTER = 3.0
# A fit has more shapes than fit into the limit: this multiple of their number. The least useful
# ones are left out of the file.
SPARE = 1.03

# The longest side of the working picture in px is the square root of the number of shapes,
# multiplied by this number.
SIDE_PER_ROOT = 12.0
LEAST_SIDE = 96  # px. The longest side of the working picture is at least this
# If the limit in bytes is below this, every second fit has only plain ellipses.
PLAIN_UNDER = 900
# If at most this number of shapes fits into the limit, there are 3 fits, and each is written with 2
# grids. If more shapes fit, there are 2 fits, and each is written with 1 grid.
FEW_UP_TO = 60
ITERATIONS = 200  # number of steps of a fit
# Each pair is for one fit: the way in which shapes are placed, and a factor on the learning rate.
FITS = ("selective", 1.0), ("error", 1.0), ("selective", 1.5)


class ByBytes:
    """A search for the best file within a plan's limit of bytes.

    subject     photo and canvas. The search replaces the working picture by a reduced one
    bytes_of    function that takes the text of an SVG, and returns the number of bytes to which the
                limit applies. None: the bytes of the file
    flat        smallest file without Gaussians
    best        best file so far, with the error of its raster
    fits        results of the fits so far
    Raise InputError if a file without Gaussians exceeds the limit.
    """

    def __init__(
        self, plan: Plan, subject: Subject, run: Run, bytes_of: BytesOf | None = None
    ) -> None:
        assert plan.goal.byte_limit is not None
        self._plan, self._run, self._limit = plan, run, plan.goal.byte_limit
        self._bytes_of = bytes_of or (lambda svg: len(file_bytes(svg, plan.counts_gzipped)))
        self.subject, self.fits = subject, list[FitResult]()
        flat = [self._file(*flat_scene(subject, digits), digits) for digits in HEX_DIGITS]
        self.flat = min(flat, key=lambda file: file.size)
        self._shape_bytes = self._limit - self.flat.size  # bytes left for shapes
        if self._shape_bytes < 0:
            raise without_gaussians(self.flat.size, self._limit)
        # For each tuple of exponents, the bytes per shape in the last file with these exponents.
        self._each: dict[Exponents, float] = {}
        self._set_up()
        self._reason = ""  # reason why the search ends before the bytes are used up, or ""
        fitting = [self._with_error(file) for file in flat if file.size <= self._limit]
        self.best = min(fitting, key=error_and_size)

    def _set_up(self) -> None:
        """Reduce the working picture. Decide which fits, exponents, grids and digits to try."""
        photo, canvas, options = self.subject.photo, self.subject.canvas, self._plan.options
        learned = options.fit.learned_falloff
        exponents = next(classes for least, classes in EXPONENTS if self._limit >= least)
        self._exponents: Exponents = exponents if learned else (1.0,)
        count = self._shape_bytes / self._expected(exponents)
        few = count <= FEW_UP_TO
        side = min(max(SIDE_PER_ROOT * math.sqrt(max(count, 1)), LEAST_SIDE), WHOLE_SIDE)
        self._fits_to_do = FITS if few else FITS[:2]
        self._grids = (1.2, 0.8) if few else (1.0,)
        side *= elongation(*canvas)
        side = min(side, options.run.max_size or side, max(photo.shape[:2]))
        width, height = (max(1, round(length * side / max(canvas))) for length in canvas)
        self.subject = dataclasses.replace(self.subject, working=shrunk(photo, height, width))
        caps = [math.prod(self.subject.size), self._plan.goal.count]
        caps += [self._plan.preset.cap] if self._plan.goal.quality is not None else []
        self._most = min(cap for cap in caps if cap is not None)
        self._alternates = learned and self._limit < PLAIN_UNDER

    def run(self) -> Outcome:
        """Search for the best file, and return it with its measurements."""
        plan, subject, best = self._plan, self.subject, self.file()
        self._run.notify("measure", None)
        subject.release()
        renderer, later_fits = plan.options.run.renderer, max(len(self.fits) - 1, 0)
        measured = round_trip(best.svg, best.scene, subject.photo, renderer)
        costs, written = self._costs(), plan.format_at()
        return Outcome(plan, subject, best.scene, best.svg, written, costs, measured, later_fits)

    def file(self) -> SmallFile:
        """Search for the best file, and return it."""
        for k, (init, rate) in enumerate(self._fits_to_do):
            exponents = () if self._alternates and k % 2 == 0 else self._exponents
            if self.best.error < EXACT_UNDER or not self._most or self._stop():
                break
            fitted = self._fit(self._count(exponents), init, exponents, rate)
            written = self._written(fitted, exponents)
            if written is not None:
                self.best = min(self.best, self._with_error(written), key=error_and_size)
        return self.best

    def _costs(self) -> FitResult:
        """Return a result that has the costs of all fits, and the reason why the search ended."""
        count, reason = len(self.best.scene), "max_bytes"
        if self._reason:
            reason = self._reason
        elif self.best.error < EXACT_UNDER:
            reason = "enough"
        elif count == self._most:
            reason = "gaussians" if count == self._plan.goal.count else "cap"
        costs = FitResult(self.best.scene, 0, 0, 0.0, 0.0, 0, reason)
        for fitted in self.fits:
            costs = fitted.after(costs, reason)
        return costs

    def _stop(self) -> bool:
        """Return whether the search must end, and set `_reason` if it must.

        It must end if the run is stopped. After the first fit, it must also end if the time that is
        left is needed for writing and measuring the file.
        """
        if self._run.stop():
            self._reason = "interrupted"
        elif self.fits and self._run.budget.must_export:
            self._reason = "time_limit"
        return bool(self._reason)

    def _expected(self, exponents: Exponents) -> float:
        """Return the bytes that a shape usually takes, without regard to files of this search."""
        gzipped = self._plan.counts_gzipped
        soft, plain = SHAPE_GZIPPED_BYTES if gzipped else SHAPE_BYTES
        return soft if exponents else plain

    def _count(self, exponents: Exponents) -> int:
        """Return the number of shapes to fit so that their file fills the limit.

        This number is estimated from the bytes per shape of the last file with these exponents.
        """
        expected = self._expected(exponents)
        # Too many shapes do less harm than too few, because the file loses little if the least
        # useful ones are left out. So a shape is never assumed to take more than the expected
        # bytes, even if it did so in the last file.
        each = min(self._each.get(exponents, expected), expected)
        count = SPARE * self._shape_bytes / each - DEFINITION * len(exponents)
        return int(min(max(count, 1), self._most))

    def _fit(self, count: int, init: str, exponents: Exponents, rate: float) -> Scene:
        """Fit `count` shapes. Return the scene, scaled to the canvas.

        init  way in which the fit places shapes, as in DensifyOptions
        rate  factor on the learning rate
        """
        subject, options = self.subject, self._plan.options.fit
        tune, rate = self._plan.tune, rate * options.learning_rate
        config = FitConfig(
            gaussians=count,
            iterations=options.iterations or ITERATIONS,
            fit=dataclasses.replace(options, tune=tune, learning_rate=rate),
            densify=DensifyOptions(init=init),  # pyright: ignore[reportArgumentType]
            reduce=False,
            opaque=not has_alpha(subject.working),
        )

        def progress(now: FitProgress) -> None:
            before = min(len(self.fits), len(self._fits_to_do) - 1)
            later_s = (len(self._fits_to_do) - 1 - before) * (now.elapsed_s + now.remaining_s)
            rest_s, done = now.remaining_s + later_s, (before + now.done) / len(self._fits_to_do)
            self._run.notify("fit", dataclasses.replace(now, done=done, remaining_s=rest_s))

        session = FitSession(
            subject.working,
            config,
            progress=progress,
            as_written=lambda scene, _: with_few_exponents(scene, exponents),
            stop=self._stop,
            targets=subject.targets(tune),
        )
        session.fit()
        self.fits.append(session.result())
        scene, (width, height) = session.scene(), subject.canvas
        scene = scene.scaled(width / scene.width, height / scene.height)
        return scene.replace(width=width, height=height)

    def _written(self, fitted: Scene, exponents: Exponents) -> SmallFile | None:
        """Write a scene with each grid and number of digits. Return the file of the smallest error.

        The error of a file is that of its scene, because files are not rasterised here. A file that
        is too large loses its least useful Gaussians. If a file loses none, coarser ones are not
        tried. Return None if no file has any Gaussians left.
        """
        order = self.subject.by_usefulness(fitted, self._plan.tune)
        best, expected, pixels = None, self._expected(exponents), self.subject.working
        weight = self.subject.weight(pixels)
        for grid, digits in itertools.product(self._grids, HEX_DIGITS[::-1]):
            if best is not None and self._stop():
                break
            unit, kept = small_file.unit_of(grid, len(fitted), self.subject.canvas), len(fitted)
            file, each = None, expected
            while kept > 0:
                scene = as_written(fitted.select(np.sort(order[:kept])), unit, digits)
                scene, error = small_file.recolored(scene, pixels, digits, weight)
                file = self._file(scene, unit, digits, error)
                shapes = file.size - self.flat.size
                if kept == len(fitted):
                    each = shapes / (kept + DEFINITION * len(exponents))
                if file.size <= self._limit:
                    break
                kept -= math.ceil((file.size - self._limit) / max(expected, shapes / kept))
                file = None
            if best is None or (file is not None and file.error < best.error):
                best = file
                self._each[exponents] = max(each, expected / SHORTER)
            if kept == len(fitted):
                break
        return best

    def _file(self, scene: Scene, unit: float, digits: int, error: float = math.nan) -> SmallFile:
        svg = minimal_svg(scene, unit, digits, self.subject.document)
        return SmallFile(svg, scene, error, self._bytes_of(svg))

    def _with_error(self, file: SmallFile) -> SmallFile:
        """Return a file with the error of its raster."""
        renderer, subject = self._plan.options.run.renderer, self.subject
        error = raster_error(file.svg, subject.working, renderer, subject.weight(subject.working))
        return dataclasses.replace(file, error=error)


def with_few_exponents(scene: Scene, exponents: Exponents) -> Scene:
    """Return the scene, in which each shape is now a plain ellipse or has one of `exponents`.

    A shape becomes a plain ellipse if its exponent is nearer to the largest class of exponents than
    to all of `exponents`. From then on, the fit draws this ellipse by the share of each pixel that
    it covers. All other shapes are soft. Each of them gets the nearest of `exponents`.
    """
    classes = np.array([*exponents, BETA_CLASSES[-1]])
    nearest = np.abs(np.log(scene.beta)[:, None] - np.log(classes)).argmin(axis=1)
    plain = nearest == len(exponents)
    beta, semi_axes = classes[nearest], scene.ellipse_axes[0] * covered_radius(scene.beta)[:, None]
    beta[plain] = plain_beta(semi_axes[plain])
    return with_falloffs(scene, beta).replace(drawn=np.where(plain, PLAIN, SOFT))
