"""The subject and the outcome of a search, and the choice of the best of several outcomes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, refusal
from gauss2svg.fit import FitResult, Tune
from gauss2svg.fit.target import Target
from gauss2svg.measure import metrics
from gauss2svg.measure.roundtrip import RoundTrip
from gauss2svg.photo.pixels import Focus, shrunk, stacked
from gauss2svg.pipeline.plan import Plan
from gauss2svg.render.cpu import splats_of
from gauss2svg.scene import ABOVE, Scene
from gauss2svg.svg import Document, SvgFormat

if TYPE_CHECKING:
    from gauss2svg.areas.find import FoundAreas


@dataclass(frozen=True, eq=False)
class Subject:
    """A photo in the sizes that a search needs, and the canvas and settings of the file to write.

    photo     photo with which files are compared, (h, w, 3) or (h, w, 4) float32 in 0..1
    working   image that a fit runs on: the photo, perhaps reduced
    canvas    width and height in px of the file. They are those of the photo before it was reduced
    document  document settings of the file
    focus     mask of the part of the photo where detail matters, None if the user gives no mask
    start     scene whose shapes a search by count refines. None: the search fits new shapes
    ground    areas, and Gaussians among them, on the working canvas, below the shapes of the fits.
              None: there are none
    """

    photo: NDArray[np.float32]
    working: NDArray[np.float32]
    canvas: tuple[int, int]
    document: Document = Document()
    focus: Focus | None = None
    start: Scene | None = None
    ground: Scene | None = None
    _targets: dict[Tune, Target] = field(default_factory=dict, init=False)

    @classmethod
    def of(cls, photo: NDArray[np.float32], canvas: tuple[int, int] | None = None) -> Self:
        """Return a subject that is fitted at the photo's size.

        canvas  width and height in px of the file. None: those of the photo
        """
        return cls(photo, photo, canvas or photo.shape[1::-1])

    def reduced(self, pixels: float) -> Self:
        """Return a subject that is fitted on at most so many pixels."""
        share = math.sqrt(pixels / math.prod(self.size))
        if share >= 1:
            return self
        height, width = (max(1, round(share * side)) for side in self.working.shape[:2])
        return dataclasses.replace(self, working=shrunk(self.working, height, width, sharp=True))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in px of the image that a fit runs on."""
        return self.working.shape[1::-1]

    def target(self, tune: Tune) -> Target:
        """Return the target of fits to the working image.

        The target for a value of `tune` is made in the first call with this value. Later calls
        return the same target again.
        """
        if tune not in self._targets:
            self._targets[tune] = Target(self.working, tune, mask=self.focus, ground=self.ground)
        return self._targets[tune]

    def weight(self, picture: NDArray[np.float32]) -> NDArray[np.float32] | None:
        """Return the weight (h, w) that the mask gives to the error of each pixel of a picture.

        Return None if there is no mask.
        """
        return None if self.focus is None else self.focus.weight(*picture.shape[:2])

    def psnr(self, raster: NDArray[np.float32], picture: NDArray[np.float32]) -> float:
        """Return the PSNR in dB of a raster against a picture, whose errors a mask weights.

        If the picture has alpha, both are compared over white and over black.
        """
        return metrics.psnr(stacked(raster), stacked(picture), self.weight(picture))

    def by_usefulness(self, scene: Scene, tune: Tune) -> NDArray[np.intp]:
        """Return the indices of a scene's shapes, from the most to the least useful.

        The most useful shape is the one without which the weighted error against the working image
        would rise most.
        """
        target = self.target(tune)
        scale = target.width / scene.width, target.height / scene.height
        above = np.flatnonzero(scene.level == ABOVE)
        cost = target.removal_cost(splats_of(scene.select(above), scale))[1][:, 0]
        among = np.flatnonzero(scene.level != ABOVE)  # they belong to the ground
        return np.concatenate([among, above[np.argsort(-cost, kind="stable")]])

    def release(self) -> None:
        """Free the memory of the targets of fits. Call this after the last fit."""
        self._targets.clear()


@dataclass(frozen=True, eq=False)
class Export:
    """A quantised scene on the canvas of the file, and the SVG that shows it.

    size   number of bytes of the file, or of the gzipped file if the limit counts those
    score  value by which a search compares exports. With an aim, it is the aim's score of the
           rasterised SVG. Without one, it is a PSNR in dB against the working image: usually that
           of the fitted scene, after a start that of `scene`, and in a search by bytes that of
           `scene` and then of the raster. It is NaN if it is not measured
    """

    scene: Scene
    svg: str
    format: SvgFormat
    size: int
    score: float = math.nan


@dataclass(frozen=True, eq=False)
class Outcome:
    """The file that a search chose, with its measurements and costs.

    plan         plan of the search
    subject      subject of the search
    corrections  number of times that the number of Gaussians was changed after the fit
    found        areas on the working canvas, with the costs of finding them. None without areas
    unsure       whether shapes alone may be closer than the areas of this outcome
    aim_score    value of the aim's score for the file, NaN if it is not measured
    """

    plan: Plan
    subject: Subject
    file: Export
    fitted: FitResult
    measured: RoundTrip
    corrections: int
    found: FoundAreas | None = None
    unsure: bool = False
    aim_score: float = math.nan

    @cached_property
    def psnr(self) -> float:
        """PSNR in dB of the rasterised file against the photo."""
        return self.subject.psnr(self.measured.raster, self.subject.photo)


def without_gaussians(size: int, limit: int) -> InputError:
    """Return the error for a limit below `size`, the bytes of a file without Gaussians."""
    needed = f"at least {size}, the bytes of a file without Gaussians"
    return refusal("max_bytes", needed, str(limit), str(size))


def best_of(searched: Iterable[Outcome], plan: Plan) -> Outcome:
    """Run the searches of a plan, and return the best outcome with the costs of all searches.

    With an aim, an outcome within the limit of bytes is better than one beyond it. If two outcomes
    are both within it, or both beyond it, the one with the higher score is better. Without an aim,
    the outcome with the higher PSNR is better.

    The searches end early if an outcome meets the aim within the limit, or was interrupted, and if
    areas are surely closer than shapes alone.

    searched  outcomes of the searches. Each search runs when its outcome is requested
    """
    aim, limit = plan.aim, plan.goal.byte_limit or math.inf
    outcomes, is_met = list[Outcome](), False
    for last in searched:
        if aim is not None and math.isnan(last.aim_score):
            aim_score = aim.score(last.measured.raster, last.subject.photo)
            last = dataclasses.replace(last, aim_score=aim_score)
        outcomes.append(last)
        is_met = aim is not None and aim.is_met_by(last.aim_score) and last.file.size <= limit
        is_sure = last.found is not None and not last.unsure
        if is_met or is_sure or last.fitted.stop_reason == "interrupted":
            break

    def closeness(outcome: Outcome) -> tuple[bool, float]:
        if aim is None:
            return True, outcome.psnr
        return outcome.file.size <= limit, outcome.aim_score

    best = max(outcomes, key=closeness) if len(outcomes) > 1 else outcomes[0]
    fitted, reason = best.fitted, best.fitted.stop_reason
    if outcomes[-1].fitted.stop_reason == "interrupted":
        reason = "interrupted"
    if aim is not None and is_met:
        reason = aim.of.option
    for other in outcomes:
        if other is not best:
            fitted = fitted.after(other.fitted, reason)
    return dataclasses.replace(best, fitted=dataclasses.replace(fitted, stop_reason=reason))
