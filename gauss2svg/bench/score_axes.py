"""The scores that tables and charts have, each with its axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gauss2svg.bench import numbers


@dataclass(frozen=True)
class ScoreAxis:
    """A score of an SVG against its photo, as a column and as the axis of a chart.

    slug        its name in file names and addresses; key: in a report
    title       of the axis
    text        a value as tables and tooltips show it
    least_step  between two ticks
    best        value of equal pictures, over which there is no tick; None: infinite
    falls       whether lower values are better; the axis is then upside down
    """

    slug: str
    key: str
    name: str
    title: str
    text: Callable[[float | None], str]
    least_step: float
    best: float | None
    falls: bool = False

    @property
    def sign(self) -> int:
        """Of the score, so that more is better."""
        return -1 if self.falls else 1

    def has(self, value: float | None) -> bool:
        """Whether a report's value can be shown: a PSNR of None is that of equal pictures."""
        return value is not None or self.best is None


PSNR = ScoreAxis("psnr", "psnr_svg", "PSNR", "PSNR, dB", numbers.decibels, 1.0, None)
SCORE_AXES = (
    PSNR,
    ScoreAxis("ssim", "ssim_svg", "SSIM", "SSIM", numbers.ratio, 0.01, 1.0),
    ScoreAxis(
        "ssimulacra2", "ssimulacra2_svg", "SSIMULACRA2", "SSIMULACRA2", numbers.tenths, 1.0, 100.0
    ),
    ScoreAxis(
        "flip", "flip_svg", "FLIP", "FLIP, lower is better", numbers.ten_thousandths, 0.01, 0.0,
        falls=True,
    ),
)  # fmt: skip
