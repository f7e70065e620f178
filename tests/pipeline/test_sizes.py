"""A large photo costs what its fit does: it is read and measured at little more than that size.

Large begins at 10 000 px here, in place of a megapixel.
"""

import tracemalloc

import numpy as np
import pytest
from flat import vectorize
from pictures import encoded
from PIL import Image

from gauss2svg.measure.check import check
from gauss2svg.photo.load import load_image
from gauss2svg.pipeline.run import measured_size

LARGE = 10_000
SMALL = {"quality": "draft", "gaussians": 40, "iterations": 20, "max_size": 60}


@pytest.fixture(autouse=True, scope="module")
def _large_is_small():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gauss2svg.pipeline.run.MEASURED_PIXELS", LARGE)
        yield


def measured(width, height):
    return measured_size((width, height), least=LARGE)


def jpeg(width, height, **options):
    """A photo of soft patches with a little noise, the same scene at any size."""
    rng = np.random.default_rng(0)
    coarse = Image.fromarray(rng.integers(0, 255, (8, 12, 3), np.uint8))
    picture = np.asarray(coarse.resize((width, height), Image.Resampling.BICUBIC), np.int16)
    noisy = np.clip(picture + rng.integers(-4, 5, picture.shape, np.int16), 0, 255)
    return encoded(Image.fromarray(noisy.astype(np.uint8)), "JPEG", quality=92, **options)


@pytest.fixture(scope="module")
def large():
    return jpeg(180, 120)


@pytest.mark.parametrize("limit", [{}, {"max_bytes": 5000}])
def test_a_strip_keeps_the_detail_along_it(limit):
    x = np.linspace(0, 40 * np.pi, 2000)[None, :, None]
    strip = np.broadcast_to((0.5 + 0.4 * np.sin(x + [0, 2, 4])) ** 2, (12, 2000, 3)).astype("f4")
    assert vectorize(strip, iterations=60, **limit).report["psnr_svg"] > 20


@pytest.mark.parametrize("full_size", [False, True])
def test_target_is_of_the_size_at_which_it_is_measured(large, full_size, drawn_here):
    found = vectorize(large, target_psnr=25, iterations=40, max_size=60, full_size=full_size)
    assert found.report["stop_reason"] == "target_psnr"
    assert found.report["psnr_svg"] >= 24.95
    assert (found.report["measured_width"] == 180) == full_size
    if full_size:
        assert found.report["psnr_svg"] == check(large, found.svg).report["psnr_svg"]


def test_nothing_is_done_at_the_size_of_a_large_photo():
    data = jpeg(1600, 1200)
    vectorize(jpeg(130, 90), **SMALL)  # what is loaded once is no part of it
    tracemalloc.start()
    try:
        vectorize(data, **SMALL)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 12 * 1600 * 1200  # of one array of its samples as float32


@pytest.mark.parametrize(
    ("size", "is_turned", "given"),
    [
        ((180, 120), False, {}),
        ((260, 180), True, {}),  # which is reduced while it is decoded
        ((180, 120), False, {"blend": "add"}),
    ],
)
def test_a_large_photo_is_measured_reduced_and_check_at_that_size_gives_the_same_scores(
    size, is_turned, given, drawn_here
):
    exif = Image.Exif()
    exif[0x0112] = 6 if is_turned else 1
    data = jpeg(*size, exif=exif)
    found = vectorize(data, **given, **SMALL)
    whole, small = (one[:: -1 if is_turned else 1] for one in (size, measured(*size)))
    assert (found.scene.width, found.scene.height) == whole
    assert found.raster.shape == (*small[::-1], 3)
    np.testing.assert_array_equal(found.photo, load_image(data, needed=max(small)).pixels)
    again = check(data, found.svg, max_size=max(small)).report
    for name in ("psnr_svg", "ssim_svg", "largest_error_svg", "bias_svg", "hue_error_at"):
        assert again[name] == found.report[name], name
    assert (again["svg_width"], again["svg_height"]) == whole
    assert again["psnr_svg"] > 10
