"""The search by bytes: files of hundreds to thousands of bytes, with every byte planned.

    photo -> working picture of 96 to 256 px -> a few fits of as many opaque shapes as the bytes
    allow, with few exponents -> small files -> the best raster that fits

Take Kodak 20, 768 x 512 px, and a limit of 250 bytes. A file without Gaussians has 98 bytes. The
other 152 bytes suffice for 3 plain ellipses of about 44 bytes, which are fitted at 96 x 64 px. Each
fit is written in units of two sizes, with colours of 3 and of 6 digits. Of these four files, the
one with the closest model is rasterised:

    <svg xmlns=".." viewBox="0 0 66 44"><path fill="#c3b8a0" d="M0 0h66v44H0"/>
    <path fill="#504c34" d="M86 27a93 10-1.8 101 0"/>
    <path fill="#fbf9e8" d="M1-19a91 20 7.2 101 0"/>
    <path fill="#736031" d="M11 18a10 4 32 101 0"/></svg>

A drawing gets ellipses that stay crisp when it is enlarged:

    drawing -> up to four fits -> the larger picture that they agree on -> fits of more and more
    ellipses, until the bytes are used or more ellipses no longer help -> the best file

The closer of two files is better (`closeness`). Files are compared at the drawing's own size if the
difference can be seen there, and enlarged if not. In the second case the counts of the fits do not
depend on the limit, so that a larger limit can choose from all files of a smaller limit.

docs/decisions/small.md explains the constants, and enlarged.md those of drawings.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import refusal
from gauss2svg.fit import DensifyOptions, FitConfig, FitProgress, FitResult
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.target import psnr_of
from gauss2svg.measure.roundtrip import model_error, raster_error, round_trip
from gauss2svg.photo.pixels import has_alpha, shrunk
from gauss2svg.pipeline import drawings, small_file
from gauss2svg.pipeline.outcome import SEEN_UP_TO, Outcome, Subject
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

Exponents = tuple[float, ...]  # exponents of soft shapes. Other shapes are plain ellipses
BytesOf = Callable[[str], int]

# Exponents, each after the smallest limit in bytes at which they are worth their definitions.
EXPONENTS = (6000, BETA_CLASSES), (2200, (1.0, 3.0)), (0, (3.0,))
DEFINITION = 5  # number of shapes whose bytes equal those of an exponent's definition
# Largest plausible ratio of expected to actual bytes of a shape. If it is larger, most shapes were
# left out of the file.
SHORTER = 3.0
SPARE = 1.03  # number of fitted shapes per shape within the limit. The least useful are left out

# Constants of searches on photos.
SIDE_PER_ROOT = 12.0  # longest side of the working picture in px, per square root of the count
LEAST_SIDE = 96  # px, least length of the longest side of the working picture
PLAIN_UNDER = 900  # limit in bytes below which every second fit has only plain ellipses
FEW_UP_TO = 60  # number of shapes up to which 3 fits have 2 grids each. Beyond, 2 fits have 1 each
ITERATIONS = 200  # number of steps of a fit to a photo
# Placement and learning rate of each fit to a photo.
_FITS_OF_PHOTO = ("selective", 1.0), ("error", 1.0), ("selective", 1.5)

# Constants of searches on drawings.
LARGE_SIDE = 1024  # px, longest side to which a larger drawing is reduced
FLAT_SIDE = 384  # px, longest side to which a drawing without antialiased edges is reduced
ENLARGED_FROM = 2000  # smallest limit in bytes at which a drawing is fitted enlarged
STEPS = 600  # number of steps of a fit to a drawing
LEAST_FEWER = 12  # least number of shapes of a fit that halves the count of the fit before
AGREEING = (150, 300)  # counts of the fits from which the enlarged drawing is made
AGREEING_LARGE = (300,)  # counts of these fits to a drawing over 256 px, where fits take longer
OWN_UP_TO = 200  # number of shapes up to which an enlarged drawing is also fitted at its own size
FIRST_COUNT, GROWTH = 160, 1.265  # count of the first enlarged fit, and ratio to the next count
MOST_IDLE = 2  # growth ends after so many fits in a row that give no better file
SHARED = 0.1  # share of the squared error that may be added so that shapes share colours
COARSE_UNDER = 1100  # limit in bytes below which grids are coarse, because digits cost much
FINE_FROM = 6000  # least limit in bytes for fine grids, and for soft shapes in shaded drawings
COARSE_GRIDS, GRIDS, FINE_GRIDS = (0.8, 1.2, 4.0, 8.0), (4.0, 8.0), (8.0, 16.0)
SOFT_FROM = 4.0  # px, narrowest rim of a soft shape of a shaded drawing


class ByBytes:
    """A search for the best file within a plan's limit of bytes.

    subject     photo and canvas, with a working picture that the search reduces for its fits
    bytes_of    function that counts the bytes of an SVG's text. None: those of the written file
    is_drawing  whether the photo is a drawing
    flat        shortest file without Gaussians
    best        closest file so far, with the error of its raster
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
            needed = f"at least {self.flat.size}, the bytes of a file without Gaussians"
            raise refusal("max_bytes", needed, str(self._limit), str(self.flat.size))
        self._each: dict[Exponents, float] = {}  # bytes per shape of the last file, by exponents
        self._set_up()
        self._large: NDArray[np.float32] | None = None  # the enlarged drawing
        self._fitted = self._solved = self.subject  # subjects of the fits, and of solving colours
        self._reason = ""  # reason for ending before the limit is full, or ""
        fitting = [self._with_errors(file) for file in flat if file.size <= self._limit]
        self.best = max(fitting, key=closeness)

    def _set_up(self) -> None:
        """Set the working picture, and the fits, counts, exponents, grids and digits to try."""
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
                self._digits, self._grids = HEX_DIGITS, COARSE_GRIDS
        else:
            count = self._shape_bytes / self._expected(exponents)
            few = count <= FEW_UP_TO
            side = min(max(SIDE_PER_ROOT * math.sqrt(max(count, 1)), LEAST_SIDE), WHOLE_SIDE)
            self._first_fits = _FITS_OF_PHOTO if few else _FITS_OF_PHOTO[:2]
            self._digits, self._grids = HEX_DIGITS, (0.8, 1.2) if few else (1.0,)
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
        self._expected_fits += self._enlarges * (5 + len(list(self._ladder())))

    def run(self) -> Outcome:
        """Search for the best file, and return it measured."""
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
            # A file of fewer shapes may be closer, because edges that meet are drawn inexactly.
            fewer = len(self.best.scene) // 2 if self.is_drawing and not self._enlarges else 0
            while fewer >= LEAST_FEWER and not self._stop():
                fewer = fewer // 2 if self._fit_and_keep(fewer, "error", self._exponents) else 0
            if self._enlarges:
                self._grow()
        return self.best

    def _grow(self) -> None:
        """Fit more and more shapes to the enlarged drawing.

        A last fit fills the limit only if differences can still be seen at the drawing's own size.
        If none can be seen, only chance makes the last fit better. A larger limit, whose last fit
        has another count, could then end with a worse file.
        """
        large = self._enlarged()
        if large is None:
            return
        height, width = large.working.shape[:2]
        divisor = 2 if max(large.size) > 2 * max(self.subject.size) else 1
        solved = shrunk(large.working, height // divisor, width // divisor)
        self._large, self._solved = large.working, dataclasses.replace(large, working=solved)
        self._fitted = large
        self.best, idle = self._with_errors(self.best), 0
        for count in self._ladder():  # ends if the bytes suffice for no larger count
            if self._stop():
                return
            idle = 0 if self._fit_and_keep(count, "selective", self._exponents) else idle + 1
            if idle == MOST_IDLE:
                self._reason = "gain"
                return
        if psnr_of(self.best.error) < SEEN_UP_TO and not self._stop():
            self._fit_and_keep(self._count(self._exponents), "selective", self._exponents)

    def _enlarged(self) -> Subject | None:
        """Make the enlarged drawing by several fits. Return it, or None if the search is stopped.

        A large or reduced drawing is returned as it is.
        """
        own, (width, height) = self.subject, self.subject.size
        if own.size != own.canvas or max(own.size) > drawings.LARGEST_ENLARGED:
            return own
        times = drawings.enlargement(width, height)
        draw, renders = render_rgba if has_alpha(own.working) else render, []
        counts = AGREEING if times > 2 else AGREEING_LARGE
        for count, init in itertools.product(counts, ("selective", "error")):
            if self._stop():
                return None
            scene = self._fit(count, init, self._exponents)
            if not len(self.best.scene):  # so that a search that is stopped has a file with shapes
                self._keep(scene, self._exponents)
            renders.append(draw(scene, 4 * width, 4 * height, covering=True))
        return dataclasses.replace(own, working=drawings.agreed(own.working, renders, times))

    def _ladder(self) -> Iterator[int]:
        """Yield the counts of enlarged fits as far as the last file's bytes per shape allow."""
        count = float(FIRST_COUNT)
        while count <= self._count(self._exponents):
            yield round(count)
            count *= GROWTH

    def _costs(self) -> FitResult:
        """Return the costs of all fits, and the reason why they ended."""
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
        """Return whether the run is stopped or, after the first fit, out of time. Set `_reason`."""
        if self._run.stop():
            self._reason = "interrupted"
        elif self.fits and self._run.budget.must_export:
            self._reason = "time_limit"
        return bool(self._reason)

    def _expected(self, exponents: Exponents) -> float:
        """Return the expected bytes per shape, for use before a file has shapes."""
        gzipped = self._plan.counts_gzipped
        soft, plain, of_drawing = SHAPE_GZIPPED_BYTES if gzipped else SHAPE_BYTES
        return of_drawing if self.is_drawing else soft if exponents else plain

    def _count(self, exponents: Exponents) -> int:
        """Return the number of shapes to fit for the limit, by the bytes per shape so far."""
        expected = self._expected(exponents)
        each = self._each.get(exponents, expected)
        if not self.is_drawing:  # leaving out a photo's least useful shapes costs little
            each = min(each, expected)
        count = SPARE * self._shape_bytes / each - DEFINITION * len(exponents)
        return int(min(max(count, 1), self._most))

    def _fit_and_keep(self, count: int, init: str, exponents: Exponents, rate: float = 1.0) -> bool:
        """Fit `count` shapes, and return whether their file is the best so far."""
        return self._keep(self._fit(count, init, exponents, rate), exponents)

    def _keep(self, scene: Scene, exponents: Exponents) -> bool:
        """Write a fitted scene, and keep the file if it is the best. Return whether it is."""
        file, before = self._written(scene, exponents), self.best
        if file is not None:
            self.best = max(before, self._with_errors(file), key=closeness)
        return self.best is not before

    def _fit(self, count: int, init: str, exponents: Exponents, rate: float = 1.0) -> Scene:
        """Fit the working or the enlarged picture, and return the scene on the canvas."""
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
        # A plain ellipse keeps its fitted area, not its contour at half the opacity.
        plain = scene.drawn == PLAIN
        wider = covered_radius(scene.beta) / covered_radius(np.full(len(scene), MOST_BETA))
        sigma = scene.sigma * np.where(plain, wider, 1.0)[:, None]
        beta = np.where(plain, MOST_BETA, scene.beta)
        scene = scene.replace(width=width, height=height, beta=beta, sigma=sigma)
        return with_falloffs(scene, beta).replace(drawn=np.where(plain, PLAIN, SOFT))

    def _written(self, fitted: Scene, exponents: Exponents) -> SmallFile | None:
        """Write a scene by several grids and digits. Return the file with the closest model.

        Files that are too long lose the least useful Gaussians. Return None if none is left.
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
        return best

    def _file(self, scene: Scene, unit: float, digits: int, error: float = math.nan) -> SmallFile:
        svg = minimal_svg(scene, unit, digits, self.subject.document)
        return SmallFile(svg, scene, error, self._bytes_of(svg))

    def _with_errors(self, file: SmallFile) -> SmallFile:
        """Return the file with the error of its raster, and with that of its model enlarged.

        The enlarged file is not rasterised, because its masks would take seconds.
        """
        large, renderer, subject = self._large, self._plan.options.run.renderer, self.subject
        error = raster_error(file.svg, subject.working, renderer, subject.weight(subject.working))
        enlarged = math.nan
        if large is not None:
            enlarged = model_error(file.scene, large, True, subject.weight(large))
        return dataclasses.replace(file, error=error, enlarged_error=enlarged)


def with_few_exponents(scene: Scene, exponents: Exponents, soft_from: float) -> Scene:
    """Return the scene, each shape with the nearest of `exponents` or as a plain ellipse.

    soft_from  width in px of the narrowest rim that stays soft. A shape with a narrower rim becomes
               a plain ellipse, which is fitted by how much of each pixel it covers
    """
    classes = np.array([*exponents, BETA_CLASSES[-1]])
    nearest = np.abs(np.log(scene.beta)[:, None] - np.log(classes)).argmin(axis=1)
    plain = nearest == len(exponents)
    plain |= RIM_WIDTH * scene.ellipse_axes[0][:, 1] / scene.beta < soft_from
    scene = with_plain(scene, plain, classes[nearest])
    return scene.replace(drawn=np.where(plain, PLAIN, SOFT))
