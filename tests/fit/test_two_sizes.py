"""The loss of an enlarged fit, at the size of its target and at the picture's own."""

import dataclasses

import numpy as np
import pytest
from flat import fit_config

from gauss2svg.fit import adam
from gauss2svg.fit.session import FitSession

STEP = 0.02  # of a shape's sigma


@pytest.mark.parametrize("times", [2, 4])
def test_the_gradient_at_two_sizes_is_that_of_finite_differences(photo, times):
    config = dataclasses.replace(fit_config(12, 20), enlarged=times)
    session = FitSession(np.ascontiguousarray(photo[:64, :64]), config)
    session.fit()
    population, state = session.population, session.state
    population.reduce_to(1)
    state.mean += np.random.default_rng(0).normal(scale=2.0, size=state.mean.shape)

    def loss():
        """Half the mean of both weighted squared errors, as if each were of the larger size."""
        own = state.scaled(1 / times, 1 / times).splats(population.background)
        small, _ = population._pyramid.reduced(times).squares(own)
        large, _ = population.target.squares(population.splats())
        return (large + times**2 * small) / 4

    # Only the optimiser sees the gradient, and steps by it at once.
    splats = population.splats()
    analytic = adam.gradients(population.evaluate(splats, True).moments, splats)
    numeric = np.zeros((len(state), 2))
    for i, factor in enumerate(state.factor):
        mean = state.mean[i].copy()
        for axis, direction in enumerate(([factor[0], factor[1]], [0.0, factor[2]])):
            moved = []
            for sign in (1, -1):
                state.mean[i] = mean + sign * STEP * np.array(direction)
                moved.append(loss())
            numeric[i, axis] = (moved[0] - moved[1]) / (2 * STEP)
        state.mean[i] = mean
    assert np.linalg.norm(numeric - analytic[:, :2]) < 0.02 * np.linalg.norm(numeric)
