"""Properties of the local error of hue, and its twins in scikit-image and SciPy."""

import numpy as np
import pytest
from scipy.ndimage import uniform_filter
from skimage import data
from skimage.color import rgb2lab

from gauss2svg.measure.metrics import local_hue_error
from gauss2svg.measure.roundtrip import measure_pixels
from gauss2svg.photo.pixels import views

RNG = np.random.default_rng(1)
PHOTO = data.astronaut()[40:219, 150:335].astype(np.float32) / 255  # 185x179 px
NOISE = RNG.normal(0, 0.05, PHOTO.shape)
NOISY = np.float32(np.round(255 * np.clip(PHOTO + NOISE, 0, 1))) / 255  # 8 bits, as rasters have
GREY = np.full((150, 80, 3), 0.5, np.float32)


@pytest.mark.parametrize("size", [(150, 20), (5, 7)])
def test_the_error_is_that_of_the_definition(size):
    photo, image = (picture[: size[0], : size[1]] for picture in (PHOTO, NOISY))
    a, b = np.moveaxis(rgb2lab(image) - rgb2lab(photo), 2, 0)[1:]
    errors = np.hypot(uniform_filter(a, 9), uniform_filter(b, 9))
    error = local_hue_error(image, photo)
    assert error.worst == pytest.approx(errors.max(), abs=0.02)
    assert errors[error.y, error.x] == pytest.approx(errors.max(), abs=0.02)
    assert error.percentile == pytest.approx(np.percentile(errors, 99.9), abs=0.02)


def test_a_lost_dot_is_found_at_its_place_and_the_more_the_larger_it_is():
    assert local_hue_error(PHOTO, PHOTO).worst == 0
    worst = [0.0]
    for side in (1, 3, 9):
        photo = GREY.copy()
        photo[130 : 130 + side, 50 : 50 + side] = 0.8, 0.2, 0.2
        report = measure_pixels(GREY, photo)
        middle = 50 + side // 2, 130 + side // 2
        assert np.abs(np.subtract(report["hue_error_at"], middle)).max() <= 4
        worst.append(report["hue_error_svg"])
    assert worst == sorted(worst)
    assert worst[1] < 2  # one px
    assert worst[3] > 50
    assert local_hue_error(0.9 * GREY, GREY).worst < 0.1  # only the lightness differs


@pytest.mark.parametrize(("color", "worse"), [((1, 1, 0), 0), ((0, 0, 1), 1)])
def test_of_a_transparent_photo_the_worse_error_of_over_white_and_over_black_counts(color, worse):
    photo = np.dstack([GREY, np.ones(GREY.shape[:2], np.float32)])
    image = photo.copy()
    image[20:40, 20:40] = *color, 0.5
    over = [local_hue_error(each, GREY) for each in views(image)]
    assert local_hue_error(image, photo) == over[worse]
    assert over[worse].worst > over[1 - worse].worst + 1
