"""The plan of a run: the numbers that its options stand for, its aim, and the searches to run."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.options import DEFAULT_LOSS, PSNR, DensifyOptions, FitConfig, Tune
from gauss2svg.measure.perceptual import measured
from gauss2svg.measure.scores import Score, Search
from gauss2svg.pipeline.checks import check_together, needs_editable
from gauss2svg.pipeline.drawings import has_edges
from gauss2svg.pipeline.options import AUTO, Goal, Options
from gauss2svg.pipeline.presets import (
    DEFAULT_PRESET,
    FINE_BYTES_FROM,
    FINE_FROM,
    INDISTINGUISHABLE,
    PRESETS,
    Preset,
    budget_preset,
)
from gauss2svg.raster import DRAW_MINIMAL, renderer_version
from gauss2svg.scene import OVER
from gauss2svg.scene.inks import inks_of
from gauss2svg.svg.blur import GRADIENT
from gauss2svg.svg.document import EDITABLE, INKS, MINIMAL, ROUNDS, SvgFormat

Markup = Literal["editable", "minimal"]

# Bytes of the largest placeholder, and largest limit for which auto markup is minimal at a target.
MINIMAL_UP_TO = 20_000


# Limits in bytes before gzip between which each search runs (docs/decisions/markup.md).
# Largest limit of a search by bytes on a photo that it has to reduce.
BY_BYTES_UP_TO = 30_000
WHOLE_SIDE = 256  # longest side in px up to which that search does not reduce a photo
# Smallest limit of a search by count for a minimal file, if there is also a search by bytes.
MINIMAL_FROM = 8_000
EDITABLE_FROM = 5_000  # smallest limit of a search for an editable file, if there is another
UNASKED_UP_TO = 200_000  # bytes of the largest minimal file that auto markup chooses
EDITABLE_IS_CLOSER = 1.5  # multiple of UNASKED_UP_TO from which an editable file is always closer
GZIP = 6  # bytes of a file for each gzipped byte (docs/decisions/minimal.md)
# Fewest entries of a palette. Fewer lower the PSNR visibly, even with a thousand Gaussians
# (docs/decisions/palette.md).
FEWEST_COLORS = 192
# Most palette entries within a budget. Their error is below that of 8 bits, and more take long to
# find (docs/decisions/palette.md).
MOST_COLORS = 4096
# dB of PSNR that a palette smaller than allowed may cost if the count is given
# (docs/decisions/palette.md).
UNSEEN_COLOR_LOSS = 0.03
# Largest mean squared error that a palette may add: 38 dB, about three levels of 255. A coarse fit
# of foliage would allow eight levels, at which sky and leaves change their hue
# (docs/decisions/palette.md).
LARGEST_COLOR_ERROR = 1.6e-4
# Most steps of a fit that ends by the clock alone. More gain nothing (docs/decisions/time.md).
MOST_STEPS = 1000
# Steps of such a fit in a round of growth. The rest of the time is better spent once all
# Gaussians exist (docs/decisions/time.md).
STEPS_A_ROUND = 6
# Ratio of the fit's longest side to a preset's max_size, up to which the preset reduces it little.
NEARLY = 1.5
PRECISION_OF_INKS = 0.1  # px, step of coordinates in a file of inks (docs/decisions/inks.md)


@dataclass(frozen=True)
class Plan:
    """The options of a run or of one of its searches, and the decisions that follow from them.

    fit_side   longest side in px of the image that the fit runs on, None before the photo is read
    by_bytes   whether the search is by bytes, otherwise by count
    has_edges  whether the photo is a drawing with antialiased edges, False before it is read
    is_small   whether the photo has at most WHOLE_SIDE px a side, False before it is read
    Raise InputError or RendererError if options exclude each other.
    """

    options: Options
    fit_side: int | None = None
    by_bytes: bool = False
    has_edges: bool = False
    is_small: bool = False

    def __post_init__(self) -> None:
        check_together(self.options)
        _ = self.fit_config

    @property
    def goal(self) -> Goal:
        """Targets and limits of the options."""
        return self.options.goal

    @property
    def in_inks(self) -> bool:
        """Whether shapes are opaque ellipses of a few inks."""
        return self.options.fit.inks is not None

    def for_picture(self, pixels: NDArray[np.float32]) -> Plan:
        """Return the plan for a photo, with inks chosen from it, or its edges and size noted."""
        given: Any = self.options.fit.inks
        if isinstance(given, int):
            options = self.options.changed(inks=inks_of(pixels, given))
            return dataclasses.replace(self, options=options)
        svg = self.options.svg
        usual = self.options.fit.learned_falloff and svg.form == GRADIENT and not svg.portable
        is_small = max(pixels.shape[:2]) <= WHOLE_SIDE
        return dataclasses.replace(self, has_edges=usual and has_edges(pixels), is_small=is_small)

    @property
    def covering(self) -> bool:
        """Whether crisp shapes are fitted by how much of each pixel they cover.

        The photo must be a drawing with antialiased edges. With a number of Gaussians, a target or
        only a limit, this is False: then the picture's own size counts, at which soft rims are as
        close or closer.
        """
        goal = self.goal
        by_preset = goal.count is None and self.aim is None and not goal.is_budget
        return by_preset and self.has_edges

    def check_renderer(self) -> None:
        """Raise RendererError if the measuring renderer is not installed."""
        renderer_version(self.options.run.renderer)

    @cached_property
    def preset(self) -> Preset:
        """Preset of the run, or numbers of its budget of bytes or seconds."""
        goal = self.goal
        if self.is_budget:
            return budget_preset(self.plain_limit, goal.time_limit, self.in_inks)
        return PRESETS[goal.quality or DEFAULT_PRESET]

    @property
    def is_budget(self) -> bool:
        """Whether the best picture within a limit of bytes or seconds is wanted.

        False for a portable file, whose additive fit decides the count first.
        """
        return self.goal.is_budget and not self.options.svg.portable

    @property
    def quality(self) -> str | None:
        """Name of the preset, None for a budget."""
        return None if self.is_budget else self.goal.quality or DEFAULT_PRESET

    @property
    def plain_limit(self) -> int | None:
        """Limit of bytes before gzip, estimated if the limit counts gzipped bytes."""
        limit = self.goal.byte_limit
        return limit if limit is None or not self.counts_gzipped else GZIP * limit

    @property
    def counts_gzipped(self) -> bool:
        """Whether a limit of bytes counts those of the gzipped file."""
        return self.options.svg.gzip or self.options.svg.count_gzipped

    @property
    def iterations(self) -> int:
        """Number of steps of a fit.

        It is at least that of each cheaper preset that reduces the image little. Otherwise a small
        drawing that has equally few Gaussians in both would end worse than by the cheaper one
        (docs/decisions/monotone.md).
        """
        side, preset = self.fit_side or math.inf, self.preset
        cheaper = [p for p in PRESETS.values() if p.cap < preset.cap and not self.is_budget]
        fits = [p.iterations for p in cheaper if side <= NEARLY * p.max_size]
        return max([preset.iterations, *fits])

    @property
    def tune(self) -> Tune:
        """Measure that fits are tuned for. The default of a search by bytes is PSNR."""
        return self.options.fit.tune or (PSNR if self.by_bytes else self.options.fit.tuned)

    @cached_property
    def aim(self) -> Aim | None:
        """Target of the rasterised SVG, None without one."""
        return aim_of(self.goal)

    @property
    def stop_psnr(self) -> float:
        """PSNR (dB) of the model from which no Gaussians are added.

        It is the preset's. With a limit of bytes, for which the best picture is wanted, it is at
        least INDISTINGUISHABLE.
        """
        limited = self.goal.byte_limit is not None
        return max(self.preset.enough, INDISTINGUISHABLE) if limited else self.preset.enough

    @cached_property
    def fit_config(self) -> FitConfig:
        """Configuration of the fit that is written."""
        return self.config(self.options.written_blend)

    @property
    def only_time_limits(self) -> bool:
        """Whether a time limit, without preset or target, decides the steps of the fit."""
        goal = self.goal
        return goal.time_limit is not None and goal.quality is None and self.aim is None

    def config(self, blend: str) -> FitConfig:
        """Return the configuration of a fit. A portable file has an additive fit first."""
        options, densify = self.options, self.options.densify
        iterations = options.fit.iterations or self.iterations
        if self.only_time_limits and options.fit.iterations is None:
            iterations = MOST_STEPS
            if densify.round_iterations is None:
                densify = dataclasses.replace(densify, round_iterations=STEPS_A_ROUND)
        falloff = options.fit.falloff if blend == options.written_blend else None
        return FitConfig(
            gaussians=0 if self.goal.count_adapts else self.goal.count or 0,
            iterations=iterations,
            fit=dataclasses.replace(options.fit, blend=blend, falloff=falloff),  # pyright: ignore[reportArgumentType]
            densify=densify,
            extend=options.fit.iterations is None and not self.goal.count_adapts,
            sparse=self.is_budget or self.only_time_limits,
        )

    @cached_property
    def markup(self) -> Markup:
        """Markup of the file. auto is minimal for small limits, and `searches` may try both."""
        asked, limit = self.options.svg.markup, self.goal.byte_limit
        if asked != AUTO:
            return asked
        small = limit is not None and limit <= MINIMAL_UP_TO
        return MINIMAL if small and self._may_be_minimal else EDITABLE

    @property
    def _may_be_minimal(self) -> bool:
        """Whether the renderer draws minimal files, and they can have all that is asked for."""
        return self.options.run.renderer in DRAW_MINIMAL and not needs_editable(self.options)

    @property
    def _may_be_by_bytes(self) -> bool:
        """Whether a search by bytes supports everything that the options ask for."""
        options, svg = self.options, self.options.svg
        usual = options.densify == DensifyOptions() and options.fit.loss == DEFAULT_LOSS
        usual = usual and options.fit.blend == OVER and not self.in_inks
        return usual and self._may_be_minimal and svg.palette is svg.stops is svg.precision is None

    def searches(self) -> list[Plan]:
        """Return the plans of the searches to run. The closest of their files is written.

        Without a limit of bytes there is one search. With it, searches differ in markup and fit,
        and searches without the target follow in case that the file misses the target. A time limit
        leaves time for one search.
        """
        limit, asked = self.plain_limit, self.options.svg.markup
        is_timed = self.goal.time_limit is not None
        if limit is None:
            return [self]
        if self.aim is not None:
            options = self.options.changed(**{self.aim.name: None})
            within = dataclasses.replace(self, options=options)
            return [self] if is_timed else [self, *within.searches()]
        plans = list[Plan]()
        up_to = math.inf if self.has_edges or self.is_small else BY_BYTES_UP_TO
        by_bytes = asked != EDITABLE and self._may_be_by_bytes and limit <= up_to
        if by_bytes:
            plans.append(self._search(MINIMAL, by_bytes=True))
        unasked_up_to = EDITABLE_IS_CLOSER * UNASKED_UP_TO
        unasked = asked == AUTO and self._may_be_minimal and limit <= unasked_up_to
        if (asked == MINIMAL or unasked) and (limit >= MINIMAL_FROM or not by_bytes):
            plans.append(self._search(MINIMAL))
        if asked == EDITABLE or (asked == AUTO and (limit >= EDITABLE_FROM or not plans)):
            plans.append(self._search(EDITABLE))
        if not is_timed:
            return plans
        # Run the search that is closest most often.
        return plans[-1:] if limit > UNASKED_UP_TO else plans[-2:-1] or plans

    def _search(self, markup: Markup, by_bytes: bool = False) -> Plan:
        limit = self.goal.byte_limit
        if markup == MINIMAL and self.options.svg.markup == AUTO and limit is not None:
            limit = min(limit, UNASKED_UP_TO // (GZIP if self.counts_gzipped else 1))
        options = self.options.changed(markup=markup, max_bytes=limit)
        return dataclasses.replace(self, options=options, by_bytes=by_bytes)

    @property
    def svg_format(self) -> SvgFormat:
        """Format of the shapes before any is fitted."""
        return self.format_at(None)

    def format_at(self, psnr: float | None) -> SvgFormat:
        """Return the format of the shapes of a scene by its PSNR in dB, None if that is unknown."""
        svg, preset = self.options.svg, self.preset
        if self.is_budget and psnr is not None:  # numbers as fine as this PSNR is worth
            of_bytes = FINE_BYTES_FROM if self.goal.byte_limit is not None else FINE_FROM
            preset = next((PRESETS[name] for name, least in of_bytes if psnr >= least), preset)
        precision = PRECISION_OF_INKS if self.in_inks else preset.precision
        return SvgFormat(
            form=svg.form,
            markup=self.markup,
            stops=preset.stops if svg.stops is None else svg.stops,
            precision=precision if svg.precision is None else svg.precision,
            layers=INKS if self.in_inks else ROUNDS,
            opacity_decimals=preset.opacity_decimals,
        )

    def quantization(self, gaussians: int, error: float | None = None) -> tuple[int, float]:
        """Return palette and color_error, as `quantize` takes them, for a number of Gaussians.

        error  mean squared error of the scene, None if it is unknown
        """
        preset, adapts, palette = self.preset, self.goal.count_adapts, 0
        if self.options.svg.palette is not None:
            return self.options.svg.palette, 0.0
        if self.is_budget:
            palette = MOST_COLORS
        elif preset.colors and not adapts:
            palette = max(FEWEST_COLORS, math.ceil(gaussians * preset.colors))
        if error is None:
            return palette, 0.0
        loss = preset.color_loss if adapts else UNSEEN_COLOR_LOSS
        return palette, min(error * (10 ** (loss / 10) - 1), LARGEST_COLOR_ERROR)


@dataclass(frozen=True)
class Aim:
    """A target of the rasterised SVG: a score, its value, and how closely a search meets it.

    The value and all scores are multiplied by the sign of the score, so that larger is better.
    """

    of: Score
    value: float
    search: Search

    @property
    def name(self) -> str:
        """Name of the option, and the stop reason once the target is reached."""
        return self.of.option

    def score(self, raster: NDArray[np.float32], photo: NDArray[np.float32]) -> float:
        """Return the score of a raster against a photo of its shape."""
        return self.of.sign * measured(self.of, raster, photo)

    def reached(self, score: float) -> bool:
        """Return whether a score reaches the target, within the tolerance."""
        return score >= self.value - self.search.tolerance


def aim_of(goal: Goal) -> Aim | None:
    """Return the target of a goal, or None if there is none that a search can aim at."""
    score = goal.target
    if score is None or score.search is None:
        return None
    return Aim(score, score.sign * getattr(goal, score.option), score.search)


def unreached(
    goal: Goal, reached: float, size: int, seconds: float, reason: str, gaussians: int
) -> Iterator[str]:
    """Yield a line for each target or limit that the written result misses.

    reached  score of the result by the goal's aim
    """
    aim, limit = aim_of(goal), goal.time_limit
    if aim is not None and not aim.reached(reached):
        reported = reason not in (aim.name, "interrupted")
        ended = f", stopped by {reason.replace('_', ' ')}" if reported else ""
        sign, unit = aim.of.sign, f" {aim.of.unit}".rstrip()
        target = f"{'' if unit else aim.of.name + ' '}{sign * aim.value:g}{unit}"
        yield f"target of {target} not reached: {sign * reached:.2f}{unit}{ended}"
    if goal.byte_limit is not None and size > goal.byte_limit:
        yield f"limit of {goal.max_bytes} bytes exceeded: the file has {size} even without shapes"
    elif reason == "max_bytes" and not gaussians:
        none = f"limit of {goal.max_bytes} bytes leaves no room for a shape: the file has none"
        yield f"{none}. Try a larger --max-bytes"
    if limit is not None and seconds > 1.05 * limit + 0.25:
        yield f"time limit of {limit:.3g} s exceeded: {seconds:.1f} s. Try a smaller --max-size"
