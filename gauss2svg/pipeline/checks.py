"""Options that exclude each other, refused before anything slow begins."""

from __future__ import annotations

from gauss2svg.errors import InputError, RendererError, quoted
from gauss2svg.fit.options import DensifyOptions
from gauss2svg.measure.perceptual import require_packages
from gauss2svg.photo.photo import Photo
from gauss2svg.pipeline.options import Options
from gauss2svg.raster import DRAW_BLENDS, DRAW_MINIMAL, DRAW_ROTATED_BLURS
from gauss2svg.scene import ADD
from gauss2svg.svg.blur import GRADIENT
from gauss2svg.svg.document import EDITABLE, MINIMAL


def check_together(options: Options) -> None:
    """Raise InputError for options that exclude each other, RendererError where a renderer does."""
    _check_blend(options)
    _check_rounds(options)
    _check_shapes(options)
    _check_inks(options)
    goal, svg = options.goal, options.svg
    if svg.count_gzipped and goal.max_bytes is None:
        raise InputError(
            "count_gzipped must be given with max_bytes; got none. Try "
            "--max-bytes 60k --count-gzipped"
        )
    _check_time(options)


def check_alpha(options: Options, photo: Photo) -> None:
    """Raise InputError for additive blending of a transparent photo."""
    if photo.alpha is not None and options.written_blend == ADD:
        raise InputError(
            "the photo must be opaque for additive blending; got a transparent one. Try "
            "--matte white, or --portable"
        )


def needs_editable(options: Options) -> str:
    """What is asked for that a minimal file does not have; empty if nothing."""
    svg = options.svg
    needs = [f"form {svg.form}"] * (svg.form != GRADIENT)
    needs += ["additive blending"] * (options.written_blend == ADD)
    return next(iter(needs + options.document.layered), "")


def _check_blend(options: Options) -> None:
    """Refuse what an additive file cannot have."""
    svg, document, blend = options.svg, options.document, options.fit.blend
    if svg.portable and blend != ADD:
        raise InputError(
            f"portable must be given with blend {ADD}, whose files it converts; got blend {blend}. "
            "Try without --portable"
        )
    if options.written_blend != ADD:
        return
    renderer = options.run.renderer
    if renderer not in DRAW_BLENDS:
        raise RendererError(
            f"renderer must be one of {', '.join(DRAW_BLENDS)} for additive blending; got "
            f"{quoted(renderer)}. Try --renderer {DRAW_BLENDS[0]}, or --portable"
        )
    for name in [f"form {svg.form}"] * (svg.form != GRADIENT) + document.layered:
        raise InputError(
            f"{name} must not be given with additive blending, because its shapes do not cover "
            "each other in layers. Try --portable"
        )


def _check_rounds(options: Options) -> None:
    """Refuse rounds of a count that is not given."""
    goal, densify = options.goal, options.densify
    if not goal.count_adapts:
        return
    limits = ("target_psnr", "target_ssimulacra2", "max_bytes", "time_limit")
    given = [f"--{one.replace('_', '-')}" for one in limits if getattr(goal, one) is not None]
    advice = "--gaussians 1000" + (f" without {' and '.join(given)}" if given else "")
    for name in ("per_round", "round_iterations", "schedule"):
        value = getattr(densify, name)
        if value != getattr(DensifyOptions, name):
            raise InputError(
                f"{name} must be given with a number of Gaussians, and without a target or limit; "
                f"got {value}. Try {advice}"
            )


def _check_shapes(options: Options) -> None:
    """Refuse markup and forms that the file or its renderer does not have."""
    svg, renderer = options.svg, options.run.renderer
    if svg.markup == MINIMAL and needs_editable(options):
        raise InputError(
            f"markup must be {EDITABLE} with {needs_editable(options)}, because a minimal file has "
            f"neither layers nor filters; got {svg.markup}. Try --markup auto"
        )
    if svg.markup == MINIMAL and renderer not in DRAW_MINIMAL:
        raise RendererError(
            f"renderer must be one of {', '.join(DRAW_MINIMAL)} for minimal markup; got "
            f"{quoted(renderer)}. Try --renderer resvg"
        )
    if svg.form != GRADIENT and renderer not in DRAW_ROTATED_BLURS:
        raise RendererError(
            f"form must be {GRADIENT} with the renderer {renderer}, which draws rotated blurs "
            f"wrongly; got {svg.form}. Try --renderer {DRAW_ROTATED_BLURS[0]}"
        )


def _check_inks(options: Options) -> None:
    """Refuse beside inks what asks for other shapes, colours or layers."""
    fit, svg = options.fit, options.svg
    if fit.inks is None:
        return
    others = {
        f"blend {ADD}": fit.blend == ADD,
        f"falloff {fit.falloff}": fit.falloff is not None,
        f"form {svg.form}": svg.form != GRADIENT,
        "palette": svg.palette is not None,
        "stops": svg.stops is not None,
    }
    for name in [*(name for name, given in others.items() if given), *options.document.layered]:
        raise InputError(
            f"{name} must not be given with inks, because a picture in inks has opaque shapes "
            f"without gradients, in one layer for each ink; got inks {fit.inks}. Try without it"
        )


def _check_time(options: Options) -> None:
    """Refuse a time limit beside what takes an unknown time."""
    goal, run = options.goal, options.run
    asked = None if goal.target is None or goal.target.always else goal.target
    name = "scores" if run.scores or asked is None else asked.option
    if run.scores or asked is not None:
        require_packages(asked)
        if goal.time_limit is not None:
            raise InputError(
                f"{name} must not be given with time_limit, because the time that scores take "
                f"is unknown; got {goal.time_limit:g}. Try gauss2svg check on the SVG"
            )
