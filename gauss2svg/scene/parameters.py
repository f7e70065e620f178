"""The parameters of a shape, declared once.

Scenes (validation, selection, concatenation, scaling, saved files) and fits (raw values,
activation, learning rates, Adam's columns, rows that come and go) follow this table. A new
parameter is one record here, one field of gauss2svg.scene.scene.Scene and, if a fit steps it, one
of gauss2svg.fit.state.State. Renderers, writer and reader say for themselves what they draw of it:
docs/development.md has the recipe.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene import ADD
from gauss2svg.scene.falloff import LEAST_BETA, MOST_BETA

# The largest absolute value of a signed colour: larger ones drown in the rounding of renderers.
MOST_SIGNED = 100.0
# The largest float below 1, at which sqrt((1 - rho)(1 + rho)) is still 1.5e-8.
RHO_LIMIT = math.nextafter(1, 0)
# px. A thinner Gaussian is invisible, as pixels are sampled at their centres. Up to the other ends
# float64 renderers and float32 gradients stay finite, with a factor of 1000 left for scaling.
LEAST_SIGMA, MOST_SIGMA = 1e-9, 1e9
MOST_MEAN = 1e12

# How a file draws a shape: by the stops of a gradient, or by a plain ellipse where that looks the
# same; by a plain ellipse in any case; as a blurred disc.
SOFT, PLAIN, BLURRED = range(3)
BLUR_BETAS = (
    1.01147233778, 1.14528662352, 1.36563435691, 1.74340697660, 2.60683835486, 4.31967523876,
    6.64289524310,
)  # fmt: skip
BLUR_TOLERANCE = 1e-6  # of the ratio: no exponent of a gradient is as near to one of a blur

# Logits: opacities from 0.0003 to 0.999994, beyond which an 8-bit image shows no change.
LEAST_RAW_OPACITY, MOST_RAW_OPACITY = -8.0, 12.0
# ln beta of a shape that is a Gaussian for now: at exactly 0 the kernels leave out what the
# gradient of the exponent needs, and less ends worse (docs/decisions/adam.md). The most is that of
# fits; files have cruder ones.
LEAST_RAW_BETA, MOST_RAW_BETA = 1e-6, math.log(128.0)

_Values = NDArray[Any]


@dataclass(frozen=True)
class Raw:
    """How a fit holds a parameter that it steps number by number, besides the geometry.

    name         of the raw array in gauss2svg.fit.state.State
    activated    from raw values to those of a scene
    inverse      from those of a scene to raw values
    least, most  bounds of the raw values
    first        raw value of a new shape whose placement gives none
    """

    name: str
    activated: Callable[[_Values], _Values]
    inverse: Callable[[_Values], _Values]
    least: float
    most: float
    first: float = 0.0


@dataclass(frozen=True)
class Parameter:
    """One parameter of every shape.

    name         of its array in a scene
    width        numbers for each shape: the array is (n,) for 1, else (n, width)
    least, most  its domain; `added` is that of additive scenes, where it is another
    default      of a scene that does not give it; None: it must be given
    dtype        of its array in a scene
    followed     how values change with a canvas whose sides are multiplied by scale (2,), a factor
                 below 0 mirroring it; None: not at all
    raw          how a fit holds it; None: with the geometry, or unchanged
    rate         learning rate in the frame of gauss2svg.fit.adam; 0: it is not stepped
    shared       whether the shapes of a file share its values by their gradients: a fit's last
                 steps keep those of the file
    advice       for values out of the domain
    """

    name: str
    width: int
    least: float
    most: float
    added: tuple[float, float] | None = None
    default: float | None = None
    dtype: type[np.generic] = np.float64
    followed: Callable[[_Values, NDArray[np.float64]], _Values] | None = None
    raw: Raw | None = None
    rate: float = 0.0
    shared: bool = False
    advice: str = "to clip it"

    def domain(self, blend: str) -> tuple[float, float]:
        """Least and largest value of the parameter in scenes of a blend."""
        return self.added if blend == ADD and self.added else (self.least, self.most)

    def shape(self, count: int) -> tuple[int, ...]:
        """Shape of the parameter's array for so many Gaussians."""
        return (count,) if self.width == 1 else (count, self.width)


def logistic(logit: _Values) -> _Values:
    """Opacities in 0..1 of logits; any shape."""
    return 1 / (1 + np.exp(-logit))


def logit(opacity: _Values) -> _Values:
    """The inverse of `logistic`."""
    return np.log(opacity / (1 - opacity))


def _as_it_is(values: _Values) -> _Values:
    return values


# Rates are those of the ablations in docs/decisions/fit.md. mean and sigma are stepped in shares of
# the shape's own sigma, rho as the shear of its frame, opacity as a logit, beta as a logarithm.
PARAMETERS = (
    Parameter(
        "mean", 2, -MOST_MEAN, MOST_MEAN, rate=0.3,
        followed=lambda values, scale: values * scale,
        advice="to drop what lies so far off, or to scale the scene down",
    ),
    Parameter(
        "sigma", 2, LEAST_SIGMA, MOST_SIGMA, rate=0.15,
        followed=lambda values, scale: values * np.abs(scale),
        advice="to clip it, to scale the scene, or to drop the Gaussian",
    ),
    Parameter(
        "rho", 1, -RHO_LIMIT, RHO_LIMIT, rate=0.15,
        followed=lambda values, scale: values * np.sign(scale[0] * scale[1]),
        advice="to clip it to RHO_LIMIT",
    ),
    Parameter(
        "opacity", 1, 0.0, 1.0, added=(1.0, 1.0), rate=0.15,
        raw=Raw("raw_opacity", logistic, logit, LEAST_RAW_OPACITY, MOST_RAW_OPACITY),
        advice="to clip it, and in an additive scene to multiply the colour by it",
    ),
    Parameter(
        "color", 3, 0.0, 1.0, added=(-MOST_SIGNED, MOST_SIGNED), rate=0.045, shared=True,
        raw=Raw("color", _as_it_is, _as_it_is, 0.0, 1.0),
    ),
    Parameter(
        "beta", 1, LEAST_BETA, MOST_BETA, added=(1.0, 1.0), default=1.0, rate=0.05,
        raw=Raw("raw_beta", np.exp, np.log, LEAST_RAW_BETA, MOST_RAW_BETA), shared=True,
    ),
    Parameter(
        "round_index", 1, 0, math.inf, default=0, dtype=np.int32,
        advice="to number the rounds from 0",
    ),
    Parameter("drawn", 1, SOFT, BLURRED, added=(SOFT, SOFT), default=SOFT, dtype=np.int8),
)  # fmt: skip

# The parameters that Adam steps number by number, in the order of its columns behind those of the
# geometry, each with how a fit holds it.
STEPPED = tuple((parameter, parameter.raw) for parameter in PARAMETERS if parameter.raw)
