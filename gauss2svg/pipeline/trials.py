"""Trials on a small picture: what some Gaussians save below, above or in place of areas."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.areas.find import FoundAreas
from gauss2svg.fit import GAUSSIAN, PSNR, FitConfig, FitOptions
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.target import Target
from gauss2svg.measure.roundtrip import model_psnr
from gauss2svg.photo.pixels import has_alpha, shrunk
from gauss2svg.pipeline.below import with_gaussians_below
from gauss2svg.pipeline.export import Exporter
from gauss2svg.pipeline.outcome import Export, Subject
from gauss2svg.pipeline.plan import SHAPE_BYTES, USUAL_BYTES, Plan
from gauss2svg.scene import ABOVE, Scene
from gauss2svg.scene.scene import PARAMETERS
from gauss2svg.svg import MINIMAL

# A trial fits this many Gaussians in so many steps, to a picture of at most so many px a side.
TRIED, TRIAL_STEPS, TRIAL_SIDE = 24, 80, 256
COUNTS_BELOW = 8, 24, 72  # numbers of Gaussians below areas that are tried, as long as they pay
MOST_TRIED = 1000
UNREFINED = 0.4  # share of their error that areas are expected to keep when they are refined
# If a trial leaves less than this share of the squared error, the picture has shading that areas
# only imitate.
SHADED = 0.85
FOR_GAUSSIANS = 0.8  # share of the bytes beside areas that Gaussians take, without definitions
# If the PSNR in dB between a drawing and its file is less than this, people can see differences at
# the drawing's own size (docs/decisions/areas.md).
SEEN_UP_TO = 41.0
LEAST_ROOM = 2  # Gaussians are fitted if a limit has room for at least this number
# Shapes alone are tried too if areas leave errors that can be seen, and a trial of as many bytes of
# shapes leaves less than SHAPES_ALONE times their squared error.
SHAPES_ALONE = 2.0
CLEARLY = 0.8  # the same for areas without shading, with Gaussians, whose error a trial tells
SHORT = 200  # shapes that are fitted if a run ends before it has found areas


@dataclass(frozen=True, eq=False)
class Trial:
    """Areas with Gaussians below them, their file, and what some Gaussians above would save.

    ground  scene of the areas, and of Gaussians below them if these pay
    error   squared error of this scene, summed over pixels and channels of the working picture
    saved   by how much Gaussians above lower it
    expected  squared error that is expected of the best file with these areas
    cost    value by which trials are compared: `expected`, to which the price of the bytes is added
            if there is no limit. Without shading it is divided by STRIPS
    shaded  whether the picture has shading that Gaussians draw better than areas
    is_met  whether the file reaches the target. False if there is none
    """

    found: FoundAreas
    ground: Scene
    export: Export
    error: float
    saved: float
    expected: float
    cost: float
    shaded: bool
    is_met: bool


class Trials:
    """Trials of areas and Gaussians, in the currency of squared error for bytes.

    plan     plan whose rate is the squared error that a byte must save
    fills    whether Gaussians fill a limit of bytes
    is_over  function that tells whether the run has to end
    values   numbers of the working picture
    most     largest number of Gaussians
    """

    def __init__(
        self, plan: Plan, subject: Subject, exporter: Exporter, fills: bool,
        is_over: Callable[[], bool],
    ) -> None:  # fmt: skip
        self._plan, self._subject, self._exporter = plan, subject, exporter
        self._limit, self._fills, self._is_over = plan.goal.byte_limit or math.inf, fills, is_over
        self._rate, self._price = plan.rate, plan.rate * plan.shape_bytes
        self._shapes_alone = dict[int, float]()  # squared error by the number of shapes
        width, height = subject.size
        share = min(1.0, TRIAL_SIDE / max(width, height))
        small = max(1, round(share * height)), max(1, round(share * width))
        self._small, self.values = shrunk(subject.working, *small), 3 * width * height
        self.most = math.inf if plan.goal.count is None else plan.goal.count
        if plan.sketch or plan.in_inks:
            self.most = 0  # they would draw errors along edges, which look like stains

    def trial(self, found: FoundAreas, count: int = TRIED) -> Trial:
        """Return areas with what `count` Gaussians below or above them are expected to save."""
        plan, subject, scene = self._plan, self._subject, scene_of(self._subject, found)
        height, width = self._small.shape[:2]
        count = int(min(count, self.most, height * width // 3))
        export, is_met = self._exporter.unscored(scene), False
        first = error = cost = self._error(scene)
        scene_of_areas = scene
        for below in COUNTS_BELOW if found.areas and not len(scene) else ():
            if self._is_over() or cost <= self._price * below or below > self.most:
                break
            tried = with_gaussians_below(scene_of_areas, self._small, below, self._is_over)
            tried_export, tried_error = self._exporter.unscored(tried), self._error(tried)
            if tried_export.size > self._limit or tried_error + self._price * below >= cost:
                break
            scene, export, error = tried, tried_export, tried_error
            cost = error + self._price * below
        if len(scene) > len(scene_of_areas):
            scene = without_idle(scene, self._error)
            found = dataclasses.replace(found, areas=scene.areas)
            export, error = self._exporter.unscored(scene), self._error(scene)
        if plan.aim is not None:
            is_met = plan.aim.is_met_by(
                plan.aim.score(self._exporter.raster(export.svg), subject.photo)
            )
        saved = 0.0
        if self._fills and found.areas:
            # As many Gaussians as the limit allows, beside their definitions.
            left = FOR_GAUSSIANS * (self._limit - export.size) / plan.shape_bytes
            count = int(min(max(left, 0), 6 * count))
        if count and error > self._price * count / 2:
            session = self._fitted(scene, count, self._is_over)
            saved = max(
                error - self.values * portable.power(10, -session.population.psnr() / 10), 0.0
            )
        price = count * self._price
        pays = saved > price
        if self._fills:
            cost = expected = error - saved
        else:
            expected = error - saved if pays else error
            cost = expected + self._rate * export.size + (price if pays else 0.0)
        is_shaded = error < first or error - saved < SHADED * error
        return Trial(found, scene, export, error, saved, expected, cost, is_shaded, is_met)

    def _fitted(self, ground: Scene, count: int, stop: Callable[[], bool]) -> FitSession:
        """Return a short fit of `count` Gaussians to the small picture, above a ground."""
        inks = self._plan.options.fit.inks
        options = FitOptions(tune=PSNR, falloff=GAUSSIAN if inks is None else None, inks=inks)
        config = FitConfig(gaussians=count, iterations=TRIAL_STEPS, fit=options)
        target = Target(self._small, PSNR, mask=self._subject.focus, ground=ground)
        session = FitSession(target, config, stop=stop)
        session.fit()
        return session

    def is_visible(self, error: float) -> bool:
        """Return whether people can see a squared error at the picture's own size."""
        return error > self.values * portable.power(10, -SEEN_UP_TO / 10)

    def _error(self, scene: Scene) -> float:
        """Return the squared error of a scene, measured on the small picture."""
        weight = self._subject.weight(self._small)
        return self.values * portable.power(10, -model_psnr(scene, self._small, weight) / 10)

    def shapes_win(self, size: float, error: float) -> bool:
        """Return whether shapes alone, in a file of so many bytes, may be closer than areas.

        error  squared error of the areas
        """
        if self._plan.prefers_areas:
            return False
        return self._error_of_shapes(size) < SHAPES_ALONE * error

    def _error_of_shapes(self, size: float) -> float:
        """Return the squared error that a trial of shapes leaves in a file of so many bytes."""
        size = self._limit if self._fills else size
        each = SHAPE_BYTES[1] if self._plan.markup == MINIMAL else USUAL_BYTES
        count = int(min(max(size / each, TRIED), MOST_TRIED))
        if count not in self._shapes_alone:
            shapes = self.trial(nothing(self._subject.working), count)
            self._shapes_alone[count] = shapes.error - shapes.saved
        return self._shapes_alone[count]

    def lose(self, found: FoundAreas, size: float) -> bool:
        """Return whether shapes alone are expected closer than areas without shading.

        Gaussians below and above these areas take the bytes that the strips of shading took.

        size  bytes of a file that has these strips
        """
        most = self._limit if self._fills else size
        left = most - self._exporter.unscored(scene_of(self._subject, found)).size
        count = int(min(max(left / self._plan.shape_bytes, TRIED), MOST_TRIED))
        trial = self.trial(found, count)
        # In a limit, Gaussians leave little but the errors of outlines, which are refined later.
        share = UNREFINED if self._fills else 1.0
        return CLEARLY * self._error_of_shapes(size) < share * (trial.error - trial.saved)

    def wants_gaussians(self, trial: Trial) -> bool:
        """Return whether Gaussians are fitted above the areas of a trial."""
        if len(trial.ground) >= self.most:
            return False
        if self._fills:
            room = self._limit - trial.export.size
            return room < 0 or room >= LEAST_ROOM * self._plan.shape_bytes
        if self._plan.aim is not None:
            return not trial.is_met
        return trial.saved > TRIED * self._price

    def in_short(self) -> Trial:
        """Return shapes alone, fitted in a fraction of a second for a run that ends now."""
        (width, height), (h, w) = self._subject.size, self._small.shape[:2]
        most = self._plan.goal.count or SHORT
        count = min(SHORT, most, self._limit / SHAPE_BYTES[0], h * w // 3)
        trial = self.trial(nothing(self._subject.working), 0)
        session = self._fitted(trial.ground, int(count), lambda: False)
        scene = session.scene().scaled(width / w, height / h).replace(width=width, height=height)
        export = self._exporter.unscored(scene)
        if export.size > self._limit:
            export = self._exporter.pruned(export, int(self._limit))
        return dataclasses.replace(trial, ground=export.scene, export=export)


def nothing(picture: NDArray[np.float32]) -> FoundAreas:
    """Return no areas, on the mean colour of a picture."""
    background = None if has_alpha(picture) else tuple(picture.mean(axis=(0, 1)).tolist())
    return FoundAreas((), background, 0.0, 0.0, 0.0, 0.0)


def without_idle(scene: Scene, error_of: Callable[[Scene], float]) -> Scene:
    """Return a scene without the areas without which its error is less.

    Such areas were strips of shading, which Gaussians draw now.
    """
    error = error_of(scene)
    for k in reversed(range(len(scene.areas))):
        areas, level = scene.areas[:k] + scene.areas[k + 1 :], scene.level
        rest = scene.replace(areas=areas, level=np.where(level > k, level - 1, level))
        if (left := error_of(rest)) < error:
            scene, error = rest, left
    return scene


def scene_of(subject: Subject, found: FoundAreas) -> Scene:
    """Return a scene of the areas, and of the Gaussians of a start that lie among them."""
    (width, height), start = subject.size, subject.start
    is_clear = found.background is None
    background = np.ones(3) if found.background is None else np.array(found.background)
    scene = Scene(width, height, background=background, transparent=is_clear, areas=found.areas)
    if start is None or (start.level == ABOVE).all():
        return scene
    below = start.select(start.level != ABOVE)
    below = below.scaled(width / start.width, height / start.height)
    shapes = {p.name: getattr(below, p.name) for p in PARAMETERS}
    return scene.replace(**{**shapes, "level": np.minimum(below.level, len(found.areas))})
