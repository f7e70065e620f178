"""How far two pictures are apart; both (h, w, 3) float in 0..1."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError

LEVELS = 255  # differences are reported in levels of an 8-bit channel
LEAST_SIDE_FOR_MS_SSIM = 176  # px: 11 taps at a sixteenth of the size
_SCALE_WEIGHTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)  # of MS-SSIM, the paper's
_C1, _C2 = 0.01**2, 0.03**2  # of SSIM, for values in 0..1
_WINDOW = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)  # 11 taps, sigma 1.5 px
_WINDOW /= _WINDOW.sum()
_BAND = 256  # rows of windows at a time
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
    rim = 5
    if side < 11:
        window = {"win_size": side if side % 2 else side - 1}
        rim = window["win_size"] // 2
    # One float32 channel at a time in bands of windows, to spare memory on photos of many
    # megapixels: whole channels take 60 bytes for each pixel.
    sums = []
    for top in range(0, image.shape[0] - 2 * rim, _BAND):
        one, two = (picture[top : top + _BAND + 2 * rim] for picture in (image, other))
        sums += [
            (one.shape[0] - 2 * rim)
            * structural_similarity(
                np.ascontiguousarray(one[:, :, c], np.float32),
                np.ascontiguousarray(two[:, :, c], np.float32),
                data_range=1.0,
                use_sample_covariance=False,
                **window,
            )
            for c in range(image.shape[2])
        ]
    return math.fsum(sums) / ((image.shape[0] - 2 * rim) * image.shape[2])


def ms_ssim(image: NDArray[np.floating], other: NDArray[np.floating]) -> float:
    """Multi-scale structural similarity in 0..1, mean over channels; at least 176 px a side.

    l_5^w5 * prod_j cs_j^wj over five scales, each half the size of the one before by means of
    2x2 px (an odd last row or column counts twice), w = .0448 .2856 .3001 .2363 .1333; cs_j is
    the mean of contrast times structure over the windows that lie inside, at scale five times
    luminance; window and constants are those of SSIM. Wang, Simoncelli and Bovik,
    "Multi-scale structural similarity for image quality assessment", 2003, and their
    implementation. A scale whose mean is negative, as of a negative film, counts as 0: a
    broken power of it is no real number.
    Raises InputError for smaller pictures: at scale five no window would fit.
    """
    _same_shape(image, other)
    height, width = image.shape[:2]
    if min(height, width) < LEAST_SIDE_FOR_MS_SSIM:
        raise InputError(
            f"picture is {width}x{height} px; MS-SSIM needs {LEAST_SIDE_FOR_MS_SSIM} px a side: "
            "use SSIM"
        )
    channels = []
    for c in range(image.shape[2]):
        one, two = (np.asarray(picture[:, :, c], np.float64) for picture in (image, other))
        similarity = 1.0
        for weight in _SCALE_WEIGHTS[:-1]:
            similarity *= max(_window_means(one, two)[1], 0.0) ** weight
            one, two = _halved(one), _halved(two)
        channels.append(similarity * max(_window_means(one, two)[0], 0.0) ** _SCALE_WEIGHTS[-1])
    return float(np.mean(channels))


def _window_means(one: NDArray[np.float64], two: NDArray[np.float64]) -> tuple[float, float]:
    """Mean of SSIM and of its contrast-structure term over the windows inside (h, w)."""
    from scipy.ndimage import correlate1d

    rim = len(_WINDOW) // 2

    def smooth(plane: NDArray[np.float64]) -> NDArray[np.float64]:
        rows = correlate1d(plane, _WINDOW, axis=0)[rim:-rim]
        return correlate1d(rows, _WINDOW, axis=1)[:, rim:-rim]

    similar, structured = [], []
    for top in range(0, one.shape[0] - 2 * rim, _BAND):  # in bands, to spare memory
        a, b = (plane[top : top + _BAND + 2 * rim] for plane in (one, two))
        mean_a, mean_b = smooth(a), smooth(b)
        product = mean_a * mean_b
        squares = mean_a**2 + mean_b**2
        structure = (2 * (smooth(a * b) - product) + _C2) / (smooth(a * a + b * b) - squares + _C2)
        luminance = (2 * product + _C1) / (squares + _C1)
        similar.append(np.sum(luminance * structure))
        structured.append(np.sum(structure))
    count = (one.shape[0] - 2 * rim) * (one.shape[1] - 2 * rim)
    return math.fsum(similar) / count, math.fsum(structured) / count


def _halved(plane: NDArray[np.float64]) -> NDArray[np.float64]:
    height, width = plane.shape
    even = np.pad(plane, ((0, height % 2), (0, width % 2)), mode="edge")
    return even.reshape(even.shape[0] // 2, 2, even.shape[1] // 2, 2).mean(axis=(1, 3))


def largest_error(image: NDArray[np.floating], other: NDArray[np.floating]) -> float:
    """Largest absolute difference of any channel, in levels of 255."""
    _same_shape(image, other)
    rows = zip(image, other, strict=True)
    return max(float(np.abs(a - b).max()) for a, b in rows) * LEVELS


def bias(image: NDArray[np.floating], other: NDArray[np.floating]) -> float:
    """Mean of image - other over pixels and channels, in levels of 255."""
    _same_shape(image, other)
    rows = zip(image, other, strict=True)
    return math.fsum(np.sum(a - b, dtype=np.float64) for a, b in rows) / image.size * LEVELS


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
