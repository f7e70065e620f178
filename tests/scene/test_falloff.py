import numpy as np
import pytest

from gauss2svg.scene.falloff import (
    BETA_CLASSES,
    CUT,
    LEAST_BETA,
    MOST_BETA,
    RADIUS,
    cut_radius,
    half_radius,
    nearest_class,
    profile,
)

BETAS = (LEAST_BETA, 0.75, 1.0, 1.7, 6.0, 64.0, MOST_BETA)


@pytest.mark.parametrize("beta", BETAS)
def test_profile_falls_from_one_at_the_mean_to_zero_at_the_cut_without_a_step(beta):
    radius = cut_radius(beta)
    assert profile(np.array(0.0), beta) == 1
    assert profile(half_radius(beta), beta) == pytest.approx(0.5, abs=1e-9)
    assert (profile(np.array([radius, radius + 1e-9, 100.0, 1e6]), beta) == 0).all()
    assert profile(np.array(0.999 * radius), beta) > 0
    values = profile(np.linspace(0, radius + 1, 500001), beta)
    assert -5e-3 < np.diff(values).min() <= np.diff(values).max() <= 0


def test_support_shrinks_as_beta_grows_towards_the_rim():
    radii = cut_radius(np.array(BETAS))
    assert (np.diff(radii) < 0).all()
    assert cut_radius(1) == pytest.approx(RADIUS)
    np.testing.assert_allclose((radii**2 / 2) ** np.array(BETAS), CUT)
    assert np.sqrt(2) < radii[-1] < 1.01 * np.sqrt(2)


def test_exponents_are_rounded_to_the_nearest_class_as_ratios_go():
    classes = np.array(BETA_CLASSES)
    assert (nearest_class(classes) == np.arange(len(classes))).all()
    beta = np.exp(np.linspace(np.log(LEAST_BETA), np.log(MOST_BETA), 400))
    distance = np.abs(np.log(beta[:, None] / classes))
    nearest = distance[np.arange(400), nearest_class(beta)]
    np.testing.assert_allclose(nearest, distance.min(axis=1))
