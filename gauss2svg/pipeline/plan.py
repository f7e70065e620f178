"""The plan of a run: the numbers that its options stand for, its aim, and the searches to run."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.losses import psnr_of
from gauss2svg.fit.options import DEFAULT_LOSS, PSNR, DensifyOptions, FitConfig, Tune
from gauss2svg.measure.perceptual import measured
from gauss2svg.measure.roundtrip import RoundTrip
from gauss2svg.measure.scores import PSNR as PSNR_SCORE
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
from gauss2svg.scene import ADD, OVER
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
    covering  whether crisp shapes are fitted by how much of each pixel they cover, as those of a
              drawing are; False before the photo is read
    has_edges  whether the photo is a drawing with antialiased edges; False before it is read
    is_small   whether the photo has at most WHOLE_SIDE px; False before it is read
    Raises InputError or RendererError for options that exclude each other.
    """

    options: Options
    fit_side: int | None = None
    by_bytes: bool = False
    covering: bool = False
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
        """The plan for a photo: how a drawing is fitted, and inks where their number is given."""
        given: Any = self.options.fit.inks
        if isinstance(given, int):
            options = self.options.changed(inks=inks_of(pixels, given))
            return dataclasses.replace(self, options=options)
        # A given number, a target and a limit alone are of the picture at its size: there soft rims
        # are as close, and sometimes closer. So they are where no edge is antialiased.
        goal, usual = self.goal, self.options.svg.form == GRADIENT
        by_preset = goal.count is None and self.aim is None and not goal.is_budget
        usual &= self.options.fit.learned_falloff and not self.options.svg.portable
        edges = usual and has_edges(pixels)
        whole = max(pixels.shape[:2]) <= WHOLE_SIDE
        covering = by_preset and edges
        return dataclasses.replace(self, covering=covering, has_edges=edges, is_small=whole)

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
        presets = list(PRESETS.values())
        cheaper = [] if self.is_budget else presets[: presets.index(self.preset)]
        side = math.inf if self.fit_side is None else self.fit_side
        fits = [p.iterations for p in cheaper if side <= NEARLY * p.max_size]
        return max([self.preset.iterations, *fits])

    @property
    def tune(self) -> Tune:
        """What fits are best at; where every byte is planned, PSNR unless it is given."""
        return self.options.fit.tune or (PSNR if self.by_bytes else self.options.fit.tuned)

    @cached_property
    def aim(self) -> Aim | None:
        """The target of the rasterised SVG."""
        return aim_of(self.goal)

    @property
    def enough(self) -> float:
        """PSNR (dB) of the model from which no Gaussians are added.

        The preset's; with a limit of bytes, in which the best is wanted, one at which none show.
        """
        limited = self.goal.byte_limit is not None
        return max(self.preset.enough, INDISTINGUISHABLE) if limited else self.preset.enough

    @property
    def palette_is_counted(self) -> bool:
        """Whether the palette has a given size, and not one that depends on its loss."""
        return self.options.svg.palette is not None or not self.goal.count_adapts

    @property
    def side(self) -> int:
        """Longest side in px of the image that the fit runs on."""
        return self.options.run.max_size or self.preset.max_size

    @cached_property
    def additive_config(self) -> FitConfig:
        """The additive fit that precedes a portable file."""
        return self._config(ADD)

    @cached_property
    def fit_config(self) -> FitConfig:
        """The fit that is written."""
        return self._config(self.options.written_blend)

    @property
    def only_time_limits(self) -> bool:
        """Whether the steps of the fit follow from the seconds that are left."""
        goal = self.goal
        return goal.time_limit is not None and goal.quality is None and self.aim is None

    def _config(self, blend: str) -> FitConfig:
        options, iterations = self.options, self.options.fit.iterations
        if iterations is None:
            iterations = MOST_STEPS if self.only_time_limits else self.iterations
        densify = options.densify
        given = options.fit.iterations or densify.round_iterations
        if self.only_time_limits and given is None:
            densify = dataclasses.replace(densify, round_iterations=STEPS_A_ROUND)
        falloff = options.fit.falloff if blend == options.written_blend else None
        fit = dataclasses.replace(options.fit, blend=blend, falloff=falloff)  # pyright: ignore[reportArgumentType]
        return FitConfig(
            gaussians=0 if self.goal.count_adapts else self.goal.count or 0,
            iterations=iterations,
            fit=fit,
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
        """Whether no other fit, target or file is asked for than a search by bytes has."""
        svg, fit = self.options.svg, self.options.fit
        free = (svg.palette, svg.stops, svg.precision)
        usual = self.options.densify == DensifyOptions() and self._may_be_minimal
        usual = usual and fit.loss == DEFAULT_LOSS and fit.blend == OVER and self.aim is None
        usual = usual and not self.in_inks
        return usual and all(given is None for given in free)

    @property
    def may_enlarge(self) -> bool:
        """Whether a drawing would be fitted enlarged, by a search that plans every byte."""
        searches = dataclasses.replace(self, has_edges=True).searches()
        return any(search.by_bytes for search in searches)

    def searches(self) -> list[Plan]:
        """The plans of the searches to run, of whose files the closest is written; mostly one.

        With a limit of bytes they differ in markup and fit. A limit of seconds leaves time for one,
        and a target is looked for by one.
        """
        limit, asked = self.plain_limit, self.options.svg.markup
        if limit is None or self.aim is not None:
            return [self]
        found = list[Plan]()
        up_to = math.inf if self.has_edges or self.is_small else BY_BYTES_UP_TO
        by_bytes = asked != EDITABLE and self._may_be_by_bytes and limit <= up_to
        if by_bytes:
            found.append(self._search(MINIMAL, by_bytes=True))
        unasked_up_to = EDITABLE_IS_CLOSER * UNASKED_UP_TO
        unasked = asked == AUTO and self._may_be_minimal and limit <= unasked_up_to
        if (asked == MINIMAL or unasked) and (limit >= MINIMAL_FROM or not by_bytes):
            found.append(self._search(MINIMAL))
        if asked == EDITABLE or (asked == AUTO and (limit >= EDITABLE_FROM or not found)):
            found.append(self._search(EDITABLE))
        if self.goal.time_limit is None:
            return found
        # The one that is the closest most often.
        return found[-1:] if limit > UNASKED_UP_TO else found[-2:-1] or found

    def without_target(self) -> Plan | None:
        """The plan of the closest file within the bytes, for a target that none of them reaches.

        None without a target or a limit of bytes, and where a limit of seconds leaves no time.
        """
        goal = self.goal
        if self.aim is None or goal.max_bytes is None or goal.time_limit is not None:
            return None
        return Plan(self.options.changed(**{self.aim.name: None}))

    def _search(self, markup: Markup, by_bytes: bool = False) -> Plan:
        svg = dataclasses.replace(self.options.svg, markup=markup)
        goal, limit = self.goal, self.goal.byte_limit
        if markup == MINIMAL and self.options.svg.markup == AUTO and limit is not None:
            most = UNASKED_UP_TO // (GZIP if self.counts_gzipped else 1)
            goal = dataclasses.replace(goal, max_bytes=min(limit, most))
        options = dataclasses.replace(self.options, svg=svg, goal=goal)
        return dataclasses.replace(self, options=options, by_bytes=by_bytes)

    @property
    def svg_format(self) -> SvgFormat:
        """The format of the shapes, before any is fitted."""
        return self.format_at(None)

    def format_at(self, psnr: float | None) -> SvgFormat:
        """The format of the shapes of a scene of this PSNR in dB, None for any."""
        svg, preset = self.options.svg, self._written_like(psnr)
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
        """Return palette and color_error, as `quantize` has them, for so many Gaussians.

        error  their mean squared error, where it is known
        """
        preset = self.preset
        palette, loss = self.options.svg.palette, 0.0
        if palette is None:
            palette = 0 if self.goal.count_adapts else preset.palette_for(gaussians)
            palette = MOST_COLORS if self.is_budget else palette
            loss = preset.color_loss if self.goal.count_adapts else UNSEEN_COLOR_LOSS
        color_error = 0.0
        if error is not None and self.options.svg.palette is None:
            color_error = min(error * (10 ** (loss / 10) - 1), LARGEST_COLOR_ERROR)
        return palette, color_error

    def _written_like(self, psnr: float | None) -> Preset:
        """The preset whose numbers the file has; within a budget those that its PSNR is worth."""
        if not self.is_budget or psnr is None:
            return self.preset
        of_bytes = FINE_BYTES_FROM if self.goal.byte_limit is not None else FINE_FROM
        return next((PRESETS[name] for name, least in of_bytes if psnr >= least), self.preset)


@dataclass(frozen=True, kw_only=True)
class Aim(Search):
    """A target, and how closely a search meets it.

    Scores and the target count by the sign of the score here, so that more is better.

    of     the score
    value  the target
    """

    of: Score
    value: float

    @property
    def name(self) -> str:
        """The option, which is also the stop reason once it is reached."""
        return self.of.option

    def score(self, raster: NDArray[np.float32], photo: NDArray[np.float32]) -> float:
        """The score of a raster against a photo of its shape."""
        return self.of.sign * measured(self.of, raster, photo)

    def of_file(
        self, found: RoundTrip, photo: NDArray[np.float32], working: NDArray[np.float32]
    ) -> float:
        """The score of a measured file against the one of both pictures that its raster is of."""
        if (known := self.known(found)) is not None:
            return known
        return self.score(found.raster, photo if found.raster.shape == photo.shape else working)

    def known(self, found: RoundTrip) -> float | None:
        """The score of a written file where its round trip has measured it, as it does PSNR."""
        return found.psnr_lowest if self.of is PSNR_SCORE else None

    def with_detail(self, score: float, detail: float) -> float:
        """The score against the reference of a file whose score at the size of the fit is known."""
        error = self._error(score)
        # A negative detail from another export may exceed the error, of which some always remains.
        left = max(error + detail, error * 0.05)
        if self.of.best is None:
            return psnr_of(left)
        return self.of.sign * self.of.best - left

    def detail(self, at_photo: float, at_fit: float) -> float:
        """What measuring one file against the reference adds to its error."""
        return self._error(at_photo) - self._error(at_fit)

    def _error(self, score: float) -> float:
        """What adds up over sizes: the squared error of decibels, else what the best lacks."""
        if self.of.best is None:
            return 10 ** (-score / 10)
        return self.of.sign * self.of.best - score

    def reached(self, score: float) -> bool:
        """Whether a score counts as reached."""
        return score >= self.value - self.tolerance

    def reported(self, score: float | None) -> dict[str, float]:
        """A score by its name, as a report has it."""
        return {} if score is None else {self.of.slug: self.of.sign * score}

    def text(self, score: float, form: str) -> str:
        """A score with its unit, as a line of text has it."""
        return f"{self.of.sign * score:{form}}{self.of.unit and ' '}{self.of.unit}"


def aim_of(goal: Goal) -> Aim | None:
    """The target of a goal."""
    score = goal.target
    if score is None or score.search is None:
        return None
    value = score.sign * getattr(goal, score.option)
    numbers = {f.name: getattr(score.search, f.name) for f in dataclasses.fields(Search)}
    return Aim(of=score, value=value, **numbers)


def unreached(
    goal: Goal, reached: float | None, size: int, seconds: float, reason: str, gaussians: int
) -> list[str]:
    """One line for each target or limit that the written result of so many Gaussians misses.

    reached  its score by the goal's aim, None without one
    """
    lines = []
    aim = aim_of(goal)
    if aim is not None and reached is not None and not aim.reached(reached):
        reported = reason not in (aim.name, "interrupted")
        ended = f", stopped by {reason.replace('_', ' ')}" if reported else ""
        name = "" if aim.of.unit else f"{aim.of.name} "
        target = f"target of {name}{aim.text(aim.value, 'g')}"
        lines.append(
            f"{target} not reached: {aim.text(reached, f'.{max(2, aim.of.digits)}f')}{ended}"
        )
    if goal.byte_limit is not None and size > goal.byte_limit:
        lines.append(
            f"limit of {goal.max_bytes} bytes exceeded: the file has {size} even without shapes"
        )
    elif reason == "max_bytes" and not gaussians:
        lines.append(
            f"limit of {goal.max_bytes} bytes leaves no room for a shape: the file has none. "
            "Try a larger --max-bytes"
        )
    limit = goal.time_limit
    if limit is not None and seconds > 1.05 * limit + 0.25:
        lines.append(
            f"time limit of {limit:.3g} s exceeded: {seconds:.1f} s. Try a smaller --max-size"
        )
    return lines
