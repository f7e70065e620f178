"""The search by bytes: files of some hundred bytes to some thousand, each byte of them planned.

    photo -> working picture of 96 to 256 px -> a few fits of as many opaque shapes as the bytes
    allow, with few exponents -> small files -> the best raster that fits

Kodak 20, 768 x 512 px, in 250 bytes. A file without Gaussians has 98, and the other 152 bytes are
3 plain ellipses of about 44, fitted at 96 x 64 px. Each fit is written in units of two sizes, with
colours of 3 and of 6 digits; the file that is best by the model is drawn:

    fit                         bytes in units of 17 px; of 12 px    drawn
    3 plain ellipses            231, 243; 238, 250                   243 bytes, 17.92 dB
    1 shape of exponent 3       452, 458; 452, 458                   none: its mask is too long
    3 ellipses in wider steps   230, 242; 237, 249                   249 bytes, 18.04 dB: the best

    <svg xmlns=".." viewBox="0 0 66 44"><path fill="#c3b8a0" d="M0 0h66v44H0"/>
    <path fill="#504c34" d="M86 27a93 10-1.8 101 0"/>
    <path fill="#fbf9e8" d="M1-19a91 20 7.2 101 0"/>
    <path fill="#736031" d="M11 18a10 4 32 101 0"/></svg>

All constants: docs/decisions/small.md.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.options import DensifyOptions, FitConfig, FitProgress, FitResult
from gauss2svg.fit.session import AsWritten, FitSession
from gauss2svg.measure.roundtrip import round_trip
from gauss2svg.photo.alpha import has_alpha, shrunk
from gauss2svg.pipeline.plan import WHOLE_SIDE, Plan
from gauss2svg.pipeline.presets import MINIMAL_BYTES, MINIMAL_GZIPPED_BYTES
from gauss2svg.pipeline.search.outcome import Outcome, Subject, Watch
from gauss2svg.pipeline.search.small_file import EXACT, Recipe, SmallFile, SmallFiles, closeness
from gauss2svg.render.cpu import kernel_lock
from gauss2svg.scene import PLAIN, SOFT, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, MOST_BETA
from gauss2svg.svg.blur import with_falloffs
from gauss2svg.svg.plain_ellipse import drawn_beta

# The fits of small files of photos (docs/decisions/small.md).
SIDE_PER_ROOT = 12.0  # longest side of the working picture in px, per square root of the count
LEAST_SIDE = 96  # least longest side of the working picture in px
# Ratio by which shapes may turn out shorter than expected. If they seem shorter, most were
# written as nothing.
SHORTER = 3.0
PLAIN_UNDER = 900  # bytes under which every second fit has plain ellipses alone, like cut paper
SOME = 60  # shapes up to which there are three fits on two grids, and beyond two on one
ITERATIONS = 200  # steps of a fit

_GRIDS = (0.8, 1.2)  # finer and coarser than units_per_root
# Placement and learning rate of each fit to a photo.
_BEGINNINGS = ("selective", 1.0), ("error", 1.0), ("selective", 1.5)
# Exponents that are worth their definition in a file of so many bytes; plain ellipses need none.
EXPONENTS: tuple[tuple[int, tuple[float, ...]], ...] = (
    (6000, BETA_CLASSES),
    (2200, (1.0, 3.0)),
    (0, (3.0,)),
)


class ByBytes:
    """A search for the best file of at most the bytes of a plan, for a photo.

    subject  of which the photo is reduced further for the fits
    count    bytes of a file's text; None: of the file itself
    Raises InputError where a file without Gaussians has more bytes.
    """

    is_drawing = False

    def __init__(
        self,
        plan: Plan,
        subject: Subject,
        watch: Watch,
        count: Callable[[str], int] | None = None,
    ) -> None:
        assert plan.goal.byte_limit is not None
        self._plan, self._watch, self._limit = plan, watch, plan.goal.byte_limit
        self._options = plan.options.fit
        caps = [plan.goal.count] if plan.goal.count is not None else []
        caps += [plan.preset.cap] if plan.options.goal.quality is not None else []
        self._most = min(caps, default=math.inf)
        self._each = MINIMAL_GZIPPED_BYTES if plan.counts_gzipped else MINIMAL_BYTES
        self._files = SmallFiles(plan, subject, count, covering=self.is_drawing)
        self.subject = self._files.subject = self._reduced(subject)
        self.fits: list[FitResult] = []
        self._starts = 1  # number of fits, for the progress
        self._ended = ""  # why no further step is made
        self._all_pixels = False  # whether a fit has as many shapes as its picture has pixels

    @property
    def flat(self) -> SmallFile:
        """The shortest file without Gaussians."""
        return self._files.flat

    def run(self) -> Outcome:
        """Return the best file, measured."""
        plan, subject = self._plan, self.subject
        best = self.file()
        self._watch.report("measure", None)
        subject.release()
        image = subject.working if self._watch.budget.measures_small else subject.photo
        return Outcome(
            plan=plan,
            subject=subject,
            scene=best.scene,
            svg=best.svg,
            format=plan.svg_format,
            reached=None,
            fitted=self._costs(best),
            measured=round_trip(
                best.svg, best.scene, image, plan.options.run.renderer, self.is_drawing
            ),
            corrections=max(len(self.fits) - 1, 0),
            enlarged=self._files.large,
        )

    def file(self) -> SmallFile:
        """Return the best file."""
        best = self._files.without_gaussians()
        if best.error < EXACT:
            return best
        # The size of the first fit with some exponents tells what a shape takes in the next one.
        sizes: dict[tuple[float, ...], tuple[int, int]] = {}
        with kernel_lock:
            recipes = self._recipes()
            self._starts = len(recipes)
            for recipe in recipes:
                count = self._count(recipe, sizes.get(recipe.exponents))
                if count < 1 or self._stop():
                    continue
                fitted = self._fit(count, recipe)
                file, sizes[recipe.exponents] = self._files.of(fitted, recipe, self._stop)
                if file is not None:
                    best = max(best, self._files.drawn(file), key=closeness)
        return best

    def _gained_little(self, best: SmallFile) -> bool:
        """Whether more shapes would help too little to be worth the rest of the limit."""
        return False

    def _reduced(self, subject: Subject) -> Subject:
        """Return the subject with a working picture for as many shapes as the bytes allow."""
        count = max((self._limit - self.flat.size) / self._each[0], 1)
        most = self._plan.options.run.max_size or WHOLE_SIDE
        side = SIDE_PER_ROOT * math.sqrt(count)
        return reduced_to(subject, min(max(side, LEAST_SIDE), WHOLE_SIDE, most))

    def _costs(self, best: SmallFile) -> FitResult:
        """Return the costs of all fits, and why they ended."""
        reason = self._ended or "max_bytes"
        if not self._ended and best.error < EXACT:
            reason = "enough"
        elif not self._ended and self._gained_little(best):
            reason = "gain"
        elif not self._ended and len(best.scene) == self._plan.goal.count:
            reason = "gaussians"
        elif not self._ended and self._all_pixels:
            reason = "cap"
        costs = FitResult(best.scene, 0, 0, 0.0, 0.0, 0, reason)
        for fitted in self.fits:
            costs = dataclasses.replace(fitted.after(costs, reason), rounds=fitted.rounds)
        return costs

    def _stop(self) -> bool:
        if not self._ended and self._watch.stop():
            self._ended = "interrupted"
        if not self._ended and self.fits and self._watch.budget.is_over:  # the first makes a file
            self._ended = "time_limit"
        return bool(self._ended)

    @property
    def _exponents(self) -> tuple[float, ...]:
        return next(exponents for least, exponents in EXPONENTS if self._limit >= least)

    def _recipes(self) -> list[Recipe]:
        """Return the fits to make."""
        soft, plain, _ = self._each
        few = (self._limit - self.flat.size) / soft <= SOME
        grids = _GRIDS if few else (1.0,)
        exponents, learned = (1.0,), self._options.learned_falloff
        if learned:
            exponents = self._exponents
        recipes = []
        for k, (init, rate) in enumerate(_BEGINNINGS if few else _BEGINNINGS[:2]):
            is_plain = k % 2 == 0 and learned and self._limit < PLAIN_UNDER
            classes, each = ((), plain) if is_plain else (exponents, soft)
            recipes.append(Recipe(init, rate, ITERATIONS, classes, each, grids))
        return recipes

    def _count(self, recipe: Recipe, earlier: tuple[int, int] | None) -> int:
        """Gaussians that the bytes allow; earlier is (count, bytes) of a file of its exponents."""
        count, size = earlier or (0, 0)
        expected = recipe.each
        each = (size - self.flat.size) / max(count, 1)
        if each >= expected / SHORTER:
            by_bytes = count + (self._limit - size) / min(each, expected)
        else:
            # One shape of each exponent: what defines an exponent takes more than a shape.
            one = np.ones(len(recipe.exponents))
            probe = Scene(
                100, 100, np.full((len(one), 2), 50.0), np.full((len(one), 2), 20.0), 0 * one,
                np.full((len(one), 3), 0.4), one, beta=np.array(recipe.exponents),
            )  # fmt: skip
            by_bytes = len(one) + (self._limit - self._files.bytes_of(probe)) / expected
        pixels = math.prod(self.subject.size)
        self._all_pixels |= by_bytes >= pixels
        # Whether one fits is seen when it is written.
        return int(min(max(by_bytes, 1), self._most, pixels))

    def _fit(self, count: int, recipe: Recipe) -> Scene:
        """Fit so many shapes, on the photo's canvas; plain ellipses have MOST_BETA too."""

        def as_written(scene: Scene, _: float) -> Scene:
            return _with_few_exponents(scene, recipe.exponents)

        scene = self._fitted(count, recipe, as_written)
        plain = np.ones(len(scene), bool)  # exponents are stepped as logarithms
        for beta in recipe.exponents:
            plain &= ~np.isclose(scene.beta, beta)
        scene = with_falloffs(scene, np.where(plain, MOST_BETA, scene.beta))
        return scene.replace(drawn=np.where(plain, PLAIN, SOFT))

    def _fitted(
        self,
        count: int,
        recipe: Recipe,
        as_written: AsWritten,
        subject: Subject | None = None,
        enlarged: int = 1,
    ) -> Scene:
        """Return the scene of a fit to the working picture of a subject, on the photo's canvas.

        subject   None: that of the search
        enlarged  see FitConfig
        """
        options, subject = self._options, subject or self.subject
        config = FitConfig(
            gaussians=count,
            iterations=options.iterations or recipe.iterations,
            fit=dataclasses.replace(
                options,
                tune=self._plan.tune,
                learning_rate=options.learning_rate * recipe.rate,
            ),
            densify=DensifyOptions(init=recipe.init),  # pyright: ignore[reportArgumentType]
            reduce=False,
            opaque=not has_alpha(subject.working),
            enlarged=enlarged,
        )

        def progress(now: FitProgress) -> None:
            start = min(len(self.fits), self._starts - 1)
            later = (self._starts - 1 - start) * (now.elapsed_s + now.remaining_s)
            rest, done = now.remaining_s + later, (start + now.done) / self._starts
            self._watch.report("fit", dataclasses.replace(now, done=done, remaining_s=rest))

        session = FitSession(
            subject.working,
            config,
            progress=progress,
            as_written=as_written,
            stop=self._stop,
            targets=subject.targets(self._plan.tune),
        )
        session.fit()
        self.fits.append(session.result())
        scene, (width, height) = session.scene(), subject.canvas
        scene = scene.scaled(width / scene.width, height / scene.height)
        return scene.replace(width=width, height=height)


def reduced_to(subject: Subject, side: float, sharp: bool = False) -> Subject:
    """Return the subject with a working picture of at most this longest side in px.

    sharp is as in `gauss2svg.photo.alpha.shrunk`.
    """
    photo, (width, height) = subject.photo, subject.canvas
    scale = min(side, max(photo.shape[:2])) / max(width, height)
    width, height = (max(1, round(length * scale)) for length in (width, height))
    return dataclasses.replace(subject, working=shrunk(photo, height, width, sharp))


def nearest_exponents(
    scene: Scene, exponents: tuple[float, ...]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the nearest of these exponents for each shape, and which are a plain ellipse's."""
    classes = np.array([*exponents, BETA_CLASSES[-1]])
    nearest = np.abs(np.log(scene.beta)[:, None] - np.log(classes)).argmin(axis=1)
    return classes[nearest], nearest == len(exponents)


def _with_few_exponents(scene: Scene, exponents: tuple[float, ...]) -> Scene:
    """Return the scene with the nearest of these exponents, or that of a plain ellipse."""
    beta, plain = nearest_exponents(scene, exponents)
    beta[plain] = drawn_beta(scene, plain)
    return with_falloffs(scene, beta)
