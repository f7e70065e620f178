"""Optimiser settings that differ between alpha compositing and additive blending."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from gauss2svg.fit.adam import RATES, Rates
from gauss2svg.scene import ADD

# An opaque or additive Gaussian has no opacity: its logit stays at one of practically 1.
OPAQUE_LOGIT = 12.0


# Start of new Gaussians, and bounds of additive blending (docs/decisions/fit.md).
INITIAL_OPACITY_LOGIT = 1.0  # logit of the opacity of a new alpha-composited Gaussian
INITIAL_SIGMA = 0.3  # sigma of a new Gaussian, as a share of the mean spacing
SIGNED_COLOR_RATE = 0.025  # learning rate of signed colours
MOST_SIGNED_COLOR = 0.5  # largest absolute value of a channel of a signed colour in the fit


@dataclass(frozen=True)
class Blending:
    """Learning rates, bounds and initial values for one of gauss2svg.scene.BLENDS.

    additive                 whether new Gaussians have the residual's colours, not the target's
    least_color, most_color  of each channel; signed colours are bounded so that a file, whose
                             partial sums must fit into 8 bits, can hold them
    initial_opacity_logit    of a new Gaussian
    initial_sigma            of a new Gaussian, as a share of the mean spacing sqrt(area / (pi n))
    """

    additive: bool
    rates: Rates
    least_color: float
    most_color: float
    initial_opacity_logit: float
    initial_sigma: float


def in_inks(usual: Blending) -> Blending:
    """The settings where shapes are opaque and keep their colours and exponents."""
    held = dict.fromkeys(("opacity", "color", "beta"), 0.0)
    rates = {**usual.rates, **held}
    return dataclasses.replace(usual, rates=rates, initial_opacity_logit=OPAQUE_LOGIT)


def blending(blend: str, opaque: bool = False, learned_falloff: bool = True) -> Blending:
    """The settings for a blend, one of gauss2svg.scene.BLENDS.

    opaque           whether all opacities stay 1
    learned_falloff  whether exponents are stepped; else all stay those of Gaussians
    """
    additive = blend == ADD
    rates = dict(RATES)
    if additive:
        rates |= {"opacity": 0.0, "color": SIGNED_COLOR_RATE}
    if opaque:
        rates["opacity"] = 0.0
    if not learned_falloff:
        rates["beta"] = 0.0
    return Blending(
        additive=additive,
        rates=rates,
        least_color=-MOST_SIGNED_COLOR if additive else 0.0,
        most_color=MOST_SIGNED_COLOR if additive else 1.0,
        initial_opacity_logit=(OPAQUE_LOGIT if additive or opaque else INITIAL_OPACITY_LOGIT),
        initial_sigma=INITIAL_SIGMA,
    )
