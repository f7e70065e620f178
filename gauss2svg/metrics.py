"""How far two pictures are apart; both (h, w, 3) float in 0..1."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError

LEVELS = 255  # differences are reported in levels of an 8-bit channel
_FLAT = 0.02  # of 0..1, the largest step to the next pixel of a flat area: five levels
_AWAY = 4  # px that a flat pixel is away from any steeper step
_WORST = 1000  # flat_error looks at one in so many of the flat pixels


def _same_shape(image: NDArray[np.floating], other: NDArray[np.floating]) -> None:
    if image.shape != other.shape or image.ndim != 3:
        raise InputError(
            f"pictures have shapes {image.shape} and {other.shape}; needed is the same (h, w, 3)"
        )


def mean_squared_error(image: NDArray[np.floating], other: NDArray[np.floating]) -> float:
    """Mean over pixels and channels of the squared difference, summed in float64."""
    _same_shape(image, other)
    rows = zip(image, other, strict=True)  # row by row: no float64 copy of a large picture
    return math.fsum(np.sum(np.subtract(a, b, dtype=np.float64) ** 2) for a, b in rows) / image.size


def psnr(image: NDArray[np.floating], other: NDArray[np.floating]) -> float:
    """Peak signal-to-noise ratio -10 log10(mean squared error) in dB; infinite if equal."""
    error = mean_squared_error(image, other)
    return -10 * math.log10(error) if error > 0 else math.inf


def ssim(image: NDArray[np.floating], other: NDArray[np.floating]) -> float:
    """Structural similarity in -1..1, mean over channels.

    Gaussian window of sigma 1.5 px and population covariance, as in Wang, Bovik,
    Sheikh and Simoncelli, "Image quality assessment", 2004; by scikit-image. Pictures
    under 11 px a side have no full window: the largest odd box that fits is used.
    """
    from skimage.metrics import structural_similarity

    _same_shape(image, other)
    side = min(image.shape[:2])
    if side < 3:
        raise InputError(f"picture is {image.shape[1]}x{image.shape[0]} px; SSIM needs 3 px a side")
    window: dict[str, Any] = {"gaussian_weights": True, "sigma": 1.5}
    if side < 11:
        window = {"win_size": side if side % 2 else side - 1}
    # One float32 channel at a time, to spare memory on photos of many megapixels.
    return float(
        np.mean(
            [
                structural_similarity(
                    np.ascontiguousarray(image[:, :, c], np.float32),
                    np.ascontiguousarray(other[:, :, c], np.float32),
                    data_range=1.0,
                    use_sample_covariance=False,
                    **window,
                )
                for c in range(image.shape[2])
            ]
        )
    )


def largest_error(image: NDArray[np.floating], other: NDArray[np.floating]) -> float:
    """Largest absolute difference of any channel, in levels of 255."""
    _same_shape(image, other)
    return float(np.abs(image - other).max()) * LEVELS


def bias(image: NDArray[np.floating], other: NDArray[np.floating]) -> float:
    """Mean of image - other over pixels and channels, in levels of 255."""
    _same_shape(image, other)
    return float(np.mean(image - other, dtype=np.float64)) * LEVELS


def flat_error(image: NDArray[np.floating], reference: NDArray[np.floating]) -> float:
    """Mean error of the worst thousandth of the reference's flat pixels, in levels of 255.

    It sees what squared error hardly does: streaks across paper or a flat colour. A pixel is
    flat where the reference has no step of 0.02 or more within 4 px, its error that of its
    worst channel. The mean of the worst grows with the height, the length and the number of
    the streaks. A percentile there is blind to one streak thinner than its share, a box
    average thins a streak of one pixel to a third, the largest cannot tell one speck from
    many streaks. Haze beyond 4 px of an edge counts as well. Not a number where no pixel is flat.
    """
    from scipy.ndimage import maximum_filter

    _same_shape(image, reference)
    steep = np.zeros(reference.shape[:2], bool)
    for axis in (0, 1):  # both sides of a step are steep
        steps = np.abs(np.diff(reference, axis=axis)).max(axis=2, initial=0) >= _FLAT
        lead = (slice(None),) * axis
        steep[(*lead, slice(1, None))] |= steps
        steep[(*lead, slice(-1))] |= steps
    flat = np.logical_not(maximum_filter(steep, size=2 * _AWAY + 1))
    errors = np.abs(np.subtract(image[flat], reference[flat], dtype=np.float64)).max(axis=1)
    if not errors.size:
        return math.nan
    worst = math.ceil(errors.size / _WORST)
    return float(np.partition(errors, -worst)[-worst:].mean()) * LEVELS
