"""The subject of a search, the scenes that it writes and scores, and its outcome."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import refusal
from gauss2svg.fit.options import PERCEPTUAL, FitResult, Tune
from gauss2svg.fit.target import Target, TargetPyramid
from gauss2svg.measure.metrics import mean_squared_error
from gauss2svg.measure.metrics import psnr as pixel_psnr
from gauss2svg.measure.roundtrip import RoundTrip, model_psnr
from gauss2svg.photo.alpha import has_alpha, shrunk, stacked
from gauss2svg.photo.photo import Photo
from gauss2svg.pipeline.memory_budget import measured_size
from gauss2svg.pipeline.palette import quantize, with_plain_edges
from gauss2svg.pipeline.plan import Aim, Plan
from gauss2svg.raster import rasterize_like
from gauss2svg.render.cpu import splats_of
from gauss2svg.scene import Scene
from gauss2svg.svg.document import MINIMAL, PHOTO_SIZE, Document, SvgFormat
from gauss2svg.svg.file import file_bytes
from gauss2svg.svg.minimal import minimal_svg
from gauss2svg.svg.minimal_shapes import FADING, HEX_DIGITS, MOST_MASKED
from gauss2svg.svg.plain_ellipse import is_plain
from gauss2svg.svg.write import in_file_order, ordered_svg, write_svg


@dataclass(frozen=True, eq=False)
class Subject:
    """A photo, and the canvas and document of its file.

    photo     (h, w, 3) or (h, w, 4) float32 in 0..1, with which files are compared
    working   image that a fit runs on: the photo, perhaps reduced
    canvas    width and height in px of the file, those of the photo before it was reduced
    document  document settings of the file
    """

    photo: NDArray[np.float32]
    working: NDArray[np.float32]
    canvas: tuple[int, int]
    document: Document = Document()
    _targets: dict[Tune, TargetPyramid] = field(default_factory=dict, init=False)

    @classmethod
    def of(cls, photo: NDArray[np.float32], canvas: tuple[int, int] | None = None) -> Self:
        """Return a subject that is fitted at the photo's size, by default for a file of it."""
        return cls(photo, photo, canvas or photo.shape[1::-1])

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in px of the image that a fit runs on."""
        return self.working.shape[1::-1]

    def targets(self, tune: Tune) -> TargetPyramid:
        """Return the working image as targets of a fit. Its weight maps are computed once."""
        if tune not in self._targets:
            self._targets[tune] = TargetPyramid(self.working, tune)
        return self._targets[tune]

    def target(self, tune: Tune) -> Target:
        """Return the working image at its own size as a target."""
        return self.targets(tune).reduced(1)

    def by_use(self, scene: Scene, tune: Tune, covering: bool = False) -> NDArray[np.intp]:
        """Return the indices of a scene's shapes, the most useful ones first.

        The most useful are those whose removal would raise the weighted error against the working
        image most.
        """
        target = self.target(tune)
        scale = target.width / scene.width, target.height / scene.height
        cost = target.removal_cost(splats_of(scene, scale, covering))[1][:, 0]
        return np.argsort(-cost, kind="stable")

    def release(self) -> None:
        """Free the targets of fits, after the last fit."""
        self._targets.clear()


def document_for(photo: Photo, document: Document) -> Document:
    """Return the document, with a size by the photo's resolution if it asks for that.

    Raise InputError if the photo lacks a resolution with square pixels for this, or if a size makes
    a side 0.
    """
    if document.size == PHOTO_SIZE:
        across, down = photo.dpi or (math.nan, math.nan)
        # Rounded resolutions of square pixels differ by less than a hundredth.
        if not abs(across / down - 1) <= 0.01:
            lacking = f"whose pixels are not square ({across:g}x{down:g} dpi)"
            lacking = "without a resolution tag" if photo.dpi is None else lacking
            raise refusal("size", f"a width for a photo {lacking}", repr(PHOTO_SIZE), "120mm")
        width = round(photo.full[0] / across * 25.4, 3)
        document = dataclasses.replace(document, size=f"{width:g}mm")
    document.sides(*photo.full)
    return document


FILLED = 0.995  # share of a limit of bytes from which a pruned file counts as full


@dataclass(frozen=True, eq=False)
class Export:
    """A quantised scene on the file's canvas, and its SVG.

    gzipped  whether `size` counts the gzipped file
    model    PSNR (dB) of the scene against the working image. If the plan is covering, that of the
             rasterised SVG, because the falloffs of the scene are not those of the fit
    score    score of the rasterised SVG by the plan's aim, NaN if it was not rasterised
    """

    scene: Scene
    svg: str
    format: SvgFormat
    document: Document
    gzipped: bool
    model: float
    score: float

    @cached_property
    def size(self) -> int:
        """Bytes of the file."""
        return len(file_bytes(self.svg, self.gzipped))

    def pruned_to(self, limit: int, empty: int, order: NDArray[np.intp]) -> Export:
        """Return the export with the first Gaussians of `order`, as many as `limit` bytes allow.

        They are not fitted again. A file without Gaussians has `empty` bytes.
        """
        if self.size <= limit or not len(self.scene):
            return self
        # Counts and bytes of files within the limit and beyond it.
        fewer, more = (0, empty), (len(self.scene), self.size)
        best = None
        while best is None or (best.size < FILLED * limit and more[0] - fewer[0] > 1):
            share = (limit - fewer[1]) / max(more[1] - fewer[1], 1)
            kept = int(fewer[0] + share * (more[0] - fewer[0]))
            kept = min(max(kept, fewer[0] + (best is not None)), more[0] - 1)
            export = self._of(order[:kept])
            if export.size > limit and kept:
                more = kept, export.size
            else:
                fewer, best = (kept, export.size), export
        return best

    def _of(self, index: NDArray[np.intp]) -> Export:
        """Return the export of some of the Gaussians, without a score."""
        scene = in_file_order(self.scene.select(np.sort(index)), self.format, self.document)
        svg = ordered_svg(scene, self.format, self.document)
        return dataclasses.replace(self, scene=scene, svg=svg, score=math.nan)


class Exporter:
    """A writer of scenes of the working canvas as files of the photo's size, with their scores.

    The option `full_size` does not change the size of scoring, because each score would take
    seconds.
    """

    def __init__(self, plan: Plan, subject: Subject) -> None:
        self._plan, self._subject = plan, subject
        self._gzipped, self._scored = plan.counts_gzipped, subject.photo
        if plan.options.run.full_size:
            width, height = measured_size(subject.photo.shape[1::-1], subject.size)
            self._scored = shrunk(subject.photo, height, width, sharp=True)
        self._last: tuple[str, NDArray[np.float32]] | None = None  # last SVG, and its raster
        self.highest_psnr = -math.inf  # dB, highest of the scenes of `as_written`

    def quantized(self, scene: Scene, psnr: float | None) -> Scene:
        """Return the scene on the file's canvas, with the colours and exponents of its file.

        psnr  PSNR of the scene in dB, None if the scene has been quantised before
        """
        if psnr is not None and self._plan.covering:
            scene = with_plain_edges(scene)
        error = None if psnr is None else 10 ** (-psnr / 10)
        plan, subject, (width, height) = self._plan, self._subject, self._subject.canvas
        fit_width, fit_height = subject.size
        scaled = scene.scaled(width / fit_width, height / fit_height)
        return quantize(
            scaled.replace(width=width, height=height),
            plan.svg_format.form,
            *plan.quantization(len(scene), error),
            # A perceptual fit weights the errors of colours too.
            subject.target(plan.tune).weight if plan.tune == PERCEPTUAL else None,
        )

    def as_written(self, scene: Scene, psnr: float) -> Scene:
        """Return the scene of `quantized` on the working canvas, for the last steps of a fit.

        The highest PSNR so far chooses the format of files, which therefore never becomes coarser.
        Otherwise the sizes of files could not be compared.
        """
        written = self.quantized(scene, psnr)
        self.highest_psnr = max(self.highest_psnr, psnr)
        return written.scaled(scene.width / written.width, scene.height / written.height)

    def formatted(self, scene: Scene, psnr: float) -> tuple[Scene, SvgFormat]:
        """Return the scene of `quantized`, and the format of its file."""
        return self.quantized(scene, psnr), self._plan.format_at(max(psnr, self.highest_psnr))

    def bytes_each(self, quantized: Scene, written: SvgFormat, size: float) -> float:
        """Return the mean bytes of a shape in a file that shapes like these fill to `size` bytes.

        A minimal file draws the first MOST_MASKED soft shapes under masks, which are short. The
        more soft shapes it has beyond these, the more of all of them it draws by gradients.
        """
        documented, count = self._subject.document, max(len(quantized), 1)

        def each(svg: str) -> float:
            return max(len(file_bytes(svg, self._gzipped)) - self.empty_bytes, 1) / count

        if written.markup != MINIMAL:
            return each(write_svg(quantized, written, documented))
        masked, by_gradients = (
            each(
                minimal_svg(
                    quantized, written.precision, HEX_DIGITS[-1], documented, stops=written.stops,
                    opacity_decimals=written.opacity_decimals, masked=masked,
                )
            )
            for masked in (True, False)
        )  # fmt: skip
        soft = max(np.count_nonzero(~is_plain(quantized)), 1) / count
        most, more = MOST_MASKED / soft, (1 + 1 / FADING) * MOST_MASKED / soft
        low, high = most * masked, more * by_gradients
        if not low < size < high:
            return masked if size <= low else by_gradients
        return size / (most + (more - most) * (size - low) / (high - low))

    @cached_property
    def empty_bytes(self) -> int:
        """Bytes of a file without Gaussians."""
        empty = Scene(*self._subject.canvas, transparent=has_alpha(self._subject.photo))
        svg = write_svg(empty, self._plan.svg_format, self._subject.document)
        return len(file_bytes(svg, self._gzipped))

    def export(self, scene: Scene) -> Export:
        """Return a scene of the working canvas as it would be written, with its scores."""
        plan, working, document = self._plan, self._subject.working, self._subject.document
        # Colours are in the palette already, except those of ellipses that are no longer plain.
        written = plan.format_at(self.highest_psnr)
        exact = in_file_order(self.quantized(scene, None), written, document)
        svg = ordered_svg(exact, written, document)
        score = math.nan
        if plan.aim is not None:
            score = plan.aim.score(self.raster(svg, self._scored), self._scored)
        if plan.covering:
            model = pixel_psnr(stacked(self.raster(svg, working)), stacked(working))
        else:
            model = model_psnr(scene, working)
        return Export(exact, svg, written, document, self._gzipped, model, score)

    def raster(self, svg: str, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return an SVG rasterised like an image. The last raster is kept and used again."""
        if self._last is None or self._last[0] != svg or self._last[1].shape != image.shape:
            self._last = svg, rasterize_like(svg, image, self._plan.options.run.renderer)
        return self._last[1]


# PSNR in dB up to which differences of a drawing can be seen at its own size
# (docs/decisions/enlarged.md).
SEEN_UP_TO = 41.0


@dataclass(frozen=True, eq=False)
class Outcome:
    """A fitted, written and measured scene on the photo's canvas.

    plan         plan of the search
    subject      subject of the search
    format       format of the file
    corrections  number of changes of the count after the fit
    enlarged     enlarged drawing, with which files are compared too. None for other pictures
    reached      score of the file by the aim of the run, NaN if it is not measured
    """

    plan: Plan
    subject: Subject
    scene: Scene
    svg: str
    format: SvgFormat
    fitted: FitResult
    measured: RoundTrip
    corrections: int
    enlarged: NDArray[np.float32] | None = None
    reached: float = math.nan

    @property
    def size(self) -> int:
        """Bytes of the file, gzipped if the limit counts those."""
        measured = self.measured
        return measured.svgz_bytes if self.plan.counts_gzipped else measured.svg_bytes


def best_of(
    searched: Iterable[Outcome], aim: Aim | None = None, limit: float = math.inf
) -> Outcome:
    """Return the closest outcome, with the costs of all.

    With an aim, outcomes within `limit` bytes come before others, and are compared by their scores.
    Without one, photos are compared at the size at which they are measured. Drawings are too up to
    SEEN_UP_TO dB, and beyond it they are compared enlarged.

    No further search runs after an outcome that meets the aim within the limit or was interrupted.
    None runs after an enlarged drawing of SEEN_UP_TO dB either, because only its shapes are crisp.
    """
    outcomes: list[Outcome] = []
    is_met = False
    for last in searched:
        if aim is not None and math.isnan(last.reached):
            reached = aim.score(last.measured.raster, last.subject.photo)
            last = dataclasses.replace(last, reached=reached)
        outcomes.append(last)
        is_met = aim is not None and aim.reached(last.reached) and last.size <= limit
        is_close = last.enlarged is not None and last.measured.psnr_lowest >= SEEN_UP_TO
        if is_met or is_close or last.fitted.stop_reason == "interrupted":
            break
    best = max(outcomes, key=lambda one: one.measured.psnr_lowest)
    large = next((one.enlarged for one in outcomes if one.enlarged is not None), None)
    if aim is not None:
        best = max(outcomes, key=lambda one: (one.size <= limit, one.reached))
    elif large is not None and len(outcomes) > 1:
        best = max(
            outcomes,
            key=lambda one: (
                min(one.measured.psnr_lowest, SEEN_UP_TO),
                -raster_error(one.svg, large, one.plan.options.run.renderer),
            ),
        )
    fitted, reason = best.fitted, best.fitted.stop_reason
    if outcomes[-1].fitted.stop_reason == "interrupted":
        reason = "interrupted"
    if aim is not None and is_met:
        reason = aim.name
    for other in outcomes:
        if other is not best:
            fitted = fitted.after(other.fitted, reason)
    return dataclasses.replace(best, fitted=dataclasses.replace(fitted, stop_reason=reason))


def raster_error(svg: str, picture: NDArray[np.float32], renderer: str) -> float:
    """Return the mean squared error of a file's raster, over both backdrops if there is alpha."""
    raster = rasterize_like(svg, picture, renderer)
    return mean_squared_error(stacked(raster), stacked(picture))
