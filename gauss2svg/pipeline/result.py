"""The progress and the result of a run."""

from __future__ import annotations

import dataclasses
import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError
from gauss2svg.files import write_atomically
from gauss2svg.options import Flag, file_name
from gauss2svg.pipeline.report import decibels
from gauss2svg.scene import Scene
from gauss2svg.svg.document import Document
from gauss2svg.svg.file import check_svg_name, file_bytes, is_svgz
from gauss2svg.svg.notebook import image
from gauss2svg.svg.plates import ink_name, inks_of_scene
from gauss2svg.svg.write import outline_svg, plate_svg

_OPAQUE, _CRISP = 0.95, 3.0  # opacity and exponent from which a shape hides what is below it


@dataclass(frozen=True, eq=False)
class Result:
    """A vectorised photo; shows itself in a notebook.

    svg       text of the file
    scene     fitted Gaussians on the photo's canvas, in the order of the file
    report    options and results of the run, ready for JSON; see docs/reference/report.md
    raster    (h, w, 3) float32 in 0..1, the rasterised SVG, perhaps smaller than the canvas; of a
              transparent photo (h, w, 4) with straight alpha
    photo     of the same shape, what the raster was compared with: the photo, perhaps reduced
    document  of the file
    """

    svg: str
    scene: Scene
    report: dict[str, Any]
    raster: NDArray[np.float32]
    photo: NDArray[np.float32]
    document: Document

    def save(self, path: str | os.PathLike[str], gzip: bool | None = None) -> None:
        """Write the SVG, whole or not at all.

        gzip  None: if the path ends in .svgz, or the run had gzip=True
        Raises InputError for something else than a path and for the name of another format,
        OutputError if it cannot be written.
        """
        path = file_name("path", path)
        check_svg_name("path", path)
        if gzip is None:
            gzip = is_svgz(path) or bool(self.report["gzip"])
        write_atomically(path, file_bytes(self.svg, Flag()("gzip", gzip)))

    def outline(self, pens: int | None = None) -> str:
        """The SVG text of the outlines of the shapes; see gauss2svg.outline_svg."""
        return outline_svg(self.scene, self.document, pens=pens)

    @property
    def hiding(self) -> int:
        """Number of shapes that hide what is below them: opaque ones with crisp rims."""
        scene = self.scene
        return int(np.count_nonzero((scene.opacity >= _OPAQUE) & (scene.beta >= _CRISP)))

    def plates(self) -> dict[str, str]:
        """The SVG text of each ink's plate, by its #rrggbb; see gauss2svg.plate_svg.

        In the order of the inks, without those that are seen nowhere. Raises InputError for a run
        without inks.
        """
        if self.report["inks"] is None:
            raise InputError("inks must be given for plates; got none. Try FitOptions(inks=6)")
        used = {ink_name(ink) for ink in inks_of_scene(self.scene)}
        inks = [ink for ink in self.report["inks"].split(",") if ink in used]
        return {ink: plate_svg(self.scene, ink, self._of_plate(ink)) for ink in inks}

    def _of_plate(self, ink: str) -> Document:
        title = f"{self.document.title}: {ink}"
        return dataclasses.replace(self.document, title=title)

    def _repr_html_(self) -> str:
        alt = self.document.alt or self.document.title
        return image(self.svg.encode(), "image/svg+xml", alt)

    def __repr__(self) -> str:
        r = self.report
        return (
            f"<gauss2svg.Result {r['width']}x{r['height']}, {r['gaussians']} Gaussians, "
            f"{decibels(r['psnr_svg'])}, {r['svg_bytes']} bytes>"
        )
