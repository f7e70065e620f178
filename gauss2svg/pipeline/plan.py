"""The plan of a run: its options resolved and checked against each other before the fit."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from gauss2svg.errors import InputError, RendererError, must_be
from gauss2svg.fit.choices import DEFAULT_LOSS
from gauss2svg.fit.options import DensifyOptions, FitConfig
from gauss2svg.measure.scores import require_packages
from gauss2svg.photo.photo import Photo
from gauss2svg.pipeline.aims import Aim, aim_of
from gauss2svg.pipeline.options import AUTO, Goal, Options
from gauss2svg.pipeline.presets import PRESETS, Preset
from gauss2svg.raster import DRAW_BLENDS, DRAW_MINIMAL, DRAW_ROTATED_BLURS, renderer_version
from gauss2svg.scene import ADD, OVER
from gauss2svg.svg.blur import GRADIENT
from gauss2svg.svg.format import EDITABLE, MINIMAL, SvgFormat

# Mean squared error that a palette may add in any case: 38 dB, about three levels of 255. With
# eight levels, which a coarse fit of foliage would allow, sky and leaves change their hue.
LARGEST_COLOR_ERROR = 1.6e-4
# Bytes from which on names and layers are little of a file (docs/decisions/minimal.md).
MINIMAL_UP_TO = 20_000
# Bytes up to which a minimal file is by far the closer one (docs/decisions/minimal.md).
_MINIMAL_IS_CLOSER_UP_TO = 60_000
# Bytes from which an editable file may be the closer one (docs/decisions/small.md).
_EDITABLE_FROM = 5000
_NEARLY = 1.5  # times a preset's largest side, which it then reduces little
# dB that the palette of a given count may cost by having fewer entries than allowed.
_UNSEEN_COLOR_LOSS = 0.03


@dataclass(frozen=True)
class Quantization:
    """How colours are quantised: two arguments of gauss2svg.pipeline.quantize.quantize."""

    palette: int
    color_error: float


@dataclass(frozen=True)
class Plan:
    """The resolved options of a run; raises InputError for options that exclude each other.

    fit_side  longest side in px of the image that the fit runs on, None before the photo is read
    """

    options: Options
    fit_side: int | None = None

    def __post_init__(self) -> None:
        goal, svg, run = self.options.goal, self.options.svg, self.options.run
        self._check_blend()
        self._check_rounds()
        if svg.markup == MINIMAL and self._needs_editable:
            raise InputError(
                f"markup must be {EDITABLE} with {self._needs_editable}; got {svg.markup}: a "
                "minimal file has neither layers nor filters. Try --markup auto"
            )
        if svg.markup == MINIMAL and run.renderer not in DRAW_MINIMAL:
            needed = f"one of {', '.join(DRAW_MINIMAL)} for minimal markup"
            raise RendererError(must_be("renderer", needed, run.renderer, "--renderer resvg"))
        if svg.form != GRADIENT and run.renderer not in DRAW_ROTATED_BLURS:
            raise RendererError(
                f"form must be {GRADIENT} with the renderer {run.renderer}, which does not render "
                f"rotated blurs; got {svg.form}. Try --renderer {DRAW_ROTATED_BLURS[0]}"
            )
        targeted = goal.target_ssimulacra2 is not None
        name = "scores" if run.scores else "target_ssimulacra2"
        if run.scores or targeted:
            require_packages(ssimulacra2=targeted)
            if goal.time_limit is not None:
                raise InputError(
                    f"{name} must not be given with time_limit, because how long scores take is "
                    f"not known; got {goal.time_limit:g}. Try gauss2svg check on the SVG"
                )
        for name in ("checkpoint", "resume"):
            if getattr(run, name) is not None and goal.time_limit is not None:
                raise InputError(
                    f"time_limit must not be given with {name}, because a run with a time limit is "
                    f"not repeatable; got {goal.time_limit:g}. Try --iterations instead"
                )
        _ = self.fit_config

    def check_renderer(self) -> None:
        """Raise RendererError if the measuring renderer is not installed."""
        renderer_version(self.options.run.renderer)

    def check_alpha(self, photo: Photo) -> None:
        """Raise InputError for additive blending of a transparent photo."""
        if photo.alpha is not None and self.written_blend == ADD:
            raise InputError(
                "the photo must be opaque for additive blending, whose signed colours "
                "hide nothing; got a transparent one. Try --matte white, or --portable"
            )

    def _check_blend(self) -> None:
        """Raise InputError for options that an additive file cannot have."""
        svg, document = self.options.svg, self.options.document
        if svg.portable and self.options.fit.blend != ADD:
            blend = self.options.fit.blend
            raise InputError(must_be("blend", f"{ADD} with portable", blend, f"--blend {ADD}"))
        if self.written_blend != ADD:
            return
        renderer = self.options.run.renderer
        if renderer not in DRAW_BLENDS:
            raise RendererError(
                must_be(
                    "renderer", f"one of {', '.join(DRAW_BLENDS)} for additive blending", renderer
                )
                + f". Try --renderer {DRAW_BLENDS[0]}, or --portable"
            )
        for name in [f"form {svg.form}"] * (svg.form != GRADIENT) + document.layered:
            raise InputError(
                f"{name} must not be given with additive blending, whose file has neither "
                "layers in painter's order nor opacities. Try --portable"
            )

    def _check_rounds(self) -> None:
        for name in ("per_round", "round_iterations"):
            value = getattr(self.options.densify, name)
            if value is not None and self.count_adapts:
                raise InputError(
                    f"{name} must not be given unless the number of Gaussians is, without a "
                    f"target; got {value}. Try --gaussians 1000"
                )
        schedule = self.options.densify.schedule
        if schedule != DensifyOptions.schedule and self.count_adapts:
            needed = f"{DensifyOptions.schedule} unless the number of Gaussians is given, without "
            raise InputError(must_be("schedule", f"{needed}a target", schedule, "--gaussians 1000"))

    @cached_property
    def preset(self) -> Preset:
        """The preset."""
        return PRESETS[self.options.goal.quality]

    @property
    def iterations(self) -> int:
        """Those of the preset; where cheaper presets reduce the image little, no fewer than theirs.

        Otherwise a small drawing that needs as few Gaussians in both would end worse
        (docs/decisions/monotone.md).
        """
        presets = list(PRESETS.values())
        cheaper = presets[: presets.index(self.preset)]
        side = math.inf if self.fit_side is None else self.fit_side
        fits = [p.iterations for p in cheaper if side <= _NEARLY * p.max_size]
        return max([self.preset.iterations, *fits])

    @cached_property
    def aim(self) -> Aim | None:
        """The target of the rasterised SVG."""
        return aim_of(self.options.goal)

    @property
    def count(self) -> int | None:
        """The given number of Gaussians, None if it adapts to the image."""
        gaussians = self.options.goal.gaussians
        return gaussians if isinstance(gaussians, int) else None

    @property
    def count_adapts(self) -> bool:
        """Whether the count depends on the image or on a target."""
        return self.count is None or has_targets(self.options.goal)

    @property
    def palette_is_counted(self) -> bool:
        """Whether the palette has a given size, and not one that depends on its loss."""
        return self.options.svg.palette is not None or not self.count_adapts

    @property
    def side(self) -> int:
        """Longest side in px of the image that the fit runs on."""
        return self.options.run.max_size or self.preset.max_size

    @property
    def written_blend(self) -> str:
        """The blend of the shapes in the file."""
        return OVER if self.options.svg.portable else self.options.fit.blend

    @cached_property
    def additive_config(self) -> FitConfig:
        """The additive fit that precedes a portable file."""
        return self._config(ADD)

    @cached_property
    def fit_config(self) -> FitConfig:
        """The fit that is written; a time limit without other targets replaces the iterations."""
        return self._config(self.written_blend)

    def _config(self, blend: str) -> FitConfig:
        options, iterations = self.options, self.options.fit.iterations
        only_time = options.goal.time_limit is not None and (
            self.aim is None and options.goal.max_bytes is None
        )
        if iterations is None and not only_time:
            iterations = self.iterations
        falloff = options.fit.falloff if blend == self.written_blend else None
        fit = dataclasses.replace(options.fit, blend=blend, falloff=falloff)  # pyright: ignore[reportArgumentType]
        return FitConfig(
            gaussians=0 if self.count_adapts else self.count or 0,
            iterations=iterations,
            fit=fit,
            densify=options.densify,
            extend=options.fit.iterations is None and not self.count_adapts,
        )

    @cached_property
    def markup(self) -> Literal["editable", "minimal"]:
        """That of the file; auto is minimal where names and layers would be much of it."""
        asked, limit = self.options.svg.markup, self.options.goal.max_bytes
        if asked != AUTO:
            return asked
        small = isinstance(limit, int) and limit <= MINIMAL_UP_TO
        return MINIMAL if small and self._may_be_minimal else EDITABLE

    @property
    def minimal_may_be_closer(self) -> bool:
        """Whether a small file is editable though nothing asks for that."""
        limit = self.options.goal.max_bytes
        few = isinstance(limit, int) and MINIMAL_UP_TO < limit <= _MINIMAL_IS_CLOSER_UP_TO
        return few and self.options.svg.markup == AUTO and self._may_be_minimal

    @property
    def _may_be_minimal(self) -> bool:
        """Whether the renderer draws minimal files, and nothing is asked for that they lack."""
        return self.options.run.renderer in DRAW_MINIMAL and not self._needs_editable

    @cached_property
    def is_small(self) -> bool:
        """Whether the file is one of gauss2svg.pipeline.small, which plans every byte.

        Not with another target than bytes, or with options of another fit or another file.
        """
        goal, svg, fit, run = (getattr(self.options, n) for n in ("goal", "svg", "fit", "run"))
        small = isinstance(goal.max_bytes, int) and goal.max_bytes <= MINIMAL_UP_TO
        free = (svg.palette, svg.stops, svg.precision, goal.time_limit, run.checkpoint, run.resume)
        usual = self.options.densify == DensifyOptions()
        usual = usual and fit.loss == DEFAULT_LOSS and fit.blend == OVER
        usual = usual and self.aim is None and all(given is None for given in free)
        return small and usual and self.markup == MINIMAL

    @cached_property
    def rival(self) -> Plan | None:
        """The plan of an editable file of as many bytes, which draws crisp drawings more exactly.

        None where the file is not small, too small for that, or asked to be minimal.
        """
        svg, limit = self.options.svg, self.options.goal.max_bytes
        if not (self.is_small and svg.markup == AUTO and isinstance(limit, int)):
            return None
        if limit < _EDITABLE_FROM:
            return None
        editable = dataclasses.replace(svg, markup=EDITABLE)
        return dataclasses.replace(self, options=dataclasses.replace(self.options, svg=editable))

    @property
    def _needs_editable(self) -> str:
        """What is asked for that a minimal file does not have; empty if nothing."""
        svg, document = self.options.svg, self.options.document
        needs = [f"form {svg.form}"] * (svg.form != GRADIENT)
        needs += ["additive blending"] * (self.written_blend == ADD)
        return next(iter(needs + document.layered), "")

    @cached_property
    def svg_format(self) -> SvgFormat:
        """The format of the shapes."""
        svg, preset = self.options.svg, self.preset
        return SvgFormat(
            form=svg.form,
            markup=self.markup,
            stops=preset.stops if svg.stops is None else svg.stops,
            precision=preset.precision if svg.precision is None else svg.precision,
            opacity_decimals=preset.opacity_decimals,
        )

    def quantization(self, gaussians: int, error: float | None) -> Quantization:
        """For a scene of so many Gaussians and, where it is known, this mean squared error."""
        preset = self.preset
        palette, loss = self.options.svg.palette, 0.0
        if palette is None:
            palette = 0 if self.count_adapts else preset.palette_for(gaussians)
            loss = preset.color_loss if self.count_adapts else _UNSEEN_COLOR_LOSS
        color_error = 0.0
        if error is not None and self.options.svg.palette is None:
            color_error = min(error * (10 ** (loss / 10) - 1), LARGEST_COLOR_ERROR)
        return Quantization(palette, color_error)


def has_targets(goal: Goal) -> bool:
    """Whether there is a target or limit besides the preset."""
    return any(t is not None for t in (aim_of(goal), goal.max_bytes, goal.time_limit))
