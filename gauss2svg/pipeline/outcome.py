"""The subject of a search, the files that it writes, and the best of the outcomes of searches."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import TYPE_CHECKING, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.fit import PERCEPTUAL, FitResult
from gauss2svg.fit.target import Target
from gauss2svg.measure import metrics
from gauss2svg.measure.roundtrip import model_psnr
from gauss2svg.photo.pixels import Focus, has_alpha, shrunk, stacked
from gauss2svg.pipeline.palette import quantize
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.run import Run
from gauss2svg.raster import rasterize_like
from gauss2svg.render.cpu import splats_of
from gauss2svg.scene import ABOVE, Scene
from gauss2svg.svg import Document, SvgFormat
from gauss2svg.svg.write import in_file_order, ordered_svg, write_svg

if TYPE_CHECKING:
    from gauss2svg.areas.find import FoundAreas
    from gauss2svg.areas.pixels import Sprite


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
    sprite    cells of pixel art, None for other pictures
    bytes_of  function that takes the text of an SVG, and returns the bytes that a limit counts
    """

    photo: NDArray[np.float32]
    working: NDArray[np.float32]
    canvas: tuple[int, int]
    document: Document = Document()
    focus: Focus | None = None
    start: Scene | None = None
    ground: Scene | None = None
    sprite: Sprite | None = None
    bytes_of: Callable[[str], int] = lambda svg: len(svg.encode())

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


def scaled_to(scene: Scene, size: tuple[int, int]) -> Scene:
    """Return the scene on a canvas of this width and height in px."""
    scaled = scene.scaled(size[0] / scene.width, size[1] / scene.height)
    return scaled.replace(width=size[0], height=size[1])


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


class Exporter:
    """A writer that turns scenes on the working canvas into files, and scores them."""

    def __init__(self, plan: Plan, subject: Subject) -> None:
        self._plan, self._subject = plan, subject
        # Number of the Gaussians that each file has in its ground.
        self._in_ground = 0 if subject.ground is None else len(subject.ground)
        draw = partial(rasterize_like, picture=subject.photo, renderer=plan.options.run.renderer)
        # Function that rasterises an SVG at the photo's size.
        self.raster = lru_cache(maxsize=1)(draw)

    @cached_property
    def target(self) -> Target:
        """Target of fits to the working image."""
        subject = self._subject
        return Target(subject.working, self._plan.tune, mask=subject.focus, ground=subject.ground)

    def by_usefulness(self, scene: Scene) -> NDArray[np.intp]:
        """Return the indices of a scene's shapes, from the most to the least useful.

        The most useful shape is the one without which the weighted error against the working image
        would rise most.
        """
        scale = self.target.width / scene.width, self.target.height / scene.height
        above = np.flatnonzero(scene.level == ABOVE)
        cost = self.target.removal_cost(splats_of(scene.select(above), scale))[1][:, 0]
        among = np.flatnonzero(scene.level != ABOVE)  # they belong to the ground
        return np.concatenate([among, above[np.argsort(-cost, kind="stable")]])

    def quantized(self, scene: Scene, psnr: float | None) -> Scene:
        """Return the scene on the canvas of the file, with the colours and exponents of the file.

        psnr  PSNR of the scene in dB, or None if the scene has already been quantised
        """
        error = None if psnr is None else portable.power(10, -psnr / 10)
        plan, subject, weight = self._plan, self._subject, None
        # With a mask or a perceptual fit, errors count more at some pixels than at others. The
        # palette is made with the same weights as the fit.
        if len(scene) and (plan.tune == PERCEPTUAL or subject.focus):
            weight = self.target.visible_weight
        palette, color_error = plan.quantization(len(scene), error)
        scaled = scaled_to(scene, subject.canvas)
        return quantize(scaled, plan.options.svg.form, palette, color_error, weight)

    def as_written(self, scene: Scene, psnr: float) -> Scene:
        """Quantise a scene whose PSNR is `psnr` dB, and return it on the working canvas."""
        written = self.quantized(scene, psnr)
        return written.scaled(scene.width / written.width, scene.height / written.height)

    def bytes_each(self, quantized: Scene, size: float) -> float:
        """Return the mean number of bytes of a shape in a file of `size` bytes with such shapes.

        A minimal file has masks, which take fewer bytes than gradients, if its shapes are few. So
        if the scene takes more bytes, parts of it are measured until one fills the file.
        """
        more, left = max(len(quantized) - self._in_ground, 1), max(size - self.empty_bytes, 1)
        over = self._bytes_above_ground(quantized)
        if self._in_ground or over <= left:
            return over / more
        fewer = under = 0
        for _ in range(4):
            count = fewer + int((left - under) / (over - under) * (more - fewer))
            if count == fewer or under >= FULL * left:
                break
            places = np.linspace(0, len(quantized) - 1, count).astype(int)
            part = self._bytes_above_ground(quantized.select(places))
            if part > left:
                more, over = count, part
            else:
                fewer, under = count, part
        return left / (fewer + (left - under) / (over - under) * (more - fewer))

    def _bytes_above_ground(self, scene: Scene) -> int:
        svg = write_svg(scene, self._plan.format, self._subject.document)
        return max(self._subject.bytes_of(svg) - self.empty_bytes, 1)

    @cached_property
    def empty_bytes(self) -> int:
        """Number of bytes of a file without Gaussians above the ground."""
        canvas, ground = self._subject.canvas, self._subject.ground
        if ground is None:
            empty = Scene(*canvas, transparent=has_alpha(self._subject.photo))
        else:
            empty = ground.scaled(canvas[0] / ground.width, canvas[1] / ground.height)
        return self._subject.bytes_of(write_svg(empty, self._plan.format, self._subject.document))

    def unscored(self, scene: Scene) -> Export:
        """Write a scene that is on the working canvas. The score of the export is NaN."""
        # The fit has already given all shapes but the plain ellipses a colour of a palette. A shape
        # that was a plain ellipse at that time may be soft now, and its colour may not be in the
        # palette. So the scene is quantised once more.
        return self.written(self.quantized(scene, None), self._plan.format)

    def written(self, scene: Scene, form: SvgFormat) -> Export:
        """Write a quantised scene. Its shapes are then in the order of the file."""
        scene = in_file_order(scene, form, self._subject.document)
        svg = ordered_svg(scene, form, self._subject.document)
        return Export(scene, svg, form, self._subject.bytes_of(svg))

    def outcome(
        self, file: Export, fitted: FitResult, corrections: int, found: FoundAreas | None = None
    ) -> Outcome:
        """Return the outcome of a search that chose a file, and free the target of its fits."""
        vars(self).pop("target", None)
        raster = self.raster(file.svg)
        return Outcome(self._plan, self._subject, file, fitted, raster, corrections, found)

    def export(self, scene: Scene) -> Export:
        """Write a scene that is on the working canvas, and return the file with its score."""
        export = self.unscored(scene)
        # Shapes of a start may not be quantised yet, so their file may be worse than they are.
        scored = scene if self._subject.start is None else export.scene
        return dataclasses.replace(export, score=self._score(scored, export.svg))

    def _score(self, scene: Scene, svg: str) -> float:
        plan, subject = self._plan, self._subject
        if plan.aim is not None:
            return plan.aim.score(self.raster(svg), subject.photo)
        return model_psnr(scene, subject.working, subject.weight(subject.working))

    def pruned(self, export: Export, limit: float) -> Export:
        """Remove the least useful Gaussians of an export until its file has at most `limit` bytes.

        The Gaussians that are left are not fitted again. A file without Gaussians is returned even
        if it has more than `limit` bytes.
        """
        order = self.by_usefulness(export.scene)

        def write(count: int) -> Export:
            return self.written(export.scene.select(np.sort(order[:count])), export.format)

        best = filled(write, (self._in_ground, self.empty_bytes), (len(order), export), limit)
        return dataclasses.replace(best, score=self._score(best.scene, best.svg))


DB_OF_TENFOLD = 1.5  # dB by which a file of ten times the bytes must be closer
FULL = 0.98  # a file is full if it has more than this share of the bytes that it may have


_File = TypeVar("_File", bound=Export)


def filled(
    write: Callable[[int], _File],
    least: tuple[int, int],
    most: tuple[int, _File],
    limit: float,
    goes_on: Callable[[], bool] = lambda: True,
) -> _File:
    """Return a file that fills a limit of bytes.

    write    function that returns the file for a number: of the most useful shapes that it has, or
             of steps down in the price of a byte. Files for larger numbers have more bytes
    least    smallest number, and the bytes of its file. It is returned even if it has more than
             `limit` bytes
    most     largest number, and its file
    goes_on  function that tells whether a larger file is tried after one within the limit
    """
    (fewer, size), (more, over) = least, (most[0], most[1].size)
    if over <= limit:
        return most[1]
    best = None
    while best is None or (best.size < FULL * limit and more - fewer > 1 and goes_on()):
        count = int(fewer + (limit - size) / max(over - size, 1) * (more - fewer))
        count = min(max(count, fewer + (best is not None)), max(more - 1, 0))
        file = write(count)
        if file.size > limit and count > least[0]:
            more, over = count, file.size
        else:
            fewer, size, best = count, file.size, file
    return best


@dataclass(frozen=True, eq=False)
class Outcome:
    """The file that a search chose, with its raster and costs.

    plan         plan of the search
    subject      subject of the search
    fitted       result with the costs of all fits. Its stop_reason says what ended the search,
                 without regard to the user and to targets
    raster       raster of the file at the photo's size
    corrections  number of times that the number of Gaussians was changed after the fit
    found        areas on the working canvas, with the costs of finding them. None without areas
    unsure       whether shapes alone may be closer than the areas of this outcome
    notes        notes on the search
    """

    plan: Plan
    subject: Subject
    file: Export
    fitted: FitResult
    raster: NDArray[np.float32]
    corrections: int
    found: FoundAreas | None = None
    unsure: bool = False
    notes: tuple[str, ...] = ()

    @cached_property
    def psnr(self) -> float:
        """PSNR in dB of the rasterised file against the photo."""
        return self.subject.psnr(self.raster, self.subject.photo)


def best_of(searched: Iterable[Outcome], plan: Plan, run: Run) -> Outcome:
    """Run the searches of a plan, and return the best outcome with the costs of all searches.

    With an aim, an outcome within the limit of bytes is better than one beyond it. If two outcomes
    are both within it, or both beyond it, the one with the higher score is better. Without an aim,
    the outcome with the higher PSNR is better. Without a limit, a file of ten times the bytes
    must be closer by more than DB_OF_TENFOLD.

    The searches end early if an outcome meets the aim within the limit, if the run is stopped, and
    if areas are surely closer than shapes alone. The stop_reason of the best outcome is then the
    aim, "interrupted", or what ended the search for this outcome.

    searched  outcomes of the searches. Each search runs when its outcome is requested
    """
    aim, limit = plan.aim, plan.goal.byte_limit
    outcomes, is_met = list[Outcome](), False
    for last in searched:
        # Searches without the aim have another score, and those for areas have none.
        if aim is not None and (last.plan.aim is None or math.isnan(last.file.score)):
            score = aim.score(last.raster, last.subject.photo)
            last = dataclasses.replace(last, file=dataclasses.replace(last.file, score=score))
        outcomes.append(last)
        is_met = aim is not None and aim.is_met_by(last.file.score) and last.file.size <= limit
        if is_met or run.ended or (last.found is not None and not last.unsure):
            break

    def closeness(outcome: Outcome) -> tuple[bool, float]:
        if aim is None:
            price = 0.0 if plan.goal.is_limited else DB_OF_TENFOLD
            return True, outcome.psnr - price * portable.log10(outcome.file.size)
        return outcome.file.size <= limit, outcome.file.score

    best = max(outcomes, key=closeness) if len(outcomes) > 1 else outcomes[0]
    reason = "interrupted" if run.ended else best.fitted.stop_reason
    if aim is not None and is_met:
        reason = aim.of.option
    others = [outcome.fitted for outcome in outcomes if outcome is not best]
    return dataclasses.replace(best, fitted=best.fitted.after(reason, *others))
