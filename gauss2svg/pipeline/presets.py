"""The speed and quality presets."""

from __future__ import annotations

import math
from dataclasses import dataclass

# A palette that fits the count, but no smaller: with 125 colours instead of 250 a thousand
# Gaussians lose 0.07 dB.
_FEWEST_COLORS = 192


@dataclass(frozen=True)
class Preset:
    """What a preset promises.

    gain        dB that a kilobyte of the file must buy, or growth stops
    enough      dB of PSNR at which growth stops
    cap         most Gaussians
    color_loss  dB that a palette may cost where the scene decides its size, before the last
                steps of the fit make up for some of it; 0: all colours
    colors      palette entries, pairs of colour and exponent, for each Gaussian where the
                number of Gaussians is given; 0: all
    iterations  optimiser steps
    max_size    longest side in px of the picture that the fit runs on
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
        """Colours of a file with a given number of Gaussians; 0 for all."""
        return max(_FEWEST_COLORS, math.ceil(gaussians * self.colors)) if self.colors else 0


# What writing more exactly buys at 5000 Gaussians, mean of eight Kodak photos, PSNR of the drawn
# SVG in dB and bytes a Gaussian, raw / gzipped: 5 stops, 0.04 px 32.915, 147.7 / 20.6; 0.02 px
# 32.924, 149.5 / 21.6; 8 stops, 0.02 px 32.937, 176 / 22.8; 10 stops, 0.01 px 32.941, 194 / 24.8;
# 12 stops, 0.002 px and every colour 33.059, 676 / 52.0.
# Palettes, balanced, four Kodak photos and coffee.jpg, at the same bytes raw / gzipped (3 dB a
# doubling): losses of 0.4, 0.8, 1.2 dB are worth 3.64, 3.95, 4.02 / 12.28, 12.35, 12.33 dB.
PRESETS: dict[str, Preset] = {
    "draft": Preset(0.03, 28, 1000, 1.0, 0.154, 200, 384, 5, 0.04, 2),
    "fast": Preset(0.01, 32, 3000, 0.8, 0.154, 120, 768, 5, 0.04, 2),
    "balanced": Preset(0.004, 36, 8000, 0.8, 0.154, 200, 1024, 5, 0.04, 2),
    "high": Preset(0.0012, 40, 20000, 0.6, 0.154, 500, 1536, 6, 0.02, 2),
    "max": Preset(0.0004, 44, 30000, 0.2, 0.0, 800, 2048, 10, 0.01, 3),
}
DEFAULT_PRESET = "balanced"
