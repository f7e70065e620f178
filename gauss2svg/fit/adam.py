"""Adam steps in each Gaussian's own frame, and a guard against steps that are too large.

Mean and shape are stepped in whitened coordinates, x = mean + L z, where L is the Cholesky factor
of the covariance:

    mean <- mean + L t,    L <- cholesky of L exp(2 A) L^T,  A symmetric,

so that a step means the same for a large, a small and a thin Gaussian. The kernels return moments m
of h (gauss2svg.render.kernels), from which the gradients follow:

    dL/dt = (m1, m2),  dL/dA11 = m11,  dL/dA12 = 2 m12,  dL/dA22 = m22,
    dL/d(logit opacity) = (sum dL/dalpha alpha) (1 - opacity),  dL/dcolor = sum w g,
    dL/d(ln beta) = -beta sum dL/dalpha alpha' t ln s.

Sizes, ratios and exponents are stepped as logarithms, and opacities as logits. rho follows from L,
and no step can make the covariance indefinite. The rim of a crisp shape is about sigma / beta wide,
so steps of mean and shape are multiplied by beta^-0.35. Without this factor, drawings with plain
ellipses diverge (docs/decisions/divergence.md). Colours are clipped to 0..1. A colour at a bound
moves again with the first step that points inward. Colours as logits would be no better, because
the gradient of a logit vanishes at the bounds (docs/decisions/adam.md).

If a fit diverges, the guard takes it back to its best state. The fit then continues in smaller
steps. Detailed photos do not need the guard. Smooth images and images of few pixels do, because in
them a single step can undo nearly all progress (docs/decisions/divergence.md).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit import FitOptions
from gauss2svg.fit.state import COLUMNS, FARTHEST, GEOMETRY, STEPS, State
from gauss2svg.render.cpu import Splats
from gauss2svg.scene import ADD
from gauss2svg.scene.falloff import RIM_WIDTH
from gauss2svg.scene.scene import PARAMETERS, STEPPED

_Column = NDArray[np.float64]  # (n,), one number for each Gaussian

# Learning rates by name of the parameter. Units are the Gaussian's own sigma for mean and sigma,
# logits for opacity, and 0..1 for colour. A parameter of rate 0 is not stepped.
Rates = Mapping[str, float]
RATES: Rates = {parameter.name: parameter.rate for parameter in PARAMETERS if parameter.rate}

FIRST_DECAY = 0.9  # decay of Adam's first moment (docs/decisions/adam.md)
SECOND_DECAY = 0.95  # decay of Adam's second moment (docs/decisions/adam.md)
# Steps of mean and shape are multiplied by beta to this power, because the rim of a crisp shape is
# narrow (docs/decisions/divergence.md).
STEP_BY_BETA = -0.35
# Largest ratio of major to minor axis. Thinner needles streak across flat areas
# (docs/decisions/fit.md).
MOST_ASPECT = 30.0
# px of the working image, least distance along the minor axis in which a rim falls from 0.9 to 0.1.
# Renderers differ in how they sample sharper rims (docs/decisions/fit.md).
LEAST_RIM = 0.5

# px, least semi-axis. Below 0.3 px every renderer draws too little (docs/decisions/renderers.md).
LEAST_SIGMA = 0.35
# Opacity logit of opaque and additive Gaussians, an opacity of nearly 1. It is not stepped.
OPAQUE_LOGIT = 12.0
# docs/decisions/fit.md has the figures for the next three constants.
INITIAL_OPACITY_LOGIT = 1.0  # logit of the opacity of a new alpha-composited Gaussian
SIGNED_COLOR_RATE = 0.025  # learning rate of signed colours
MOST_SIGNED_COLOR = 0.5  # largest absolute value of a channel of a signed colour in the fit


@dataclass(frozen=True)
class Blending:
    """Learning rates, bounds and initial values of the shapes of a fit.

    rates                    learning rates by parameter
    initial_opacity_logit    logit of a new Gaussian's opacity
    least_color, most_color  bounds of each colour channel. Those of signed colours are narrow,
                             because a file holds partial sums in 8 bits
    """

    rates: Rates
    initial_opacity_logit: float
    least_color: float = 0.0
    most_color: float = 1.0

    def without(self, *names: str) -> Blending:
        """Return these settings with rates of 0 for some parameters."""
        return dataclasses.replace(self, rates={**self.rates, **dict.fromkeys(names, 0.0)})

    @cached_property
    def sharing(self) -> Blending:
        """Settings with rates of 0 for shared parameters. SharedColors steps colours instead."""
        return self.without(*(p.name for p in PARAMETERS if p.shared))


def blending_of(options: FitOptions, opaque: bool = False) -> Blending:
    """Return the settings of a fit with these options; opaque: whether all opacities stay 1."""
    if options.blend == ADD:
        rates = {**RATES, "opacity": 0.0, "color": SIGNED_COLOR_RATE}
        most = MOST_SIGNED_COLOR
        blending = Blending(rates, OPAQUE_LOGIT, -most, most)
    else:
        blending = Blending(RATES, INITIAL_OPACITY_LOGIT)
    if opaque or options.inks is not None:
        blending = dataclasses.replace(blending, initial_opacity_logit=OPAQUE_LOGIT)
        blending = blending.without("opacity")
    if options.inks is not None:
        blending = blending.without("color")
    return blending if options.learned_falloff else blending.without("beta")


# Added to the root of Adam's second moment before the bias correction, so that a step is finite
# even if the gradient has always been 0.
EPSILON = 1e-12
# Number of Gaussians that are stepped at a time. Their arrays stay in the cache of the CPU.
_BLOCK = 4096


def gradients(
    moments: NDArray[np.float64], splats: Splats, price: float = 0.0
) -> NDArray[np.float64]:
    """Return the gradients (n, STEPS) of t1, t2, A11, A12, A22, logit opacity, r, g, b, ln beta.

    moments  (n, MOMENTS) from gauss2svg.render.kernels, in the order of the gradients
    price    decrease of the loss that each unit of ln beta must bring. It is added to the gradient
             of ln beta
    """
    gradient = moments.copy()
    gradient[:, COLUMNS["opacity"]] *= 1 - splats.opacity[:, None]
    gradient[:, COLUMNS["beta"]] = (price - splats.beta * moments[:, 9])[:, None]
    gradient[:, 3] *= 2
    return gradient


def step(
    state: State,
    gradient: NDArray[np.float64],
    blending: Blending,
    most_sigma: float,
    rate: float = 1.0,
) -> bool:
    """Take an Adam step with every Gaussian of the state, in place. Return whether all were finite.

    most_sigma  largest major axis, px of the working image
    rate        factor of all learning rates

    A Gaussian whose step would not be finite stays as it is. Its moments and age become 0.
    """
    columns = [*GEOMETRY, *(p.name for p, _ in STEPPED for _ in range(p.width))]
    sizes = rate * np.array([blending.rates[name] for name in columns])
    finite = True
    with np.errstate(all="ignore"):  # _step_block finds numbers that are not finite
        for begin in range(0, len(state), _BLOCK):
            block = slice(begin, begin + _BLOCK)
            finite &= _step_block(state, block, gradient[block], sizes, blending, most_sigma)
    return finite


def _step_block(
    state: State,
    block: slice,
    gradient: NDArray[np.float64],
    sizes: NDArray[np.float64],
    blending: Blending,
    most_sigma: float,
) -> bool:
    adam_m, adam_v, age = state.adam_m[block], state.adam_v[block], state.age[block]
    d = _directions(adam_m, adam_v, age, gradient, sizes)
    mean = state.mean[block]
    rim_factor = np.exp(STEP_BY_BETA * state.raw_beta[block])
    d[:5] = [direction * rim_factor for direction in d[:5]]
    l11, l21, l22 = state.factor[block].T
    x = mean[:, 0] + l11 * d[0]
    y = mean[:, 1] + l21 * d[0] + l22 * d[1]
    l11, l21, l22, minor = _stretched(l11, l21, l22, d[2], d[3], d[4], most_sigma)
    reach = np.abs(x) + np.abs(y) + l11 + np.abs(l21) + l22
    # A sum is finite only if all of its terms are.
    finite = (reach < FARTHEST) & (l22 > 0) & np.isfinite(sum(d[6:], d[5]))
    if not np.isfinite(adam_v.sum()):
        finite &= np.isfinite(adam_v).all(axis=1)

    factor = zip(state.factor[block].T, (l11, l21, l22), strict=True)
    changes = [(mean[:, 0], x), (mean[:, 1], y), *factor]
    for parameter, raw in STEPPED:
        steps = range(*COLUMNS[parameter.name].indices(STEPS))
        if not sizes[steps[0]]:
            continue
        least, most = raw.least, raw.most
        if parameter.name == "color":
            least, most = blending.least_color, blending.most_color
        elif parameter.name == "beta":
            sharpest = np.log(RIM_WIDTH / LEAST_RIM * minor)
            most = np.clip(sharpest, least, most)
        for values, k in zip(np.atleast_2d(getattr(state, raw.name)[block].T), steps, strict=True):
            changes.append((values, np.clip(values + d[k], least, most)))
    if finite.all():
        for values, value in changes:
            values[:] = value
        return True
    for values, value in changes:
        np.copyto(values, value, where=finite)
    adam_m[~finite], adam_v[~finite], age[~finite] = 0, 0, 0
    return False


def _directions(
    adam_m: NDArray[np.float64],
    adam_v: NDArray[np.float64],
    age: _Column,
    gradient: NDArray[np.float64],
    sizes: NDArray[np.float64],
) -> list[_Column]:
    """Return Adam's step for each column of the gradient. Update moments and ages in place.

    One factor for each Gaussian corrects the bias of both moments, as "Adam: A Method for
    Stochastic Optimization" (Kingma and Ba, 2015) suggests at the end of its section 2.
    """
    first_decay, second_decay = FIRST_DECAY, SECOND_DECAY
    age += 1
    scratch = (1 - first_decay) * gradient
    adam_m *= first_decay
    adam_m += scratch
    np.multiply(gradient, gradient, out=scratch)
    scratch *= 1 - second_decay
    adam_v *= second_decay
    adam_v += scratch
    np.sqrt(adam_v, out=scratch)
    scratch += EPSILON
    np.divide(adam_m, scratch, out=scratch)
    unbiased = -np.sqrt(1 - second_decay**age) / (1 - first_decay**age)
    return [size * unbiased * column for size, column in zip(sizes, scratch.T, strict=True)]


def _stretched(
    l11: _Column, l21: _Column, l22: _Column, a: _Column, c: _Column, b: _Column, most_sigma: float
) -> tuple[_Column, _Column, _Column, _Column]:
    """Return l11, l21, l22 and minor axis of L exp(A), A = [[a, c], [c, b]], with axes clipped."""
    # e is exp(A) to second order, and F = L e. F F^T is a covariance however large the error is.
    e11 = 1 + a + 0.5 * (a * a + c * c)
    e12 = c + 0.5 * c * (a + b)
    e22 = 1 + b + 0.5 * (b * b + c * c)
    f11, f12 = l11 * e11, l11 * e12
    f21, f22 = l21 * e11 + l22 * e12, l21 * e12 + l22 * e22
    xx = f11 * f11 + f12 * f12
    xy = f11 * f21 + f12 * f22
    yy = f21 * f21 + f22 * f22
    # the singular values of F follow from their sum and difference, which is stable
    axis_sum = np.sqrt(np.square(f11 + f22) + np.square(f21 - f12))
    axis_difference = np.sqrt(np.square(f11 - f22) + np.square(f21 + f12))
    major, minor = 0.5 * (axis_sum + axis_difference), 0.5 * np.abs(axis_sum - axis_difference)
    new_minor = np.clip(minor, LEAST_SIGMA, most_sigma)
    new_major = np.clip(major, LEAST_SIGMA, most_sigma)
    new_major = np.minimum(new_major, MOST_ASPECT * new_minor)
    at = np.flatnonzero((new_minor != minor) | (new_major != major))
    if at.size > 0:
        angle = 0.5 * np.arctan2(2 * xy[at], xx[at] - yy[at])
        co, si = np.cos(angle), np.sin(angle)
        p, q = np.square(new_major[at]), np.square(new_minor[at])
        xx[at] = co * co * p + si * si * q
        xy[at] = co * si * (p - q)
        yy[at] = si * si * p + co * co * q
    root = np.sqrt(xx)
    l22 = np.sqrt(np.maximum(xx * yy - xy * xy, 0)) / root
    return root, xy / root, l22, new_minor


# Losses that count as diverged (docs/decisions/divergence.md).
NEGLIGIBLE = 1e-5  # mean squared error (50 dB) under which no step counts as diverged
# multiple of the least loss since a change, relocation or rollback above which a loss has diverged
DIVERGED = 2.0
STALLED = 1.5  # multiple of the least loss above which a loss has stalled
STALLED_STEPS = 25  # steps after the least loss from which on a stalled loss has diverged
WORSE_AT_END = 1.2  # multiple of the least loss above which the last loss of a stage has diverged
# Learning rates after a rollback (docs/decisions/divergence.md). The rate grows up to a ceiling.
CEILING_SHARE = 0.5  # new ceiling, as a share of the rate that diverged
CEILING_SHARE_AGAIN = 0.1  # CEILING_SHARE if the fit diverges again within AGAIN steps
AGAIN = 3  # number of steps since a rollback below which a fit diverges "again"
# Share of the ceiling with which the rate begins after a rollback. It grows to the ceiling, so one
# bad step among many good ones costs little.
LOWERED = 0.5
GROWTH = 1.1  # factor by which each step raises the rate, up to the ceiling
GENTLE = 0.25  # share of the ceiling with which a finished fit continues

_Backup = TypeVar("_Backup")


class DivergenceGuard(Generic[_Backup]):
    """A guard against divergence. It keeps a fit's best state, and lowers its learning rate.

    learning_rate  FitOptions.learning_rate
    rate           present factor of learning_rate, up to 1
    rollbacks      number of rollbacks
    best           state of least loss since the last reset; None before the first step
    least          loss of that state
    """

    def __init__(self, learning_rate: float = 1.0) -> None:
        self._usual = min(1 / learning_rate, 1.0)  # rate at which steps have their default size
        self.rate = self._ceiling = 1.0
        self.rollbacks = 0
        self._steps_since_rollback = 0
        self.reset()

    def reset(self) -> None:
        """Forget the best state after a change of the problem, and raise the rate's ceiling."""
        self._ceiling = max(self._ceiling, min(self._ceiling / CEILING_SHARE, self._usual))
        self.best: _Backup | None = None
        self.least = self._recent_least = math.inf
        self._steps_since_best = 0

    def begin_gently(self) -> None:
        """Lower the rate, which grows again. Full steps would undo a nearly exact drawing."""
        self.rate = min(self.rate, GENTLE * self._ceiling)

    def allow_rise(self) -> None:
        """Forget the recent least loss, because a relocation may raise the loss."""
        self._recent_least = math.inf

    def accepts(self, loss: float, error: float, backup: Callable[[], _Backup]) -> bool:
        """Return whether a fit with this loss and mean squared error has not diverged.

        If so, raise the rate, and keep the copy from backup() if the state is the best one.
        """
        if not math.isfinite(loss):
            return False
        self._steps_since_best += 1
        self._steps_since_rollback += 1
        stalled = loss > STALLED * self.least and self._steps_since_best > STALLED_STEPS
        if error > NEGLIGIBLE and (loss > DIVERGED * self._recent_least or stalled):
            return False
        self._recent_least = min(self._recent_least, loss)
        self.rate = min(self.rate * GROWTH, self._ceiling)
        if loss < self.least:
            self.best, self.least, self._steps_since_best = backup(), loss, 0
        return True

    def ends_worse(self, loss: float, tolerant: bool) -> bool:
        """Return whether a stage that ends at this loss should return to its best state.

        tolerant: whether a loss up to WORSE_AT_END times the least one is accepted.
        A larger loss counts as a rollback if learning_rate is above 1 or there was one before.
        """
        diverged = not loss <= WORSE_AT_END * self.least
        if diverged and (self._usual < 1 or self.rollbacks > 0):
            self.roll_back()
        if tolerant:
            return diverged
        return not loss <= self.least * (1 + 1e-6)  # sums in another order differ by rounding

    def roll_back(self) -> None:
        """Count a rollback, and lower the rate and its ceiling."""
        self.rollbacks += 1
        again = self._steps_since_rollback < AGAIN
        share = CEILING_SHARE_AGAIN if again and self.rollbacks > 1 else CEILING_SHARE
        # sqrt: a rate far above the usual one goes half of the way to it, on a logarithmic scale.
        self._ceiling = min(self.rate * share, math.sqrt(self.rate * self._usual))
        self._steps_since_rollback = 0
        self.rate = self._ceiling * LOWERED
        self._recent_least, self._steps_since_best = math.inf, 0
