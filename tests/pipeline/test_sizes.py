"""A large photo costs what its fit does: it is read and measured at little more than that size.

Large begins at 10 000 px here, in place of a megapixel, but for two tests of the megapixel itself.
"""

import dataclasses
import math
import tracemalloc

import numpy as np
import pytest
from flat import vectorize
from hypothesis import given
from hypothesis import strategies as st
from pictures import encoded
from PIL import Image

from gauss2svg.cli.main import main
from gauss2svg.measure.check import check
from gauss2svg.photo.load import load_image
from gauss2svg.photo.pixels import Header, pixels_of, shrunk
from gauss2svg.pipeline.budgets import MEASURED_PIXELS, load_of, measured_size
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan

SIDES = st.integers(1, 20_000)
LARGE = 10_000
QUICK = {"quality": "draft", "gaussians": 40, "iterations": 20}
SMALL = {**QUICK, "max_size": 60}


@pytest.fixture(autouse=True, scope="module")
def _large_is_small():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gauss2svg.pipeline.budgets.MEASURED_PIXELS", LARGE)
        yield


@pytest.fixture
def megapixel(monkeypatch):
    monkeypatch.setattr("gauss2svg.pipeline.budgets.MEASURED_PIXELS", MEASURED_PIXELS)


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


@pytest.fixture(scope="module")
def run_on_large(large):
    return vectorize(large, **SMALL)


@given(SIDES, SIDES, st.floats(0, 1))
def test_measured_size_is_that_of_the_fit_or_a_megapixel_or_the_photo(width, height, share):
    photo = width, height
    fit = max(1, round(share * width)), max(1, round(share * height))
    found = measured_size(photo, fit)
    if fit[0] * fit[1] >= MEASURED_PIXELS:
        assert found == fit
    elif width * height <= MEASURED_PIXELS:
        assert found == photo
    else:
        assert abs(math.prod(found) - MEASURED_PIXELS) <= 2 * max(found)
        assert abs(found[0] * height - found[1] * width) <= max(photo)
    assert all(least <= side <= most for least, side, most in zip(fit, found, photo, strict=True))


def test_large_photo_is_measured_at_a_megapixel_and_written_at_its_size(megapixel):
    large = jpeg(1300, 900)
    found = vectorize(large, **QUICK)
    report = found.report
    assert (report["width"], report["height"]) == (1300, 900)
    assert (report["fit_width"], report["fit_height"]) == (384, 266)
    size = measured_size((1300, 900))
    assert (report["measured_width"], report["measured_height"]) == size != (1300, 900)
    assert found.raster.shape == found.photo.shape == (*size[::-1], 3)
    assert (found.scene.width, found.scene.height) == (1300, 900)
    assert ' width="1300"' in found.svg
    off = found.photo - shrunk(load_image(large).pixels, *size[::-1], sharp=True)
    assert np.abs(off).mean() < 1 / 255


def test_full_size_is_asked_for_and_the_file_has_about_as_many_bytes(
    large, run_on_large, drawn_here
):
    whole = vectorize(large, full_size=True, **SMALL)
    report = whole.report
    assert (report["measured_width"], report["measured_height"]) == (180, 120)
    assert report["psnr_svg"] == check(large, whole.svg).psnr
    # The noise that the photo has at its own size is averaged at a smaller one.
    assert abs(report["psnr_svg"] - run_on_large.report["psnr_svg"]) < 1
    assert abs(len(whole.svg) / len(run_on_large.svg) - 1) < 0.15


@pytest.mark.parametrize("given", [{"quality": "draft"}, {"max_size": 30}, {"full_size": True}])
def test_photo_of_up_to_a_megapixel_is_measured_at_its_own_size(photo, given, megapixel):
    found = vectorize(photo, **{**QUICK, **given})
    assert found.raster.shape == photo.shape
    np.testing.assert_array_equal(found.photo, photo)


@pytest.mark.parametrize("full_size", [False, True])
def test_target_is_of_the_size_at_which_it_is_measured(large, full_size):
    found = vectorize(large, target_psnr=25, quality="draft", max_size=60, full_size=full_size)
    assert found.report["stop_reason"] == "target_psnr"
    assert found.report["psnr_svg"] >= 24.95
    assert (found.report["measured_width"] == 180) == full_size


def test_nothing_is_done_at_the_size_of_a_large_photo():
    data = jpeg(2000, 1500)
    vectorize(jpeg(130, 90), **SMALL)  # what is loaded once is no part of it
    tracemalloc.start()
    try:
        vectorize(data, **SMALL)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 12 * 2000 * 1500  # of one array of its samples as float32


@pytest.mark.parametrize("limit", [600, 5_050])
def test_bytes_go_as_far_for_a_large_photo_as_for_the_same_one_reduced(limit):
    pixels = load_image(jpeg(60, 40)).pixels
    enlarged = np.kron(pixels, np.ones((4, 4, 1), np.float32))
    given = {"max_bytes": limit, "iterations": 4}
    small, large = (vectorize(one, **given).report for one in (pixels, enlarged))
    assert large["gaussians"] >= 0.95 * small["gaussians"] - 1
    assert (large["width"], small["width"]) == (240, 60)


def test_matte_and_transparency_are_those_of_the_reduced_photo():
    rng = np.random.default_rng(1)
    pixels = rng.random((120, 110, 4), np.float32)
    pixels[:30, :, 3] = 0
    found = vectorize(pixels, **SMALL)
    assert found.report["transparent"]
    assert found.photo.shape == (*measured(110, 120)[::-1], 4)
    expected = load_image(pixels, needed=measured)
    np.testing.assert_array_equal(found.photo, pixels_of(expected))


def test_summary_says_at_which_size_it_was_measured(large, tmp_path, capsys):
    (tmp_path / "photo.jpg").write_bytes(large)
    command = [str(tmp_path / "photo.jpg"), "--quality", "draft", "--gaussians", "20"]
    command += ["--iterations", "5", "--max-size", "60"]
    size = measured(180, 120)
    for more, is_said in (([], True), (["--full-size"], False)):
        assert main([*command, *more]) == 0
        said = " ".join(capsys.readouterr().err.split())
        assert (f", at {size[0]}x{size[1]} px" in said) == is_said == (", at " in said)


@pytest.mark.parametrize(
    ("size", "is_turned", "given"),
    [
        ((180, 120), False, {}),
        ((180, 120), True, {}),
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
    for name in ("psnr_svg", "ssim_svg", "largest_error_svg", "bias_svg"):
        assert again[name] == found.report[name], name
    assert (again["svg_width"], again["svg_height"]) == whole
    assert again["psnr_svg"] > 10


def test_opaque_photo_with_an_alpha_channel_needs_no_more_memory_than_without():
    picture, limit = Image.fromarray(np.zeros((900, 1100, 3), np.uint8)), 320_000_000
    load = load_of(Plan(Options.from_flat(SMALL)), Header(1100, 900, has_alpha=True))
    # what it would be refused for if it were transparent
    assert dataclasses.replace(load, fit=(1, 1)).bytes > limit
    reports = [
        vectorize(encoded(picture.convert(mode), "PNG"), max_memory=limit, **SMALL).report
        for mode in ("RGB", "RGBA")
    ]
    assert reports[0]["notes"] == reports[1]["notes"]
    assert reports[0]["fit_width"] == reports[1]["fit_width"]
