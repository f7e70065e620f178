"""The quality presets: what a file promises, and how long may be spent on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gauss2svg.errors import InputError

# A palette that fits the count, but no smaller: with 125 colours instead of 250 a thousand
# Gaussians lose 0.07 dB.
_FEWEST_COLORS = 192


@dataclass(frozen=True)
class Quality:
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


# What writing more exactly buys at 5000 Gaussians, 1250 colours, on four Kodak photos, PSNR of
# the drawn SVG in dB and bytes a Gaussian: 6 stops, 1 decimal, 2 of opacity 33.21, 194;
# 8 stops 33.22, 221; and 3 of opacity 33.22, 224; and 2 decimals 33.28, 230; 10 stops 33.28,
# 256; 12 stops 33.28, 283.
# Palettes, balanced, four Kodak photos and coffee.jpg, at the same bytes raw / gzipped (3 dB a
# doubling): losses of 0.4, 0.8, 1.2 dB are worth 3.64, 3.95, 4.02 / 12.28, 12.35, 12.33 dB.
QUALITIES: dict[str, Quality] = {
    "draft": Quality(0.03, 28, 1000, 1.0, 0.154, 200, 384, 5, 0.04, 2),
    "fast": Quality(0.01, 32, 3000, 0.8, 0.154, 120, 768, 5, 0.04, 2),
    "balanced": Quality(0.004, 36, 8000, 0.8, 0.154, 200, 1024, 5, 0.04, 2),
    "high": Quality(0.0012, 40, 20000, 0.6, 0.154, 500, 1536, 6, 0.02, 2),
    "max": Quality(0.0004, 44, 30000, 0.2, 0.0, 800, 2048, 10, 0.01, 3),
}
DEFAULT_QUALITY = "balanced"


def quality_named(name: str) -> Quality:
    """The preset of a name; raises InputError for an unknown one."""
    if name not in QUALITIES:
        raise InputError(f"quality is {name!r}; needed is one of {', '.join(QUALITIES)}")
    return QUALITIES[name]
