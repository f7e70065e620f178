"""The plan of a run: its preset, the values of its options, its aim, and the searches to run."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.areas.texture import is_icon, is_small, may_have_areas
from gauss2svg.errors import refusal
from gauss2svg.fit import DEFAULT_LOSS, GAUSSIAN, MOST_GAUSSIANS, PSNR, FitConfig, FitOptions, Tune
from gauss2svg.measure import Score, Search
from gauss2svg.measure.roundtrip import score_of
from gauss2svg.pipeline.conflicts import check_together, needs_editable, without_areas
from gauss2svg.pipeline.options import ALWAYS, AUTO, NEVER, Goal, Options
from gauss2svg.raster import DRAW_MINIMAL, renderer_version
from gauss2svg.scene import OVER
from gauss2svg.scene.inks import inks_of, printed_colors
from gauss2svg.svg import EDITABLE, INKS, MINIMAL, ROUNDS, Markup, StopCount, SvgFormat

# Bytes of an ellipse in an editable file, and of its share of the palette
USUAL_BYTES = 120  # docs/decisions/numbers.md
# Bytes of a soft shape and of a plain ellipse in minimal markup (docs/decisions/small.md).
SHAPE_BYTES = 62, 44
GZIP = 6  # bytes of a file before gzip, divided by its bytes after (docs/decisions/numbers.md)


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
# The same for a mosaic of MOSAIC squares along the longest side: a smooth photo of a leaf or of
# cells has little else to see. The mosaics of the eight have 16 to 24 dB.
MOSAIC, MOSAIC_PSNR = 64, 26.0
FAINT_STOP = 46.0  # largest PSNR (dB) at which growth stops later for a faint photo

CAP_FOR_TARGET = 50000  # largest number of Gaussians in a run with a target, for every preset
# PSNR (dB) from which on nothing visible is gained: the error is less than half a level of 255.
INDISTINGUISHABLE = 54.0


def faintness_of(pixels: NDArray[np.float32]) -> float:
    """Return by how many dB the mean colour of a photo (h, w, c), or a mosaic of it, is too close.

    At the usual PSNR, the photo would lose what is seen in it.
    """
    height, width, channels = pixels.shape
    side = min(max(1, round(max(height, width) / MOSAIC)), height, width)
    rows, columns = height // side, width // side
    squares = pixels[: rows * side, : columns * side].reshape(rows, side, columns, side, channels)
    faint = 0.0
    for parts, least in ((pixels[None, :, None], FAINT_PSNR), (squares, MOSAIC_PSNR)):
        variance = float(parts[..., :3].var(axis=(1, 3), dtype=float).mean())
        if variance > 0:
            faint = max(faint, -10 * portable.log10(variance) - least)
    return round(faint, 1)


# In the markup `auto`, files of limits above this are editable, because names and layers are little
# of them. It is in bytes before gzip (docs/decisions/markup.md).
AUTO_MINIMAL = 200_000
BY_BYTES_UP_TO = 15_000  # largest limit of a search by bytes (docs/decisions/markup.md)
MINIMAL_UP_TO = 20_000  # largest size of a placeholder


@dataclass(frozen=True)
class Plan:
    """The options of a run or of one of its searches, and the decisions that follow from them.

    starts     whether the run starts with a scene. No search by bytes can begin with one
    has_areas  whether the photo is drawn by areas if the option is auto, False before it is read
    faintness  dB by which growth stops later, because the photo is dark or pale all over
    is_small   whether the photo has few pixels, and no limit, count, target or start is given
    rate       squared error that each byte of a shape above areas must save, else 0
    has_focus  whether the run has a mask. Without one, focus_strength is refused
    sketch     paper and ink as "#rrggbb,#rrggbb", in which a sketch is drawn by areas alone. It is
               "" for other pictures, and before the photo is read
    printed    inks that the user listed, their paper and their tones (printed_colors), which the
               inks of `options` replace (on_paper). None for other inks, and before
    Raise InputError or RendererError if options exclude each other.
    """

    options: Options
    starts: bool = False
    has_areas: bool = False
    faintness: float = 0.0
    is_small: bool = False
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
        return not without_areas(self.options)

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

    def for_picture(self, pixels: NDArray[np.float32], whole: NDArray[np.float32]) -> Plan:
        """Return the plan with the decisions that depend on the photo.

        whole  photo that is not reduced, in which thin lines look drawn. It may be `pixels`
        If the options give a number of inks, the inks are chosen. Nothing else is decided for a
        sketch.
        """
        options, count = self.options, self.options.fit.inks
        if self.sketch:
            options = options.changed(inks=self.sketch) if isinstance(count, int) else options
            return dataclasses.replace(self, options=options)
        if isinstance(count, int):
            options = options.changed(inks=inks_of(pixels, count, options.fit.paper))
            plan = dataclasses.replace(self, options=options)
            return (plan.on_paper() if options.fit.paper else plan).for_picture(pixels, whole)
        may = options.svg.areas == AUTO and self.may_be_exact
        pictures = (pixels,) if whole is pixels else (pixels, whole)
        has_areas = self.has_areas or (may and any(map(may_have_areas, pictures)))
        is_free = not (self.goal.is_limited or self.goal.count or self.goal.target)
        has_areas |= may and is_free and is_icon(pixels)
        return dataclasses.replace(
            self, faintness=faintness_of(pixels), has_areas=has_areas,
            is_small=is_free and not self.starts and is_small(pixels),
        )  # fmt: skip

    @property
    def shape_bytes(self) -> float:
        """Bytes that a shape usually takes in the file, before gzip."""
        if self.in_areas:
            return SHAPE_BYTES[0] if self.markup == MINIMAL else 300  # few share a gradient
        return 60 if self.in_inks else USUAL_BYTES  # docs/decisions/inks.md

    def check_renderer(self) -> None:
        """Raise RendererError if the renderer that draws the file is not installed."""
        renderer_version(self.options.run.renderer)

    def check_limit(self, size: int) -> None:
        """Raise InputError if the limit of bytes is below the size of a file without Gaussians."""
        if size > self.goal.byte_limit:
            needed = f"at least {size}, the bytes of a file without Gaussians"
            raise refusal("max_bytes", needed, str(self.goal.byte_limit), str(size))

    @cached_property
    def preset(self) -> Preset:
        """Preset of the run.

        A budget of bytes or seconds has the preset of its usual or fine numbers, but no other limit
        ends growth before nothing visible is gained. Bytes are spent on shapes rather than on many
        colours (docs/decisions/markup.md).
        """
        limit, seconds = self.uncompressed_limit, self.goal.time_limit
        if not self.is_budget:
            usual = PRESETS[self.goal.quality or DEFAULT_PRESET]
            stop = min(usual.stop_psnr + self.faintness, max(usual.stop_psnr, FAINT_STOP))
            return dataclasses.replace(usual, stop_psnr=stop)
        usual = PRESETS["high" if limit > 1_000_000 else DEFAULT_PRESET]
        cap, side, loss = MOST_GAUSSIANS, PRESETS["max"].max_size, usual.color_loss
        if seconds is not None:
            cap = min(cap, int(5000 * seconds))  # docs/decisions/time.md
        if limit < math.inf:
            # An ellipse takes at least 60 bytes, in inks in minimal markup 20.
            cap = min(cap, int(limit) // (20 if self.in_inks else 60))
            side, loss = usual.max_size, 1.0
        return dataclasses.replace(
            usual, gain=0.0, stop_psnr=INDISTINGUISHABLE, cap=max(cap, 150), max_size=side,
            color_loss=loss,
        )  # fmt: skip

    @property
    def is_budget(self) -> bool:
        """Whether the goal is the best picture within a limit of bytes or seconds.

        It is True if a limit is given without a preset, a number of Gaussians or a target. It is
        False for a portable file, because the additive fit that comes first decides the number of
        Gaussians.
        """
        goal, svg = self.goal, self.options.svg
        is_alone = goal.quality is goal.gaussians is goal.target is None
        return goal.is_limited and is_alone and not svg.portable

    @property
    def uncompressed_limit(self) -> float:
        """Limit of bytes before gzip. It is estimated if the user's limit counts gzipped bytes."""
        return self.goal.byte_limit * (GZIP if self.counts_gzipped else 1)

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
        least = INDISTINGUISHABLE if self.goal.byte_limit < math.inf or self.rate else 0.0
        return max(self.preset.stop_psnr, least)

    def caps(self, pixels: int) -> tuple[int, int]:
        """Return the largest counts of growth and of corrections, for a fit to so many pixels."""
        if self.goal.count is not None:
            return self.goal.count, self.goal.count
        # A Gaussian has nine numbers, as three pixels have. With a budget, two are enough.
        cap = min(self.preset.cap, max(1, pixels // (2 if self.is_budget else 3)))
        most = cap if self.aim is None else max(cap, min(CAP_FOR_TARGET, pixels))
        return most if self.grows_to_aim else cap, most

    @property
    def grows_to_aim(self) -> bool:
        """Whether growth stops at the target.

        It does at a PSNR, because growth measures how much PSNR more shapes gain. Otherwise growth
        ends at the preset's PSNR, and corrections raise or lower the count until the file reaches
        the target.
        """
        return self.aim is not None and self.aim.search.slope is None

    @property
    def only_time_limits(self) -> bool:
        """Whether a time limit is given, but neither a preset nor a target."""
        goal = self.goal
        return goal.time_limit is not None and goal.quality is None and self.aim is None

    @cached_property
    def fit_config(self) -> FitConfig:
        """Configuration of the fit whose scene is written."""
        options, goal, each, steps = self.options, self.goal, None, self.preset.iterations
        fit = options.changed(blend=options.written_blend).fit
        if self.only_time_limits and fit.iterations is None:
            # More than 1000 steps gain nothing. The time is better spent on steps in which all
            # Gaussians exist than on rounds of growth (docs/decisions/time.md).
            steps, each = 1000, 6
        if (self.in_areas or self.is_small) and fit.falloff is None:
            # Areas have the crisp edges. Each further falloff takes a definition in the file. Rims
            # that are sharper than a pixel are discs and rolls where a small picture is enlarged.
            fit = dataclasses.replace(fit, falloff=GAUSSIAN)
        return FitConfig(
            gaussians=0 if goal.count_adapts else goal.count or 0,
            iterations=fit.iterations or steps,
            fit=fit,
            round_iterations=each,
            extend=fit.iterations is None and not goal.count_adapts,
            relocate_rarely=self.is_budget or self.only_time_limits,
        )

    @cached_property
    def markup(self) -> Markup:
        """Markup of the file. If the option is auto, files within a small limit are minimal."""
        asked = self.options.svg.markup
        if asked != AUTO:
            return asked
        is_able = self.options.run.renderer in DRAW_MINIMAL and not needs_editable(self.options)
        return MINIMAL if is_able and self.uncompressed_limit <= AUTO_MINIMAL else EDITABLE

    @cached_property
    def by_bytes(self) -> bool:
        """Whether the search for shapes is a search by bytes. Otherwise it is one by count."""
        fit, svg = self.options.fit, self.options.svg
        is_small = self.uncompressed_limit <= BY_BYTES_UP_TO and self.markup == MINIMAL
        is_usual = fit.init == FitOptions.init and fit.relocate and fit.loss == DEFAULT_LOSS
        is_usual &= fit.blend == OVER and svg.palette is svg.stops is svg.precision is None
        return is_small and is_usual and not (self.in_inks or self.starts or self.aim)

    def searches(self) -> list[Plan]:
        """Return the plans of the searches to run. The run writes the closest of their files.

        One search usually suffices. Shapes alone may be closer than areas, and `best_of` runs their
        search only if this is likely. If a target is missed within a limit of bytes, the limit is
        filled instead. With a time limit there is time for one search only, but the one for areas
        may end early.
        """
        if self.in_areas:
            options = self.options.changed(areas=NEVER)
            alone = dataclasses.replace(self, options=options, has_areas=False, sketch="")
            return [self, alone] if self.has_areas else [self]
        if self.aim and self.goal.byte_limit < math.inf and self.goal.time_limit is None:
            options = self.options.changed(**{self.aim.of.option: None})
            return [self, dataclasses.replace(self, options=options)]
        return [self]

    @cached_property
    def format(self) -> SvgFormat:
        """Format of the file."""
        svg, preset = self.options.svg, self.preset
        # Files of inks round coordinates to .1 px (docs/decisions/inks.md).
        precision = 0.1 if self.in_inks else preset.precision
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
        docs/decisions/palette.md explains the numbers.
        """
        preset, adapts, palette = self.preset, self.goal.count_adapts, 0
        if self.options.svg.palette is not None:
            return self.options.svg.palette, 0.0
        if self.is_budget:
            palette = 4096  # these err less than 8 bits do, and more take long to find
        elif preset.colors and not adapts:
            # Fewer than 192 entries lower the PSNR even of a thousand Gaussians.
            palette = max(192, math.ceil(gaussians * preset.colors))
        if error is None:
            return palette, 0.0
        loss = preset.color_loss if adapts else 0.03
        # A palette may add an error of 38 dB at most, or about three levels of 255. Otherwise the
        # hue of sky and leaves would change in a coarse fit.
        return palette, min(error * (portable.power(10, loss / 10) - 1), 1.6e-4)


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
