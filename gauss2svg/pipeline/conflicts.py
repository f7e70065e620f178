"""Options that exclude each other, which are refused before anything slow begins."""

from __future__ import annotations

from collections.abc import Iterator

from gauss2svg.errors import InputError, RendererError, quoted
from gauss2svg.fit import GAUSSIAN
from gauss2svg.measure import require_packages
from gauss2svg.pipeline.options import ALWAYS, NEVER, Options
from gauss2svg.raster import DRAW_BLENDS, DRAW_MINIMAL, DRAW_ROTATED_BLURS
from gauss2svg.scene import ADD
from gauss2svg.scene.ink_lists import LEAST_INKS, MOST_INKS
from gauss2svg.scene.inks import printed_colors
from gauss2svg.svg import EDITABLE, MINIMAL
from gauss2svg.svg.forms import GRADIENT


def check_together(options: Options) -> None:
    """Raise InputError if options conflict, or RendererError for what the renderer cannot draw."""
    for name, rule, got, advice in _conflicts(options):
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


def needs_editable(options: Options) -> str:
    """Return the first requested feature that a minimal file cannot have, "" if there is none."""
    additive = ["additive blending"] * (options.written_blend == ADD)
    return next(iter([*additive, *_layered(options)]), "")


def _layered(options: Options) -> list[str]:
    """Return the requested features that no additive, minimal or ink file can have."""
    form = options.svg.form
    return [*[f"form {form}"] * (form != GRADIENT), *options.document.layered]


def without_areas(options: Options) -> dict[str, object]:
    """Return the given options with which a file has no areas, by their names.

    They ask for the method of the paper, whose pictures are a given number of Gaussians.
    """
    goal, fit = options.goal, options.fit
    asked = {
        "gaussians": None if goal.count_adapts else goal.count,
        "blend": fit.blend if fit.blend == ADD else None,
        "falloff": fit.falloff if fit.falloff == GAUSSIAN else None,
    }
    return {name: value for name, value in asked.items() if value is not None}


def _conflicts(options: Options) -> Iterator[tuple[str, str, object, str]]:
    """Yield for each conflict the name of an option, the rule it breaks, its value, and advice."""
    goal, fit, svg = options.goal, options.fit, options.svg
    layered, inks, tones = _layered(options), fit.inks, fit.overprint
    if svg.areas == ALWAYS:
        for name, value in without_areas(options).items():
            yield name, f"not be given with areas {ALWAYS}", value, f"--areas {NEVER}"
    if svg.portable and fit.blend != ADD:
        yield "portable", f"be given with blend {ADD}", f"blend {fit.blend}", "without --portable"
    if svg.count_gzipped and goal.max_bytes is None:
        advice = "--max-bytes 60k --count-gzipped"
        yield "count_gzipped", "be given with max_bytes", "none", advice
    if svg.markup == MINIMAL and (needs := needs_editable(options)):
        yield "markup", f"be {EDITABLE} with {needs}", svg.markup, "--markup auto"
    for name in layered if options.written_blend == ADD else ():
        advice = f"--form {GRADIENT}" if name.startswith("form") else "--portable"
        yield name, "not be given with additive blending", f"blend {ADD}", advice
    if inks is not None:
        why = "because a picture in inks has opaque shapes without gradients, in one layer each"
        asked = {"blend": fit.blend == ADD, "falloff": fit.falloff is not None}
        asked |= {"palette": svg.palette is not None, "stops": svg.stops is not None}
        for name in (*(name for name, is_asked in asked.items() if is_asked), *layered):
            yield name, f"not be given with inks, {why}", f"inks {inks}", "without it"
    if fit.paper is not None and inks is None:
        yield "paper", "be given with inks", fit.paper, f'--inks 3 --paper "{fit.paper}"'
    if isinstance(inks, str):
        count = inks.count(",") + 1
        if tones is not None and (tones + 1) ** count > MOST_INKS:
            most = int(MOST_INKS ** (1 / count) + 1e-9) - 1
            rule, got = f"make at most {MOST_INKS} mixes", f"{tones} for {count} inks"
            yield "overprint", rule, got, str(most) if most else "fewer inks"
        elif len(printed_colors(inks, fit.paper, tones)) < LEAST_INKS:
            yield "inks", "be another colour than the paper", inks, '--inks "#0078bf,#ff48b0"'
    elif tones is not None:
        yield "overprint", "be given with inks that are listed", tones, '--inks "#0078bf,#ff48b0"'
    score = None if goal.target is None or goal.target.always else goal.target
    if options.run.scores or score is not None:
        require_packages(score)
        if goal.time_limit is not None:
            name = "scores" if options.run.scores or score is None else score.option
            rule = "not be given with time_limit, because the time that scores take is unknown"
            yield name, rule, f"{goal.time_limit:g}", "gauss2svg check on the SVG"
