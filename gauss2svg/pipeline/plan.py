"""The plan of a run: its preset, the values of its options, its aim, and the searches to run.

Options that exclude each other are refused here, before anything slow begins.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.areas.texture import may_have_areas
from gauss2svg.errors import InputError, RendererError, quoted, refusal
from gauss2svg.fit import (
    DEFAULT_LOSS,
    GAUSSIAN,
    MOST_GAUSSIANS,
    PSNR,
    DensifyOptions,
    FitConfig,
    FitOptions,
    Tune,
)
from gauss2svg.measure import Score, Search, require_packages
from gauss2svg.measure.roundtrip import score_of
from gauss2svg.pipeline.options import ALWAYS, AUTO, NEVER, Goal, Options
from gauss2svg.raster import DRAW_BLENDS, DRAW_MINIMAL, DRAW_ROTATED_BLURS, renderer_version
from gauss2svg.scene import ADD, OVER
from gauss2svg.scene.inks import LEAST_INKS, MOST_INKS, inks_of, printed_colors
from gauss2svg.svg import EDITABLE, INKS, MINIMAL, ROUNDS, Markup, StopCount, SvgFormat
from gauss2svg.svg.forms import GRADIENT

# Bounds on the number of Gaussians and of pixels in a run with a limit (docs/decisions/time.md).
MOST_GAUSSIANS_A_SECOND = 5000  # largest number of Gaussians per second of the time limit
PIXELS_EACH_IN_LIMIT = 30  # a fit should have this many pixels for each shape that fits the limit
# dB of PSNR that the palette may cost in a file of few bytes. The bytes are then spent on shapes,
# which gain more than they do for a preset, whose palette saves bytes (docs/decisions/markup.md).
COLOR_LOSS_IN_LIMIT = 1.0
LEAST_CAP = 150  # however small the limit of bytes or seconds is, so many Gaussians are allowed

# The next numbers say how many bytes a Gaussian takes in a file of editable markup, unless another
# markup is named.
USUAL_BYTES = 120  # bytes of an ellipse and its share of the palette (docs/decisions/numbers.md)
GZIPPED_SHARE = 0.17  # compressed size as a share of the original (docs/decisions/numbers.md)
BYTES_IN_LIMIT = 100  # bytes of an ellipse in a file that fills a limit (docs/decisions/time.md)
BYTES_IN_INKS = 60  # bytes of an ellipse in a file with only a few inks (docs/decisions/inks.md)
# Bytes that a soft shape and a plain ellipse take in minimal markup: first without compression,
# then after gzip (docs/decisions/small.md).
SHAPE_BYTES, SHAPE_GZIPPED_BYTES = (62, 44), (22, 20)


@dataclass(frozen=True)
class Preset:
    """The values of a preset, in the order of the columns of PRESETS.

    gain        dB that one more kilobyte of the file must gain. If it gains less, growth stops
    stop_psnr   PSNR (dB) at which growth stops
    cap         largest number of Gaussians
    color_loss  dB of PSNR that the palette may cost if the number of Gaussians adapts to the image.
                The last steps of the fit regain a part of this loss. 0: all colours are written
    colors      number of palette entries per Gaussian if the user gives the number of Gaussians.
                0: all colours are written
    iterations  number of steps of the optimiser
    max_size    longest side in px of the image that the fit runs on. It bounds the pixels: an image
                longer than 3 : 2 may have as many as one of 3 : 2 with this longest side
    stops       number of colour stops in a gradient
    precision   step in px to which coordinates are rounded
    opacity_decimals  number of decimals of fill-opacity
    """

    gain: float
    stop_psnr: float
    cap: int
    color_loss: float
    colors: float
    iterations: int
    max_size: int
    stops: StopCount
    precision: float
    opacity_decimals: int


# docs/decisions/numbers.md and palette.md show what finer numbers and larger palettes gain.
PRESETS = {
    #                 gain    PSNR  cap   loss  colors steps side stops px  decimals
    "draft":    Preset(0.03,   28,  1000, 1.0, 0.154, 200,  384,  5, 0.04, 2),
    "fast":     Preset(0.01,   32,  3000, 0.8, 0.154, 120,  768,  5, 0.04, 2),
    "balanced": Preset(0.004,  36,  8000, 0.8, 0.154, 200, 1024,  5, 0.04, 2),
    "high":     Preset(0.0012, 40, 20000, 0.6, 0.154, 500, 1536,  6, 0.02, 2),
    "max":      Preset(0.0004, 44, 30000, 0.2, 0.0,   800, 2048, 10, 0.01, 3),
}  # fmt: skip
DEFAULT_PRESET = "balanced"
# A photo whose mean colour alone is closer than this is faint: at the usual PSNRs it would lose
# what is seen in it. The mean colours of eight Kodak photos have 9 to 16 dB.
FAINT_PSNR = 22.0
FAINT_STOP = 46.0  # largest PSNR (dB) at which growth stops later for a faint photo

CAP_FOR_TARGET = 50000  # largest number of Gaussians in a run with a target, for every preset
# PSNR (dB) above which adding Gaussians makes no visible difference. An error of half a level of
# 255 has 54.1 dB.
INDISTINGUISHABLE = 54.0
# If the model's PSNR (dB) is above this, rounding the raster to 8 bits hides any further gain.
NOTHING_TO_GAIN = 58.0
# Pairs of a preset and a PSNR in dB. More digits are worth their bytes only if the PSNR is high. So
# a file within a budget has the digits and stops of the first preset here whose PSNR it reaches.
# FINE_FROM is for a budget of seconds alone, and FINE_BYTES_FROM for a budget with a byte limit.
FINE_FROM, FINE_BYTES_FROM = (("max", 46.0), ("high", 40.0)), (("high", 44.0),)


def faintness_of(pixels: NDArray[np.float32]) -> float:
    """Return by how many dB the mean colour of a photo (h, w, c) is closer than FAINT_PSNR."""
    variance = float(pixels.reshape(-1, pixels.shape[2])[:, :3].var(axis=0, dtype=float).mean())
    if variance == 0:
        return 0.0
    return round(max(0.0, -10 * portable.log10(variance) - FAINT_PSNR), 1)


def budget_preset(max_bytes: int | None, time_limit: float | None, inks: bool = False) -> Preset:
    """Return the preset for a budget of bytes, of seconds or of both.

    max_bytes   largest size of the file before gzip in bytes, or None
    time_limit  time limit in s, or None
    inks        whether the shapes are opaque ellipses in a few inks
    """
    usual, finer, finest = PRESETS[DEFAULT_PRESET], PRESETS["high"], PRESETS["max"]
    side, caps, steps = finest.max_size, [MOST_GAUSSIANS], usual.iterations
    loss = usual.color_loss
    if time_limit is not None:
        caps.append(int(MOST_GAUSSIANS_A_SECOND * time_limit))
    if max_bytes is not None:
        # An ellipse takes at least this many bytes, in inks in minimal markup.
        caps.append(max_bytes // (20 if inks else 60))
        square = math.sqrt(PIXELS_EACH_IN_LIMIT * max_bytes / BYTES_IN_LIMIT)
        side = round(min(max(square, usual.max_size), finest.max_size))
        # A file of as many shapes as a preset allows is fitted in as many steps as by this preset.
        loss = COLOR_LOSS_IN_LIMIT
        counts, numbers = (usual.cap, finer.cap), (usual.iterations, finer.iterations)
        steps = round(float(np.interp(max_bytes / BYTES_IN_LIMIT, counts, numbers)))
    cap = max(LEAST_CAP, min(caps))
    return dataclasses.replace(
        usual, gain=0.0, stop_psnr=NOTHING_TO_GAIN, cap=cap, color_loss=loss, iterations=steps,
        max_size=side,
    )  # fmt: skip


# Largest limit of bytes of a placeholder. In a search for a target, the option markup=auto means
# minimal markup if the limit of bytes is at most this.
MINIMAL_UP_TO = 20_000

# The limit of bytes before gzip decides which searches run (docs/decisions/markup.md). A search by
# bytes runs if this limit is at most BY_BYTES_UP_TO. It runs with every limit for a photo whose
# longest side is at most WHOLE_SIDE px.
BY_BYTES_UP_TO = 30_000
WHOLE_SIDE = 256  # px. A search by bytes does not reduce a photo whose longest side is at most this
# Below this limit, a search by count for minimal markup runs only if no search by bytes runs.
MINIMAL_FROM = 8_000
# With a smaller limit than this, a search for an editable file runs only if no other search runs.
EDITABLE_FROM = 5_000
UNASKED_UP_TO = 200_000  # auto markup is never minimal in a file of more bytes than this
# If the limit is above this multiple of UNASKED_UP_TO, only an editable file is made. An editable
# file is then always closer than a minimal one, which could have at most UNASKED_UP_TO bytes.
EDITABLE_IS_CLOSER = 1.5
GZIP = 6  # bytes of a file before gzip, divided by its bytes after (docs/decisions/minimal.md)
# Fewer palette entries lower the PSNR even of a thousand Gaussians (docs/decisions/palette.md).
FEWEST_COLORS = 192
# Largest number of palette entries in a run with a budget. So many already cause less error than
# rounding to 8 bits does, and it would take long to find more entries (docs/decisions/palette.md).
MOST_COLORS = 4096
# If the user gives the number of Gaussians, entries are left out of the palette as long as this
# lowers the PSNR by at most this many dB (docs/decisions/palette.md).
UNSEEN_COLOR_LOSS = 0.03
# Largest mean squared error that a palette may add: a PSNR of 38 dB, or about three levels of 255.
# Without this bound, a preset would allow eight levels in a coarse fit of foliage, and the hue of
# sky and leaves would change (docs/decisions/palette.md).
LARGEST_COLOR_ERROR = 1.6e-4
# Numbers for a fit that only a time limit ends (docs/decisions/time.md).
MOST_STEPS = 1000  # largest number of steps. More steps gain nothing
STEPS_A_ROUND = 6  # few, because the time is better spent on steps in which all Gaussians exist
# A cheaper preset is ignored if the longest side of the image is more than this times its max_size.
NEARLY = 1.5
PRECISION_OF_INKS = 0.1  # px. Files of inks round coordinates to this (docs/decisions/inks.md)


@dataclass(frozen=True)
class Plan:
    """The options of a run or of one of its searches, and the decisions that follow from them.

    fit_side   longest side in px of the image that the fit runs on, None before the photo is read.
               If the image is longer than 3 : 2, it is that of one of 3 : 2 with as many pixels
    by_bytes   whether the search is a search by bytes. Otherwise it is one by count
    is_small   whether the photo's longest side is at most WHOLE_SIDE px, False before it is read
    starts     whether the run starts with a scene. No search by bytes can begin with one
    has_areas  whether the photo is drawn by areas if the option is auto, False before it is read
    faintness  dB by which growth stops later, because the photo is dark or pale all over
    rate       squared error that each byte of a shape above areas must save, else 0
    has_focus  whether the run has a mask. Without one, focus_strength is refused
    sketch     paper and ink as "#rrggbb,#rrggbb", in which a sketch is drawn by areas alone. It is
               "" for other pictures, and before the photo is read
    printed    inks that the user listed, their paper and their tones (printed_colors), which the
               inks of `options` replace (on_paper). None for other inks, and before
    Raise InputError or RendererError if options exclude each other.
    """

    options: Options
    fit_side: float | None = None
    by_bytes: bool = False
    is_small: bool = False
    starts: bool = False
    has_areas: bool = False
    faintness: float = 0.0
    rate: float = 0.0
    has_focus: bool = False
    sketch: str = ""
    printed: tuple[str, str | None, int | None] | None = None

    def __post_init__(self) -> None:
        check_together(self.options)
        if (strength := self.options.fit.focus_strength) is not None and not self.has_focus:
            raise refusal("focus_strength", "given with a mask", f"{strength:g}", "without it")
        _ = self.fit_config

    @property
    def goal(self) -> Goal:
        """Targets and limits that the options give."""
        return self.options.goal

    @property
    def in_inks(self) -> bool:
        """Whether the shapes are opaque ellipses in a few inks."""
        return self.options.fit.inks is not None

    @property
    def in_areas(self) -> bool:
        """Whether the file has areas and lines, below its Gaussians."""
        asked = self.options.svg.areas
        return asked == ALWAYS or (asked == AUTO and self.has_areas)

    @property
    def prefers_areas(self) -> bool:
        """Whether areas are the file even if shapes alone are closer."""
        return self.options.svg.areas == ALWAYS or bool(self.sketch)

    @property
    def allows_areas(self) -> bool:
        """Whether the options allow areas. They do not if they ask for the method of the paper."""
        return next(_without_areas(self.options), None) is None

    @property
    def may_be_exact(self) -> bool:
        """Whether the areas of pixel art are the file.

        The scene of a start is refined instead. A target in inks asks for shapes, which come closer
        to colours between the inks.
        """
        may_have = self.options.svg.areas != NEVER and self.allows_areas and not self.starts
        return may_have and not (self.in_inks and self.aim is not None)

    @property
    def may_even_paper(self) -> bool:
        """Whether a sketch on paper is drawn without the stains of the paper.

        It is not if the options ask for more inks than two, or exclude areas for another reason. It
        is not for a target either, which asks for the likeness of the picture as it is.
        """
        inks, paper = self.options.fit.inks, self.options.fit.paper
        may_have_two = (inks in (None, 2) and paper is None) or (
            isinstance(inks, str) and inks.count(",") == 1
        )
        is_asked = self.options.svg.areas != NEVER and self.aim is None and may_have_two
        return is_asked and self.allows_areas and (self.has_areas or not self.starts)

    def on_paper(self) -> Plan:
        """Return the plan with the paper and the mixes of listed inks among its inks."""
        fit = self.options.fit
        if not isinstance(fit.inks, str):
            return self
        colors = printed_colors(fit.inks, fit.paper, fit.overprint)
        first, strength = next(iter(colors.items()))
        printed = fit.inks, None if any(strength) else first, fit.overprint
        options = self.options.changed(inks=",".join(colors), paper=None, overprint=None)
        return dataclasses.replace(self, printed=printed, options=options)

    def for_picture(self, pixels: NDArray[np.float32]) -> Plan:
        """Return the plan with the decisions that depend on the photo.

        If the options give a number of inks, the inks are chosen. Nothing else is decided for a
        sketch.
        """
        options, svg = self.options, self.options.svg
        if isinstance(count := options.fit.inks, int) and not self.sketch:
            options = options.changed(inks=inks_of(pixels, count, options.fit.paper))
            plan = dataclasses.replace(self, options=options)
            return (plan.on_paper() if options.fit.paper else plan).for_picture(pixels)
        if self.sketch:
            options = options.changed(inks=self.sketch) if isinstance(count, int) else options
            return dataclasses.replace(self, options=options)
        is_small = max(pixels.shape[:2]) <= WHOLE_SIDE
        may = svg.areas == AUTO and self.may_be_exact
        return dataclasses.replace(
            self, options=options, is_small=is_small, faintness=faintness_of(pixels),
            has_areas=self.has_areas or (may and may_have_areas(pixels)),
        )  # fmt: skip

    @property
    def shape_bytes(self) -> float:
        """Bytes that a shape usually takes in the file, before gzip."""
        if self.in_areas:
            return SHAPE_BYTES[0] if self.markup == MINIMAL else 300  # few share a gradient
        return BYTES_IN_INKS if self.in_inks else USUAL_BYTES

    def check_renderer(self) -> None:
        """Raise RendererError if the renderer that draws the file is not installed."""
        renderer_version(self.options.run.renderer)

    @cached_property
    def preset(self) -> Preset:
        """Preset of the run. `budget_preset` makes it for a budget of bytes or seconds."""
        goal = self.goal
        if self.is_budget:
            return budget_preset(self.uncompressed_limit, goal.time_limit, self.in_inks)
        usual = PRESETS[goal.quality or DEFAULT_PRESET]
        stop = min(usual.stop_psnr + self.faintness, max(usual.stop_psnr, FAINT_STOP))
        return dataclasses.replace(usual, stop_psnr=stop)

    @property
    def is_budget(self) -> bool:
        """Whether the goal is the best picture within a limit of bytes or seconds.

        It is False for a portable file, because the additive fit that comes first decides the
        number of Gaussians.
        """
        return self.goal.is_budget and not self.options.svg.portable

    @property
    def uncompressed_limit(self) -> int | None:
        """Limit of bytes before gzip. It is estimated if the user's limit counts gzipped bytes."""
        limit = self.goal.byte_limit
        return limit if limit is None or not self.counts_gzipped else GZIP * limit

    @property
    def counts_gzipped(self) -> bool:
        """Whether a limit of bytes applies to the gzipped file."""
        return self.options.svg.gzip or self.options.svg.count_gzipped

    @property
    def tune(self) -> Tune:
        """Tune of the fits. By bytes and above areas it is PSNR if the user gives none."""
        usual = PSNR if self.by_bytes or self.in_areas else self.options.fit.tuned
        return self.options.fit.tune or usual

    @cached_property
    def aim(self) -> Aim | None:
        """Score that the rasterised SVG must reach, or None if there is no target."""
        goal, score = self.goal, self.goal.target
        if score is None or score.search is None:
            return None
        return Aim(score, score.sign * getattr(goal, score.option), score.search)

    @property
    def stop_psnr(self) -> float:
        """PSNR (dB) of the model at which growth stops.

        It is the value of the preset. With a limit of bytes it is at least INDISTINGUISHABLE,
        because the goal is then the best picture that fits.
        """
        least = 0.0 if self.goal.byte_limit is None and not self.rate else INDISTINGUISHABLE
        return max(self.preset.stop_psnr, least)

    @cached_property
    def fit_config(self) -> FitConfig:
        """Configuration of the fit whose scene is written."""
        return self.config(self.options.written_blend)

    @property
    def only_time_limits(self) -> bool:
        """Whether a time limit is given, but neither a preset nor a target."""
        goal = self.goal
        return goal.time_limit is not None and goal.quality is None and self.aim is None

    def config(self, blend: str) -> FitConfig:
        """Return the configuration of a fit.

        blend  blend mode of the fit. A portable file has two fits, of which the first is additive
        Every preset gives a small drawing the same few Gaussians. A cheaper preset with more steps
        could then be better (docs/decisions/monotone.md). So the fit has at least as many steps as
        each cheaper preset whose max_size is not far below the longest side of the image.
        """
        options, densify, preset = self.options, self.options.densify, self.preset
        side, steps = self.fit_side or math.inf, preset.iterations
        if not self.is_budget:
            cheaper = [p for p in PRESETS.values() if p.cap < preset.cap]
            steps = max([steps, *(p.iterations for p in cheaper if side <= NEARLY * p.max_size)])
        if self.only_time_limits and options.fit.iterations is None:
            steps = MOST_STEPS
            densify = dataclasses.replace(densify, round_iterations=STEPS_A_ROUND)
        falloff = options.fit.falloff if blend == options.written_blend else None
        if self.in_areas:
            # Areas have the crisp edges. Each further falloff takes a definition in the file.
            falloff = falloff or GAUSSIAN
        return FitConfig(
            gaussians=0 if self.goal.count_adapts else self.goal.count or 0,
            iterations=options.fit.iterations or steps,
            fit=dataclasses.replace(options.fit, blend=blend, falloff=falloff),  # pyright: ignore[reportArgumentType]
            densify=densify,
            extend=options.fit.iterations is None and not self.goal.count_adapts,
            relocate_rarely=self.is_budget or self.only_time_limits,
        )

    @cached_property
    def markup(self) -> Markup:
        """Markup of the file.

        If the option is auto, the markup is minimal for small limits of bytes. `searches` may try
        both markups.
        """
        asked, limit = self.options.svg.markup, self.goal.byte_limit
        if asked != AUTO:
            return asked
        small = limit is not None and limit <= MINIMAL_UP_TO
        return MINIMAL if small and self.may_be_minimal else EDITABLE

    @property
    def may_be_minimal(self) -> bool:
        """Whether the renderer draws minimal files, and no option needs an editable file."""
        return self.options.run.renderer in DRAW_MINIMAL and not needs_editable(self.options)

    def searches(self) -> list[Plan]:
        """Return the plans of the searches to run. The run writes the closest of their files.

        Without a limit of bytes there is one search, and so there is for areas. With a limit of
        bytes there may be several: by bytes or by count, and for minimal or editable markup. If
        there is also a target, only the first search aims at it. The others run if the first one
        misses the target.
        With a time limit there is time for one search only, but the one for areas may end early.
        """
        limit, asked = self.uncompressed_limit, self.options.svg.markup
        is_timed = self.goal.time_limit is not None
        if self.in_areas:
            # Shapes alone may be closer. `best_of` runs their search only if this is likely.
            options = self.options.changed(areas=NEVER)
            alone = dataclasses.replace(self, options=options, has_areas=False, sketch="")
            return [self, *(alone.searches()[:1] if self.has_areas else [])]
        if limit is None:
            return [self]
        if self.aim is not None:
            options = self.options.changed(**{self.aim.of.option: None})
            within = dataclasses.replace(self, options=options)
            return [self] if is_timed else [self, *within.searches()]
        plans = list[Plan]()
        options, svg = self.options, self.options.svg
        usual = options.densify == DensifyOptions() and options.fit.loss == DEFAULT_LOSS
        usual = usual and options.fit.blend == OVER and not (self.in_inks or self.starts)
        usual = usual and svg.palette is svg.stops is svg.precision is None
        up_to = math.inf if self.is_small else BY_BYTES_UP_TO
        by_bytes = usual and asked != EDITABLE and self.may_be_minimal and limit <= up_to
        if by_bytes:
            plans.append(self._search(MINIMAL, by_bytes=True))
        unasked_up_to = EDITABLE_IS_CLOSER * UNASKED_UP_TO
        unasked = asked == AUTO and self.may_be_minimal and limit <= unasked_up_to
        if (asked == MINIMAL or unasked) and (limit >= MINIMAL_FROM or not by_bytes):
            plans.append(self._search(MINIMAL))
        if asked == EDITABLE or (asked == AUTO and (limit >= EDITABLE_FROM or not plans)):
            plans.append(self._search(EDITABLE))
        if not is_timed:
            return plans
        # There is time for one search only, so run the one whose file is usually closest.
        return plans[-1:] if limit > UNASKED_UP_TO else plans[-2:-1] or plans

    def _search(self, markup: Markup, by_bytes: bool = False) -> Plan:
        limit = self.goal.byte_limit
        if markup == MINIMAL and self.options.svg.markup == AUTO and limit is not None:
            limit = min(limit, UNASKED_UP_TO // (GZIP if self.counts_gzipped else 1))
        options = self.options.changed(markup=markup, max_bytes=limit)
        return dataclasses.replace(self, options=options, by_bytes=by_bytes)

    def format_at(self, psnr: float | None = None) -> SvgFormat:
        """Return the format in which a scene is written.

        psnr  PSNR of the scene in dB, None before the fit
        """
        svg, preset = self.options.svg, self.preset
        if self.is_budget and psnr is not None:
            fine = FINE_FROM if self.goal.byte_limit is None else FINE_BYTES_FROM
            preset = next((PRESETS[name] for name, least in fine if psnr >= least), preset)
        precision = PRECISION_OF_INKS if self.in_inks else preset.precision
        return SvgFormat(
            form=svg.form,
            markup=self.markup,
            stops=preset.stops if svg.stops is None else svg.stops,
            precision=precision if svg.precision is None else svg.precision,
            layers=INKS if self.in_inks else ROUNDS,
            opacity_decimals=preset.opacity_decimals,
            current_color=svg.current_color,
        )

    def quantization(self, gaussians: int, error: float | None = None) -> tuple[int, float]:
        """Return the values of the arguments `palette` and `color_error` of `quantize`.

        gaussians  number of Gaussians in the scene
        error      mean squared error of the scene, None if it is unknown
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
        return palette, min(error * (portable.power(10, loss / 10) - 1), LARGEST_COLOR_ERROR)


@dataclass(frozen=True)
class Aim:
    """A target: the value that a score of the rasterised SVG must reach.

    of      score that is measured
    value   value that the score must reach
    search  tolerances of the search for this value
    If lower values of the score are better, `value` and all measured values are negated here, so
    that larger is always better.
    """

    of: Score
    value: float
    search: Search

    def score(self, raster: NDArray[np.float32], photo: NDArray[np.float32]) -> float:
        """Return the score of a raster against a photo of the same shape."""
        return self.of.sign * score_of(self.of, raster, photo)

    def is_met_by(self, score: float) -> bool:
        """Return whether `score` reaches the target, or misses it by at most the tolerance."""
        return score >= self.value - self.search.tolerance


def check_together(options: Options) -> None:
    """Raise InputError if options conflict, or RendererError for what the renderer cannot draw."""
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


def needs_editable(options: Options) -> str:
    """Return the first requested feature that a minimal file cannot have, "" if there is none."""
    additive = ["additive blending"] * (options.written_blend == ADD)
    return next(iter([*additive, *_layered(options)]), "")


def _layered(options: Options) -> list[str]:
    """Return the requested features that no additive, minimal or ink file can have."""
    form = options.svg.form
    return [*[f"form {form}"] * (form != GRADIENT), *options.document.layered]


def _without_areas(options: Options) -> Iterator[tuple[str, object]]:
    """Yield the names and values of given options with which a file has no areas.

    They ask for the method of the paper, whose pictures are a given number of Gaussians.
    """
    goal, fit = options.goal, options.fit
    if not goal.count_adapts:
        yield "gaussians", goal.count
    if fit.blend == ADD:
        yield "blend", fit.blend
    if fit.falloff == GAUSSIAN:
        yield "falloff", fit.falloff


def _without_paper(fit: FitOptions) -> Iterator[tuple[str, str, object, str]]:
    """Yield what `_exclusions` yields, for inks on paper."""
    inks, advice = fit.inks, '--inks "#0078bf,#ff48b0"'
    if fit.paper is not None and inks is None:
        yield "paper", "be given with inks", fit.paper, f'--inks 3 --paper "{fit.paper}"'
    if not isinstance(inks, str):
        if fit.overprint is not None:
            got = f"{fit.overprint} with inks {inks}" if inks else str(fit.overprint)
            yield "overprint", "be given with inks that are listed", got, advice
        return
    count, tones = inks.count(",") + 1, fit.overprint
    if tones is not None and (tones + 1) ** count > MOST_INKS:
        most = int(MOST_INKS ** (1 / count) + 1e-9) - 1
        rule = f"make at most {MOST_INKS} mixes"
        yield "overprint", rule, f"{tones} for {count} inks", str(most) if most else "fewer inks"
    elif len(printed_colors(inks, fit.paper, tones)) < LEAST_INKS:
        yield "inks", "be another colour than the paper", inks, advice


def _exclusions(options: Options) -> Iterator[tuple[str, str, object, str]]:
    """Yield for each conflict the name of an option, the rule it breaks, its value, and advice."""
    goal, fit, svg, layered = options.goal, options.fit, options.svg, _layered(options)
    if svg.areas == ALWAYS:
        for name, value in _without_areas(options):
            why = "because the picture would have no areas"
            yield name, f"not be given with areas {ALWAYS}, {why}", value, f"--areas {NEVER}"
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
    if fit.inks is not None:
        why = "a picture in inks has opaque shapes without gradients, in one layer for each ink"
        names = [f"blend {ADD}"] * (fit.blend == ADD)
        names += [f"falloff {fit.falloff}"] * (fit.falloff is not None)
        names += [name for name in ("palette", "stops") if getattr(svg, name) is not None]
        for name in (*names, *layered):
            yield name, f"not be given with inks, because {why}", f"inks {fit.inks}", "without it"
    yield from _without_paper(fit)
    for name in ("per_round", "round_iterations", "schedule") if goal.count_adapts else ():
        value = getattr(options.densify, name)
        if value != getattr(DensifyOptions, name):
            rule = "be given with a number of Gaussians, and without a target or limit"
            yield name, rule, value, "--gaussians 1000 alone"
    score = None if goal.target is None or goal.target.always else goal.target
    if options.run.scores or score is not None:
        require_packages(score)
        if goal.time_limit is not None:
            name = "scores" if options.run.scores or score is None else score.option
            rule = "not be given with time_limit, because the time that scores take is unknown"
            yield name, rule, f"{goal.time_limit:g}", "gauss2svg check on the SVG"
