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
from dataclasses import dataclass

import numpy as np

from gauss2svg.fit.options import DensifyOptions, FitConfig, FitProgress, FitResult
from gauss2svg.fit.session import FitSession
from gauss2svg.measure.roundtrip import round_trip
from gauss2svg.photo.alpha import has_alpha, shrunk
from gauss2svg.pipeline.bytes_each import MINIMAL, MINIMAL_GZIPPED
from gauss2svg.pipeline.drawings import has_edges, is_drawing, is_shaded
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.search.enlarged import enlarged, large_raster, may_enlarge
from gauss2svg.pipeline.search.outcome import Outcome, Watch
from gauss2svg.pipeline.search.small_file import EXACT, SmallFile, SmallFiles, Writing
from gauss2svg.pipeline.search.subject import Subject
from gauss2svg.render.cpu import kernel_lock
from gauss2svg.scene import PLAIN, SOFT, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, MOST_BETA, RIM_WIDTH, covered_radius
from gauss2svg.svg.minimal.shapes import HEX_DIGITS
from gauss2svg.svg.plain_ellipse import drawn_beta
from gauss2svg.svg.snap import with_falloffs


@dataclass(frozen=True)
class ByBytesTuning:
    """The fits of small files (docs/decisions/small.md).

    side_per_root       longest side of the working picture in px, per square root of the count
    least_side          that side at least
    most_side           that side at most
    drawing_side        that side of a drawing
    shorter             times shorter that shapes may turn out; where they seem shorter most were
                        written as nothing
    plain_under         bytes under which every second fit has plain ellipses alone, like cut paper
    coarse_under        bytes under which a digit is a large part of a drawing's shape
    some                shapes up to which there are three fits on two grids, beyond two on one
    iterations          steps of a fit
    drawing_iterations  steps of a fit to a drawing
    few_of_drawing      shapes or px of a side, under which half as many shapes are not tried
    shared_by_drawing   share of the squared error that colours in common may add to a drawing
    shaded_from         bytes from which a drawing with shading has soft shapes beside ellipses
                        (docs/decisions/enlarged.md)
    soft_from           px of rim across the minor axis, of the picture that is fitted, from which a
                        shape of a shaded drawing is soft (docs/decisions/enlarged.md)
    """

    side_per_root: float = 12.0
    least_side: int = 96
    most_side: int = 256
    drawing_side: int = 384
    shorter: float = 3.0
    plain_under: int = 900
    coarse_under: int = 1100
    some: int = 60
    iterations: int = 200
    drawing_iterations: int = 600
    few_of_drawing: int = 12
    shared_by_drawing: float = 0.1
    shaded_from: int = 6000
    soft_from: float = 4.0


TUNING = ByBytesTuning()

_GRIDS = (0.8, 1.2)  # finer and coarser than units_per_root
_DRAWING_GRIDS = (4.0, 8.0)  # of drawings, whose edges need more exact numbers
# Placement and learning rate of each fit to a photo.
_BEGINNINGS = ("selective", 1.0), ("error", 1.0), ("selective", 1.5)
# Exponents that are worth their definition in a file of so many bytes; plain ellipses need none.
_EXPONENTS: tuple[tuple[int, tuple[float, ...]], ...] = (
    (6000, BETA_CLASSES),
    (2200, (1.0, 3.0)),
    (0, (3.0,)),
)


@dataclass(frozen=True)
class Recipe:
    """A fit: how it begins, what shapes it has, and how its file is written.

    init, rate  placement and learning rate
    exponents   of soft shapes; others are plain ellipses
    """

    init: str
    rate: float
    iterations: int
    exponents: tuple[float, ...]
    writing: Writing


class ByBytes:
    """A search for the best file of at most the bytes of a plan.

    subject  of which the photo is reduced further for the fits
    count    bytes of a file's text; None: of the file itself
    Raises InputError where a file without Gaussians has more bytes.
    """

    def __init__(
        self,
        plan: Plan,
        subject: Subject,
        watch: Watch,
        count: Callable[[str], int] | None = None,
    ) -> None:
        assert plan.byte_limit is not None
        self._plan, self._watch, self._limit = plan, watch, plan.byte_limit
        self._options = plan.options.fit
        caps = [plan.count] if plan.count is not None else []
        caps += [plan.preset.cap] if plan.options.goal.quality is not None else []
        self._most = min(caps, default=math.inf)
        self._each = MINIMAL_GZIPPED if plan.counts_gzipped else MINIMAL
        self.is_drawing = is_drawing(subject.photo) and self._options.learned_falloff
        self._files = SmallFiles(plan, subject, count, covering=self.is_drawing)
        self._files.subject = self._fitted = self._reduced(subject)
        self.fits: list[FitResult] = []
        self._ended = ""  # why no further step is made

    def _reduced(self, subject: Subject) -> Subject:
        """The subject with a working picture for as many shapes as the bytes allow."""
        photo, (width, height), tuning = subject.photo, subject.canvas, TUNING
        count = max((self._limit - self.flat.size) / self._each[0], 1)
        low, high = tuning.least_side, tuning.most_side
        if self.is_drawing:
            low = high = tuning.drawing_side
        most = self._plan.options.run.max_size or high
        side = min(max(tuning.side_per_root * math.sqrt(count), low), high, most)
        side = min(side, max(photo.shape[:2]))
        scale = side / max(width, height)
        width, height = (max(1, round(length * scale)) for length in (width, height))
        return dataclasses.replace(subject, working=shrunk(photo, height, width))

    @property
    def subject(self) -> Subject:
        """The photo, with the picture that the present fits run on."""
        return self._files.subject

    @property
    def flat(self) -> SmallFile:
        """The shortest file without Gaussians."""
        return self._files.flat

    def run(self) -> Outcome:
        """The best file found, measured."""
        plan, subject = self._plan, self._fitted
        found = self.file()
        self._watch.report("measure", None)
        costs = self._costs(found)
        image = subject.working if self._watch.budget.measures_small else subject.photo
        return Outcome(
            plan=plan,
            working=subject.working,
            scene=found.scene,
            svg=found.svg,
            format=plan.svg_format,
            reached=None,
            fitted=costs,
            measured=round_trip(
                found.svg, found.scene, image, plan.options.run.renderer, self.is_drawing
            ),
            corrections=max(len(self.fits) - 1, 0),
            enlarged=None if self.subject is subject else self.subject.working,
        )

    def file(self) -> SmallFile:
        """The best file found."""
        best = self._files.without_gaussians()
        if best.error < EXACT:
            return best
        # The size of the first fit with some exponents tells what a shape takes in the next one.
        sizes: dict[tuple[float, ...], tuple[int, int]] = {}
        files: list[SmallFile] = []
        enlarges = self._enlarges
        with kernel_lock:
            recipes = self._recipes()
            starts = len(recipes) + enlarges
            for start, recipe in enumerate(recipes):
                count = self._count(recipe, sizes.get(recipe.exponents))
                if count < 1 or self._stop():
                    continue
                found, sizes[recipe.exponents] = self._made(count, recipe, start, starts)
                files += [] if found is None else [found]
                best = _better(best, found)
            # Edges that meet are drawn less exactly than they are fitted; thin pictures have few.
            fewer = len(best.scene) // 2 if self.is_drawing and not self._is_thin else 0
            while fewer >= TUNING.few_of_drawing and not self._stop():
                found, _ = self._made(fewer, recipes[-1], len(recipes) - 1, starts)
                if found is None or found.error >= best.error:
                    break
                best, fewer = found, fewer // 2
            if enlarges and files and best.error >= EXACT and not self._stop():
                self._enlarge(files)
                count = self._count(recipes[0], sizes[recipes[0].exponents])
                found, _ = self._made(count, recipes[0], starts - 1, starts)
                best = _better(self._files.drawn(best), found)
        return best

    @property
    def _enlarges(self) -> bool:
        """Whether the drawing is fitted once more, at twice its size."""
        fitted = self._fitted
        return (
            self.is_drawing
            and fitted.size == fitted.canvas  # a larger photo has its own pixels between these
            and may_enlarge(*fitted.size, self._limit)
            and has_edges(fitted.working)
        )

    def _enlarge(self, files: list[SmallFile]) -> None:
        """Go on with the picture enlarged, as the files of these fits show it."""
        picture, renderer = self._fitted.working, self._plan.options.run.renderer
        large = enlarged(picture, [large_raster(f.svg, picture, renderer) for f in files])
        self._files.subject = dataclasses.replace(self._fitted, working=large)

    def _costs(self, found: SmallFile) -> FitResult:
        """The costs of all fits, and why they ended."""
        reason = self._ended or "max_bytes"
        if not self._ended and found.error < EXACT:
            reason = "enough"
        elif not self._ended and len(found.scene) == self._plan.count:
            reason = "gaussians"
        costs = FitResult(found.scene, 0, 0, 0.0, 0.0, 0, reason)
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
    def _is_thin(self) -> bool:
        return min(self.subject.size) < TUNING.few_of_drawing

    def _made(
        self, count: int, recipe: Recipe, start: int, starts: int
    ) -> tuple[SmallFile | None, tuple[int, int]]:
        """The best file of a fit of so many shapes, with its drawn error; see SmallFiles.of."""
        fitted = self._fit(count, recipe, start, starts)
        found, whole = self._files.of(fitted, recipe.writing, self._stop)
        return (None if found is None else self._files.drawn(found)), whole

    def _recipes(self) -> list[Recipe]:
        """The fits to make."""
        return self._drawing_recipes() if self.is_drawing else self._photo_recipes()

    def _drawing_recipes(self) -> list[Recipe]:
        grids, digits = _DRAWING_GRIDS, HEX_DIGITS[-1:]
        if self._limit < TUNING.coarse_under:
            grids, digits = _GRIDS + grids, HEX_DIGITS
        writing = Writing(self._each[2], grids, digits, TUNING.shared_by_drawing)
        steps = TUNING.iterations if self._is_thin else TUNING.drawing_iterations
        shades = self._limit >= TUNING.shaded_from and is_shaded(self._fitted.working)
        exponents = self._exponents if shades else ()
        return [Recipe(init, 1.0, steps, exponents, writing) for init in ("selective", "error")]

    @property
    def _exponents(self) -> tuple[float, ...]:
        return next(exponents for least, exponents in _EXPONENTS if self._limit >= least)

    def _photo_recipes(self) -> list[Recipe]:
        soft, plain, _ = self._each
        few = (self._limit - self.flat.size) / soft <= TUNING.some
        grids = _GRIDS if few else (1.0,)
        exponents, learned = (1.0,), self._options.learned_falloff
        if learned:
            exponents = self._exponents
        recipes = []
        for k, (init, rate) in enumerate(_BEGINNINGS if few else _BEGINNINGS[:2]):
            is_plain = k % 2 == 0 and learned and self._limit < TUNING.plain_under
            classes, each = ((), plain) if is_plain else (exponents, soft)
            writing = Writing(each, grids)
            recipes.append(Recipe(init, rate, TUNING.iterations, classes, writing))
        return recipes

    def _count(self, recipe: Recipe, earlier: tuple[int, int] | None) -> int:
        """Gaussians that the bytes allow; earlier is (count, bytes) of a file of its exponents."""
        count, size = earlier or (0, 0)
        expected = recipe.writing.each
        each = (size - self.flat.size) / max(count, 1)
        if each >= expected / TUNING.shorter:
            by_bytes = count + (self._limit - size) / min(each, expected)
        else:
            # One shape of each exponent: what defines an exponent takes more than a shape.
            one = np.ones(len(recipe.exponents))
            probe = Scene(
                100, 100, np.full((len(one), 2), 50.0), np.full((len(one), 2), 20.0), 0 * one,
                np.full((len(one), 3), 0.4), one, beta=np.array(recipe.exponents),
            )  # fmt: skip
            by_bytes = len(one) + (self._limit - self._files.bytes_of(probe)) / expected
        # Whether one fits is seen when it is written.
        return int(min(max(by_bytes, 1), self._most, math.prod(self.subject.size)))

    def _fit(self, count: int, recipe: Recipe, start: int, starts: int) -> Scene:
        """A fit of so many shapes, on the photo's canvas; plain ellipses have MOST_BETA too."""
        options, subject = self._options, self.subject
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
        )

        def progress(now: FitProgress) -> None:
            rest = now.remaining_s + (starts - 1 - start) * (now.elapsed_s + now.remaining_s)
            done = (start + now.done) / starts
            self._watch.report("fit", dataclasses.replace(now, done=done, remaining_s=rest))

        session = FitSession(
            subject.working,
            config,
            progress=progress,
            as_written=lambda scene, _: _with_few_exponents(
                scene, recipe.exponents, self.is_drawing
            ),
            stop=self._stop,
            targets=subject.targets(self._plan.tune),
        )
        session.fit()
        self.fits.append(session.result())
        scene = session.scene()
        plain = scene.drawn == PLAIN
        if not self.is_drawing:
            plain = np.ones(len(scene), bool)  # exponents are stepped as logarithms
            for beta in recipe.exponents:
                plain &= ~np.isclose(scene.beta, beta)
        width, height = subject.canvas
        scene = scene.scaled(width / scene.width, height / scene.height)
        if self.is_drawing:  # of the area that was fitted, not of the contour of half height
            most = np.full(len(scene), MOST_BETA)
            wider = covered_radius(scene.beta) / covered_radius(most)
            sigma = scene.sigma * np.where(plain, wider, 1.0)[:, None]
            scene = scene.replace(beta=np.where(plain, MOST_BETA, scene.beta), sigma=sigma)
        scene = with_falloffs(scene, np.where(plain, MOST_BETA, scene.beta))
        return scene.replace(width=width, height=height, drawn=np.where(plain, PLAIN, SOFT))


def _better(best: SmallFile, found: SmallFile | None) -> SmallFile:
    return min(best, found or best, key=lambda file: (file.error, file.size))


def _with_few_exponents(
    scene: Scene, exponents: tuple[float, ...], covering: bool = False
) -> Scene:
    """The scene with the nearest of these exponents, or that of a plain ellipse.

    covering: these are fitted by how much of each pixel they cover from here on, and so is every
    shape whose rim is an edge's, for small ones have no large exponents.
    """
    classes = np.array([*exponents, BETA_CLASSES[-1]])
    logs = np.log(classes)
    nearest = np.abs(np.log(scene.beta)[:, None] - logs).argmin(axis=1)
    plain = nearest == len(exponents)
    if covering:
        plain |= RIM_WIDTH * scene.ellipse_axes[0][:, 1] / scene.beta < TUNING.soft_from
    beta = classes[nearest]
    beta[plain] = drawn_beta(scene, plain)
    scene = with_falloffs(scene, beta)
    return scene.replace(drawn=np.where(plain, PLAIN, SOFT)) if covering else scene
