"""What differs in a fit between Gaussians painted over each other and Gaussians summed."""

from __future__ import annotations

from dataclasses import dataclass

from gauss2svg.fit.adam import Rates
from gauss2svg.scene import ADD

# A summed Gaussian has no opacity: its logit is one of 1, and stays.
_OPAQUE_LOGIT = 12.0


@dataclass(frozen=True)
class Blending:
    """Step sizes, bounds and beginnings of one of gauss2svg.scene.scene.BLENDS.

    least_color, most_color  of each channel; signed colours are bounded so that a file, whose
                             partial sums must fit into 8 bits, can hold them
    first_opacity_logit      of a new Gaussian
    sigma_share              its first sigma as a share of the mean spacing sqrt(area / (pi n))
    by_residual              whether its first colour is what is missing, or the target's
    """

    additive: bool
    rates: Rates
    least_color: float
    most_color: float
    first_opacity_logit: float
    sigma_share: float
    by_residual: bool


# First sigma 0.3 to 0.42: within 0.08 dB of each other, 0.6 loses 0.7 dB.
_OVER = Blending(False, Rates(), 0.0, 1.0, 1.0, 0.3, by_residual=False)
# See the ablation in loop.py.
_ADD = Blending(
    True, Rates(opacity=0.0, color=0.025), -0.5, 0.5, _OPAQUE_LOGIT, 0.3, by_residual=True
)


def blending(blend: str) -> Blending:
    """That of a blend, one of gauss2svg.scene.scene.BLENDS."""
    return _ADD if blend == ADD else _OVER
