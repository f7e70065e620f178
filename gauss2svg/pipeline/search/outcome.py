"""What a search is given, what it ends with, and which of several outcomes is the best."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError
from gauss2svg.fit.options import FitProgress, FitResult, Tune
from gauss2svg.fit.target import Target, TargetPyramid
from gauss2svg.measure.metrics import mean_squared_error
from gauss2svg.measure.roundtrip import RoundTrip
from gauss2svg.photo.alpha import stacked
from gauss2svg.photo.photo import Photo
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.time_budget import TimeBudget
from gauss2svg.raster import rasterize_like
from gauss2svg.scene import Scene
from gauss2svg.svg.document import PHOTO_SIZE, Document, SvgFormat


@dataclass(frozen=True, eq=False)
class Subject:
    """A photo, and the file that is made of it.

    photo     (h, w, 3) or (h, w, 4) float32 in 0..1, the reference of the measurements
    working   the same, perhaps smaller: the image that a fit runs on
    canvas    width and height in px of the file, which the photo has or had
    document  of the file
    """

    photo: NDArray[np.float32]
    working: NDArray[np.float32]
    canvas: tuple[int, int]
    document: Document = Document()
    _targets: dict[Tune, TargetPyramid] = field(default_factory=dict, init=False)

    @classmethod
    def of(cls, photo: NDArray[np.float32], canvas: tuple[int, int] | None = None) -> Self:
        """A photo that is fitted as it is, by default to a file of its own size."""
        return cls(photo, photo, canvas or photo.shape[1::-1])

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in px of the image that a fit runs on."""
        return self.working.shape[1::-1]

    def targets(self, tune: Tune) -> TargetPyramid:
        """The working image as targets of a fit, whose weight maps are computed once."""
        if tune not in self._targets:
            self._targets[tune] = TargetPyramid(self.working, tune)
        return self._targets[tune]

    def target(self, tune: Tune) -> Target:
        """The working image at its own size."""
        return self.targets(tune).reduced(1)

    def release(self) -> None:
        """Free what fits needed, once there is none to come."""
        self._targets.clear()


def document_for(photo: Photo, document: Document) -> Document:
    """Return the document, with a size by the photo's resolution if it asks for that.

    Raise InputError for a photo without a resolution, or a size that makes a side 0.
    """
    if document.size == PHOTO_SIZE:
        document = dataclasses.replace(document, size=_printed_width(photo))
    document.sides(*photo.full)
    return document


def _printed_width(photo: Photo) -> str:
    """Width in mm, by the photo's resolution tag."""
    if photo.dpi is None:
        raise InputError(
            "size must be a width for a photo without a resolution tag; got 'photo'. Try 120mm"
        )
    across, down = photo.dpi
    # Rounded resolutions of square pixels differ by less than a hundredth.
    if abs(across / down - 1) > 0.01:
        raise InputError(
            f"size must be a width for a photo whose pixels are not square ({across:g}x{down:g} "
            "dpi); got 'photo'. Try 120mm"
        )
    return f"{round(photo.full[0] / across * 25.4, 3):g}mm"


# PSNR in dB up to which differences of a drawing can be seen at its own size
# (docs/decisions/enlarged.md).
SEEN_UP_TO = 41.0


@dataclass(frozen=True, eq=False)
class Outcome:
    """A fitted, written and measured scene on the photo's canvas.

    plan         of its search
    subject      of its search
    format       of its file
    reached      its score, by the plan's aim; None without one
    corrections  how often the count was changed after the fit
    enlarged     the drawing enlarged, with which files are compared too; None for other pictures
    """

    plan: Plan
    subject: Subject
    scene: Scene
    svg: str
    format: SvgFormat
    reached: float | None
    fitted: FitResult
    measured: RoundTrip
    corrections: int
    enlarged: NDArray[np.float32] | None = None


class Search(Protocol):
    """One way to carry out a plan."""

    def run(self) -> Outcome:
        """The best of what the search finds."""
        ...


@dataclass(frozen=True, eq=False)
class Watch:
    """What watches a search: the clock, who sees its progress, and who may stop it.

    report  called with "additive", "fit", "correct", "write" or "measure", and the progress of the
            fit
    stop    polled at every step; True ends the search with the best so far
    """

    budget: TimeBudget = field(default_factory=TimeBudget)
    report: Callable[[str, FitProgress | None], None] = lambda phase, fitting: None
    stop: Callable[[], bool] = lambda: False


def best_of(searches: Iterable[Search]) -> Outcome:
    """Return the closest outcome, with the costs of all.

    Photos are compared at the size at which they are measured. Drawings are compared so up to
    SEEN_UP_TO, and enlarged beyond it. Each search begins when the one before has run, and none
    once one has been interrupted or has a drawing that close, for only its shapes are crisp.
    """
    outcomes: list[Outcome] = []
    for search in searches:
        outcomes.append(search.run())
        del search  # its fit takes memory, which the next one needs
        last = outcomes[-1]
        is_close = last.enlarged is not None and last.measured.psnr_lowest >= SEEN_UP_TO
        if is_close or last.fitted.stop_reason == "interrupted":
            break
    best = max(outcomes, key=lambda one: one.measured.psnr_lowest)
    large = next((one.enlarged for one in outcomes if one.enlarged is not None), None)
    if large is not None and len(outcomes) > 1:
        best = max(
            outcomes,
            key=lambda one: (min(one.measured.psnr_lowest, SEEN_UP_TO), -_error(one, large)),
        )
    fitted, last = best.fitted, outcomes[-1].fitted.stop_reason
    for other in outcomes:
        if other is not best:
            ended = "interrupted" if last == "interrupted" else fitted.stop_reason
            fitted = fitted.after(other.fitted, ended)
    return dataclasses.replace(best, fitted=fitted)


def _error(outcome: Outcome, picture: NDArray[np.float32]) -> float:
    raster = rasterize_like(outcome.svg, picture, outcome.plan.options.run.renderer)
    return mean_squared_error(stacked(raster), stacked(picture))
