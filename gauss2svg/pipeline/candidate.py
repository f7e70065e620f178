"""Candidates of a search: scenes as written and rasterised, and the outcome of a run."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.choices import PERCEPTUAL
from gauss2svg.fit.options import FitResult
from gauss2svg.fit.target import target_of
from gauss2svg.measure.roundtrip import RoundTrip, model_psnr, round_trip
from gauss2svg.photo.alpha import has_alpha
from gauss2svg.pipeline.plan import Plan, Quantization
from gauss2svg.pipeline.quantize import quantize
from gauss2svg.raster import rasterize_like
from gauss2svg.render.cpu import splats_of
from gauss2svg.scene import Scene
from gauss2svg.svg.document import Document
from gauss2svg.svg.file import file_bytes
from gauss2svg.svg.format import MINIMAL, SvgFormat
from gauss2svg.svg.layers import grouped_by_segment
from gauss2svg.svg.minimal.shapes import HEX_DIGITS
from gauss2svg.svg.minimal.write import MOST_MASKED, minimal_svg
from gauss2svg.svg.plain_ellipse import is_plain as is_solid
from gauss2svg.svg.write import write_svg

# Soft shapes that a fit aims at where as many are drawn under masks: a few solid ones may become
# soft in the last steps.
_MASKED = MOST_MASKED - 8
# Share of the Gaussians that is kept at least at once where fewer may be drawn in another way.
_KEPT_AT_ONCE = 0.98


@dataclass(frozen=True, eq=False)
class Candidate:
    """A quantised scene on the photo's canvas, and its SVG.

    model  PSNR (dB) of the scene itself against the working image
    score  of the rasterised SVG against it, by the plan's aim; NaN if it was not rasterised
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


@dataclass(frozen=True, eq=False)
class Outcome:
    """A fitted, written and measured scene on the photo's canvas.

    format        of its file
    quantization  of its file
    reached       its score, by the plan's aim; None without one
    corrections   how often the count was changed after the fit
    """

    scene: Scene
    svg: str
    format: SvgFormat
    quantization: Quantization
    reached: float | None
    fitted: FitResult
    measured: RoundTrip
    corrections: int


class Exporter:
    """Writes scenes of the working canvas as files of the photo's size.

    photo    (h, w, 3) or (h, w, 4) float32 in 0..1, the reference of the measurements
    working  the same, perhaps smaller: the image that the fit runs on
    """

    def __init__(
        self,
        photo: NDArray[np.float32],
        working: NDArray[np.float32],
        plan: Plan,
        document: Document,
    ) -> None:
        self.photo = photo
        self.working = working
        self.document = document
        self._plan = plan
        self._gzipped = plan.counts_gzipped
        self.seen = -math.inf  # highest PSNR in dB so far, by which the format is chosen

    def quantized(self, scene: Scene, psnr: float | None) -> Scene:
        """The scene on the photo's canvas, with the colours and exponents of its file."""
        quantization = self._plan.quantization(
            len(scene), None if psnr is None else 10 ** (-psnr / 10)
        )
        return quantize(
            self._on_photo(scene),
            self._plan.svg_format.form,
            quantization.palette,
            quantization.color_error,
            self._weight,
        )

    def as_written(self, scene: Scene, psnr: float) -> Scene:
        """The same on the working canvas, for the last steps of a fit."""
        photo = self.quantized(scene, psnr)
        self.seen = max(self.seen, psnr)
        return photo.scaled(scene.width / photo.width, scene.height / photo.height)

    def write(self, scene: Scene, psnr: float) -> str:
        """The SVG of a scene on the working canvas whose colours are not quantised yet."""
        return write_svg(self.quantized(scene, psnr), self._format_at(psnr), self.document)

    def bytes_each(self, scene: Scene, psnr: float, room: float) -> float:
        """Bytes of each shape where so many bytes are filled by more or fewer such shapes.

        A minimal file draws some hundred soft shapes under masks and more by gradients, which are
        longer: where the limit lies between, it has as many as masks draw.
        """
        quantized, written = self.quantized(scene, psnr), self._format_at(psnr)

        def each(masked: bool | None = None) -> float:
            if masked is None:
                svg = write_svg(quantized, written, self.document)
            else:
                svg = minimal_svg(
                    quantized, written.precision, HEX_DIGITS[-1], self.document,
                    opacity_decimals=written.opacity_decimals, stops=written.stops, masked=masked,
                )  # fmt: skip
            more = len(file_bytes(svg, self._gzipped)) - self.empty_bytes
            return max(more, 1) / max(len(scene), 1)

        if written.markup != MINIMAL:
            return each()
        most = _MASKED * len(scene) / max(np.count_nonzero(~is_solid(quantized)), 1)
        under_masks = each(masked=True)
        if room / under_masks <= most:
            return under_masks
        return min(each(masked=False), room / most)

    @cached_property
    def _weight(self) -> NDArray[np.floating] | None:
        """That of a fit for perception, by which colours are quantised as well."""
        tune = self._plan.options.fit.tuned
        return target_of(self.working, np.float32, tune).weight if tune == PERCEPTUAL else None

    @cached_property
    def empty_bytes(self) -> int:
        """Bytes of a file without Gaussians."""
        height, width = self.photo.shape[:2]
        none, pair = np.zeros(0), np.zeros((0, 2))
        transparent = has_alpha(self.photo)
        scene = Scene(
            width, height, pair, pair, none, np.zeros((0, 3)), none, transparent=transparent
        )
        svg = write_svg(scene, self._plan.svg_format, self.document)
        return len(file_bytes(svg, self._gzipped))

    def candidate(self, scene: Scene) -> Candidate:
        """A scene of the working canvas as it would be written, rasterised if there is an aim."""
        model = model_psnr(scene, self.working)
        # Colours are in the palette already, except those of ellipses that are no longer solid.
        exact = grouped_by_segment(self.quantized(scene, None), self.document.labels)
        written = self._format_at(self.seen)
        svg = write_svg(exact, written, self.document)
        aim, score = self._plan.aim, math.nan
        if aim is not None:
            raster = rasterize_like(svg, self.working, self._plan.options.run.renderer)
            score = aim.score(raster, self.working)
        return Candidate(exact, svg, written, self.document, self._gzipped, model, score)

    def measured(self, best: Candidate, small: bool = False) -> RoundTrip:
        """The round trip at the photo's size, or at the size of the fit."""
        scene, image = best.scene, self.working if small else self.photo
        if small:
            height, width = image.shape[:2]
            scene = scene.scaled(width / scene.width, height / scene.height)
        return round_trip(best.svg, scene, image, self._plan.options.run.renderer)

    def _format_at(self, psnr: float) -> SvgFormat:
        """The format at this PSNR in dB; what it once was worth it stays worth, or bytes jump."""
        self.seen = max(self.seen, psnr)
        return self._plan.format_at(self.seen)

    def _on_photo(self, scene: Scene) -> Scene:
        height, width = self.photo.shape[:2]
        scaled = scene.scaled(width / self.working.shape[1], height / self.working.shape[0])
        return scaled.replace(width=width, height=height)


def pruned_to_size(
    candidate: Candidate, limit: int, empty: int, image: NDArray[np.float32], tune: str
) -> Candidate:
    """The candidate without its least useful Gaussians, so that it has at most `limit` bytes.

    Useful ones reduce the error against image (h, w, 3) or (h, w, 4), as FitOptions.tune weights
    it. The rest is not refined.
    A file without any has `empty` bytes.
    """
    target = target_of(image, np.float32, tune)
    while candidate.size > limit and len(candidate.scene):
        scene = candidate.scene
        height, width = image.shape[:2]
        splats = splats_of(scene.scaled(width / scene.width, height / scene.height))
        cost = target.removal_cost(splats)[1][:, 0]
        share = max(limit - empty, 0) / (candidate.size - empty)
        if candidate.format.markup == MINIMAL:
            share = max(share, _KEPT_AT_ONCE)
        kept = min(len(scene) - 1, int(len(scene) * share))
        scene = scene.select(np.sort(np.argsort(-cost, kind="stable")[:kept]))
        svg = write_svg(scene, candidate.format, candidate.document)
        candidate = dataclasses.replace(candidate, scene=scene, svg=svg, score=math.nan)
    return candidate
