"""The report of a run: every number of it, ready for JSON."""

from __future__ import annotations

import dataclasses
import math
import platform
from importlib.metadata import version
from typing import Any

import numpy as np

from gauss2svg.attempt import Outcome
from gauss2svg.finish import Finish
from gauss2svg.image import Photo
from gauss2svg.request import Request
from gauss2svg.svg import bytes_by_part
from gauss2svg.version import __version__
from gauss2svg.warmup import COMPILED_S


def run_report(
    request: Request,
    photo: Photo,
    outcome: Outcome,
    fit_size: tuple[int, int],
    *,
    threads: int,
    compile_s: float,
    total_s: float,
) -> dict[str, Any]:
    """What a run was asked for, what came of it and what it took; see the README for the keys.

    fit_size  width and height in px of the picture that the fit ran on
    """
    fitted, measured, page, targets = (
        outcome.fitted, outcome.measured, request.page, request.targets,
    )  # fmt: skip
    fit_width, fit_height = fit_size
    run_s = total_s - (compile_s if compile_s > COMPILED_S else 0.0)
    size_reached = measured.svgz_bytes if request.gzip else measured.svg_bytes
    unreached = targets.unreached(measured.psnr_lowest, size_reached, run_s, fitted.stop_reason)
    notes = list(photo.notes)
    measured_height, measured_width = measured.raster.shape[:2]
    if (measured_width, measured_height) != (photo.width, photo.height):
        notes.append(f"measured at {measured_width}x{measured_height} px for want of time")
    if photo.alpha is not None and photo.alpha.any() and not len(outcome.scene):
        notes.append("what shows of the photo is too faint for any renderer: the SVG is empty")
    if fitted.rollbacks:
        times = "once" if fitted.rollbacks == 1 else f"{fitted.rollbacks} times"
        notes.append(
            f"fit ran away {times}, was taken back to its best state, and went on in smaller steps"
            + (f": in the end {fitted.rate:.3g} times the usual" if fitted.rate != 1 else "")
        )
    return {
        "width": photo.width,
        "height": photo.height,
        "fit_width": fit_width,
        "fit_height": fit_height,
        "gaussians": len(outcome.scene),
        "iterations": fitted.iterations,
        "rounds": fitted.rounds,
        "corrections": outcome.corrections,
        "quality": request.quality,
        "target_psnr": targets.psnr,
        "max_bytes": targets.max_bytes,
        "time_limit": targets.time_limit_s,
        "init": request.init,
        "schedule": request.schedule,
        "loss": request.loss,
        "ssim_weight": request.ssim_weight,
        "per_round": request.per_round,
        "round_iterations": request.round_iterations,
        "relocate": request.relocate,
        "learning_rate": request.learning_rate,
        "rollbacks": fitted.rollbacks,
        "blend": request.blend,
        "portable": request.portable,
        "falloff": request.fit_options.falloff,
        "form": outcome.svg_options.form,
        "palette": outcome.svg_options.palette if request.palette_is_counted else None,
        "colors": len(np.unique(np.round(outcome.scene.color * 255), axis=0)),
        "gradients": outcome.svg.count("<radialGradient"),
        "stops": outcome.svg_options.stops,
        "precision": outcome.svg_options.precision,
        "title": page.title,
        "alt": page.alt,
        "size": page.size,
        "aspect": page.aspect,
        "segments": None if page.segments is None else len(np.unique(page.segments)),
        "animate": page.animate,
        "fragments": page.fragments,
        "gzip": request.gzip,
        "seed": request.seed,
        "dtype": request.dtype,
        "threads": threads,
        "stop_reason": fitted.stop_reason,
        "unreached": unreached,
        "compile_s": compile_s,
        "fit_s": fitted.wall_s,
        "fit_cpu_s": fitted.cpu_s,
        "pixel_pairs": fitted.pixel_pairs,
        **{
            field.name: _finite(getattr(measured, field.name))
            for field in dataclasses.fields(measured)
            if field.name != "raster"
        },
        "finish": request.finish,
        "finish_drawings": outcome.finish.drawings if outcome.finish else None,
        "finish_gains": _gains(outcome.finish),
        "bytes_by_part": bytes_by_part(outcome.svg),
        "transparent": photo.alpha is not None,
        "matte": request.matte,
        "notes": notes,
        "versions": _versions(),
        "total_s": total_s,
    }


def decibels(value: float | None) -> str:
    """A PSNR of the report as text."""
    return "equal" if value is None else f"{value:.2f} dB"


def _gains(finish: Finish | None) -> dict[str, list[float | None]] | None:
    """PSNR in dB before and after the finish, by renderer."""
    if finish is None:
        return None
    return {name: [_finite(psnr) for psnr in pair] for name, pair in finish.gains.items()}


def _finite(value: Any) -> Any:
    """None for an infinite PSNR, of equal pictures: JSON has no infinity."""
    return None if isinstance(value, float) and math.isinf(value) else value


def _versions() -> dict[str, str]:
    names = ("numpy", "numba", "scipy", "scikit-image", "torch", "svgwrite", "resvg_py", "CairoSVG")
    found = {"gauss2svg": __version__, "python": platform.python_version()}
    return found | {name: version(name) for name in names}
