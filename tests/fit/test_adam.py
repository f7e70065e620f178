"""Adam's step by the kernel, against the same step by linear algebra."""

import math

import numpy as np
import pytest

from gauss2svg.fit import FitOptions
from gauss2svg.fit.population import LEAST_SIGMA_ABOVE_AREAS
from gauss2svg.fit.state import (
    COLUMN_COUNT,
    FIRST_DECAY,
    LEAST_FITTED_SIGMA,
    LEAST_RIM,
    MOST_ASPECT,
    SECOND_DECAY,
    STEP_BY_BETA,
    State,
    columns_of,
    step,
)
from gauss2svg.scene.falloff import RIM_WIDTH
from gauss2svg.scene.scene import LEAST_RAW_BETA, MOST_RAW_BETA

OVER = columns_of(FitOptions())
MOST_SIGMA = 40.0
NAMES = ("mean", "factor", "raw_opacity", "color", "raw_beta", "adam_m", "adam_v", "age")


def random_state(count: int, seed: int) -> State:
    rng = np.random.default_rng(seed)
    factor = np.column_stack(
        [rng.uniform(0.4, 9, count), rng.normal(0, 9, count), rng.uniform(0.4, 9, count)]
    )
    raw_beta = np.where(rng.random(count) < 0.3, 0.0, rng.uniform(0, 3, count))
    return State.of(
        rng.random((count, 2)) * 50, factor, 0, raw_opacity=rng.normal(0, 4, count),
        color=rng.random((count, 3)), raw_beta=raw_beta,
    )  # fmt: skip


def step_by_linear_algebra(
    state, moments, splats, columns, most_sigma, price, rate, least_sigma
) -> bool:
    """The slow twin of `step`."""
    gradient = moments * [1, 1, 1, 2, 1, 1, 1, 1, 1, 1]
    gradient[:, 5] *= 1 - splats.opacity_color[:, 0]
    gradient[:, 9] = price - splats.shape[:, 5] * moments[:, 9]
    sizes, *bounds = columns.T
    finite = True
    for i in range(len(state)):
        if not (np.abs(gradient[i]) < 1e150).all():
            state.adam_m[i], state.adam_v[i], state.age[i] = 0, 0, 0
            finite = False
            continue
        state.age[i] += 1
        d = []
        for k in range(COLUMN_COUNT):
            g = gradient[i, k]
            state.adam_m[i, k] += (1 - FIRST_DECAY) * (g - state.adam_m[i, k])
            state.adam_v[i, k] += (1 - SECOND_DECAY) * (g * g - state.adam_v[i, k])
            first = state.adam_m[i, k] / (1 - FIRST_DECAY ** state.age[i])
            root = math.sqrt(state.adam_v[i, k]) + 1e-12
            unbiased = root / math.sqrt(1 - SECOND_DECAY ** state.age[i])
            d.append(-rate * sizes[k] * first / unbiased)
        d[:5] = [x * math.exp(state.raw_beta[i]) ** STEP_BY_BETA for x in d[:5]]
        l11, l21, l22 = state.factor[i]
        lower = np.array([[l11, 0], [l21, l22]])
        state.mean[i] += lower @ d[:2]
        a = np.array([[d[2], d[3]], [d[3], d[4]]])
        stretched = lower @ (np.eye(2) + a + a @ a / 2)
        u, axes, _ = np.linalg.svd(stretched)
        minor = np.clip(axes[1], least_sigma, most_sigma)
        major = np.clip(axes[0], least_sigma, most_sigma)
        major = min(major, MOST_ASPECT * minor)
        shape = np.linalg.cholesky(u @ np.diag([major**2, minor**2]) @ u.T)
        state.factor[i] = shape[0, 0], shape[1, 0], shape[1, 1]
        state.raw_opacity[i] = np.clip(state.raw_opacity[i] + d[5], -8, 12)
        color = state.color[i] + d[6:9]
        state.color[i] = np.clip(color, bounds[0][6:9], bounds[1][6:9])
        if sizes[9]:
            sharpest = math.log(max(RIM_WIDTH / LEAST_RIM * minor, 1e-300))
            sharpest = min(max(sharpest, LEAST_RAW_BETA), MOST_RAW_BETA)
            moved = max(state.raw_beta[i] + d[9], LEAST_RAW_BETA)
            state.raw_beta[i] = min(moved, sharpest)
    return finite


@pytest.mark.parametrize("rate", [0.02, 5.0])
@pytest.mark.parametrize("least", [LEAST_FITTED_SIGMA, LEAST_SIGMA_ABOVE_AREAS])
def test_the_kernel_steps_as_linear_algebra_does_and_forgets_what_is_not_finite(least, rate):
    fast, rng = random_state(90, 0), np.random.default_rng(0)
    slow = fast.copy()
    for number, bad in enumerate((0.0, math.nan, -math.inf, 1e200)):
        moments = rng.normal(size=(90, COLUMN_COUNT)) * 10.0 ** rng.integers(-6, 6, (90, 1))
        moments[range(COLUMN_COUNT), range(COLUMN_COUNT)] += bad
        splats = fast.splats(np.zeros(3))
        given = moments, splats, OVER, MOST_SIGMA, 0.1, rate, least
        assert step(fast, *given) == step_by_linear_algebra(slow, *given) == (number == 0)
        for name in NAMES:
            np.testing.assert_allclose(
                getattr(fast, name), getattr(slow, name), rtol=1e-7, atol=1e-7, err_msg=name
            )
