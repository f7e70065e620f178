"""The quality presets: one word for how long to fit and how exactly to write."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gauss2svg.errors import InputError
from gauss2svg.svg.encode import SvgOptions

# A palette that fits the count: under this many colours even a small drawing bands.
_FEWEST_COLORS = 64


@dataclass(frozen=True)
class Quality:
    """What a preset stands for.

    gaussians   how many, unless asked for otherwise
    iterations  optimiser steps
    max_size    longest side in px of the picture that the fit runs on
    colors      palette entries for each Gaussian; 0 keeps every colour
    stops, decimals  of gradients and of coordinates
    """

    gaussians: int
    iterations: int
    max_size: int
    colors: float
    stops: int = 8
    decimals: int = 1

    def svg_options(self, gaussians: int, palette: int | None = None) -> SvgOptions:
        """How a scene of so many Gaussians is written; a given palette overrides."""
        if palette is None and self.colors:
            palette = max(_FEWEST_COLORS, math.ceil(gaussians * self.colors))
        return SvgOptions(palette=palette or 0, stops=self.stops, decimals=self.decimals)


QUALITIES: dict[str, Quality] = {
    "draft": Quality(500, 100, 384, colors=0.25),
    "fast": Quality(2000, 150, 768, colors=0.25),
    "balanced": Quality(5000, 300, 1024, colors=0.25),
    "high": Quality(10000, 500, 1536, colors=0.25, stops=10, decimals=2),
    "max": Quality(20000, 1000, 2048, colors=0, stops=12, decimals=2),
}
DEFAULT_QUALITY = "balanced"


def quality_named(name: str) -> Quality:
    """The preset of a name; raises InputError for an unknown one."""
    if name not in QUALITIES:
        raise InputError(f"quality is {name!r}; needed is one of {', '.join(QUALITIES)}")
    return QUALITIES[name]
