"""The presets of speed and quality, and the bytes of a Gaussian that are assumed at first."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from gauss2svg.fit.options import MOST_GAUSSIANS
from gauss2svg.svg.document import StopCount

# Bounds of the Gaussians and pixels of a run.
MOST_A_SECOND = 5000  # most Gaussians for each second of a limit (docs/decisions/time.md)
PIXELS_EACH = 30  # px of the fit for each shape within a limit (docs/decisions/time.md)
LEAST_CAP = 150  # smallest cap, however small the limit (docs/decisions/time.md)

# Bytes of a Gaussian in editable markup.
USUAL_BYTES = 120  # bytes of an ellipse and its share of the palette (docs/decisions/numbers.md)
GZIPPED_SHARE = 0.17  # share of the bytes that gzip leaves (docs/decisions/numbers.md)
BYTES_IN_LIMIT = 100  # bytes of an ellipse in a file that fills a limit (docs/decisions/time.md)
LEAST_BYTES_IN_LIMIT = 60  # fewest bytes of such an ellipse
BYTES_IN_INKS = 60  # bytes of an ellipse of one of a few inks (docs/decisions/inks.md)
LEAST_BYTES_IN_INKS = 20  # fewest bytes of such an ellipse, in minimal markup
# Bytes in minimal markup of a soft shape, a plain ellipse and a shape of a drawing, before and
# after gzip (docs/decisions/small.md).
MINIMAL_BYTES, MINIMAL_GZIPPED_BYTES = (62, 44, 36), (22, 20, 18)


@dataclass(frozen=True, kw_only=True)
class Preset:
    """The numbers of a preset.

    gain        dB that a kilobyte of the file must gain for growth to continue
    enough      PSNR (dB) at which growth stops
    cap         largest number of Gaussians
    color_loss  PSNR (dB) that the palette may cost if the count adapts. The last steps of the fit
                regain some of it. 0: all colours are written
    colors      palette entries per Gaussian if the count is given. 0: all colours are written
    iterations  number of optimiser steps
    max_size    longest side in px of the image that the fit runs on
    stops       number of stops of a gradient
    precision   step of coordinates in px
    opacity_decimals  number of decimals of fill-opacity
    """

    gain: float
    enough: float
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
    "draft": Preset(
        gain=0.03, enough=28, cap=1000, color_loss=1.0, colors=0.154,
        iterations=200, max_size=384, stops=5, precision=0.04, opacity_decimals=2,
    ),
    "fast": Preset(
        gain=0.01, enough=32, cap=3000, color_loss=0.8, colors=0.154,
        iterations=120, max_size=768, stops=5, precision=0.04, opacity_decimals=2,
    ),
    "balanced": Preset(
        gain=0.004, enough=36, cap=8000, color_loss=0.8, colors=0.154,
        iterations=200, max_size=1024, stops=5, precision=0.04, opacity_decimals=2,
    ),
    "high": Preset(
        gain=0.0012, enough=40, cap=20000, color_loss=0.6, colors=0.154,
        iterations=500, max_size=1536, stops=6, precision=0.02, opacity_decimals=2,
    ),
    "max": Preset(
        gain=0.0004, enough=44, cap=30000, color_loss=0.2, colors=0.0,
        iterations=800, max_size=2048, stops=10, precision=0.01, opacity_decimals=3,
    ),
}  # fmt: skip
DEFAULT_PRESET = "balanced"

CAP_FOR_TARGET = 50000  # largest number of Gaussians for a target, whatever the preset
# PSNR (dB) from which more Gaussians do not show: an error of half a level of 255 has 54.1.
INDISTINGUISHABLE = 54.0
# PSNR (dB) of the model from which rounding the raster to 8 bits hides what more Gaussians gain.
NOTHING_TO_GAIN = 58.0
# PSNR (dB) from which a budget of seconds, or of bytes, uses the finer numbers of a preset.
FINE_FROM = ("max", 46.0), ("high", 40.0)
FINE_BYTES_FROM = (("high", 44.0),)


def budget_preset(max_bytes: int | None, time_limit: float | None, inks: bool = False) -> Preset:
    """Return the numbers of a budget of bytes before gzip, of seconds or of both.

    inks  whether the shapes are opaque ellipses of a few inks
    """
    usual, finest = PRESETS[DEFAULT_PRESET], PRESETS["max"]
    side, caps = finest.max_size, [MOST_GAUSSIANS]
    if time_limit is not None:
        caps.append(int(MOST_A_SECOND * time_limit))
    if max_bytes is not None:
        least = LEAST_BYTES_IN_INKS if inks else LEAST_BYTES_IN_LIMIT
        caps.append(max_bytes // least)
        square = math.sqrt(PIXELS_EACH * max_bytes / BYTES_IN_LIMIT)
        side = round(min(max(square, usual.max_size), finest.max_size))
    cap = max(LEAST_CAP, min(caps))
    return dataclasses.replace(usual, gain=0.0, enough=NOTHING_TO_GAIN, cap=cap, max_size=side)
