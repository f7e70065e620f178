"""The scenes that a search by count writes, with their files and scores."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import cached_property, lru_cache, partial

import numpy as np

from gauss2svg import portable
from gauss2svg.fit import PERCEPTUAL
from gauss2svg.measure.roundtrip import RoundTrip, model_psnr, round_trip
from gauss2svg.photo.pixels import has_alpha
from gauss2svg.pipeline.outcome import Export, Subject
from gauss2svg.pipeline.palette import quantize
from gauss2svg.pipeline.plan import Plan
from gauss2svg.raster import rasterize_like
from gauss2svg.scene import Scene
from gauss2svg.svg import MINIMAL, SvgFormat
from gauss2svg.svg.file import bytes_by_part, file_bytes
from gauss2svg.svg.forms import is_plain
from gauss2svg.svg.write import in_file_order, ordered_svg, write_svg


class Exporter:
    """A writer that turns scenes on the working canvas into files for the photo, and scores them.

    The format of the files depends on the highest PSNR that `as_written` has noted so far. So the
    format never becomes coarser, and the bytes of successive files can be compared.
    """

    def __init__(self, plan: Plan, subject: Subject) -> None:
        self._plan, self._subject = plan, subject
        self._highest_psnr = -math.inf  # dB
        # Number of the Gaussians that each file has in its ground.
        self._in_ground = 0 if subject.ground is None else len(subject.ground)
        draw = partial(rasterize_like, picture=subject.photo, renderer=plan.options.run.renderer)
        # Function that rasterises an SVG at the photo's size.
        self.raster = lru_cache(maxsize=1)(draw)

    def quantized(self, scene: Scene, psnr: float | None) -> Scene:
        """Return the scene on the canvas of the file, with the colours and exponents of the file.

        psnr  PSNR of the scene in dB, or None if the scene has already been quantised
        """
        error = None if psnr is None else portable.power(10, -psnr / 10)
        plan, subject, (width, height) = self._plan, self._subject, self._subject.canvas
        scaled = scene.scaled(width / scene.width, height / scene.height)
        scaled, weight = scaled.replace(width=width, height=height), None
        # With a mask or a perceptual fit, errors count more at some pixels than at others. The
        # palette is made with the same weights as the fit.
        if len(scene) and (plan.tune == PERCEPTUAL or subject.focus):
            weight = subject.targets(plan.tune).reduced(1).visible_weight
        palette, color_error = plan.quantization(len(scene), error)
        return quantize(scaled, plan.options.svg.form, palette, color_error, weight)

    def as_written(self, scene: Scene, psnr: float) -> Scene:
        """Quantise a scene whose PSNR is `psnr` dB, and return it on the working canvas.

        The exporter notes the PSNR, because the format of the files depends on it.
        """
        written = self.quantized(scene, psnr)
        self._highest_psnr = max(self._highest_psnr, psnr)
        return written.scaled(scene.width / written.width, scene.height / written.height)

    def bytes_each(
        self,
        quantized: Scene,
        size: float,
        psnr: float = -math.inf,
        keeps_gradients: bool = False,
    ) -> float:
        """Return the mean number of bytes per shape in a file of `size` bytes.

        The shapes of the file are assumed to be like those of the scene `quantized`. A minimal file
        with up to MOST_MASKED soft shapes draws all of them by masks, which take few bytes. If a
        file has more soft shapes, fewer are drawn by masks: FADING fewer for each soft shape above
        MOST_MASKED. The file draws its other soft shapes by gradients.

        psnr             PSNR of the scene in dB. It may be left out if `as_written` has noted it
        keeps_gradients  whether the file has all gradients of the scene, even if it has fewer or
                         more shapes. A minimal file has so few that this makes no difference
        """
        document, count = self._subject.document, max(len(quantized) - self._in_ground, 1)
        written = self._plan.format_at(max(psnr, self._highest_psnr))

        def each(svg: str) -> float:
            return max(self._size(svg) - self.empty_bytes, 1) / count

        left = max(size - self.empty_bytes, 1)
        if written.markup != MINIMAL:
            mean = each(svg := write_svg(quantized, written, document))
            if not keeps_gradients:
                return mean
            own = mean * (1 - bytes_by_part(svg)["gradients"] / len(svg))
            return left / max(count + (left - count * mean) / own, 1)
        from gauss2svg.svg.minimal import FADING, MOST_MASKED

        masked, by_gradients = (
            each(ordered_svg(quantized, written, document, masked)) for masked in (True, False)
        )
        most = MOST_MASKED * count / max(np.count_nonzero(~is_plain(quantized)), 1)
        counts = most * np.array([0, 1, 1 + 1 / FADING, 1e6])
        sizes = counts * [0, masked, by_gradients, by_gradients]
        return left / float(np.interp(left, sizes, counts))

    @cached_property
    def empty_bytes(self) -> int:
        """Number of bytes of a file without Gaussians."""
        canvas, ground = self._subject.canvas, self._subject.ground
        if ground is None:
            empty = Scene(*canvas, transparent=has_alpha(self._subject.photo))
        else:
            empty = ground.scaled(canvas[0] / ground.width, canvas[1] / ground.height)
        return self._size(write_svg(empty, self._plan.format_at(), self._subject.document))

    def _size(self, svg: str) -> int:
        return len(file_bytes(svg, self._plan.counts_gzipped))

    def unscored(self, scene: Scene) -> Export:
        """Write a scene that is on the working canvas. The score of the export is NaN."""
        form = self._plan.format_at(self._highest_psnr)
        # The fit has already given all shapes but the plain ellipses a colour of a palette. A shape
        # that was a plain ellipse at that time may be soft now, and its colour may not be in the
        # palette. So the scene is quantised once more.
        scene = in_file_order(self.quantized(scene, None), form, self._subject.document)
        return self.written(scene, form)

    def written(self, scene: Scene, form: SvgFormat) -> Export:
        """Write a quantised scene whose shapes are in the order of the file."""
        svg = ordered_svg(scene, form, self._subject.document)
        return Export(scene, svg, form, self._size(svg))

    def measured(self, export: Export) -> RoundTrip:
        """Return the measurements of a file against the photo."""
        renderer, raster = self._plan.options.run.renderer, self.raster(export.svg)
        photo = self._subject.photo
        return round_trip(export.svg, export.scene, photo, renderer, raster=raster)

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

    def pruned(self, export: Export, limit: int) -> Export:
        """Remove the least useful Gaussians of an export until its file has at most `limit` bytes.

        The Gaussians that are left are not fitted again. A file without Gaussians is returned even
        if it has more than `limit` bytes.
        """
        order = self._subject.by_usefulness(export.scene, self._plan.tune)
        form, document = export.format, self._subject.document

        def write(count: int) -> Export:
            scene = export.scene.select(np.sort(order[:count]))
            return self.written(in_file_order(scene, form, document), form)

        best = filled(write, (self._in_ground, self.empty_bytes), export, limit)
        return dataclasses.replace(best, score=self._score(best.scene, best.svg))


FILLED = 0.995  # a file that uses at least this share of the limit of bytes is not enlarged further


def filled(
    write: Callable[[int], Export], empty: tuple[int, int], whole: Export, limit: int
) -> Export:
    """Return the file of as many of the most useful shapes as a limit of bytes allows.

    write  function that returns the file of so many of the most useful shapes
    empty  number of shapes and bytes of a file that has no fewer. It is returned even if it has
           more than `limit` bytes
    whole  file of all shapes
    """
    if whole.size <= limit:
        return whole
    # Each of these is a number of shapes and the bytes of their file. `fewer` is for the largest
    # file so far within the limit, and `more` for the smallest file so far beyond it.
    fewer, more, best = empty, (len(whole.scene), whole.size), None
    while best is None or (best.size < FILLED * limit and more[0] - fewer[0] > 1):
        share = (limit - fewer[1]) / max(more[1] - fewer[1], 1)
        count = int(fewer[0] + share * (more[0] - fewer[0]))
        count = min(max(count, fewer[0] + (best is not None)), max(more[0] - 1, 0))
        part = write(count)
        if part.size > limit and count > empty[0]:
            more = count, part.size
        else:
            fewer, best = (count, part.size), part
    return best
