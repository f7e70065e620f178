"""Adam steps in each Gaussian's own frame, and a guard against steps that are too large.

A step changes the mean and the shape in whitened coordinates z, where x = mean + L z and L is the
Cholesky factor of the covariance:

    mean <- mean + L t,    L <- cholesky of L exp(2 A) L^T,  A symmetric.

A step of a given size thus changes large, small and thin Gaussians equally, relative to their own
size. The kernels return the moments m of a quantity h, which gauss2svg/core/gaussians.h defines.
The gradients follow from these moments:

    dL/dt = (m1, m2),  dL/dA11 = m11,  dL/dA12 = 2 m12,  dL/dA22 = m22,
    dL/d(logit opacity) = (sum dL/dalpha alpha) (1 - opacity),  dL/dcolor = sum w g,
    dL/d(ln beta) = -beta sum dL/dalpha alpha' t ln s.

Steps change the logarithms of sizes, aspect ratios and exponents, and the logits of opacities. rho
follows from L, and no step can make the covariance indefinite. The rim of a crisp shape is only
about sigma / beta wide, so its steps of mean and shape are multiplied by beta^-0.35. Without this
factor, fits of drawings with plain ellipses diverge (docs/decisions/divergence.md). Colours are
clipped to 0..1, and a colour at a bound leaves it with the first step that points inward. Stepping
the logits of colours would be no better, because the gradient of a logit vanishes at the bounds
(docs/decisions/adam.md).

If a fit diverges, the guard takes it back to its best state, and the fit continues in smaller
steps. Detailed photos do not need the guard. Smooth images and images of few pixels do need it,
because in such images a single step can undo nearly all progress (docs/decisions/divergence.md).
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

from gauss2svg.core import Kernel
from gauss2svg.fit import FitOptions
from gauss2svg.fit.state import FARTHEST, GEOMETRY, State
from gauss2svg.render.cpu import Splats
from gauss2svg.scene import ADD
from gauss2svg.scene.falloff import RIM_WIDTH
from gauss2svg.scene.scene import PARAMETERS, STEPPED

# Learning rates by the name of the parameter. The rates of mean and sigma are relative to the
# Gaussian's own sigma. The rate of opacity refers to its logit, and the rate of color to channels
# in 0..1. Adam does not step a parameter whose rate is 0.
Rates = Mapping[str, float]
RATES: Rates = {parameter.name: parameter.rate for parameter in PARAMETERS if parameter.rate}

FIRST_DECAY = 0.9  # decay of Adam's first moment (docs/decisions/adam.md)
SECOND_DECAY = 0.95  # decay of Adam's second moment (docs/decisions/adam.md)
# Steps of mean and shape are multiplied by beta to this power. So crisp shapes take smaller steps,
# as their narrow rims need (docs/decisions/divergence.md).
STEP_BY_BETA = -0.35
# Largest ratio of the major axis to the minor axis. Thinner Gaussians leave visible streaks in flat
# areas (docs/decisions/fit.md).
MOST_ASPECT = 30.0
# Least width of a rim in px of the working image: the distance along the minor axis over which the
# falloff drops from 0.9 to 0.1. Renderers differ in how they draw sharper rims
# (docs/decisions/fit.md).
LEAST_RIM = 0.5

# Least semi-axis in px. Every renderer draws shapes below 0.3 px too faintly
# (docs/decisions/renderers.md).
LEAST_FITTED_SIGMA = 0.35
# The same above areas. Smaller shapes draw what the outlines miss of single pixels, which makes an
# enlarged drawing worse (docs/decisions/areas.md).
LEAST_SIGMA_ABOVE_AREAS = 0.8
# Logit of the opacity of opaque and of additive Gaussians. Adam does not step this logit. The
# opacity that it stands for is nearly 1.
OPAQUE_LOGIT = 12.0
# The values of the next three constants were chosen by measurements (docs/decisions/fit.md).
INITIAL_OPACITY_LOGIT = 1.0  # logit of the opacity of a new alpha-composited Gaussian
SIGNED_COLOR_RATE = 0.025  # learning rate of signed colours
MOST_SIGNED_COLOR = 0.5  # largest absolute value of a channel of a signed colour in the fit


@dataclass(frozen=True)
class Blending:
    """Learning rates, bounds and initial values of the shapes of a fit.

    rates                    learning rates by the name of the parameter
    initial_opacity_logit    logit of a new Gaussian's opacity
    least_color, most_color  bounds of each colour channel. The bounds of signed colours are narrow,
                             because renderers of the file keep partial sums of these colours in 8
                             bits, and large sums would not fit
    """

    rates: Rates
    initial_opacity_logit: float
    least_color: float = 0.0
    most_color: float = 1.0

    def without(self, *names: str) -> Blending:
        """Return these settings, but with a rate of 0 for each parameter named in `names`."""
        return dataclasses.replace(self, rates={**self.rates, **dict.fromkeys(names, 0.0)})

    @cached_property
    def columns(self) -> NDArray[np.float64]:
        """Learning rate, least and largest value (COLUMN_COUNT, 3) of each column of Adam's arrays.

        The columns of mean and shape have no bounds here.
        """
        rows = [(self.rates[name], -math.inf, math.inf) for name in GEOMETRY]
        for parameter, raw in STEPPED:
            bounds = raw.least, raw.most
            if parameter.name == "color":
                bounds = self.least_color, self.most_color
            rows += [(self.rates[parameter.name], *bounds)] * parameter.width
        return np.array(rows)

    @cached_property
    def sharing(self) -> Blending:
        """These settings with a rate of 0 for each parameter whose values several shapes share.

        `step` must not change these parameters: SharedColors steps the colours in its place, and
        the exponents stay fixed.
        """
        return self.without(*(p.name for p in PARAMETERS if p.shared))


def blending_of(options: FitOptions, opaque: bool = False) -> Blending:
    """Return the learning rates, bounds and initial values for a fit with these options.

    opaque: whether all shapes are opaque from the first step to the last.
    """
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


_step_gaussians = Kernel(
    "step_gaussians",
    "int float64 float64 float64 float64 float64 float64 float64 float64 float64 float64 float64"
    " float64 float64 float float64 float float float float",
)


def step(
    state: State,
    moments: NDArray[np.float64],
    splats: Splats,
    blending: Blending,
    most_sigma: float,
    price: float = 0.0,
    rate: float = 1.0,
    least_sigma: float = LEAST_FITTED_SIGMA,
) -> bool:
    """Take an Adam step with every Gaussian of the state, in place.

    Return whether the step of every Gaussian was finite. A Gaussian whose step would not be finite
    stays as it is, but Adam's moments and its age become 0.

    moments     (n, MOMENTS) from gauss2svg.render.cpu, of the state's Gaussians
    splats      the state as the kernels read it
    most_sigma  largest major axis in px of the working image
    price       a step raises ln beta only if this lowers the loss by more than this amount for each
                unit of ln beta
    rate        factor by which all learning rates are multiplied
    least_sigma  least semi-axis in px of the working image
    """
    return bool(_step_gaussians(
        len(state.age), moments, splats.opacity_color, splats.shape, state.mean, state.factor,
        state.raw_opacity, state.color, state.raw_beta, state.adam_m, state.adam_v, state.age,
        blending.columns, np.array([FIRST_DECAY, SECOND_DECAY]), STEP_BY_BETA,
        np.array([least_sigma, most_sigma, MOST_ASPECT]), RIM_WIDTH / LEAST_RIM, FARTHEST, price,
        rate,
    ))  # fmt: skip


# Conditions under which a fit has diverged (docs/decisions/divergence.md).
# No step counts as diverged if the mean squared error is at most this value (50 dB).
NEGLIGIBLE = 1e-5
# A fit has diverged if its loss exceeds this multiple of the recent least loss. This is the least
# loss since the latest of three events: a reset of the guard, a relocation, or a rollback.
DIVERGED = 2.0
# A fit has also diverged if its loss exceeds STALLED times the least loss, and if more than
# STALLED_STEPS steps have passed since it had the least loss.
STALLED = 1.5
STALLED_STEPS = 25
# A stage has diverged at its end if its last loss exceeds this multiple of its least loss.
WORSE_AT_END = 1.2
# Constants for the learning rate after a rollback (docs/decisions/divergence.md). A rollback lowers
# the rate, and also the ceiling up to which the rate can grow again.
CEILING_SHARE = 0.5  # new ceiling, as a share of the rate at which the fit diverged
# This value replaces CEILING_SHARE if the fit diverges again less than AGAIN steps after a
# rollback.
CEILING_SHARE_AGAIN = 0.1
AGAIN = 3
# The rate after a rollback, as a share of the ceiling. From there the rate grows to the ceiling, so
# one bad step among many good ones costs little.
LOWERED = 0.5
GROWTH = 1.1  # factor by which each step raises the rate, up to the ceiling
# If a finished fit or a scene is refined, the rate begins at this share of the ceiling or below it.
GENTLE = 0.25

_Backup = TypeVar("_Backup")


class DivergenceGuard(Generic[_Backup]):
    """A guard that keeps a fit's best state, and lowers the learning rate if the fit diverges.

    learning_rate  FitOptions.learning_rate
    rate           factor, at most 1, by which learning_rate is multiplied at present
    rollbacks      number of rollbacks so far
    best           copy of the state with the least loss since the last reset. It is None until a
                   step after the reset has been accepted
    least          loss of the state `best`
    """

    def __init__(self, learning_rate: float = 1.0) -> None:
        # With this rate, steps are as large as with the default learning_rate.
        self._default_rate = min(1 / learning_rate, 1.0)
        self.rate = self._ceiling = 1.0
        self.rollbacks = 0
        self._steps_since_rollback = 0
        self.reset()

    def reset(self) -> None:
        """Forget the best state, because the problem has changed. Raise the ceiling of the rate.

        The ceiling is divided by CEILING_SHARE. But it never rises above the rate that gives steps
        of the same size as the default learning_rate gives.
        """
        self._ceiling = max(self._ceiling, min(self._ceiling / CEILING_SHARE, self._default_rate))
        self.best: _Backup | None = None
        self.least = self._recent_least = math.inf
        self._steps_since_best = 0

    def begin_gently(self) -> None:
        """Lower the rate to at most GENTLE times its ceiling.

        The drawing is nearly exact already, so full steps would spoil it. The next steps raise the
        rate again.
        """
        self.rate = min(self.rate, GENTLE * self._ceiling)

    def allow_rise(self) -> None:
        """Forget the recent least loss, because a relocation may raise the loss for a while."""
        self._recent_least = math.inf

    def observe(self, loss: float, error: float, backup: Callable[[], _Backup]) -> bool:
        """Take note of the loss and mean squared error of a step, and return whether it is sound.

        A step is not sound if the fit has diverged. If the step is sound, raise the rate. If its
        loss is also the least so far, keep the copy of the state that backup() returns.
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
        """Return whether a stage that ends with this loss should return to its best state.

        The stage should return to it if it has diverged, that is, if the loss is above WORSE_AT_END
        times the least loss. If `tolerant` is False, it should return even if the loss is only a
        little above the least loss.

        If the stage has diverged, a rollback is counted, which lowers the rate. This is not done if
        learning_rate is at most 1 and the fit has never been rolled back.
        """
        diverged = not loss <= WORSE_AT_END * self.least
        if diverged and (self._default_rate < 1 or self.rollbacks > 0):
            self.roll_back()
        if tolerant:
            return diverged
        # If the stage ends in its best state, `loss` and `least` are sums of the same terms. But
        # the terms may be added in different orders, so that the sums differ slightly. The factor
        # allows for such rounding errors. If tiles were left out, `least` may also be off by 0.1 %.
        return not loss <= self.least * (1 + 1e-6)

    def roll_back(self) -> None:
        """Count a rollback, and lower the rate and its ceiling."""
        self.rollbacks += 1
        again = self._steps_since_rollback < AGAIN
        share = CEILING_SHARE_AGAIN if again and self.rollbacks > 1 else CEILING_SHARE
        # Usually the new ceiling is `share` times the present rate. If the present rate is far
        # above the default rate, this would still be too high. In this case the new ceiling is the
        # geometric mean of the two rates, which is lower.
        self._ceiling = min(self.rate * share, math.sqrt(self.rate * self._default_rate))
        self._steps_since_rollback = 0
        self.rate = self._ceiling * LOWERED
        self._recent_least, self._steps_since_best = math.inf, 0
