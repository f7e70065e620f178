import math

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio

from gauss2svg.errors import InputError
from gauss2svg.measure import metrics

RNG = np.random.default_rng(1)
A = RNG.random((30, 40, 3)).astype(np.float32)
B = RNG.random((30, 40, 3)).astype(np.float32)


def test_psnr_is_that_of_scikit_image():
    expected = peak_signal_noise_ratio(A.astype(np.float64), B, data_range=1)
    assert metrics.psnr(A, B) == pytest.approx(expected, abs=1e-9)


def test_equal_pictures_have_infinite_psnr_and_ssim_one():
    assert metrics.psnr(A, A) == math.inf
    assert metrics.ssim(A, A) == pytest.approx(1)


def test_ssim_is_symmetric_and_falls_with_noise():
    noisy = np.clip(A + 0.1 * (B - 0.5), 0, 1)
    assert metrics.ssim(A, noisy) == pytest.approx(metrics.ssim(noisy, A), abs=1e-6)
    assert metrics.ssim(A, B) < metrics.ssim(A, noisy) < 1


def test_ssim_of_a_small_picture_is_defined():
    assert metrics.ssim(A[:4, :5], A[:4, :5]) == pytest.approx(1)


def test_ssim_under_three_pixels_is_refused():
    with pytest.raises(InputError, match="at least 3 px a side"):
        metrics.ssim(A[:2], A[:2])


def test_bias_and_largest_error_are_in_levels():
    shifted = np.zeros((2, 2, 3))
    shifted[0, 0, 0] = 0.2
    zero = np.zeros((2, 2, 3))
    assert metrics.largest_error(shifted, zero) == pytest.approx(51)
    assert metrics.bias(shifted, zero) == pytest.approx(51 / 12)
    assert metrics.bias(zero, shifted) == pytest.approx(-51 / 12)


def flat_halves():
    """Two flat colours side by side, and the same with an error of one level all over."""
    reference = np.full((100, 120, 3), 0.9)
    reference[:, 60:] = [0.2, 0.4, 0.6]
    return reference, reference - 1 / 255


def test_flat_error_sees_a_streak_that_psnr_hardly_sees():
    reference, fitted = flat_halves()
    assert metrics.flat_error(fitted, reference) == pytest.approx(1)
    streaked = fitted.copy()
    streaked[20, 10:40] -= 3 / 255
    assert metrics.psnr(fitted, reference) - metrics.psnr(streaked, reference) < 0.2
    assert metrics.flat_error(streaked, reference) == pytest.approx(4)


def test_flat_error_grows_with_the_length_of_a_streak():
    reference, fitted = flat_halves()
    errors = []
    for length in (1, 4, 8):
        streaked = fitted.copy()
        streaked[20, 10 : 10 + length] -= 30 / 255
        errors.append(metrics.flat_error(streaked, reference))
    assert errors == sorted(set(errors))


def test_flat_error_does_not_count_errors_at_an_edge():
    reference, fitted = flat_halves()
    blurred = fitted.copy()
    blurred[:, 55:65] = 0.5  # within 4 px of the step
    assert metrics.flat_error(blurred, reference) == pytest.approx(1)
    blurred[:, 54] = 0.5
    assert metrics.flat_error(blurred, reference) == pytest.approx(0.4 * 255)


def test_flat_error_takes_slopes_for_flat_and_a_checkerboard_not():
    slope = np.repeat(np.linspace(0, 1, 101)[None, :, None], 20, axis=0)
    slope = np.repeat(slope, 3, axis=2)
    assert metrics.flat_error(slope, slope) == 0
    checkerboard = np.indices((20, 30)).sum(axis=0)[:, :, None] % 2 * np.ones(3)
    assert math.isnan(metrics.flat_error(checkerboard, checkerboard))


@pytest.mark.parametrize("name", ["psnr", "ssim", "bias", "largest_error", "flat_error"])
def test_pictures_of_different_shape_are_refused(name):
    with pytest.raises(InputError, match="of one shape"):
        getattr(metrics, name)(A, B[:-1])


@pytest.mark.parametrize(
    "shape", [(1, 1, 3), (3, 700, 3), (300, 1000, 3), (1000, 30, 1), (40, 50, 4)]
)
def test_errors_summed_in_bands_are_those_row_by_row(shape):
    rng = np.random.default_rng(0)
    one, two = rng.random((2, *shape)).astype(np.float32)
    rows = list(zip(one.astype(np.float64), two, strict=True))
    squared = math.fsum(float(np.square(a - b).sum()) for a, b in rows) / one.size
    assert metrics.mean_squared_error(one, two) == pytest.approx(squared, rel=1e-14)
    mean = math.fsum(float((a - b).sum()) for a, b in rows) / one.size
    assert metrics.bias(one, two) == pytest.approx(255 * mean, abs=1e-6)
    largest = max(float(np.abs(a - b).max()) for a, b in rows)
    assert metrics.largest_error(one, two) == pytest.approx(255 * largest, rel=1e-6)
