"""The report of a run, ready for JSON, and what a browser takes to paint its file."""

from __future__ import annotations

import dataclasses
import math
import platform
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from gauss2svg.measure.perceptual import Scores
from gauss2svg.measure.scores import SCORES
from gauss2svg.photo.photo import Photo
from gauss2svg.pipeline.drawings import outline_bytes
from gauss2svg.pipeline.plan import Plan, unreached
from gauss2svg.pipeline.run import Run
from gauss2svg.pipeline.search.outcome import Outcome
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import cut_radius
from gauss2svg.scene.scene import narrowing_of
from gauss2svg.svg.canvas import pixels_of
from gauss2svg.svg.document import MINIMAL, Document
from gauss2svg.svg.file import bytes_by_part
from gauss2svg.svg.plates import ink_name, inks_of_scene
from gauss2svg.version import __version__


def run_report(
    plan: Plan,
    photo: Photo,
    outcome: Outcome,
    scores: Scores,
    run: Run,
) -> dict[str, Any]:
    """All options and results of a run; the keys are in docs/reference/report.md."""
    chosen, subject, document = outcome.plan, outcome.subject, outcome.subject.document
    fitted, measured, options = outcome.fitted, outcome.measured, plan.options
    total_s = run.total_s
    size_reached = measured.svgz_bytes if plan.counts_gzipped else measured.svg_bytes
    missed = unreached(
        options.goal, outcome.reached, size_reached, total_s - run.first_s, fitted.stop_reason,
        len(outcome.scene),
    )  # fmt: skip
    shown = shown_width(document, outcome.scene)
    palette, _ = chosen.quantization(len(outcome.scene))
    return {
        **options.flat(),
        "quality": chosen.quality,
        # Values of options that were left open.
        "width": photo.full[0],
        "height": photo.full[1],
        "fit_width": subject.size[0],
        "fit_height": subject.size[1],
        "measured_width": measured.raster.shape[1],
        "measured_height": measured.raster.shape[0],
        "gaussians": len(outcome.scene),
        "iterations": fitted.iterations,
        "falloff": chosen.fit_config.fit.shaped,
        "markup": chosen.markup,
        "stops": outcome.format.stops,
        "precision": None if chosen.by_bytes else outcome.format.precision,
        "tune": chosen.tune,
        "palette": palette if plan.palette_is_counted else None,
        "size": document.size,
        "threads": run.threads,
        # Results.
        "rounds": fitted.rounds,
        "corrections": outcome.corrections,
        "rollbacks": fitted.rollbacks,
        "colors": len(np.unique(np.round(outcome.scene.color * 255), axis=0)),
        "gradients": outcome.svg.count("<radialGradient"),
        "stop_reason": fitted.stop_reason,
        "unreached": missed,
        "compile_s": run.compile_s,
        "fit_s": fitted.wall_s,
        "fit_cpu_s": fitted.cpu_s,
        "pixel_pairs": fitted.pixel_pairs,
        **{
            field.name: _finite(getattr(measured, field.name))
            for field in dataclasses.fields(measured)
            if field.name != "raster"
        },
        **scores.report,
        "bytes_by_part": bytes_by_part(outcome.svg),
        # Filters were not measured.
        "paint_ms": None
        if "<filter" in outcome.svg
        else paint_ms(outcome.scene, outcome.svg, shown),
        "paint_width": shown,
        "transparent": photo.alpha is not None,
        "notes": _notes(plan, photo, outcome),
        "versions": dict(_versions()),
        "total_s": total_s,
    }


def _notes(plan: Plan, photo: Photo, outcome: Outcome) -> list[str]:
    notes, chosen = list(photo.notes), outcome.plan
    height, width = outcome.measured.raster.shape[:2]
    if (width, height) != (photo.width, photo.height):
        notes.append(f"measured at {width}x{height} px to meet the time limit")
    nothing = photo.alpha is not None and photo.alpha.any() and not len(outcome.scene)
    if nothing and not chosen.by_bytes:  # of which unreached says that it has no room
        notes.append("the SVG is empty, because the photo is too transparent to be visible")
    if chosen.markup == MINIMAL != plan.options.svg.markup:
        notes.append(
            "the file is in minimal markup, which is closer in as few bytes but has no names or "
            "layers. For Inkscape, Figma and other editors give --markup editable"
        )
    outlines = outline_bytes(photo.pixels)
    if outlines is not None and len(outcome.scene) and outlines <= len(outcome.svg):
        notes.append(
            "a tracer such as vtracer draws these few flat colours exactly in about "
            f"{math.ceil(outlines / 1000)} kB"
        )
    unused = _unused_inks(plan, outcome)
    if unused:
        notes.append(
            f"not used: {', '.join(unused)} of the inks, because other inks are closer everywhere"
        )
    rate = plan.options.fit.learning_rate
    if outcome.fitted.rollbacks and rate > 1:  # else nothing can be done about it
        notes.append(
            f"--learning-rate {rate:g} is too large for this picture. The fit diverged, went back "
            f"to its best state and ended with {outcome.fitted.rate:.3g}"
        )
    return notes


def _unused_inks(plan: Plan, outcome: Outcome) -> list[str]:
    inks: Any = plan.options.fit.inks
    if inks is None:
        return []
    used = {ink_name(ink) for ink in inks_of_scene(outcome.scene)}
    return [ink for ink in inks.split(",") if ink not in used]


def decibels(value: float | None) -> str:
    """A PSNR of the report as text; None is that of equal images."""
    return "equal" if value is None else f"{value:.2f} dB"


def _finite(value: Any) -> Any:
    """A PSNR; None for an infinite one, which JSON does not have."""
    return None if isinstance(value, float) and math.isinf(value) else value


@cache  # reading them from the disk takes as long as a fit of a thumbnail
def _versions() -> dict[str, str]:
    found = {"gauss2svg": __version__, "python": platform.python_version()}
    for name in (
        "numpy", "numba", "scipy", "scikit-image", "torch", "svgwrite", "resvg_py", "CairoSVG",
        *(score.package for score in SCORES if score.package),
    ):  # fmt: skip
        with suppress(PackageNotFoundError):  # extras may be missing
            found[name] = version(name)
    return found


# Milliseconds of a shape and of a million drawn pixels, by gradients and by masks
# (docs/benchmarks/paint.md).
_BY_GRADIENTS, _BY_MASKS = (0.03, 20.0), (0.9, 52.0)
# A tenth of a second is what people take for at once (Miller, "Response time in man-computer
# conversational transactions", 1968).
HEAVY_MS = 100.0
WIDEST_SHOWN = 1600.0  # px, about the widest that pages show a picture


def drawn_pixels(scene: Scene) -> float:
    """Pixels that a renderer blends at the scene's own size: the sum of all ellipses' areas.

    Of an ellipse counts the share that is on the canvas of its bounding box.
    """
    half = cut_radius(scene.beta)[:, None] * scene.sigma
    size = np.array([scene.width, scene.height])
    low, high = np.clip(scene.mean - half, 0, size), np.clip(scene.mean + half, 0, size)
    return float(np.pi / 4 * (narrowing_of(scene.rho) * np.prod(high - low, axis=1)).sum())


def shown_width(document: Document, scene: Scene) -> float:
    """Width in px at which a page probably shows a file: as --size says, or its own up to 1600."""
    sides = document.sides(scene.width, scene.height)
    return (pixels_of(sides[0]) or 0.0) if sides else min(scene.width, WIDEST_SHOWN)


def paint_ms(scene: Scene, svg: str, width: float | None = None) -> float:
    """Estimated CPU milliseconds of a browser's first paint, and of each repaint.

    a n + b drawn_pixels (width / scene.width)^2 / 1e6, width in px, by default that of the scene;
    a and b are of the file's ways of drawing soft shapes, as measured in Chromium without a GPU.
    Other machines differ by a factor of a few.
    """
    share = float("<mask" in svg)
    if share and "<style" in svg:  # of which some soft shapes are under masks
        masked = svg.count("<use ")
        share = masked / (masked + svg.count("<circle "))
    each, million = (
        share * by_masks + (1 - share) * by_gradients
        for by_masks, by_gradients in zip(_BY_MASKS, _BY_GRADIENTS, strict=True)
    )
    scale = 1.0 if width is None else width / scene.width
    return each * len(scene) + million * scale**2 * drawn_pixels(scene) / 1e6
