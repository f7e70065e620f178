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
from gauss2svg.measure.perceptual import require_packages
from gauss2svg.photo.photo import Photo
from gauss2svg.pipeline.aims import Aim, aim_of
from gauss2svg.pipeline.options import AUTO, Goal, Options
from gauss2svg.pipeline.presets import (
    DEFAULT_PRESET,
    FINE_BYTES_FROM,
    FINE_FROM,
    PRESETS,
    Preset,
    budget_preset,
)
from gauss2svg.raster import DRAW_BLENDS, DRAW_MINIMAL, DRAW_ROTATED_BLURS, renderer_version
from gauss2svg.scene import ADD, OVER
from gauss2svg.svg.blur import GRADIENT
from gauss2svg.svg.format import EDITABLE, MINIMAL, SvgFormat

# Mean squared error that a palette may add in any case: 38 dB, about three levels of 255. With
# eight levels, which a coarse fit of foliage would allow, sky and leaves change their hue.
LARGEST_COLOR_ERROR = 1.6e-4
# Bytes of the largest placeholder, and of the largest file with a target that is minimal by itself.
MINIMAL_UP_TO = 20_000
# Bytes between which files of gauss2svg.pipeline.small, minimal files of the usual fit and editable
# ones are tried; the closest is written (docs/decisions/markup.md).
_SMALL_UP_TO, _USUAL_FROM, _EDITABLE_FROM = 30_000, 8_000, 5_000
# Bytes of the largest minimal file that is written unasked, and times as many from which an
# editable file is closer than that (docs/decisions/markup.md).
_MINIMAL_IS_PLAUSIBLE_UP_TO, _EDITABLE_IS_CLOSER = 200_000, 1.5
# Palette entries within a budget: they cost less than 8 bits do, and more would take long to find
# (docs/decisions/palette.md).
_MOST_COLORS = 4096
_GZIP = 6  # times as many bytes as gzipped ones: docs/decisions/minimal.md
# Steps of a fit that ends by the clock alone, beyond which there is nothing to be gained
# (docs/decisions/time.md).
_MOST_STEPS = 1000
_STEPS_A_ROUND = 6  # of growth; the rest of the time is better spent once all Gaussians exist
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
    is_small  whether the file is one of gauss2svg.pipeline.small, which plans every byte
    """

    options: Options
    fit_side: int | None = None
    is_small: bool = False

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
        if svg.count_gzipped and goal.max_bytes is None:
            needed, advice = "given with max_bytes alone", "--max-bytes 60k --count-gzipped"
            raise InputError(must_be("count_gzipped", needed, True, advice))
        asked = None if goal.target is None or goal.target.always else goal.target
        name = "scores" if run.scores or asked is None else asked.option
        if run.scores or asked is not None:
            require_packages(asked)
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
        """The preset, or the numbers of a budget of bytes or seconds."""
        goal = self.options.goal
        if self.is_budget:
            return budget_preset(self.plain_limit, goal.time_limit)
        return PRESETS[goal.quality or DEFAULT_PRESET]

    @property
    def is_budget(self) -> bool:
        """Whether the best picture within a limit of bytes or seconds is wanted.

        Not of a portable file, whose additive fit decides the count before.
        """
        return self.options.goal.is_budget and not self.options.svg.portable

    @property
    def quality(self) -> str | None:
        """The name of the preset, None of a budget."""
        return None if self.is_budget else self.options.goal.quality or DEFAULT_PRESET

    @property
    def byte_limit(self) -> int | None:
        """Largest number of bytes, gzipped ones if these are counted; None without a limit."""
        limit = self.options.goal.max_bytes
        return limit if isinstance(limit, int) else None

    @property
    def plain_limit(self) -> int | None:
        """About the bytes of the file before gzip that a limit stands for."""
        limit = self.byte_limit
        return limit if limit is None or not self.counts_gzipped else _GZIP * limit

    @property
    def counts_gzipped(self) -> bool:
        """Whether a limit of bytes is on those of the gzipped file."""
        return self.options.svg.gzip or self.options.svg.count_gzipped

    @property
    def iterations(self) -> int:
        """Those of the preset; where cheaper presets reduce the image little, no fewer than theirs.

        Otherwise a small drawing that needs as few Gaussians in both would end worse
        (docs/decisions/monotone.md).
        """
        presets = list(PRESETS.values())
        cheaper = [] if self.is_budget else presets[: presets.index(self.preset)]
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
        """The fit that is written."""
        return self._config(self.written_blend)

    @property
    def only_time_limits(self) -> bool:
        """Whether the steps of the fit follow from the seconds that are left."""
        goal = self.options.goal
        return goal.time_limit is not None and goal.quality is None and self.aim is None

    def _config(self, blend: str) -> FitConfig:
        options, iterations = self.options, self.options.fit.iterations
        if iterations is None:
            iterations = _MOST_STEPS if self.only_time_limits else self.iterations
        densify = options.densify
        given = options.fit.iterations or densify.round_iterations
        if self.only_time_limits and given is None:
            densify = dataclasses.replace(densify, round_iterations=_STEPS_A_ROUND)
        falloff = options.fit.falloff if blend == self.written_blend else None
        fit = dataclasses.replace(options.fit, blend=blend, falloff=falloff)  # pyright: ignore[reportArgumentType]
        return FitConfig(
            gaussians=0 if self.count_adapts else self.count or 0,
            iterations=iterations,
            fit=fit,
            densify=densify,
            extend=options.fit.iterations is None and not self.count_adapts,
            sparse=self.is_budget or self.only_time_limits,
        )

    @cached_property
    def markup(self) -> Literal["editable", "minimal"]:
        """Markup of the file: with auto minimal for small ones; `ways` tries more than one."""
        asked, limit = self.options.svg.markup, self.byte_limit
        if asked != AUTO:
            return asked
        small = limit is not None and limit <= MINIMAL_UP_TO
        return MINIMAL if small and self._may_be_minimal else EDITABLE

    @property
    def _may_be_minimal(self) -> bool:
        """Whether the renderer draws minimal files, and nothing is asked for that they lack."""
        return self.options.run.renderer in DRAW_MINIMAL and not self._needs_editable

    @property
    def _may_be_small(self) -> bool:
        """Whether no other fit, target or file is asked for than gauss2svg.pipeline.small has."""
        svg, fit, run = (getattr(self.options, name) for name in ("svg", "fit", "run"))
        free = (svg.palette, svg.stops, svg.precision, run.checkpoint, run.resume)
        usual = self.options.densify == DensifyOptions() and self._may_be_minimal
        usual = usual and fit.loss == DEFAULT_LOSS and fit.blend == OVER and self.aim is None
        return usual and all(given is None for given in free)

    @cached_property
    def ways(self) -> list[Plan]:
        """The plans to carry out, of whose files the closest is written; most runs have one.

        With a limit of bytes they differ in markup and fit. Targets, checkpoints and a limit of
        seconds leave time for one.
        """
        limit, asked, goal = self.plain_limit, self.options.svg.markup, self.options.goal
        run = self.options.run
        if limit is None or self.aim is not None or run.checkpoint or run.resume:
            return [self]
        small = asked != EDITABLE and self._may_be_small and limit <= _SMALL_UP_TO
        usual = asked == MINIMAL or (asked == AUTO and self._may_be_minimal)
        if asked == AUTO and limit > _EDITABLE_IS_CLOSER * _MINIMAL_IS_PLAUSIBLE_UP_TO:
            usual = False
        usual = usual and (limit >= _USUAL_FROM or not small)
        editable = asked == EDITABLE or (
            asked == AUTO and (limit >= _EDITABLE_FROM or not (small or usual))
        )
        ways = [self._way(MINIMAL, is_small=True)] if small else []
        ways += [self._way(MINIMAL)] if usual else []
        ways += [self._way(EDITABLE)] if editable else []
        if goal.time_limit is None:
            return ways
        # The one that is the closest most often.
        return ways[-1:] if limit > _MINIMAL_IS_PLAUSIBLE_UP_TO else ways[-2:-1] or ways

    def _way(self, markup: Literal["editable", "minimal"], is_small: bool = False) -> Plan:
        svg = dataclasses.replace(self.options.svg, markup=markup)
        goal, limit = self.options.goal, self.byte_limit
        if markup == MINIMAL and self.options.svg.markup == AUTO and limit is not None:
            most = _MINIMAL_IS_PLAUSIBLE_UP_TO // (_GZIP if self.counts_gzipped else 1)
            goal = dataclasses.replace(goal, max_bytes=min(limit, most))
        options = dataclasses.replace(self.options, svg=svg, goal=goal)
        return dataclasses.replace(self, options=options, is_small=is_small)

    @property
    def _needs_editable(self) -> str:
        """What is asked for that a minimal file does not have; empty if nothing."""
        svg, document = self.options.svg, self.options.document
        needs = [f"form {svg.form}"] * (svg.form != GRADIENT)
        needs += ["additive blending"] * (self.written_blend == ADD)
        return next(iter(needs + document.layered), "")

    @property
    def svg_format(self) -> SvgFormat:
        """The format of the shapes, before any is fitted."""
        return self.format_at(None)

    def format_at(self, psnr: float | None) -> SvgFormat:
        """The format of the shapes of a scene of this PSNR in dB, None for any."""
        svg, preset = self.options.svg, self._written_like(psnr)
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
            palette = _MOST_COLORS if self.is_budget else palette
            loss = preset.color_loss if self.count_adapts else _UNSEEN_COLOR_LOSS
        color_error = 0.0
        if error is not None and self.options.svg.palette is None:
            color_error = min(error * (10 ** (loss / 10) - 1), LARGEST_COLOR_ERROR)
        return Quantization(palette, color_error)

    def _written_like(self, psnr: float | None) -> Preset:
        """The preset whose numbers the file has; within a budget those that its PSNR is worth."""
        if not self.is_budget or psnr is None:
            return self.preset
        of_bytes = FINE_BYTES_FROM if self.byte_limit is not None else FINE_FROM
        return next((PRESETS[name] for name, least in of_bytes if psnr >= least), self.preset)


def has_targets(goal: Goal) -> bool:
    """Whether there is a target or limit besides the preset."""
    return any(t is not None for t in (aim_of(goal), goal.max_bytes, goal.time_limit))
