"""The parameters of a scene, declared once.

Scenes read from these tables what they check, select, concatenate, scale and save. Fits read raw
values, activations, learning rates and Adam's columns. A new parameter of shapes is a record of
PARAMETERS and a field of gauss2svg.scene.scene.Scene, and also of gauss2svg.fit.state.State if a
fit steps it. Renderers, writers and readers name what they use (docs/development.md).
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

LEAST_CANVAS, MOST_CANVAS = 1e-6, 1e9  # px, bounds of a side
# Largest absolute value of a signed colour. Larger ones are lost to the rounding of renderers.
MOST_SIGNED = 100.0
# The largest float below 1, at which sqrt((1 - rho)(1 + rho)) is still 1.5e-8.
RHO_LIMIT = math.nextafter(1, 0)
# px, bounds of sigma and of the mean. A thinner Gaussian is invisible, because pixels are sampled
# at their centres. Float64 renders and float32 gradients are finite up to 1000 times the upper
# bounds.
LEAST_SIGMA, MOST_SIGMA = 1e-9, 1e9
MOST_MEAN = 1e12

# Ways in which a file draws a shape. SOFT: by a gradient, or by a plain ellipse if that looks the
# same. PLAIN: always by a plain ellipse. BLURRED: as a blurred disc.
SOFT, PLAIN, BLURRED = range(3)

# Logits of opacities 0.0003 and 0.999994. An 8-bit image shows no change beyond them.
LEAST_RAW_OPACITY, MOST_RAW_OPACITY = -8.0, 12.0
# Bounds of ln beta in a fit. The lower one stands for a Gaussian: at exactly 0 the kernels leave
# out the gradient of the exponent, and a smaller one ends worse (docs/decisions/adam.md).
LEAST_RAW_BETA, MOST_RAW_BETA = 1e-6, math.log(128.0)

_Values = NDArray[Any]


@dataclass(frozen=True)
class Raw:
    """The raw form of a parameter that a fit steps number by number, unlike the geometry.

    name         field of gauss2svg.fit.state.State with the raw values
    activated    maps raw values to those of a scene
    inverse      maps values of a scene to raw ones
    least, most  bounds of the raw values
    first        raw value of a new shape if its placement gives none
    """

    name: str
    activated: Callable[[_Values], _Values]
    inverse: Callable[[_Values], _Values]
    least: float
    most: float
    first: float = 0.0


@dataclass(frozen=True)
class Parameter:
    """A parameter of each shape of a scene, or of its canvas.

    name             field of the scene with its array
    width            numbers for each shape: the array is (n,) for 1, else (n, width)
    least, most      domain of its values
    additive_domain  least and largest value in additive scenes, if they differ
    default          value in a scene that does not give it; None if it must be given
    dtype            type of its array in a scene
    scaled           whether it is in px, and scales with the canvas
    raw              raw form in a fit; None if it belongs to the geometry or never changes
    rate             learning rate in the frame of gauss2svg.fit.adam; 0 if it is not stepped
    shared           whether shapes of a file share its values by their gradients, so that a fit's
                     last steps keep the values of the file
    advice           what to try with values out of the domain
    once             whether a scene has one value, not one for each shape
    """

    name: str
    width: int
    least: float
    most: float
    additive_domain: tuple[float, float] | None = None
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
        domain = self.additive_domain if blend == ADD else None
        return domain or (self.least, self.most)

    def shape(self, count: int) -> tuple[int, ...]:
        """Return the shape of the parameter's array for `count` Gaussians."""
        each = () if self.width == 1 else (self.width,)
        return each if self.once else (count, *each)

    def checked(self, values: Any, count: int | None, blend: str) -> _Values:
        """Return a read-only copy of `values` of the parameter's dtype, for `count` Gaussians.

        None stands for the default. Any number of Gaussians is accepted if `count` is None.
        Raise SceneError if values have another shape or leave the domain.
        """
        low, high = self.domain(blend)
        if values is None:
            size = 0 if self.default is None else count or 0
            values = np.full(self.shape(size), self.default or 0)
        try:
            values = np.ma.filled(np.asanyarray(values), np.nan)  # NaN is refused below
            array = values.astype(np.float64, "C", "same_kind", subok=False)
        except Exception as error:  # NumPy's errors, and torch's for a tensor with requires_grad
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


_COLOR_ADVICE = "to clip it, or to divide by 255 what is in 8 bits"
_SIDE_ADVICE = "to scale the scene"
# Parameters that a scene has once.
CANVAS = (
    Parameter("width", 1, LEAST_CANVAS, MOST_CANVAS, advice=_SIDE_ADVICE, scaled=True, once=True),
    Parameter("height", 1, LEAST_CANVAS, MOST_CANVAS, advice=_SIDE_ADVICE, scaled=True, once=True),
    Parameter("background", 3, 0.0, 1.0, default=1.0, advice=_COLOR_ADVICE, once=True),
)
# Parameters of each shape. Learning rates come from the ablations of docs/decisions/fit.md. A fit
# steps mean and sigma in shares of the shape's own sigma, rho as the shear of its frame, opacity as
# a logit, and beta as a logarithm.
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
        "opacity", 1, 0.0, 1.0, additive_domain=(1.0, 1.0), rate=0.15,
        raw=Raw(
            "raw_opacity", lambda logit: 1 / (1 + np.exp(-logit)), lambda p: np.log(p / (1 - p)),
            LEAST_RAW_OPACITY, MOST_RAW_OPACITY,
        ),
        advice="to clip it, and in an additive scene to multiply the colour by it",
    ),
    Parameter(
        "color", 3, 0.0, 1.0, additive_domain=(-MOST_SIGNED, MOST_SIGNED), rate=0.045, shared=True,
        advice=_COLOR_ADVICE, raw=Raw("color", np.asarray, np.asarray, 0.0, 1.0),
    ),
    Parameter(
        "beta", 1, LEAST_BETA, MOST_BETA, additive_domain=(1.0, 1.0), default=1.0, rate=0.05,
        raw=Raw("raw_beta", np.exp, np.log, LEAST_RAW_BETA, MOST_RAW_BETA), shared=True,
    ),
    Parameter("round_index", 1, 0, 2**31 - 1, default=0, dtype=np.int32, advice="to count from 0"),
    Parameter("drawn", 1, SOFT, BLURRED, additive_domain=(SOFT, SOFT), default=SOFT, dtype=np.int8),
)  # fmt: skip

# Parameters that Adam steps number by number, with their raw forms. Adam's columns have this order,
# after those of the geometry.
STEPPED = tuple((parameter, parameter.raw) for parameter in PARAMETERS if parameter.raw)
