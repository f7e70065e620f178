import math

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio

from gauss2svg import metrics
from gauss2svg.errors import InputError

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
    with pytest.raises(InputError, match="needs 3 px"):
        metrics.ssim(A[:2], A[:2])


def test_bias_and_largest_error_are_in_levels():
    shifted = np.zeros((2, 2, 3))
    shifted[0, 0, 0] = 0.2
    zero = np.zeros((2, 2, 3))
    assert metrics.largest_error(shifted, zero) == pytest.approx(51)
    assert metrics.bias(shifted, zero) == pytest.approx(51 / 12)
    assert metrics.bias(zero, shifted) == pytest.approx(-51 / 12)


@pytest.mark.parametrize("name", ["psnr", "ssim", "bias", "largest_error"])
def test_pictures_of_different_shape_are_refused(name):
    with pytest.raises(InputError, match="shapes"):
        getattr(metrics, name)(A, B[:-1])
