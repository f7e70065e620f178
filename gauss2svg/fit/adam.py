"""One Adam step in each Gaussian's own frame.

The shape is stepped in whitened coordinates, x = mean + L z with L the Cholesky
factor of the covariance:

    mean <- mean + L t,    L <- cholesky of L exp(2 A) L^T,  A symmetric,

so that a step means the same for a large, a small and a thin Gaussian. With the
kernels' moments m of h (gauss2svg.render.kernels) the gradients are

    dL/dt = (m1, m2),  dL/dA11 = m11,  dL/dA12 = 2 m12,  dL/dA22 = m22,
    dL/d(logit opacity) = (sum dL/dalpha alpha) (1 - opacity),  dL/dcolor = sum w g,
    dL/d(ln beta) = -beta sum dL/dalpha alpha' t ln s.

Sizes, ratios and exponents are stepped as logarithms, opacities as logits, and rho follows from L,
which no step can make indefinite. What is still bounded, such as colours by 0..1, is put back onto
its bound after the step: the gradient there is the picture's own, and the first one that points
inward moves it. Colours as logits, whose gradient dies at the bounds, end at 30.16, 21.76, 31.38,
40.25 and 28.65 dB where these end at 30.27, 21.80, 31.35, 40.27 and 28.62 (Kodak 04, 08 and 20,
logo, page; 1000 shapes, 120 iterations).
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from gauss2svg.fit.state import FARTHEST, PARAMETERS, State
from gauss2svg.scene.falloff import RIM_WIDTH


@dataclass(frozen=True)
class Rates:
    """Step sizes of one unit of Adam, in the frame above.

    shift and stretch are shares of the Gaussian's own sigma; opacity is in logits,
    color in 0..1.
    """

    shift: float = 0.3
    stretch: float = 0.15
    shear: float = 0.15
    opacity: float = 0.15
    color: float = 0.045
    beta: float = 0.05


@dataclass(frozen=True)
class Limits:
    """Shapes and opacities that renderers draw well.

    least_sigma   px of the working image; the minor axis never gets thinner
    most_sigma    px of the working image
    most_aspect   major over minor axis: thinner needles streak across flat areas
    most_beta     exponent of the falloff; the least is 1: with 0.9 or 0.75 for the least,
                  three Kodak photos lose 0.04 or 0.07 dB at 5000 shapes
    least_rim     px of the working image in which a rim across the minor axis falls from
                  0.9 to 0.1: sharper ones are not sampled alike by renderers
    least_color, most_color  of each channel
    """

    least_sigma: float
    most_sigma: float
    most_aspect: float = 30.0
    most_beta: float = 128.0
    least_rim: float = 0.5
    least_color: float = 0.0
    most_color: float = 1.0


FIRST_DECAY, SECOND_DECAY = 0.9, 0.95
# ln beta of a shape that is a Gaussian for now: with 0 it would be one for good.
LEAST_RAW_BETA = 1e-6


def gradients(
    moments: NDArray[np.float64],
    opacity: NDArray[np.float64],
    beta: NDArray[np.float64],
    price: float = 0.0,
) -> NDArray[np.float64]:
    """(n, PARAMETERS) gradients of t1, t2, A11, A12, A22, logit opacity, r, g, b, ln beta.

    price is added to the last: what the loss must gain for each unit of ln beta.
    """
    gradient = moments.copy()
    gradient[:, 3] *= 2
    gradient[:, 5] *= 1 - opacity
    gradient[:, 9] = price - beta * gradient[:, 9]
    return gradient


def step(
    state: State, gradient: NDArray[np.float64], rates: Rates, limits: Limits, rate: float
) -> bool:
    """Move every Gaussian of the state by one Adam step, in place; whether all stayed finite.

    One whose step would make a parameter infinite or no number stays where it is, and forgets.
    """
    sizes = np.array(
        [rates.shift] * 2 + [rates.stretch, rates.shear, rates.stretch, rates.opacity]
        + [rates.color] * 3 + [rates.beta]
    )  # fmt: skip
    bounds = np.array([
        limits.least_sigma, limits.most_sigma, limits.most_aspect,
        math.log(limits.most_beta), RIM_WIDTH / limits.least_rim,
        limits.least_color, limits.most_color,
    ])  # fmt: skip
    return _step(
        state.mean, state.factor, state.raw_opacity, state.color, state.raw_beta,
        state.first, state.second, state.age, gradient, rate * sizes, bounds,
    ) == 0  # fmt: skip


@njit(parallel=True, cache=True)
def _step(mean, factor, raw_opacity, color, raw_beta, first, second, age, gradient, sizes, bounds):
    least, most, aspect, sharpest, rim, darkest, brightest = bounds
    lost = 0
    for i in prange(mean.shape[0]):
        age[i] += 1
        correct1 = 1 - FIRST_DECAY ** age[i]
        correct2 = 1 - SECOND_DECAY ** age[i]
        d = np.empty(PARAMETERS)
        for k in range(PARAMETERS):
            g = gradient[i, k]
            first[i, k] = FIRST_DECAY * first[i, k] + (1 - FIRST_DECAY) * g
            second[i, k] = SECOND_DECAY * second[i, k] + (1 - SECOND_DECAY) * g * g
            d[k] = -sizes[k] * (first[i, k] / correct1)
            d[k] /= np.sqrt(second[i, k] / correct2) + 1e-12
        l11, l21, l22 = factor[i, 0], factor[i, 1], factor[i, 2]
        mx = mean[i, 0] + l11 * d[0]
        my = mean[i, 1] + l21 * d[0] + l22 * d[1]
        # exp(A) to second order; L exp(A) gives a valid covariance whatever the error
        a, c, b = d[2], d[3], d[4]
        e11 = 1 + a + 0.5 * (a * a + c * c)
        e12 = c + 0.5 * c * (a + b)
        e22 = 1 + b + 0.5 * (b * b + c * c)
        f11, f12 = l11 * e11, l11 * e12
        f21, f22 = l21 * e11 + l22 * e12, l21 * e12 + l22 * e22
        xx = f11 * f11 + f12 * f12
        xy = f11 * f21 + f12 * f22
        yy = f21 * f21 + f22 * f22
        # singular values of F, by the stable sum and difference formulas
        far = np.hypot(f11 + f22, f21 - f12)
        near = np.hypot(f11 - f22, f21 + f12)
        major = 0.5 * (far + near)
        minor = 0.5 * abs(far - near)
        new_minor = min(max(minor, least), most)
        new_major = min(max(major, least), most, aspect * new_minor)
        if new_minor != minor or new_major != major:
            half = 0.5 * np.arctan2(2 * xy, xx - yy)
            co, si = np.cos(half), np.sin(half)
            p, q = new_major * new_major, new_minor * new_minor
            xx = co * co * p + si * si * q
            xy = co * si * (p - q)
            yy = si * si * p + co * co * q
        l11 = np.sqrt(xx)
        l22 = np.sqrt(max(xx * yy - xy * xy, 0.0)) / l11
        # One sum is finite only if all of it is; infinite l11 and l22 make xy / l11 no number.
        reach = abs(mx) + abs(my) + l11 + abs(xy / l11) + l22
        known = d[5] + d[6] + d[7] + d[8] + d[9]
        for k in range(PARAMETERS):
            known += second[i, k]
        if not (reach < FARTHEST and l22 > 0 and np.isfinite(known)):
            lost += 1
            age[i] = 0
            for k in range(PARAMETERS):
                first[i, k] = 0.0
                second[i, k] = 0.0
            continue
        mean[i, 0] = mx
        mean[i, 1] = my
        factor[i, 0] = l11
        factor[i, 1] = xy / l11
        factor[i, 2] = l22
        raw_opacity[i] = min(max(raw_opacity[i] + d[5], -8.0), 12.0)
        for k in range(3):
            color[i, k] = min(max(color[i, k] + d[6 + k], darkest), brightest)
        if raw_beta[i] != 0.0 and sizes[9] != 0.0:
            bound = min(max(np.log(rim * new_minor), LEAST_RAW_BETA), sharpest)
            raw_beta[i] = min(max(raw_beta[i] + d[9], LEAST_RAW_BETA), bound)
    return lost
