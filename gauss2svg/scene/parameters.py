"""The parameters of a scene, declared once.

Scenes (checks, selection, concatenation, scaling, saved files) and fits (raw values, activation,
learning rates, Adam's columns, rows that come and go) follow these tables. A new parameter of
shapes is one record of PARAMETERS, one field of gauss2svg.scene.scene.Scene and, if a fit steps
it, one of gauss2svg.fit.state.State. Renderers, writer and reader say for themselves what they draw
of it: docs/development.md has the recipe.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import SceneError, brief
from gauss2svg.scene import ADD
from gauss2svg.scene.falloff import LEAST_BETA, MOST_BETA

LEAST_CANVAS, MOST_CANVAS = 1e-6, 1e9  # px, of a side
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
    """A parameter of a scene: of every shape, or of its canvas.

    name         of its array in a scene
    width        numbers for each shape: the array is (n,) for 1, else (n, width)
    least, most  its domain; `added` is that of additive scenes, where it is another
    default      of a scene that does not give it; None: it must be given
    dtype        of its array in a scene
    scaled       whether it is in px, and scales with the canvas
    raw          how a fit holds it; None: with the geometry, or unchanged
    rate         learning rate in the frame of gauss2svg.fit.adam; 0: it is not stepped
    shared       whether the shapes of a file share its values by their gradients: a fit's last
                 steps keep those of the file
    advice       for values out of the domain
    once         whether a scene has one, and not one for each shape
    """

    name: str
    width: int
    least: float
    most: float
    added: tuple[float, float] | None = None
    default: float | None = None
    dtype: type[np.generic] = np.float64
    scaled: bool = False
    raw: Raw | None = None
    rate: float = 0.0
    shared: bool = False
    advice: str = "to clip it"
    once: bool = False

    def domain(self, blend: str) -> tuple[float, float]:
        """Return the least and the largest value of the parameter in scenes of a blend."""
        return self.added if blend == ADD and self.added else (self.least, self.most)

    def shape(self, count: int) -> tuple[int, ...]:
        """Return the shape of the parameter's array for `count` Gaussians."""
        each = () if self.width == 1 else (self.width,)
        return each if self.once else (count, *each)

    def checked(self, values: Any, count: int | None, blend: str) -> _Values:
        """Return a read-only copy of `values` of the parameter's dtype, for `count` Gaussians.

        None stands for the default. If `count` is None, any number of Gaussians will do.
        Raise SceneError for values of another shape, or out of the domain.
        """
        low, high = self.domain(blend)
        if values is None:
            size = 0 if self.default is None else count or 0
            values = np.full(self.shape(size), self.default or 0)
        try:
            values = np.ma.filled(np.asanyarray(values), np.nan)  # masked values are none
            array = values.astype(np.float64, "C", "same_kind", subok=False)
        except Exception as error:  # NumPy's, and that of a tensor that requires grad
            raise SceneError(f"scene {self.name} must be numbers; got {brief(error)}") from None
        shape = self.shape(len(np.atleast_1d(array)) if count is None else count)
        if array.shape != shape:
            raise SceneError(f"scene {self.name} must be of shape {shape}; got {array.shape}")
        whole = np.issubdtype(self.dtype, np.integer)
        bad = ~((array >= low) & (array <= high)) | (whole & (array != np.rint(array)))
        if bad.any():
            at = tuple(int(i) for i in np.argwhere(bad)[0])
            raise SceneError(
                f"scene {self.name}{list(at) or ''} must be finite{' and whole' * whole} and in "
                f"{low:.16g}..{high:.16g}{' in an additive scene' * (blend == ADD)}; got "
                f"{array[at]!s}. Try {self.advice}"
            )
        array = array.astype(self.dtype, copy=False)
        array.flags.writeable = False
        return array


_OF_COLORS = "to clip it, or to divide by 255 what is in 8 bits"
_OF_SIDES = "to scale the scene"
# What a scene has once.
CANVAS = (
    Parameter("width", 1, LEAST_CANVAS, MOST_CANVAS, advice=_OF_SIDES, scaled=True, once=True),
    Parameter("height", 1, LEAST_CANVAS, MOST_CANVAS, advice=_OF_SIDES, scaled=True, once=True),
    Parameter("background", 3, 0.0, 1.0, default=1.0, advice=_OF_COLORS, once=True),
)
# Rates are those of the ablations in docs/decisions/fit.md. mean and sigma are stepped in shares of
# the shape's own sigma, rho as the shear of its frame, opacity as a logit, beta as a logarithm.
PARAMETERS = (
    Parameter(
        "mean", 2, -MOST_MEAN, MOST_MEAN, rate=0.3, scaled=True,
        advice="to drop what lies so far off, or to scale the scene down",
    ),
    Parameter(
        "sigma", 2, LEAST_SIGMA, MOST_SIGMA, rate=0.15, scaled=True,
        advice="to clip it, to scale the scene, or to drop the Gaussian",
    ),
    Parameter("rho", 1, -RHO_LIMIT, RHO_LIMIT, rate=0.15, advice="to clip it to RHO_LIMIT"),
    Parameter(
        "opacity", 1, 0.0, 1.0, added=(1.0, 1.0), rate=0.15,
        raw=Raw(
            "raw_opacity", lambda logit: 1 / (1 + np.exp(-logit)), lambda p: np.log(p / (1 - p)),
            LEAST_RAW_OPACITY, MOST_RAW_OPACITY,
        ),
        advice="to clip it, and in an additive scene to multiply the colour by it",
    ),
    Parameter(
        "color", 3, 0.0, 1.0, added=(-MOST_SIGNED, MOST_SIGNED), rate=0.045, shared=True,
        advice=_OF_COLORS, raw=Raw("color", np.asarray, np.asarray, 0.0, 1.0),
    ),
    Parameter(
        "beta", 1, LEAST_BETA, MOST_BETA, added=(1.0, 1.0), default=1.0, rate=0.05,
        raw=Raw("raw_beta", np.exp, np.log, LEAST_RAW_BETA, MOST_RAW_BETA), shared=True,
    ),
    Parameter("round_index", 1, 0, 2**31 - 1, default=0, dtype=np.int32, advice="to count from 0"),
    Parameter("drawn", 1, SOFT, BLURRED, added=(SOFT, SOFT), default=SOFT, dtype=np.int8),
)  # fmt: skip

# The parameters that Adam steps number by number, in the order of its columns behind those of the
# geometry, each with how a fit holds it.
STEPPED = tuple((parameter, parameter.raw) for parameter in PARAMETERS if parameter.raw)
