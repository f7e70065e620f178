"""MS-SSIM against a slow twin that is written from the paper, window by window."""

import numpy as np
import pytest
from skimage import data

from gauss2svg.errors import InputError
from gauss2svg.measure import metrics

WEIGHTS = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333]


@pytest.fixture(scope="module")
def pair():
    """A piece of a photo whose sides are odd at some scales, and the same with noise."""
    image = data.astronaut()[40:219, 150:335].astype(np.float32) / 255  # 179 x 185 px
    noise = np.random.default_rng(3).normal(0, 0.1, image.shape)
    return image, np.clip(image + noise, 0, 1).astype(np.float32)


def twin(image, other):
    """As in the paper: no separable filter, no bands, each window by itself."""
    taps = np.array([[np.exp(-(x * x + y * y) / 4.5) for x in range(-5, 6)] for y in range(-5, 6)])
    taps /= taps.sum()
    scores = []
    for c in range(image.shape[2]):
        x, y = image[:, :, c].astype(np.float64), other[:, :, c].astype(np.float64)
        score = 1.0
        for scale, weight in enumerate(WEIGHTS, 1):
            windows = [np.lib.stride_tricks.sliding_window_view(p, (11, 11)) for p in (x, y)]
            terms = []
            for a_row, b_row in zip(*windows, strict=True):
                for a, b in zip(a_row, b_row, strict=True):
                    mean_a, mean_b = np.sum(taps * a), np.sum(taps * b)
                    var_a = np.sum(taps * (a - mean_a) ** 2)
                    var_b = np.sum(taps * (b - mean_b) ** 2)
                    covariance = np.sum(taps * (a - mean_a) * (b - mean_b))
                    term = (2 * covariance + 0.0009) / (var_a + var_b + 0.0009)
                    if scale == 5:
                        term *= (2 * mean_a * mean_b + 0.0001) / (mean_a**2 + mean_b**2 + 0.0001)
                    terms.append(term)
            score *= max(np.mean(terms), 0) ** weight
            x, y = halved(x), halved(y)
        scores.append(score)
    return np.mean(scores)


def halved(plane):
    """Means of 2 x 2 px; beyond the last row or column it is repeated."""
    rows, columns = ((side + 1) // 2 for side in plane.shape)
    out = np.empty((rows, columns))
    for i in range(rows):
        for j in range(columns):
            block = [
                plane[min(2 * i + di, plane.shape[0] - 1), min(2 * j + dj, plane.shape[1] - 1)]
                for di in (0, 1)
                for dj in (0, 1)
            ]
            out[i, j] = np.mean(block)
    return out


@pytest.mark.sweep
def test_it_is_that_of_the_slow_twin(pair):
    image, noisy = (picture[:, :, :1] for picture in pair)
    assert metrics.ms_ssim(image, noisy) == pytest.approx(twin(image, noisy), abs=1e-9)


def test_it_is_the_mean_over_channels(pair):
    each = [metrics.ms_ssim(*(picture[:, :, c : c + 1] for picture in pair)) for c in range(3)]
    assert metrics.ms_ssim(*pair) == pytest.approx(np.mean(each), abs=1e-12)


def test_equal_pictures_have_one_and_noise_lowers_it(pair):
    image, noisy = pair
    assert metrics.ms_ssim(image, image) == pytest.approx(1, abs=1e-12)
    half = image + (noisy - image) / 2
    assert metrics.ms_ssim(image, noisy) < metrics.ms_ssim(image, half) < 1


def test_it_is_symmetric(pair):
    image, noisy = pair
    assert metrics.ms_ssim(image, noisy) == pytest.approx(metrics.ms_ssim(noisy, image), abs=1e-12)


def test_bands_do_not_change_it(pair, monkeypatch):
    whole = metrics.ms_ssim(*pair)
    monkeypatch.setattr(metrics, "_BAND", 7)
    assert metrics.ms_ssim(*pair) == pytest.approx(whole, abs=1e-12)


def test_a_negative_film_has_none_of_it(pair):
    image, _ = pair
    assert metrics.ms_ssim(image, 1 - image) == 0
    # A scale alone is enough: the squares of a checkerboard have their mean at the next one.
    squares = 0.5 + 0.2 * (np.indices((176, 176)).sum(axis=0)[:, :, None] % 2 - 0.5)
    assert metrics.ms_ssim(squares, 1 - squares) == 0


@pytest.mark.parametrize("size", [(175, 300), (300, 175)])
def test_smaller_pictures_are_refused(size):
    small = np.zeros((*size, 3))
    with pytest.raises(InputError, match="MS-SSIM must be at least 176 px a side"):
        metrics.ms_ssim(small, small)


def test_the_smallest_picture_has_a_window_at_every_scale():
    smallest = np.random.default_rng(0).random((176, 176, 3))
    assert metrics.ms_ssim(smallest, smallest) == pytest.approx(1)
