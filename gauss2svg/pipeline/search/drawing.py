"""The search for a drawing's file of limited bytes: ellipses that stay crisp when it is enlarged.

    drawing -> four fits -> what they agree on, up to four times as large -> fits of more and more
    ellipses, until the bytes are used or more no longer help -> the best of their files

Of two files the closer one is better, at the drawing's own size as long as the difference can be
seen there, and enlarged beyond that (`closeness`). Where it cannot be seen, the counts of the fits
do not depend on the limit, so that a larger limit has the files of a smaller one to choose from.

All constants: docs/decisions/enlarged.md.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator

import numpy as np

from gauss2svg.fit.losses import psnr_of
from gauss2svg.photo.alpha import has_alpha
from gauss2svg.pipeline.drawings import (
    agreed,
    enlargement,
    has_edges,
    is_drawing,
    is_shaded,
    may_enlarge,
)
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.search.by_bytes import ByBytes, nearest_exponents, reduced_to
from gauss2svg.pipeline.search.outcome import SEEN_UP_TO, Subject, Watch
from gauss2svg.pipeline.search.small_file import EXACT, Recipe, SmallFile, closeness
from gauss2svg.render import render, render_rgba
from gauss2svg.render.cpu import kernel_lock
from gauss2svg.scene import PLAIN, SOFT, Scene
from gauss2svg.scene.falloff import MOST_BETA, RIM_WIDTH, covered_radius
from gauss2svg.svg.blur import with_falloffs
from gauss2svg.svg.minimal_shapes import HEX_DIGITS
from gauss2svg.svg.plain_ellipse import drawn_beta

LARGE_SIDE = 1024  # longest side in px of the working picture of a larger drawing
FLAT_SIDE = 384  # longest side in px of the working picture of a drawing without smooth edges
ENLARGED_FROM = 2000  # bytes of a file from which a drawing is fitted enlarged
STEPS, STEPS_OF_THIN = 600, 200
THIN = 12  # px of a side or number of shapes under which fits with fewer shapes are not tried
AGREEING = (150, 300)  # shapes of the fits that enlarge a drawing
AGREEING_LARGE = (300,)  # the same for drawings over 256 px, whose fits take longer
OWN_UP_TO = 200  # shapes up to which fits at the drawing's own size are tried too
FIRST_COUNT, GROWTH = 160, 1.265  # shapes of the first enlarged fit, and the ratio to the next
IDLE = 2  # fits in a row whose files are no better, after which growth ends
SPARE = 1.03  # times the shapes that fit into the limit are fitted; the least useful are left out
LEAST_SHARE = 3.0  # shapes of a third of the usual bytes or less were mostly written as nothing
FEW, WELL_USED = 60, 0.97  # shapes and share of a limit from which more would have been written
SHARED = 0.1  # share of the squared error that colours in common may add
COARSE_UNDER = 1100  # bytes under which a digit is a large part of a shape
COARSE_GRIDS = (0.8, 1.2, 4.0, 8.0)
GRIDS, FINE_GRIDS, FINE_FROM = (4.0, 8.0), (8.0, 16.0), 6000  # bytes
SHADED_FROM = 6000  # bytes from which a drawing with shading has soft shapes beside ellipses
SOFT_FROM = 4.0  # px of rim from which a shape of a shaded drawing is soft


def search_by_bytes(
    plan: Plan,
    subject: Subject,
    watch: Watch,
    count: Callable[[str], int] | None = None,
) -> ByBytes:
    """Return the search that plans every byte: of a drawing if the photo is one.

    Arguments and errors are those of ByBytes.
    """
    flat = is_drawing(subject.photo) and plan.options.fit.learned_falloff
    return (DrawingByBytes if flat else ByBytes)(plan, subject, watch, count)


class DrawingByBytes(ByBytes):
    """A search for the best file of a drawing of at most the bytes of a plan."""

    is_drawing = True

    def file(self) -> SmallFile:
        """Return the best file."""
        best = self._files.without_gaussians()
        if best.error < EXACT or not self._most:
            return best
        self._each_shape = float(self._each[2])  # bytes, until files are measured
        is_small = self._most_shapes() <= OWN_UP_TO
        starts = 5 + 2 * is_small + len(list(self._ladder()))
        self._starts = starts if self._enlarges else 3
        with kernel_lock:
            if is_small or not self._enlarges:
                best = self._at_its_size(best)
            if not self._enlarges:
                return self._fewer(best)
            best, large = self._large_subject(best)
            if large is None:
                return best
            times = max(large.size) / max(self.subject.size)
            self._files.enlarge(large.working, 2 if times > 2 else 1)
            return self._grown(self._files.drawn(best), large)

    def _gained_little(self, best: SmallFile) -> bool:
        return len(best.scene) >= FEW and best.size < WELL_USED * self._limit

    def _reduced(self, subject: Subject) -> Subject:
        """Return the subject at the size at which a drawing is fitted first."""
        edges = has_edges(subject.photo)
        side = LARGE_SIDE if edges else FLAT_SIDE
        asked = self._plan.options.run.max_size or side
        subject = reduced_to(subject, min(asked, side), sharp=True)
        self._plain_limit = self._plan.plain_limit or self._limit
        self._is_thin = min(subject.size) < THIN
        self._enlarges = edges and self._plain_limit >= ENLARGED_FROM and not self._is_thin
        return subject

    def _recipe(self, init: str, grids: tuple[float, ...]) -> Recipe:
        """Return how a fit begins, with soft shapes if the drawing is shaded, and is written."""
        limit = self._plain_limit
        digits = HEX_DIGITS if limit < COARSE_UNDER else HEX_DIGITS[-1:]
        shades = limit >= SHADED_FROM and is_shaded(self.subject.working)
        steps = STEPS_OF_THIN if self._is_thin else STEPS
        exponents = self._exponents if shades else ()
        return Recipe(init, 1.0, steps, exponents, self._each[2], grids, digits, SHARED)

    def _at_its_size(self, best: SmallFile) -> SmallFile:
        """Return the best of a file and of those of two fits at the drawing's own size."""
        grids = COARSE_GRIDS if self._plain_limit < COARSE_UNDER else GRIDS
        for init in ("selective", "error"):
            if not self._stop():
                best = self._tried(best, self._most_shapes(), self._recipe(init, grids))[0]
        return best

    def _tried(
        self, best: SmallFile, count: int, recipe: Recipe, large: Subject | None = None
    ) -> tuple[SmallFile, SmallFile | None]:
        """Return the better of a file and of that of so many shapes, and the latter."""
        return self._better(best, self._ellipses(count, recipe, large), recipe)

    def _better(
        self, best: SmallFile, scene: Scene, recipe: Recipe
    ) -> tuple[SmallFile, SmallFile | None]:
        """Return the better of a file and of that of a fitted scene, and the latter."""
        file, (_, size) = self._files.of(scene, recipe, self._stop)
        each = (size - self.flat.size) / max(len(scene), 1)
        if each >= recipe.each / LEAST_SHARE:  # else most were written as nothing
            self._each_shape = each
        if file is None:
            return best, None
        file = self._files.drawn(file)
        return max(best, file, key=closeness), file

    def _fewer(self, best: SmallFile) -> SmallFile:
        """Return the best of a file and of those of half as many shapes, as long as they win.

        Edges that meet are drawn less exactly than they are fitted.
        """
        recipe = self._recipe("error", GRIDS)
        fewer = 0 if self._is_thin else len(best.scene) // 2
        while fewer >= THIN and not self._stop():
            best, file = self._tried(best, fewer, recipe)
            if file is not best:
                break
            fewer //= 2
        return best

    def _large_subject(self, best: SmallFile) -> tuple[SmallFile, Subject | None]:
        """Return the best file so far, and the drawing enlarged, None if the search is stopped.

        One that is large, or that is reduced, is not enlarged.
        """
        own, (width, height) = self.subject, self.subject.size
        if own.size != own.canvas or not may_enlarge(width, height):
            return best, own
        times = enlargement(width, height)
        draw, renders = render_rgba if has_alpha(own.working) else render, []
        for count in AGREEING if times > 2 else AGREEING_LARGE:
            for init in ("selective", "error"):
                if self._stop():
                    return best, None
                recipe = self._recipe(init, GRIDS)
                scene = self._ellipses(count, recipe)
                if not len(best.scene):  # of a search that is stopped here
                    best, _ = self._better(best, scene, recipe)
                renders.append(draw(scene, 4 * width, 4 * height, covering=True))
        picture = agreed(own.working, renders, times)
        return best, dataclasses.replace(own, working=picture)

    def _ladder(self) -> Iterator[int]:
        """Yield the counts of enlarged fits that the limit allows."""
        count = float(FIRST_COUNT)
        while count <= self._most_shapes():
            yield round(count)
            count *= GROWTH

    def _grown(self, best: SmallFile, large: Subject) -> SmallFile:
        """Return the best of a file and of those of more and more shapes, fitted enlarged.

        As many shapes as fill the limit are fitted only where the difference can be seen at the own
        size. Beyond that a fit of a count of its own ends better or worse by chance, and a larger
        limit, which does not try that count, could have a worse file.
        """
        grids = FINE_GRIDS if self._plain_limit >= FINE_FROM else GRIDS
        recipe, idle = self._recipe("selective", grids), 0
        for count in self._ladder():  # depends on the bytes of a shape in the files so far
            if self._stop() or idle == IDLE:
                return best
            best, file = self._tried(best, count, recipe, large)
            idle = 0 if file is best else idle + 1
        if psnr_of(best.error) < SEEN_UP_TO and not self._stop():
            best, _ = self._tried(best, self._most_shapes(), recipe, large)
        return best

    def _most_shapes(self) -> int:
        """Return how many shapes to fit for the limit, by what they take in the last file."""
        count = SPARE * max(self._limit - self.flat.size, 0) / self._each_shape
        return int(min(max(count, 1), self._most, math.prod(self.subject.size)))

    def _ellipses(
        self,
        count: int,
        recipe: Recipe,
        large: Subject | None = None,
    ) -> Scene:
        """Fit so many ellipses to the drawing, at its own size or enlarged, on its canvas."""
        enlarged = 1 if large is None else enlargement(*self.subject.size)
        scale = max((large or self.subject).size) / max(self.subject.size)

        def as_written(scene: Scene, _: float) -> Scene:
            return _crisp(scene, recipe.exponents, SOFT_FROM * scale)

        scene = self._fitted(count, recipe, as_written, large, enlarged)
        # A plain ellipse of the area that was fitted, not of the contour of half height.
        plain = scene.drawn == PLAIN
        wider = covered_radius(scene.beta) / covered_radius(np.full(len(scene), MOST_BETA))
        sigma = scene.sigma * np.where(plain, wider, 1.0)[:, None]
        beta = np.where(plain, MOST_BETA, scene.beta)
        scene = with_falloffs(scene.replace(beta=beta, sigma=sigma), beta)
        return scene.replace(drawn=np.where(plain, PLAIN, SOFT))


def _crisp(scene: Scene, exponents: tuple[float, ...], soft_from: float) -> Scene:
    """Return the scene with the nearest of these exponents, and all other shapes plain ellipses.

    A shape whose rim is narrower than soft_from px is an edge, and becomes a plain ellipse too.
    From here on plain ellipses are fitted by how much of each pixel they cover.
    """
    beta, plain = nearest_exponents(scene, exponents)
    plain |= RIM_WIDTH * scene.ellipse_axes[0][:, 1] / scene.beta < soft_from
    beta[plain] = drawn_beta(scene, plain)
    return with_falloffs(scene, beta).replace(drawn=np.where(plain, PLAIN, SOFT))
