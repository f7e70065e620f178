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

A drawing is fitted with ellipses that stay crisp when the SVG is enlarged:

    drawing -> up to four fits -> an enlarged picture, on which the fits agree -> fits of more and
    more ellipses to it, until the bytes are used or more ellipses no longer help -> the best file

Of two files, the closer one is better (`closeness`). If differences from the drawing can be seen at
its own size, files are compared at that size, and otherwise with the enlarged picture. In the
second case, the numbers of ellipses do not depend on the limit of bytes, if several of them fit
into it. So a search with a larger limit has the files of one with a smaller limit to choose from.

docs/decisions/small.md explains the constants, and enlarged.md explains those for drawings.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit import DensifyOptions, FitConfig, FitProgress, FitResult
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.target import psnr_of
from gauss2svg.measure.roundtrip import model_error, raster_error, round_trip
from gauss2svg.photo.pixels import elongation, has_alpha, shrunk
from gauss2svg.pipeline import drawings, small_file
from gauss2svg.pipeline.outcome import SEEN_UP_TO, Outcome, Subject, without_gaussians
from gauss2svg.pipeline.plan import SHAPE_BYTES, SHAPE_GZIPPED_BYTES, WHOLE_SIDE, Plan
from gauss2svg.pipeline.run import Run
from gauss2svg.pipeline.small_file import EXACT_UNDER, SmallFile, closeness, flat_scene
from gauss2svg.render import render, render_rgba
from gauss2svg.scene import PLAIN, SOFT, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, MOST_BETA, RIM_WIDTH, covered_radius
from gauss2svg.svg.file import file_bytes
from gauss2svg.svg.forms import with_falloffs, with_plain
from gauss2svg.svg.minimal import minimal_rounded, minimal_svg
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

# Constants for photos.

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
_FITS_OF_PHOTO = ("selective", 1.0), ("error", 1.0), ("selective", 1.5)

# Constants for drawings.
LARGE_SIDE = 1024  # px. A larger drawing with antialiased edges is reduced to this longest side
FLAT_SIDE = 384  # px. A larger drawing without antialiased edges is reduced to this longest side
# A drawing is enlarged before it is fitted if the limit is at least this many bytes.
ENLARGED_FROM = 2000
STEPS = 600  # number of steps of a fit
# Fits to a picture of at least this number of pixels leave out tiles that have hardly any error. A
# smaller picture takes little time, and has so few tiles that each of them matters.
SKIP_FROM = 65536
# A drawing that is not enlarged is fitted again with half the shapes of the best file. This is
# repeated as long as it gives a better file and leaves at least this number of shapes.
LEAST_FEWER = 12
# The enlarged drawing is made from several fits, which have these numbers of shapes. For drawings
# over 256 px there is only one number, because fits to them take longer.
AGREEING = (150, 300)
AGREEING_LARGE = (300,)
# A drawing that is enlarged is also fitted at its own size, but only if the limit has room for at
# most this number of shapes.
OWN_UP_TO = 200
# The first fit to the enlarged drawing has FIRST_COUNT shapes. Each further one has GROWTH times as
# many as the one before it.
FIRST_COUNT, GROWTH = 200, 1.265
# dB. Twice as many shapes are expected to raise the PSNR of a drawing by this. Numbers of shapes
# for which differences would then be seen are left out.
GAIN_OF_TWICE = 6.0
# If all shapes are plain ellipses, one of a fit to the enlarged drawing takes this multiple of the
# bytes that one of a fit to the drawing itself takes.
ENLARGED_BYTES = 0.9
# Several shapes of a drawing get the same colour if the squared error then grows by at most this
# fraction.
SHARED = 0.1
# If the limit in bytes is below this, coarse grids and 3-digit colours are tried too, because
# digits take a large share of the file.
COARSE_UNDER = 1100
# If the limit in bytes is at least this, FINE_GRIDS are tried instead of GRIDS, and shaded drawings
# may have soft shapes.
FINE_FROM = 6000
# A grid is a factor on the usual number of units along the sides of a file. The larger it is, the
# more exact the coordinates are (`small_file.unit_of`).
COARSE_GRIDS, GRIDS, FINE_GRIDS = (8.0, 4.0, 1.2, 0.8), (8.0, 4.0), (16.0, 8.0)
# px. In a shaded drawing, a shape is soft if its rim is at least this wide at the drawing's own
# size. Otherwise it is a plain ellipse.
SOFT_FROM = 4.0


class ByBytes:
    """A search for the best file within a plan's limit of bytes.

    subject     photo and canvas. The search replaces the working picture by a reduced one
    bytes_of    function that takes the text of an SVG, and returns the number of bytes to which the
                limit applies. None: the bytes of the file
    is_drawing  whether the photo is treated as a flat drawing. This is so if it is a flat drawing
                and the fit learns falloffs
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
        self.is_drawing = plan.options.fit.learned_falloff and drawings.is_drawing(subject.photo)
        self.subject, self.fits = subject, list[FitResult]()
        flat = [self._file(*flat_scene(subject, digits), digits) for digits in HEX_DIGITS]
        self.flat = min(flat, key=lambda file: file.size)
        self._shape_bytes = self._limit - self.flat.size  # bytes left for shapes
        if self._shape_bytes < 0:
            raise without_gaussians(self.flat.size, self._limit)
        # For each tuple of exponents, the bytes per shape in the last file with these exponents.
        self._each: dict[Exponents, float] = {}
        self._fewest = 0.0  # number of shapes with which differences are expected not to be seen
        self._set_up()
        self._large: NDArray[np.float32] | None = None  # the enlarged drawing
        # Shapes are fitted to the working picture of the subject `_fitted`. Their colours are then
        # computed from the working picture of the subject `_solved`. Once a drawing is enlarged,
        # both pictures are the enlarged drawing, but that of `_solved` may have half the size.
        self._fitted = self._solved = self.subject
        self._reason = ""  # reason why the search ends before the bytes are used up, or ""
        fitting = [self._with_errors(file) for file in flat if file.size <= self._limit]
        self.best = max(fitting, key=closeness)

    def _set_up(self) -> None:
        """Reduce the working picture. Decide which fits, exponents, grids and digits to try."""
        photo, canvas, options = self.subject.photo, self.subject.canvas, self._plan.options
        limit = self._plan.uncompressed_limit or self._limit
        learned, self._enlarges = options.fit.learned_falloff, False
        exponents = next(classes for least, classes in EXPONENTS if self._limit >= least)
        self._exponents: Exponents = exponents if learned else (1.0,)
        if self.is_drawing:
            edges = drawings.has_edges(photo)
            self._enlarges = edges and limit >= ENLARGED_FROM
            side = LARGE_SIDE if edges else FLAT_SIDE
            self._digits, self._grids = HEX_DIGITS[-1:], FINE_GRIDS if limit >= FINE_FROM else GRIDS
            if limit < COARSE_UNDER:
                self._digits, self._grids = HEX_DIGITS[::-1], COARSE_GRIDS
        else:
            count = self._shape_bytes / self._expected(exponents)
            few = count <= FEW_UP_TO
            side = min(max(SIDE_PER_ROOT * math.sqrt(max(count, 1)), LEAST_SIDE), WHOLE_SIDE)
            self._first_fits = _FITS_OF_PHOTO if few else _FITS_OF_PHOTO[:2]
            self._digits, self._grids = HEX_DIGITS[::-1], (1.2, 0.8) if few else (1.0,)
        side *= elongation(*canvas)
        side = min(side, options.run.max_size or side, max(photo.shape[:2]))
        size = [max(1, round(length * side / max(canvas))) for length in canvas[::-1]]
        working = shrunk(photo, *size, sharp=self.is_drawing)
        self.subject = dataclasses.replace(self.subject, working=working)
        caps = [math.prod(self.subject.size), self._plan.goal.count]
        caps += [self._plan.preset.cap] if self._plan.goal.quality is not None else []
        self._most = min(cap for cap in caps if cap is not None)
        if self.is_drawing:
            if limit < FINE_FROM or not drawings.is_shaded(working):
                self._exponents = ()
            is_large = self._enlarges and self._count(self._exponents) > OWN_UP_TO
            self._first_fits = () if is_large else _FITS_OF_PHOTO[:2]
        self._alternates = not self.is_drawing and learned and self._limit < PLAIN_UNDER
        self._expected_fits = len(self._first_fits)
        self._expected_fits += self._enlarges * (2 * len(self._agreeing) + 2)

    def run(self) -> Outcome:
        """Search for the best file, and return it with its measurements."""
        plan, subject, best = self._plan, self.subject, self.file()
        self._run.notify("measure", None)
        subject.release()
        renderer, later_fits = plan.options.run.renderer, max(len(self.fits) - 1, 0)
        measured = round_trip(best.svg, best.scene, subject.photo, renderer, covering=True)
        return Outcome(
            plan, subject, best.scene, best.svg, plan.format_at(), self._costs(), measured,
            later_fits, enlarged=self._large,
        )  # fmt: skip

    def file(self) -> SmallFile:
        """Search for the best file, and return it."""
        if self.best.error >= EXACT_UNDER and self._most:
            for k, (init, rate) in enumerate(self._first_fits):
                exponents = () if self._alternates and k % 2 == 0 else self._exponents
                if not self._stop():
                    self._fit_and_keep(self._count(exponents), init, exponents, rate)
            # A fit with half as many shapes as the best file has is tried too. Its file may be
            # closer, because renderers do not draw shapes exactly where their edges meet.
            fewer = len(self.best.scene) // 2 if self.is_drawing and not self._enlarges else 0
            while fewer >= LEAST_FEWER and not self._stop():
                fewer = fewer // 2 if self._fit_and_keep(fewer, "error", self._exponents) else 0
            if self._enlarges:
                self._grow()
        return self.best

    def _grow(self) -> None:
        """Fit more and more shapes to the enlarged drawing.

        The fits end when one more does not give a better file. If people can still see differences
        at the drawing's own size then, or if there was no fit yet, one more fit has as many shapes
        as the limit allows. If people can see no differences, this fit is left out. Its file could
        be better only by chance, and its number of shapes would depend on the limit, so a larger
        limit could lead to a worse file.
        """
        large = self._enlarged()
        if large is None:
            return
        height, width = large.working.shape[:2]
        divisor = 2 if max(large.size) > 2 * max(self.subject.size) else 1
        solved = shrunk(large.working, height // divisor, width // divisor)
        self._large, self._solved = large.working, dataclasses.replace(large, working=solved)
        self._fitted = large
        self.best, is_first, helps = self._with_errors(self.best), True, True
        for count in self._ladder():
            if self._stop():
                return
            helps = self._fit_and_keep(count, "selective", self._exponents) or is_first
            is_first = False
            if not helps:
                break
        if is_first or psnr_of(self.best.error) < SEEN_UP_TO:
            if not self._stop():
                self._fit_and_keep(self._count(self._exponents), "selective", self._exponents)
        elif not helps:
            self._reason = "gain"

    @property
    def _agreeing(self) -> tuple[int, ...]:
        """Numbers of shapes of the fits from which the enlarged drawing is made.

        There are none if the drawing is already large, or if it was reduced.
        """
        subject = self.subject
        if subject.size != subject.canvas or max(subject.size) > drawings.LARGEST_ENLARGED:
            return ()
        return AGREEING if drawings.enlargement(*subject.size) > 2 else AGREEING_LARGE

    def _enlarged(self) -> Subject | None:
        """Fit the drawing several times, and make the enlarged drawing from these fits.

        Return a subject whose working picture is the enlarged drawing. If there are no such fits,
        the subject is returned as it is. Return None if the search is stopped.
        """
        own, (width, height) = self.subject, self.subject.size
        if not self._agreeing:
            return own
        draw, renders = render_rgba if has_alpha(own.working) else render, []
        fewest = list[float]()
        for count, init in itertools.product(self._agreeing, ("selective", "error")):
            if self._stop():
                return None
            scene = self._fit(count, init, self._exponents)
            # Keep a file of the first fit, so that there are shapes if the search is stopped soon.
            if not len(self.best.scene):
                self._keep(scene, self._exponents)
            renders.append(draw(scene, 4 * width, 4 * height, covering=True))
            missing = SEEN_UP_TO - psnr_of(model_error(scene, own.working, True))
            fewest.append(count * 2 ** (missing / GAIN_OF_TWICE))
        self._fewest = min(fewest)
        if not self._exponents and self._each:
            self._each[()] *= ENLARGED_BYTES
        times = drawings.enlargement(width, height)
        return dataclasses.replace(own, working=drawings.agreed(own.working, renders, times))

    def _ladder(self) -> Iterator[int]:
        """Yield the number of shapes for each fit to the enlarged drawing, in ascending order.

        Begin with a number of shapes for which no differences are expected to be seen. Stop before
        a number of shapes that would not fit into the limit. The bytes per shape of the last file
        decide how many fit. If there is only one such number, yield nothing.
        """
        count = float(FIRST_COUNT)
        while count < self._fewest:
            count *= GROWTH
        if GROWTH * count > self._count(self._exponents):
            return
        while count <= self._count(self._exponents):
            yield round(count)
            count *= GROWTH

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
        soft, plain, of_drawing = SHAPE_GZIPPED_BYTES if gzipped else SHAPE_BYTES
        return of_drawing if self.is_drawing else soft if exponents else plain

    def _count(self, exponents: Exponents) -> int:
        """Return the number of shapes to fit so that their file fills the limit.

        This number is estimated from the bytes per shape of the last file with these exponents.
        """
        expected = self._expected(exponents)
        each = self._each.get(exponents, expected)
        # Too many shapes of a photo do less harm than too few, because the file loses little if the
        # least useful ones are left out. So a shape is never assumed to take more than the expected
        # bytes, even if it did so in the last file.
        if not self.is_drawing:
            each = min(each, expected)
        count = SPARE * self._shape_bytes / each - DEFINITION * len(exponents)
        return int(min(max(count, 1), self._most))

    def _fit_and_keep(self, count: int, init: str, exponents: Exponents, rate: float = 1.0) -> bool:
        """Fit `count` shapes, and keep their file if it is the best. Return whether it is."""
        return self._keep(self._fit(count, init, exponents, rate), exponents)

    def _keep(self, scene: Scene, exponents: Exponents) -> bool:
        """Write a fitted scene, and keep the file if it is the best. Return whether it is."""
        file, before = self._written(scene, exponents), self.best
        if file is not None:
            self.best = max(before, self._with_errors(file), key=closeness)
        return self.best is not before

    def _fit(self, count: int, init: str, exponents: Exponents, rate: float = 1.0) -> Scene:
        """Fit `count` shapes. Return the scene, scaled to the canvas.

        The fit runs on the enlarged drawing if there is one, and otherwise on the working picture.

        init  way in which the fit places shapes, as in DensifyOptions
        rate  factor on the learning rate
        """
        subject, options = self._fitted, self._plan.options.fit
        share = max(subject.size) / max(self.subject.size)
        soft_from = SOFT_FROM * share if self.is_drawing else 0.0
        tune, rate = self._plan.tune, rate * options.learning_rate
        config = FitConfig(
            gaussians=count,
            iterations=options.iterations or (STEPS if self.is_drawing else ITERATIONS),
            fit=dataclasses.replace(options, tune=tune, learning_rate=rate),
            densify=DensifyOptions(init=init),  # pyright: ignore[reportArgumentType]
            reduce=False,
            opaque=not has_alpha(subject.working),
            enlarged=1 if self._large is None else drawings.enlargement(*self.subject.size),
            skip_quiet=self.is_drawing and math.prod(subject.size) >= SKIP_FROM,
        )

        def progress(now: FitProgress) -> None:
            before = min(len(self.fits), self._expected_fits - 1)
            later_s = (self._expected_fits - 1 - before) * (now.elapsed_s + now.remaining_s)
            rest_s, done = now.remaining_s + later_s, (before + now.done) / self._expected_fits
            self._run.notify("fit", dataclasses.replace(now, done=done, remaining_s=rest_s))

        session = FitSession(
            subject.working,
            config,
            progress=progress,
            as_written=lambda scene, _: with_few_exponents(scene, exponents, soft_from),
            stop=self._stop,
            targets=subject.targets(tune),
        )
        session.fit()
        self.fits.append(session.result())
        scene, (width, height) = session.scene(), subject.canvas
        scene = scene.scaled(width / scene.width, height / scene.height)
        # A plain ellipse covers the same area in the file as in the fit. Its exponent becomes
        # MOST_BETA here, so its sigmas are scaled to keep the area.
        plain = scene.drawn == PLAIN
        wider = covered_radius(scene.beta) / covered_radius(np.full(len(scene), MOST_BETA))
        sigma = scene.sigma * np.where(plain, wider, 1.0)[:, None]
        beta = np.where(plain, MOST_BETA, scene.beta)
        scene = scene.replace(width=width, height=height, beta=beta, sigma=sigma)
        return with_falloffs(scene, beta).replace(drawn=np.where(plain, PLAIN, SOFT))

    def _written(self, fitted: Scene, exponents: Exponents) -> SmallFile | None:
        """Write a scene with each grid and number of digits. Return the file of the smallest error.

        The error of a file is that of its scene, because files are not rasterised here. A file that
        is too large loses its least useful Gaussians. If a file loses none, coarser ones are not
        tried. Return None if no file has any Gaussians left.
        """
        order = self._solved.by_usefulness(fitted, self._plan.tune, covering=True)
        best, expected, pixels = None, self._expected(exponents), self._solved.working
        shared, weight = SHARED * self.is_drawing, self._solved.weight(pixels)
        for grid, digits in itertools.product(self._grids, self._digits):
            if best is not None and self._stop():
                break
            unit, kept = small_file.unit_of(grid, len(fitted), self.subject.canvas), len(fitted)
            file, each = None, expected
            while kept > 0:
                scene = minimal_rounded(fitted.select(np.sort(order[:kept])), unit, digits)
                exact, error = small_file.recolored(scene, pixels, digits, shared, weight)
                file = self._file(exact, unit, digits, error)
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

    def _with_errors(self, file: SmallFile) -> SmallFile:
        """Measure the errors of a file, and return the file with them.

        `error` becomes the error of the file's raster. If there is an enlarged drawing,
        `enlarged_error` becomes the error of the scene against it. The file is not rasterised at
        this larger size, because drawing its masks would take seconds.
        """
        large, renderer, subject = self._large, self._plan.options.run.renderer, self.subject
        error = raster_error(file.svg, subject.working, renderer, subject.weight(subject.working))
        enlarged = math.nan
        if large is not None:
            enlarged = model_error(file.scene, large, True, subject.weight(large))
        return dataclasses.replace(file, error=error, enlarged_error=enlarged)


def with_few_exponents(scene: Scene, exponents: Exponents, soft_from: float) -> Scene:
    """Return the scene, in which each shape is now a plain ellipse or has one of `exponents`.

    A shape becomes a plain ellipse if its rim is narrower than `soft_from` px, or if its exponent
    is nearer to the largest class of exponents than to all of `exponents`. From then on, the fit
    draws this ellipse by the share of each pixel that it covers. All other shapes are soft. Each of
    them gets the nearest of `exponents`.
    """
    classes = np.array([*exponents, BETA_CLASSES[-1]])
    nearest = np.abs(np.log(scene.beta)[:, None] - np.log(classes)).argmin(axis=1)
    plain = nearest == len(exponents)
    plain |= RIM_WIDTH * scene.ellipse_axes[0][:, 1] / scene.beta < soft_from
    scene = with_plain(scene, plain, classes[nearest])
    return scene.replace(drawn=np.where(plain, PLAIN, SOFT))
