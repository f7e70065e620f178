import numpy as np
import pytest

from gauss2svg.errors import InputError
from gauss2svg.falloff import RADIUS, STOP_COUNTS, gradient_stops, profile


def test_profile_is_one_at_the_mean_and_zero_from_the_cut_on():
    assert profile(np.array(0.0)) == 1
    assert (profile(np.array([RADIUS, RADIUS + 1e-9, 100.0])) == 0).all()


def test_profile_falls_without_a_step():
    values = profile(np.linspace(0, RADIUS + 1, 5001))
    assert (np.diff(values) <= 0).all()
    assert np.abs(np.diff(values)).max() < 1e-3


# (largest error, root mean square over the disc): what gradient stops promise
@pytest.mark.parametrize(
    ("count", "largest", "rms"),
    [(6, 0.025, 0.0042), (8, 0.012, 0.0021), (10, 0.013, 0.0015), (12, 0.0074, 0.0009)],
)
def test_stops_reproduce_the_profile_within_the_stated_error(count, largest, rms):
    r = np.linspace(0, RADIUS, 3001)
    offsets, values = gradient_stops(count)
    error = np.interp(r / RADIUS, offsets, values) - profile(r)
    assert np.abs(error).max() < largest
    assert np.sqrt(np.average(error**2, weights=r)) < rms


@pytest.mark.parametrize("count", STOP_COUNTS)
def test_stops_rise_in_offset_and_fall_in_opacity_from_one_to_zero(count):
    offsets, values = gradient_stops(count)
    assert len(offsets) == len(values) == count
    assert (offsets[0], offsets[-1], values[0], values[-1]) == (0, 1, 1, 0)
    assert (np.diff(offsets) > 0).all()
    assert (np.diff(values) < 0).all()


def test_unknown_stop_count_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="6, 8, 10, 12"):
        gradient_stops(7)
