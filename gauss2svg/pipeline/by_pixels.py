"""The file of pixel art: its areas, which draw it exactly. Nothing is searched or fitted."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Iterator

import numpy as np

from gauss2svg.areas.find import FoundAreas
from gauss2svg.areas.pixels import Sprite, areas_of_sprite
from gauss2svg.fit import FitResult
from gauss2svg.pipeline.found import sprite_in_inks
from gauss2svg.pipeline.outcome import Exporter, Outcome, Subject
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.run import Run
from gauss2svg.scene import Scene
from gauss2svg.svg import SvgFormat


def exact_outcomes(plan: Plan, run: Run, subject: Subject, sprite: Sprite) -> Iterator[Outcome]:
    """Yield the file of a sprite if it is within the limit of bytes, or else nothing.

    If the file is too large, it is tried without overlaps.
    """
    if isinstance(inks := plan.options.fit.inks, str):
        sprite = sprite_in_inks(sprite, inks)
    exporter, limit = Exporter(plan, subject), plan.goal.byte_limit or math.inf
    for overlap in (True, False):
        run.notify("areas")
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        areas, ground = areas_of_sprite(sprite, overlap)
        fitted_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
        (width, height), (rows, columns) = subject.canvas, sprite.cells.shape
        scale = width / (columns * sprite.side), height / (rows * sprite.side)
        scene = Scene(
            width, height, background=np.ones(3) if ground is None else np.array(ground),
            transparent=ground is None, areas=tuple(area.scaled(*scale) for area in areas),
        )  # fmt: skip
        run.notify("write")
        file = exporter.written(scene, _format(plan, scene))
        if file.size <= limit:
            run.notify("measure")
            measured = exporter.measured(file)
            found = FoundAreas(areas, ground, 1.0, measured.scores["psnr_model"], fitted_s[0], 0.0)
            fitted = FitResult(scene, 0, 0, *fitted_s, 0, "gain")
            yield Outcome(plan, subject, file, fitted, measured, 0, found=found)
            return


def _format(plan: Plan, scene: Scene) -> SvgFormat:
    """Return the format of a file whose user unit is as large as the outlines allow."""
    # With 3 decimals, opacities of 8 bits are off by an eighth of a level.
    svg_format = dataclasses.replace(plan.format, opacity_decimals=3)
    if plan.options.svg.precision is not None:
        return svg_format
    points = np.array([p for area in scene.areas for one in area.outlines for p in one.points])
    units = (unit for unit in (1.0, 0.5) if (points % unit == 0).all())
    return dataclasses.replace(svg_format, precision=next(units, svg_format.precision))
