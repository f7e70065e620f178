"""The report of a run, ready for JSON, and the time that a browser takes to paint its file."""

from __future__ import annotations

import math
import platform
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from gauss2svg.measure.perceptual import Scores
from gauss2svg.measure.scores import SCORES
from gauss2svg.photo.photo import Photo
from gauss2svg.pipeline.memory_budget import measured_size
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
    plan: Plan, photo: Photo, outcome: Outcome, scores: Scores, run: Run
) -> dict[str, Any]:
    """Return all options and results of a run, with the keys of docs/reference/report.md."""
    chosen, subject, document = outcome.plan, outcome.subject, outcome.subject.document
    fitted, measured, options = outcome.fitted, outcome.measured, plan.options
    total_s, count = run.total_s, len(outcome.scene)
    size = measured.svgz_bytes if plan.counts_gzipped else measured.svg_bytes
    shown = shown_width(document, outcome.scene)
    is_counted = options.svg.palette is not None or not options.goal.count_adapts
    reached, seconds = outcome.reached, total_s - run.first_s
    missed = unreached(options.goal, reached, size, seconds, fitted.stop_reason, count)
    return {
        **options.flat(),
        "quality": chosen.quality,
        # Values that were chosen for options that were not given.
        **_sides("", photo.full),
        **_sides("fit_", subject.size),
        **_sides("measured_", measured.raster.shape[1::-1]),
        "gaussians": count,
        "iterations": fitted.iterations,
        "falloff": chosen.fit_config.fit.shaped,
        "markup": chosen.markup,
        "stops": outcome.format.stops,
        "precision": None if chosen.by_bytes else outcome.format.precision,
        "tune": chosen.tune,
        "palette": chosen.quantization(count)[0] if is_counted else None,
        "size": document.size,
        "threads": run.threads,
        # Results.
        "rounds": fitted.rounds,
        "corrections": outcome.corrections,
        "rollbacks": fitted.rollbacks,
        "colors": len(np.unique(np.round(outcome.scene.color * 255), axis=0)),
        "gradients": outcome.svg.count("<radialGradient"),
        "stop_reason": fitted.stop_reason,
        "unreached": [*missed],
        "compile_s": run.compile_s,
        "fit_s": fitted.wall_s,
        "fit_cpu_s": fitted.cpu_s,
        "pixel_pairs": fitted.pixel_pairs,
        **{k: _finite(v) for k, v in vars(measured).items() if k != "raster"},
        **scores.report,
        "bytes_by_part": bytes_by_part(outcome.svg),
        "paint_ms": paint_ms(outcome.scene, outcome.svg, shown),
        "paint_width": shown,
        "transparent": photo.alpha is not None,
        "notes": [*photo.notes, *_notes(plan, photo, outcome)],
        "versions": dict(_versions()),
        "total_s": total_s,
    }


def _sides(prefix: str, size: tuple[int, ...]) -> dict[str, int]:
    return {f"{prefix}width": size[0], f"{prefix}height": size[1]}


def _notes(plan: Plan, photo: Photo, outcome: Outcome) -> Iterator[str]:
    """Yield notes on what a user may want to know or change."""
    chosen, count, rate = outcome.plan, len(outcome.scene), plan.options.fit.learning_rate
    usual, size = measured_size(photo.full, outcome.subject.size), (photo.width, photo.height)
    if plan.goal.time_limit is not None and size < usual:
        yield f"measured at {photo.width}x{photo.height} px to meet the time limit"
    # After a search by bytes, `unreached` reports that the bytes suffice for no shape.
    if photo.alpha is not None and photo.alpha.any() and not count and not chosen.by_bytes:
        yield "the SVG is empty, because the photo is too transparent to be visible"
    if chosen.markup == MINIMAL != plan.options.svg.markup:
        yield (
            "the file is in minimal markup, which is closer in as few bytes but has no names or "
            "layers. For Inkscape, Figma and other editors give --markup editable"
        )
    inks: Any = plan.options.fit.inks
    used = {ink_name(ink) for ink in inks_of_scene(outcome.scene)} if inks else set()
    unused = ", ".join(ink for ink in (inks or "").split(",") if ink not in used)
    if unused:
        yield f"not used: {unused} of the inks, because other inks are closer everywhere"
    if outcome.fitted.rollbacks and rate > 1:  # the user can lower it
        yield (
            f"--learning-rate {rate:g} is too large for this picture. The fit diverged, went back "
            f"to its best state and ended with {outcome.fitted.rate:.3g}"
        )


def decibels(value: float | None) -> str:
    """Return a PSNR of the report as text. None stands for equal images."""
    return "equal" if value is None else f"{value:.2f} dB"


def _finite(value: Any) -> Any:
    """Return a value, or None for an infinite PSNR, because JSON has no infinity."""
    return None if isinstance(value, float) and math.isinf(value) else value


@cache  # reading the versions from the disk takes as long as a fit of a thumbnail
def _versions() -> dict[str, str]:
    found = {"gauss2svg": __version__, "python": platform.python_version()}
    for name in (
        "numpy", "numba", "scipy", "scikit-image", "torch", "svgwrite", "resvg_py", "CairoSVG",
        *(score.package for score in SCORES if score.package),
    ):  # fmt: skip
        with suppress(PackageNotFoundError):  # extras may be missing
            found[name] = version(name)
    return found


# Milliseconds for painting a shape and a million drawn pixels, with gradients and with masks
# (docs/benchmarks/paint.md).
_BY_GRADIENTS, _BY_MASKS = np.array([0.03, 20.0]), np.array([0.9, 52.0])
# Paint time in ms from which a file is heavy. A tenth of a second seems immediate to people
# (Miller, "Response time in man-computer conversational transactions", 1968).
HEAVY_MS = 100.0
WIDEST_SHOWN = 1600.0  # px, about the greatest width at which pages show a picture


def drawn_pixels(scene: Scene) -> float:
    """Return the pixels that a renderer blends at the scene's size: the sum of all ellipses' areas.

    The area of an ellipse is multiplied by the share of its bounding box that is on the canvas.
    """
    half = cut_radius(scene.beta)[:, None] * scene.sigma
    size = np.array([scene.width, scene.height])
    low, high = np.clip(scene.mean - half, 0, size), np.clip(scene.mean + half, 0, size)
    return float(np.pi / 4 * (narrowing_of(scene.rho) * np.prod(high - low, axis=1)).sum())


def shown_width(document: Document, scene: Scene) -> float:
    """Return the probable width in px of a file on a page: by --size, or its own up to 1600."""
    sides = document.sides(scene.width, scene.height)
    return (pixels_of(sides[0]) or 0.0) if sides else min(scene.width, WIDEST_SHOWN)


def paint_ms(scene: Scene, svg: str, width: float) -> float | None:
    """Return the estimated CPU milliseconds of a browser's first paint and of each repaint.

    They are a n + b drawn_pixels (width / scene.width)^2 / 1e6, with width in px. a and b depend on
    how the file draws soft shapes, and were measured in Chromium without a GPU. Other machines may
    differ several times. Return None for a file with filters, which were not measured.
    """
    if "<filter" in svg:
        return None
    share = float("<mask" in svg)
    if share and "<style" in svg:  # only some of the soft shapes are under masks
        masked = svg.count("<use ")
        share = masked / (masked + svg.count("<circle "))
    each, million = share * _BY_MASKS + (1 - share) * _BY_GRADIENTS
    pixels = (width / scene.width) ** 2 * drawn_pixels(scene)
    return float(each * len(scene) + million * pixels / 1e6)
