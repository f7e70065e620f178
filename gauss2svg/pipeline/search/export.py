"""Exports of a search: scenes as they are written, and what their files score."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.options import PERCEPTUAL
from gauss2svg.fit.target import Target
from gauss2svg.measure.metrics import psnr as psnr_of
from gauss2svg.measure.roundtrip import RoundTrip, model_psnr, round_trip
from gauss2svg.photo.alpha import has_alpha, stacked
from gauss2svg.pipeline.palette import quantize, with_plain_edges
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.search.outcome import Subject
from gauss2svg.raster import rasterize_like
from gauss2svg.render.cpu import splats_of
from gauss2svg.scene import Scene
from gauss2svg.svg import minimal_shapes
from gauss2svg.svg.document import MINIMAL, Document, SvgFormat
from gauss2svg.svg.file import file_bytes
from gauss2svg.svg.minimal import minimal_svg
from gauss2svg.svg.minimal_shapes import HEX_DIGITS
from gauss2svg.svg.plain_ellipse import is_plain
from gauss2svg.svg.write import in_file_order, ordered_svg, write_svg

FILLED = 0.995  # share of a limit of bytes from which a file needs no more Gaussians


@dataclass(frozen=True, eq=False)
class Export:
    """A quantised scene on the file's canvas, and its SVG.

    model  PSNR (dB) against the working image: of the scene itself, and of the rasterised SVG where
           the plan is covering, for there the falloffs of the scene are not what was fitted
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

    def pruned_to(self, limit: int, empty: int, target: Target) -> Export:
        """Return the export with as many of its most useful Gaussians as `limit` bytes allow.

        Useful are those whose removal would raise the weighted error against the target most. The
        others are not refined. A file without any Gaussians has `empty` bytes.
        """
        if self.size <= limit or not len(self.scene):
            return self
        scene = self.scene
        factors = target.width / scene.width, target.height / scene.height
        cost = target.removal_cost(splats_of(scene.scaled(*factors)))[1][:, 0]
        order = np.argsort(-cost, kind="stable")
        fewer, more = (0, empty), (len(scene), self.size)  # count and bytes, on both sides
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
        """Return the export of some of the Gaussians, not rasterised."""
        scene = in_file_order(self.scene.select(np.sort(index)), self.format, self.document)
        svg = ordered_svg(scene, self.format, self.document)
        return dataclasses.replace(self, scene=scene, svg=svg, score=math.nan)


class Exporter:
    """Writes scenes of the working canvas as files of the photo's size, and measures them."""

    def __init__(self, plan: Plan, subject: Subject) -> None:
        self._plan, self._subject = plan, subject
        self._gzipped = plan.counts_gzipped
        self.seen = -math.inf  # highest PSNR in dB so far, by which the format is chosen

    def quantized(self, scene: Scene, psnr: float | None) -> Scene:
        """The scene on the file's canvas, with the colours and exponents of its file.

        psnr  of the scene in dB, None where it has been quantised before
        """
        if psnr is not None and self._plan.covering:
            scene = with_plain_edges(scene)
        error = None if psnr is None else 10 ** (-psnr / 10)
        return quantize(
            self._on_canvas(scene),
            self._plan.svg_format.form,
            *self._plan.quantization(len(scene), error),
            self._weight,
        )

    def as_written(self, scene: Scene, psnr: float) -> Scene:
        """The scene of `quantized` on the working canvas, for the last steps of a fit."""
        written = self.quantized(scene, psnr)
        self.seen = max(self.seen, psnr)
        return written.scaled(scene.width / written.width, scene.height / written.height)

    def write(self, scene: Scene, psnr: float) -> str:
        """The SVG of a scene on the working canvas whose colours are not quantised yet."""
        return self._written(self.quantized(scene, psnr), self._format_at(psnr))

    def bytes_each(self, scene: Scene, psnr: float, room: float, size: int | None = None) -> float:
        """Return the bytes of each shape where more or fewer such shapes fill so many bytes.

        size  bytes of the scene's file if it has been written, by which the estimate is scaled

        A minimal file draws some hundred soft shapes under masks, which are short. The more there
        are, the more of them it draws by gradients.
        """
        quantized, written = self.quantized(scene, psnr), self._format_at(psnr)

        scale = 1.0

        def each(svg: str) -> float:
            more = len(file_bytes(svg, self._gzipped)) - self.empty_bytes
            return scale * max(more, 1) / max(len(scene), 1)

        if size is not None:
            estimated = each(self._written(quantized, written)) * max(len(scene), 1)
            scale = max(size - self.empty_bytes, 1) / estimated

        def minimal(masked: bool) -> str:
            return minimal_svg(
                quantized, written.precision, HEX_DIGITS[-1], self._subject.document,
                opacity_decimals=written.opacity_decimals, stops=written.stops, masked=masked,
            )  # fmt: skip

        if written.markup != MINIMAL:
            return each(self._written(quantized, written))
        share = max(np.count_nonzero(~is_plain(quantized)), 1) / max(len(scene), 1)
        most = minimal_shapes.MOST_MASKED / share
        all_by_gradients = most * (1 + 1 / minimal_shapes.FADING)
        under_masks, by_gradients = each(minimal(masked=True)), each(minimal(masked=False))
        low, high = most * under_masks, all_by_gradients * by_gradients
        if not low < room < high:
            return under_masks if room <= low else by_gradients
        return room / (most + (all_by_gradients - most) * (room - low) / (high - low))

    @cached_property
    def empty_bytes(self) -> int:
        """Bytes of a file without Gaussians."""
        empty = Scene(*self._subject.canvas, transparent=has_alpha(self._subject.photo))
        return len(file_bytes(self._written(empty, self._plan.svg_format), self._gzipped))

    def export(self, scene: Scene) -> Export:
        """A scene of the working canvas as it would be written, and its scores."""
        working, document = self._subject.working, self._subject.document
        # Colours are in the palette already, except those of ellipses that are no longer plain.
        written = self._format_at(self.seen)
        exact = in_file_order(self.quantized(scene, None), written, document)
        svg = ordered_svg(exact, written, document)
        aim, score = self._plan.aim, math.nan
        if aim is not None:
            score = aim.score(self._raster(svg), working)
        if self._plan.covering:
            model = psnr_of(stacked(self._raster(svg)), stacked(working))
        else:
            model = model_psnr(scene, working)
        return Export(exact, svg, written, document, self._gzipped, model, score)

    def measured(self, best: Export, small: bool = False) -> RoundTrip:
        """The round trip at the size of the reference, or at that of the fit."""
        image = self._subject.working if small else self._subject.photo
        plan = self._plan
        return round_trip(best.svg, best.scene, image, plan.options.run.renderer, plan.covering)

    def _raster(self, svg: str) -> NDArray[np.float32]:
        return rasterize_like(svg, self._subject.working, self._plan.options.run.renderer)

    def _written(self, scene: Scene, written: SvgFormat) -> str:
        return write_svg(scene, written, self._subject.document)

    def _format_at(self, psnr: float) -> SvgFormat:
        """The format at this PSNR in dB; what it once was worth it stays worth, or bytes jump."""
        self.seen = max(self.seen, psnr)
        return self._plan.format_at(self.seen)

    @property
    def _weight(self) -> NDArray[np.floating] | None:
        """Weight map of a fit for perception, by which colours are quantised as well."""
        tune = self._plan.tune
        return self._subject.target(tune).weight if tune == PERCEPTUAL else None

    def _on_canvas(self, scene: Scene) -> Scene:
        (width, height), (fit_width, fit_height) = self._subject.canvas, self._subject.size
        scaled = scene.scaled(width / fit_width, height / fit_height)
        return scaled.replace(width=width, height=height)
