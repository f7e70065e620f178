"""Refusal of options that exclude each other, before anything slow begins."""

from __future__ import annotations

from collections.abc import Iterator

from gauss2svg.errors import InputError, RendererError, quoted, refusal
from gauss2svg.fit.options import DensifyOptions
from gauss2svg.measure.perceptual import require_packages
from gauss2svg.photo.photo import Photo
from gauss2svg.pipeline.options import Options
from gauss2svg.raster import DRAW_BLENDS, DRAW_MINIMAL, DRAW_ROTATED_BLURS
from gauss2svg.scene import ADD
from gauss2svg.svg.blur import GRADIENT
from gauss2svg.svg.document import EDITABLE, MINIMAL

_ROUNDS = ("per_round", "round_iterations", "schedule")  # options that need a given count
_LIMITS = ("target_psnr", "target_ssimulacra2", "max_bytes", "time_limit")


def check_together(options: Options) -> None:
    """Raise InputError if options conflict, or RendererError if the renderer lacks them."""
    for name, rule, got, advice in _exclusions(options):
        raise InputError(f"{name} must {rule}; got {got}. Try {advice}")
    renderer, svg = options.run.renderer, options.svg
    for is_asked, able, what, otherwise in (
        (options.written_blend == ADD, DRAW_BLENDS, "additive blending", ", or --portable"),
        (svg.markup == MINIMAL, DRAW_MINIMAL, "minimal markup", ""),
        (svg.form != GRADIENT, DRAW_ROTATED_BLURS, f"form {svg.form}", f", or --form {GRADIENT}"),
    ):
        if is_asked and renderer not in able:
            raise RendererError(
                f"renderer must be one of {', '.join(able)} for {what}; got {quoted(renderer)}. "
                f"Try --renderer {able[0]}{otherwise}"
            )


def check_alpha(options: Options, photo: Photo) -> None:
    """Raise InputError for additive blending of a transparent photo."""
    if photo.alpha is not None and options.written_blend == ADD:
        advice = "--matte white, or --portable"
        raise refusal("the photo", "opaque for additive blending", "a transparent one", advice)


def needs_editable(options: Options) -> str:
    """Return the first requested feature that a minimal file cannot have, or "" if none."""
    additive = ["additive blending"] * (options.written_blend == ADD)
    return next(iter([*additive, *_layered(options)]), "")


def _layered(options: Options) -> list[str]:
    """Return the requested features that additive, minimal and ink files cannot have."""
    form = options.svg.form
    return [*[f"form {form}"] * (form != GRADIENT), *options.document.layered]


def _exclusions(options: Options) -> Iterator[tuple[str, str, object, str]]:
    """Yield the name of an option, the rule that it breaks, its value, and what to try instead."""
    goal, fit, svg, layered = options.goal, options.fit, options.svg, _layered(options)
    if svg.portable and fit.blend != ADD:
        rule = f"be given with blend {ADD}, whose files it converts"
        yield "portable", rule, f"blend {fit.blend}", "without --portable"
    if svg.count_gzipped and goal.max_bytes is None:
        advice = "--max-bytes 60k --count-gzipped"
        yield "count_gzipped", "be given with max_bytes", "none", advice
    if svg.markup == MINIMAL and (needs := needs_editable(options)):
        why = "because a minimal file has neither layers nor filters"
        yield "markup", f"be {EDITABLE} with {needs}, {why}", svg.markup, "--markup auto"
    if options.written_blend == ADD and layered:
        why = "because its shapes do not cover each other in layers"
        rule = f"not be given with additive blending, {why}"
        of_form = layered[0] not in options.document.layered
        yield layered[0], rule, f"blend {ADD}", f"--form {GRADIENT}" if of_form else "--portable"
    others = {
        f"blend {ADD}": fit.blend == ADD,
        f"falloff {fit.falloff}": fit.falloff is not None,
        "palette": svg.palette is not None,
        "stops": svg.stops is not None,
    }
    for name in [*(name for name, is_given in others.items() if is_given), *layered]:
        if fit.inks is not None:
            why = "a picture in inks has opaque shapes without gradients, in one layer for each ink"
            yield name, f"not be given with inks, because {why}", f"inks {fit.inks}", "without it"
    for name in _ROUNDS if goal.count_adapts else ():
        value = getattr(options.densify, name)
        if value != getattr(DensifyOptions, name):
            given = [one for one in _LIMITS if getattr(goal, one) is not None]
            flags = " and ".join(f"--{one.replace('_', '-')}" for one in given)
            advice = "--gaussians 1000" + (f" without {flags}" if given else "")
            rule = "be given with a number of Gaussians, and without a target or limit"
            yield name, rule, value, advice
    score = None if goal.target is None or goal.target.always else goal.target
    if options.run.scores or score is not None:
        require_packages(score)
        if goal.time_limit is not None:
            name = "scores" if options.run.scores or score is None else score.option
            rule = "not be given with time_limit, because the time that scores take is unknown"
            yield name, rule, f"{goal.time_limit:g}", "gauss2svg check on the SVG"
