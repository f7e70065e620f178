"""The file of pixel art: its areas, which draw it exactly. Nothing is searched or fitted."""

from __future__ import annotations

import dataclasses
import math
import time

import numpy as np

from gauss2svg.areas.find import FoundAreas
from gauss2svg.areas.pixels import areas_of_sprite
from gauss2svg.fit import FitResult
from gauss2svg.pipeline.found import sprite_in_inks
from gauss2svg.pipeline.outcome import Exporter, Outcome, Subject
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.run import Run
from gauss2svg.scene import Scene
from gauss2svg.svg import SvgFormat


def exact(plan: Plan, subject: Subject, run: Run) -> Outcome | None:
    """Return the file of a sprite if it is within the limit of bytes, and None otherwise.

    If the file is too large, it is tried without overlaps.
    """
    sprite, inks = subject.sprite, plan.options.fit.inks
    assert sprite is not None
    if isinstance(inks, str):
        sprite = sprite_in_inks(sprite, inks)
    exporter, limit = Exporter(plan, subject), plan.goal.byte_limit or math.inf
    (width, height), (rows, columns) = subject.canvas, sprite.cells.shape
    scale = width / (columns * sprite.side), height / (rows * sprite.side)
    for overlap in (True, False):
        run.notify("areas")
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        areas, ground = areas_of_sprite(sprite, overlap)
        wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
        scene = Scene(
            width, height, background=np.ones(3) if ground is None else np.array(ground),
            transparent=ground is None, areas=tuple(area.scaled(*scale) for area in areas),
        )  # fmt: skip
        run.notify("write")
        file = exporter.written(scene, _format(plan, scene))
        if file.size <= limit:
            fitted = FitResult(scene, 0, 0, wall_s, cpu_s, 0, "gain")
            found = FoundAreas(areas, ground, 1.0, math.inf, wall_s, 0.0)
            return exporter.outcome(file, fitted, 0, found)
    return None


def _format(plan: Plan, scene: Scene) -> SvgFormat:
    """Return the format of a file whose user unit is as large as the outlines allow."""
    # With 3 decimals, opacities of 8 bits are off by an eighth of a level.
    svg_format = dataclasses.replace(plan.format, opacity_decimals=3)
    if plan.options.svg.precision is not None:
        return svg_format
    points = np.array([p for area in scene.areas for one in area.outlines for p in one.points])
    units = (unit for unit in (1.0, 0.5) if (points % unit == 0).all())
    return dataclasses.replace(svg_format, precision=next(units, svg_format.precision))
