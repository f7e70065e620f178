"""The speed and quality presets."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from gauss2svg.fit.options import MOST_GAUSSIANS

# Fewer cost PSNR visibly even with a thousand Gaussians (docs/decisions/palette.md).
_FEWEST_COLORS = 192


@dataclass(frozen=True)
class Preset:
    """The numbers of a preset.

    gain        dB that a kilobyte of the file must gain for growth to continue
    enough      PSNR (dB) at which growth stops
    cap         largest number of Gaussians
    color_loss  dB that the palette of an adaptive count may cost before the last steps of the fit
                compensate for some of it; 0: all colours are written
    colors      palette entries per Gaussian for a given count; 0: all colours are written
    iterations  optimiser steps
    max_size    longest side in px of the image that the fit runs on
    stops, precision, opacity_decimals  of gradients, of coordinates in px, of fill-opacity
    """

    gain: float
    enough: float
    cap: int
    color_loss: float
    colors: float
    iterations: int
    max_size: int
    stops: int
    precision: float
    opacity_decimals: int

    def palette_for(self, gaussians: int) -> int:
        """Palette entries for a given number of Gaussians; 0 for all colours."""
        return max(_FEWEST_COLORS, math.ceil(gaussians * self.colors)) if self.colors else 0


# What more exact numbers and larger palettes gain for their bytes: docs/decisions/numbers.md and
# palette.md.
PRESETS: dict[str, Preset] = {
    "draft": Preset(0.03, 28, 1000, 1.0, 0.154, 200, 384, 5, 0.04, 2),
    "fast": Preset(0.01, 32, 3000, 0.8, 0.154, 120, 768, 5, 0.04, 2),
    "balanced": Preset(0.004, 36, 8000, 0.8, 0.154, 200, 1024, 5, 0.04, 2),
    "high": Preset(0.0012, 40, 20000, 0.6, 0.154, 500, 1536, 6, 0.02, 2),
    "max": Preset(0.0004, 44, 30000, 0.2, 0.0, 800, 2048, 10, 0.01, 3),
}
DEFAULT_PRESET = "balanced"

# Of the file, palette included (docs/decisions/numbers.md); measured if the bytes are limited.
KILOBYTES_PER_GAUSSIAN = 0.12
CAP_FOR_TARGET = 50000  # largest number of Gaussians for a target, whatever the preset
# PSNR (dB) from which more Gaussians do not show: an error of half a level of 255 has 54.1.
INDISTINGUISHABLE = 54.0
# PSNR (dB) of the model from which the 8 bits of a raster decide, and more Gaussians gain nothing.
NOTHING_TO_GAIN = 58.0
# Bytes of a shape at least and usually, Gaussians that a second fits at most, and px of the fit for
# each usual shape that a limit allows (docs/decisions/time.md, also for the next two).
_LEAST_BYTES, _USUAL_BYTES, _MOST_A_SECOND, _PIXELS_EACH = 60, 100, 5000, 30
_LEAST_CAP = 150  # of Gaussians, however small the limit is
# PSNR (dB) from which the numbers of a dearer preset are worth their time, or their bytes.
FINE_FROM = ("max", 46.0), ("high", 40.0)
FINE_BYTES_FROM = (("high", 44.0),)


def budget_preset(max_bytes: int | None, time_limit: float | None) -> Preset:
    """The numbers of a run that is limited by bytes before gzip, or by seconds, alone."""
    usual, finest = PRESETS[DEFAULT_PRESET], PRESETS["max"]
    side, caps = finest.max_size, [MOST_GAUSSIANS]
    if time_limit is not None:
        caps.append(int(_MOST_A_SECOND * time_limit))
    if max_bytes is not None:
        caps.append(max_bytes // _LEAST_BYTES)
        square = math.sqrt(_PIXELS_EACH * max_bytes / _USUAL_BYTES)
        side = round(min(max(square, usual.max_size), finest.max_size))
    return dataclasses.replace(
        usual, gain=0.0, enough=NOTHING_TO_GAIN, cap=max(_LEAST_CAP, min(caps)), max_size=side
    )
