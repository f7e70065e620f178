"""Photos that are dark or pale all over keep what is seen in them."""

import numpy as np
import pytest
from flat import vectorize
from PIL import Image
from skimage import data

from gauss2svg.measure.metrics import psnr

PHOTO = np.asarray(Image.fromarray(data.astronaut()).resize((160, 160)), np.float32) / 255


@pytest.mark.parametrize("base", [0.0, 0.93])
def test_a_faint_photo_is_recognised_when_its_contrast_is_restored(base):
    faint = np.round(255 * (base + 0.07 * PHOTO)) / 255
    result = vectorize(np.float32(faint), quality="draft")
    restored = np.clip((result.raster - base) / 0.07, 0, 1)
    assert psnr(restored, PHOTO) > 14  # its mean colour alone has 10 dB
