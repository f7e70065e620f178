"""The report of a run, ready for JSON."""

import hashlib
import json
import math
import platform
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import several
from gauss2svg.measure import NO_SCORES, SCORES, decibels
from gauss2svg.measure.metrics import psnr
from gauss2svg.measure.roundtrip import paint_ms, round_trip, shown_width
from gauss2svg.options import flag_of
from gauss2svg.photo.pixels import Photo, has_alpha, over, shrunk
from gauss2svg.pipeline.outcome import Outcome
from gauss2svg.pipeline.plan import DEFAULT_PRESET, Plan
from gauss2svg.pipeline.run import Run
from gauss2svg.processes import held_bytes
from gauss2svg.raster import renderer_version
from gauss2svg.scene import ABOVE, Scene
from gauss2svg.scene.areas import AreaCounts
from gauss2svg.scene.inks import ink_colors, ink_name, inks_in, oklab, printed_colors
from gauss2svg.svg import CURRENT_COLOR, MINIMAL
from gauss2svg.svg.file import bytes_by_part
from gauss2svg.version import __version__
from gauss2svg.without_scipy import nearest_entry


def run_report(plan: Plan, photo: Photo, outcome: Outcome, run: Run) -> dict[str, Any]:
    """Measure the file of a run, and return a dict of all options and results.

    docs/reference/report.md explains its keys.
    """
    file, svg, raster = outcome.file, outcome.file.svg, outcome.raster
    chosen, subject, document = outcome.plan, outcome.subject, outcome.subject.document
    fitted, options, count = outcome.fitted, plan.options, len(file.scene)
    scored = round_trip(svg, file.scene, subject.photo, raster)
    scores, shown = _scores(plan, outcome, run), shown_width(document, file.scene)
    psnr_photo = psnr(raster, photo.pixels) if plan.sketch else scored["psnr_svg"]
    scored |= {**_by_focus(outcome), "psnr_photo": psnr_photo}
    total_s = time.perf_counter() - run.started
    counts, found = AreaCounts.of(file.scene.areas), outcome.found
    text, pixels = json.dumps(options.of_picture(), sort_keys=True), photo.pixels
    digest = hashlib.sha256(str(pixels.shape).encode())
    digest.update(np.ascontiguousarray(pixels, "<f4").data)
    is_counted = options.svg.palette is not None or not options.goal.count_adapts
    return {
        **options.flat(),
        "quality": None if chosen.is_budget else chosen.goal.quality or DEFAULT_PRESET,
        # Values that the run has chosen for options that the user did not give.
        **dict(zip(("inks", "paper", "overprint"), plan.printed or (), strict=False)),
        **dict(zip(("width", "height"), photo.original_size, strict=True)),
        **dict(zip(("fit_width", "fit_height"), subject.size, strict=True)),
        **dict(zip(("measured_width", "measured_height"), raster.shape[1::-1], strict=True)),
        "gaussians": count,
        **dict(zip(("area_count", "line_count", "node_count"), counts, strict=True)),
        "iterations": fitted.iterations,
        "falloff": chosen.fit_config.fit.shaped,
        "markup": chosen.markup,
        "stops": file.format.stops,
        "precision": None if chosen.by_bytes else file.format.precision,
        "tune": chosen.tune,
        "focus_strength": None if subject.focus is None else subject.focus.strength,
        "palette": chosen.quantization(count)[0] if is_counted else None,
        "size": document.size,
        "sketch": plan.sketch or None,
        "threads": run.threads,
        # Results.
        "rounds": fitted.rounds,
        "corrections": outcome.corrections,
        "rollbacks": fitted.rollbacks,
        "ink_shares": _ink_shares(plan, raster),
        "colors": _colors(file.scene),
        "gradients": svg.count("<radialGradient") + svg.count("<linearGradient"),
        "area_share": 0.0 if found is None else found.explained,
        "stop_reason": fitted.stop_reason,
        "unreached": [*unreached(plan, outcome, total_s)],
        "fit_s": fitted.wall_s,
        "fit_cpu_s": fitted.cpu_s,
        "area_find_s": 0.0 if found is None else found.find_s,
        "area_refine_s": 0.0 if found is None else found.refine_s,
        "pixel_pairs": fitted.pixel_pairs,
        "renderer": renderer_version(options.run.renderer),
        # The PSNR of equal images is infinite. It becomes None, because JSON has no infinity.
        **{name: None if value == math.inf else value for name, value in scored.items()},
        **scores,
        "bytes_by_part": bytes_by_part(svg),
        "paint_ms": paint_ms(file.scene, svg, shown),
        "paint_width": shown,
        "transparent": has_alpha(photo.pixels),
        "notes": [*photo.notes, *outcome.notes, *_notes(plan, photo, outcome, psnr_photo)],
        # The digest of the shape of the pixels as text, and of their float32 bytes.
        "pixels_sha256": digest.hexdigest(),
        # The digest of the options that change a file, as JSON with sorted names.
        "options_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "versions": dict(versions()),
        "total_s": total_s,
    }


def _scores(plan: Plan, outcome: Outcome, run: Run) -> dict[str, Any]:
    """Measure the scores that the options ask for."""
    aim = plan.aim
    if not plan.options.run.scores and (aim is None or aim.of.always):
        return NO_SCORES
    # This is imported here, because only few runs ask for scores.
    from gauss2svg.measure.perceptual import perceptual_scores

    known = {} if aim is None else {aim.of.slug: aim.of.sign * outcome.file.score}
    free_bytes = run.most_bytes - held_bytes()
    return perceptual_scores(outcome.raster, outcome.subject.photo, free_bytes, known)


def _colors(scene: Scene) -> int:
    """Return the number of colours of the Gaussians, and of the areas without gradients."""
    flat = [area.paint for area in scene.areas if isinstance(area.paint, tuple)]
    colors = np.concatenate([scene.color, np.reshape(flat, (-1, 3))])
    return len(np.unique(np.round(colors * 255), axis=0))


def _printed(plan: Plan) -> tuple[str, str | None, int | None] | None:
    """Return the inks, the paper and the strengths of a run, or None if it has no inks."""
    inks = plan.options.fit.inks
    return plan.printed or ((inks, None, None) if isinstance(inks, str) else None)


def _ink_shares(plan: Plan, raster: NDArray[np.float32]) -> list[float] | None:
    """Return for each ink the mean of its strength in the colours nearest to visible pixels."""
    if (printed := _printed(plan)) is None:
        return None
    mixes = printed_colors(*printed)
    pixels, table = raster.reshape(-1, raster.shape[2]), ink_colors(",".join(mixes))
    visible = pixels if pixels.shape[1] == 3 else pixels[pixels[:, 3] >= 0.5]
    entry = nearest_entry(table, visible[:, :3].astype(np.float64))[1]
    counts = np.bincount(entry, minlength=len(table)) @ np.array([*mixes.values()])
    return [round(share, 4) for share in (counts / max(1, len(visible))).tolist()]


def _by_focus(outcome: Outcome) -> dict[str, float | None]:
    """Return the PSNR in dB of the SVG inside of the mask, and that outside of it.

    Both are None if there is no mask.
    """
    subject, raster = outcome.subject, over(outcome.raster)
    if subject.focus is None:
        return {"psnr_svg_inside": None, "psnr_svg_outside": None}
    inside, photo = subject.focus.inside(*raster.shape[:2]), over(subject.photo)
    psnrs = (psnr(raster, photo, weight) for weight in (inside, 1 - inside))
    return dict(zip(("psnr_svg_inside", "psnr_svg_outside"), psnrs, strict=True))


SOFT = 30.0  # dB below which a file is soft, as the summary says


def _notes(plan: Plan, photo: Photo, outcome: Outcome, psnr_photo: float) -> Iterator[str]:
    """Yield notes on choices of the run that a user may want to know about or to change.

    psnr_photo  PSNR in dB of the SVG against the photo, with the paper of a sketch
    """
    scene, raster = outcome.file.scene, outcome.raster
    # If the bytes suffice for no shape, `unreached` reports it.
    is_clear, is_empty = has_alpha(photo.pixels), not len(scene) and not scene.areas
    if is_clear and is_empty and outcome.fitted.stop_reason != "max_bytes":
        yield "the SVG is empty, because the photo is too transparent to be visible"
    is_open = not (plan.goal.is_limited or plan.in_inks or plan.sketch or plan.prefers_areas)
    if outcome.found is not None and outcome.found.window is not None:
        yield (
            "the edges of this picture are soft, and those of its areas are crisp, which costs dB. "
            "For soft edges give --areas never"
        )
    elif scene.areas and is_open and psnr_photo < SOFT:
        yield "areas and lines are far from this picture. Soft shapes may be closer: --areas never"
    if outcome.plan.markup == MINIMAL != plan.options.svg.markup:
        yield (
            "the file is in minimal markup, which is closer in as few bytes but has no names or "
            "layers. For Inkscape, Figma and other editors give --markup editable"
        )
    has_color = is_empty or CURRENT_COLOR in outcome.file.svg
    if plan.options.svg.current_color and not has_color:
        many = "more than one colour" + ("" if plan.in_inks else ". Try --inks 2")
        why = "Gaussians. Try --areas always" if len(scene) else many
        yield f"--current-color has no effect, because the file has {why}"
    if (layered := plan.options.document.layered) and not (scene.level == ABOVE).any():
        names = " and ".join(map(flag_of, layered))
        have = "have" if len(layered) > 1 else "has"
        why = "because the file has no rounds of soft shapes. Try --areas never"
        yield f"{names} {have} no effect, {why}"
    if plan.sketch:
        inks = "one ink" if (count := plan.sketch.count(",")) == 1 else several(count, "ink")
        yield (
            f"drawn as a sketch: {inks} on paper of one colour. The match is that with the sketch "
            "without shadows, grain and stains, and without stairs of pixels. With them it is "
            f"{decibels(psnr_photo)}. For these give --areas never"
        )
    if printed := _printed(plan):
        used = [*inks_in(scene, *printed), printed[1]]
        unused = ", ".join(ink for ink in printed[0].split(",") if ink not in used)
        if unused:
            yield f"not used: {unused} of the inks, because other inks are closer everywhere"
    if plan.printed and (far := _far_colors(raster, outcome.subject.photo)):
        overprint = plan.printed[2]
        mixed = "" if overprint and overprint > 1 else ", or --overprint 3 if they may mix"
        yield f"{far}. Try inks of its colours, such as those of --inks 4{mixed}"


def _far_colors(raster: NDArray[np.float32], photo: NDArray[np.float32]) -> str:
    """Return a sentence on how much of a photo its inks are far from, or "" if it is little.

    It compares the mean colours of blocks in Oklab, 24 of them along the longer side
    (docs/decisions/inks.md).

    raster, photo  (h, w, 3), or (h, w, 4) with alpha, in 0..1
    """
    longest = max(photo.shape[:2])
    height, width = (max(1, round(min(24, longest) * n / longest)) for n in photo.shape[:2])
    drawn, wanted = (shrunk(over(p), height, width).astype(np.float64) for p in (raster, photo))
    is_far = np.square(oklab(drawn) - oklab(wanted)).sum(axis=2) > 0.15**2
    if (share := is_far.mean()) < 0.2:
        return ""
    drawn, wanted = drawn[is_far], wanted[is_far]
    usual = np.square(wanted - wanted.mean(axis=0)).sum(axis=1).argmin()
    example = f"{ink_name(wanted[usual])} of the photo is {ink_name(drawn[usual])}"
    return f"the inks are far from {100 * share:.0f} % of the photo. For example, {example}"


def unreached(plan: Plan, outcome: Outcome, seconds: float) -> Iterator[str]:
    """Yield a line for each target or limit that the outcome misses.

    seconds  time that the run has taken. If the run compiled the kernels, the time of this
             compilation is not included
    """
    goal, aim, limit, reason = plan.goal, plan.aim, plan.goal.time_limit, outcome.fitted.stop_reason
    scene = outcome.file.scene
    if aim is not None and not aim.is_met_by(outcome.file.score):
        reported = reason not in (aim.of.option, "interrupted")
        ended = f", stopped by {reason.replace('_', ' ')}" if reported else ""
        if reason == "cap":
            ended = f", stopped at {several(len(scene), 'shape')}, the most for this picture"
        sign, unit = aim.of.sign, f" {aim.of.unit}".rstrip()
        target = f"{'' if unit else aim.of.name + ' '}{sign * aim.value:g}{unit}"
        yield f"target of {target} not reached: {sign * outcome.file.score:.2f}{unit}{ended}"
    is_empty = not len(scene) and not scene.areas
    if is_empty and reason == "max_bytes":
        none = f"limit of {goal.max_bytes} bytes leaves no room for a shape: the file has none"
        yield f"{none}. Try a larger --max-bytes"
    if is_empty and reason == "interrupted":
        yield "interrupted before the first shape: the file has none"
    if limit is not None and seconds > 1.1 * limit + 0.1:
        yield f"time limit of {limit:.3g} s exceeded: {seconds:.1f} s. Try a smaller --max-size"


@cache  # reading the versions from the disk takes as long as a fit of a thumbnail
def versions() -> dict[str, str]:
    """Return the versions of gauss2svg, of Python and of the packages that a file may depend on."""
    found = {"gauss2svg": __version__, "python": platform.python_version()}
    names = ["numpy", "scipy", "scikit-image", "pillow", "pyvips", "pi-heif", "torch", "svgwrite"]
    names += ["resvg_py", "CairoSVG"]
    for name in (*names, *(score.package for score in SCORES if score.package)):
        # A package that is not installed is left out. It may belong to an extra.
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found
