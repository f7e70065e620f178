"""The scores that tables and charts have, each with its axis."""

from __future__ import annotations

from dataclasses import dataclass

from gauss2svg.bench.numbers import NONE, SPACE


@dataclass(frozen=True)
class ScoreAxis:
    """A score of an SVG against its photo, as a column and as the axis of a chart.

    slug        its name in file names and addresses; key: in a report
    title       of the axis
    form, unit  of a value as tables and tooltips show it
    least_step  between two ticks
    best        value of equal pictures, over which there is no tick; None: infinite
    falls       whether lower values are better; the axis is then upside down
    """

    slug: str
    key: str
    name: str
    title: str
    form: str
    least_step: float
    best: float | None
    falls: bool = False
    unit: str = ""

    @property
    def sign(self) -> int:
        """Sign that the score is given, so that more is better."""
        return -1 if self.falls else 1

    def has(self, value: float | None) -> bool:
        """Whether a report's value can be shown: a PSNR of None is that of equal pictures."""
        return value is not None or self.best is None

    def text(self, value: float | None) -> str:
        """A value with its unit; "equal" for a PSNR of None, the infinite one of an exact SVG."""
        if value is None:
            return "equal" if self.best is None else NONE
        return f"{value:{self.form}}{self.unit}"


PSNR = ScoreAxis("psnr", "psnr_svg", "PSNR", "PSNR, dB", ".2f", 1.0, None, unit=f"{SPACE}dB")
SSIM = ScoreAxis("ssim", "ssim_svg", "SSIM", "SSIM", ".3f", 0.01, 1.0)
PERCEPTUAL_AXES = (
    ScoreAxis("ssimulacra2", "ssimulacra2_svg", "SSIMULACRA2", "SSIMULACRA2", ".1f", 1.0, 100.0),
    ScoreAxis("flip", "flip_svg", "FLIP", "FLIP, lower is better", ".4f", 0.01, 0.0, falls=True),
)
SCORE_AXES = (PSNR, SSIM, *PERCEPTUAL_AXES)
