"""Optimiser settings that differ between alpha compositing and additive blending."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from gauss2svg.fit.adam import RATES, Rates
from gauss2svg.scene import ADD

# An opaque or additive Gaussian has no opacity: its logit stays at one of practically 1.
_OPAQUE_LOGIT = 12.0


@dataclass(frozen=True)
class Blending:
    """Learning rates, bounds and initial values for one of gauss2svg.scene.BLENDS.

    least_color, most_color  of each channel; signed colours are bounded so that a file, whose
                             partial sums must fit into 8 bits, can hold them
    initial_opacity_logit    of a new Gaussian
    initial_sigma            of a new Gaussian, as a share of the mean spacing sqrt(area / (pi n))
    color_from_residual      whether a new Gaussian has the residual's colour or the target's
    """

    additive: bool
    rates: Rates
    least_color: float
    most_color: float
    initial_opacity_logit: float
    initial_sigma: float
    color_from_residual: bool


# All values from the ablations in docs/decisions/fit.md.
_OVER = Blending(False, RATES, 0.0, 1.0, 1.0, 0.3, color_from_residual=False)
_ADD = Blending(
    True, {**RATES, "opacity": 0.0, "color": 0.025}, -0.5, 0.5, _OPAQUE_LOGIT, 0.3,
    color_from_residual=True,
)  # fmt: skip


def in_inks(usual: Blending) -> Blending:
    """The settings where shapes are opaque and keep their colours and exponents."""
    held = dict.fromkeys(("opacity", "color", "beta", "skew"), 0.0)
    rates = {**usual.rates, **held}
    return dataclasses.replace(usual, rates=rates, initial_opacity_logit=_OPAQUE_LOGIT)


def blending(
    blend: str, opaque: bool = False, learned_falloff: bool = True, learned_skew: bool = True
) -> Blending:
    """The settings for a blend, one of gauss2svg.scene.BLENDS.

    opaque           whether all opacities stay 1
    learned_falloff  whether exponents are stepped; else all stay those of Gaussians
    learned_skew     whether skews are stepped; else all stay 0
    """
    found = _ADD if blend == ADD else _OVER
    for name, learned in (("beta", learned_falloff), ("skew", learned_skew)):
        if not learned:
            found = dataclasses.replace(found, rates={**found.rates, name: 0.0})
    if not opaque:
        return found
    rates = {**found.rates, "opacity": 0.0}
    return dataclasses.replace(found, rates=rates, initial_opacity_logit=_OPAQUE_LOGIT)
