"""The quality presets: one word for how long to fit and how exactly to write."""

from __future__ import annotations

from dataclasses import dataclass

from gauss2svg.errors import InputError
from gauss2svg.svg.encode import SvgOptions


@dataclass(frozen=True)
class Quality:
    """What a preset stands for.

    gaussians   how many, unless asked for otherwise
    iterations  optimiser steps
    max_size    longest side in px of the picture that the fit runs on
    svg         how the scene is written
    """

    gaussians: int
    iterations: int
    max_size: int
    svg: SvgOptions


QUALITIES: dict[str, Quality] = {
    "draft": Quality(500, 100, 384, SvgOptions(palette=256)),
    "fast": Quality(2000, 150, 768, SvgOptions(palette=512)),
    "balanced": Quality(5000, 300, 1024, SvgOptions(palette=1280)),
    "high": Quality(10000, 500, 1536, SvgOptions(palette=2048, stops=10, decimals=2)),
    "max": Quality(20000, 1000, 2048, SvgOptions(palette=0, stops=12, decimals=2)),
}
DEFAULT_QUALITY = "balanced"


def quality_named(name: str) -> Quality:
    """The preset of a name; raises InputError for an unknown one."""
    if name not in QUALITIES:
        raise InputError(f"quality is {name!r}; needed is one of {', '.join(QUALITIES)}")
    return QUALITIES[name]
