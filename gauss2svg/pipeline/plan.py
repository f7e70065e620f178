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

# Bytes of the largest placeholder, and of the largest file with a target that is minimal by itself.
MINIMAL_UP_TO = 20_000


# Bytes before gzip between which each search for a limit is run (docs/decisions/markup.md).
# Largest limit of the search that plans every byte, for photos that it has to reduce.
BY_BYTES_UP_TO = 30_000
WHOLE_SIDE = 256  # px of the longest side of a photo that this search does not reduce
# Least limit of minimal files of the usual fit, where files that plan every byte are tried too.
MINIMAL_FROM = 8_000
EDITABLE_FROM = 5_000  # least limit of editable files, where there is another
UNASKED_UP_TO = 200_000  # bytes of the largest minimal file that is written unasked
EDITABLE_IS_CLOSER = 1.5  # multiple of UNASKED_UP_TO from which an editable file is always closer
GZIP = 6  # bytes of a file for each gzipped byte (docs/decisions/minimal.md)
# Fewest entries of a palette. Fewer cost PSNR visibly even with a thousand Gaussians
# (docs/decisions/palette.md).
FEWEST_COLORS = 192
# Palette entries within a budget. They cost less than 8 bits do, and more would take long to find
# (docs/decisions/palette.md).
MOST_COLORS = 4096
# PSNR in dB that the palette of a given count may cost by having fewer entries than allowed
# (docs/decisions/palette.md).
UNSEEN_COLOR_LOSS = 0.03
# Mean squared error that a palette may add in any case: 38 dB, about three levels of 255. With
# eight levels, which a coarse fit of foliage would allow, sky and leaves change their hue
# (docs/decisions/palette.md).
LARGEST_COLOR_ERROR = 1.6e-4
# Most steps of a fit that ends by the clock alone. More gain nothing (docs/decisions/time.md).
MOST_STEPS = 1000
# Steps of such a fit in a round of growth. The rest of the time is better spent once all
# Gaussians exist (docs/decisions/time.md).
STEPS_A_ROUND = 6
# Ratio of a photo's side to a preset's, up to which a reduction would matter too little.
NEARLY = 1.5
PRECISION_OF_INKS = 0.1  # px: edges of opaque ellipses at a tenth of one (docs/decisions/inks.md)


@dataclass(frozen=True)
class Plan:
    """What the options of a run, or of one of its searches, come to.

    fit_side  longest side in px of the image that the fit runs on, None before the photo is read
    by_bytes  whether the search plans every byte, else it is one by count
    has_edges  whether the photo is a drawing with antialiased edges; False before it is read
    is_small  whether the photo has at most WHOLE_SIDE px a side; False before it is read
    Raises InputError or RendererError for options that exclude each other.
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
        """The targets and limits of the options."""
        return self.options.goal

    @property
    def in_inks(self) -> bool:
        """Whether shapes are opaque ellipses of a few inks."""
        return self.options.fit.inks is not None

    def for_picture(self, pixels: NDArray[np.float32]) -> Plan:
        """Return the plan for a photo: with inks that are chosen from it, or with its edges."""
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

        A given number, a target and a limit alone are of the picture at its size: there soft rims
        are as close, and sometimes closer. So they are where no edge is antialiased.
        """
        goal = self.goal
        by_preset = goal.count is None and self.aim is None and not goal.is_budget
        return by_preset and self.has_edges

    def check_renderer(self) -> None:
        """Raise RendererError if the measuring renderer is not installed."""
        renderer_version(self.options.run.renderer)

    @cached_property
    def preset(self) -> Preset:
        """The preset, or the numbers of a budget of bytes or seconds."""
        goal = self.goal
        if self.is_budget:
            return budget_preset(self.plain_limit, goal.time_limit, self.in_inks)
        return PRESETS[goal.quality or DEFAULT_PRESET]

    @property
    def is_budget(self) -> bool:
        """Whether the best picture within a limit of bytes or seconds is wanted.

        Not of a portable file, whose additive fit decides the count before.
        """
        return self.goal.is_budget and not self.options.svg.portable

    @property
    def quality(self) -> str | None:
        """The name of the preset, None of a budget."""
        return None if self.is_budget else self.goal.quality or DEFAULT_PRESET

    @property
    def plain_limit(self) -> int | None:
        """About the bytes of the file before gzip that a limit stands for."""
        limit = self.goal.byte_limit
        return limit if limit is None or not self.counts_gzipped else GZIP * limit

    @property
    def counts_gzipped(self) -> bool:
        """Whether a limit of bytes counts those of the gzipped file."""
        return self.options.svg.gzip or self.options.svg.count_gzipped

    @property
    def iterations(self) -> int:
        """Steps of a fit: the preset's; no fewer than cheaper ones' that reduce the image little.

        Otherwise a small drawing that needs as few Gaussians in both would end worse
        (docs/decisions/monotone.md).
        """
        side, preset = self.fit_side or math.inf, self.preset
        cheaper = [p for p in PRESETS.values() if p.cap < preset.cap and not self.is_budget]
        fits = [p.iterations for p in cheaper if side <= NEARLY * p.max_size]
        return max([preset.iterations, *fits])

    @property
    def tune(self) -> Tune:
        """What fits are best at; where every byte is planned, PSNR unless it is given."""
        return self.options.fit.tune or (PSNR if self.by_bytes else self.options.fit.tuned)

    @cached_property
    def aim(self) -> Aim | None:
        """The target of the rasterised SVG."""
        return aim_of(self.goal)

    @property
    def stop_psnr(self) -> float:
        """PSNR (dB) of the model from which no Gaussians are added.

        The preset's; with a limit of bytes, in which the best is wanted, one at which none show.
        """
        limited = self.goal.byte_limit is not None
        return max(self.preset.enough, INDISTINGUISHABLE) if limited else self.preset.enough

    @cached_property
    def fit_config(self) -> FitConfig:
        """The fit that is written."""
        return self.config(self.options.written_blend)

    @property
    def only_time_limits(self) -> bool:
        """Whether the steps of the fit follow from the seconds that are left."""
        goal = self.goal
        return goal.time_limit is not None and goal.quality is None and self.aim is None

    def config(self, blend: str) -> FitConfig:
        """Return the fit with a blend, which is additive before that of a portable file."""
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
        """Markup of the file: with auto minimal for small ones; `searches` tries more than one."""
        asked, limit = self.options.svg.markup, self.goal.byte_limit
        if asked != AUTO:
            return asked
        small = limit is not None and limit <= MINIMAL_UP_TO
        return MINIMAL if small and self._may_be_minimal else EDITABLE

    @property
    def _may_be_minimal(self) -> bool:
        """Whether the renderer draws minimal files, and nothing is asked for that they lack."""
        return self.options.run.renderer in DRAW_MINIMAL and not needs_editable(self.options)

    @property
    def _may_be_by_bytes(self) -> bool:
        """Whether a search by bytes supports everything that the options ask for."""
        options, svg = self.options, self.options.svg
        usual = options.densify == DensifyOptions() and options.fit.loss == DEFAULT_LOSS
        usual = usual and options.fit.blend == OVER and not self.in_inks
        return usual and self._may_be_minimal and svg.palette is svg.stops is svg.precision is None

    def searches(self) -> list[Plan]:
        """Return the plans of the searches to run, whose closest file is written; mostly one.

        With a limit of bytes they differ in markup and fit. A limit of seconds leaves time for one.
        If none of the files within the bytes reaches a target, the closest one without it is
        written.
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
        # The one that is the closest most often.
        return plans[-1:] if limit > UNASKED_UP_TO else plans[-2:-1] or plans

    def _search(self, markup: Markup, by_bytes: bool = False) -> Plan:
        limit = self.goal.byte_limit
        if markup == MINIMAL and self.options.svg.markup == AUTO and limit is not None:
            limit = min(limit, UNASKED_UP_TO // (GZIP if self.counts_gzipped else 1))
        options = self.options.changed(markup=markup, max_bytes=limit)
        return dataclasses.replace(self, options=options, by_bytes=by_bytes)

    @property
    def svg_format(self) -> SvgFormat:
        """The format of the shapes, before any is fitted."""
        return self.format_at(None)

    def format_at(self, psnr: float | None) -> SvgFormat:
        """Return the format of the shapes of a scene of this PSNR in dB, None for any."""
        svg, preset = self.options.svg, self.preset
        if self.is_budget and psnr is not None:  # the numbers that this PSNR is worth
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

        error  their mean squared error, where it is known
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

    The value and all scores are multiplied by the sign of the score, so that more is better.
    """

    of: Score
    value: float
    search: Search

    @property
    def name(self) -> str:
        """The option, which is also the stop reason once it is reached."""
        return self.of.option

    def score(self, raster: NDArray[np.float32], photo: NDArray[np.float32]) -> float:
        """Return the score of a raster against a photo of its shape."""
        return self.of.sign * measured(self.of, raster, photo)

    def reached(self, score: float) -> bool:
        """Whether a score counts as reached."""
        return score >= self.value - self.search.tolerance


def aim_of(goal: Goal) -> Aim | None:
    """Return the target of a goal, None without one."""
    score = goal.target
    if score is None or score.search is None:
        return None
    return Aim(score, score.sign * getattr(goal, score.option), score.search)


def unreached(
    goal: Goal, reached: float, size: int, seconds: float, reason: str, gaussians: int
) -> Iterator[str]:
    """Yield a line for each target or limit that the written result of so many Gaussians misses.

    reached  its score by the goal's aim
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
