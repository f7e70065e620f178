"""Files of every kind: cut in their data they are refused, and reduced they are what they were.

A photo that is reduced while it is decoded is the whole one, reduced afterwards by Pillow.
"""

import io
import re
import tracemalloc
from functools import partial

import numpy as np
import pytest
from pictures import BROKEN, encoded, png, tiff
from PIL import Image

from gauss2svg.errors import InputError
from gauss2svg.photo.load import header_of, load_image
from gauss2svg.photo.pixels import has_alpha, shrunk

RNG = np.random.default_rng(0)
HEIGHT, WIDTH = 151, 217
LEVEL = 1 / 255
# What only the programmers of a decoder understand: names of functions and of exceptions.
INTERNAL = re.compile(r"\n|unable to (call|fetch|open source)|[Vv]ips|AssertionError")
SMOOTH = np.stack(
    [np.sin(np.mgrid[:HEIGHT, :WIDTH].sum(0) / k) * 90 + 120 for k in (31, 47, 19)], axis=2
)
NOISY = (SMOOTH + RNG.integers(-15, 16, SMOOTH.shape)).round().astype(np.uint8)
RGB = Image.fromarray(NOISY)
ALPHA = RNG.integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8)
ALPHA[:80, :90] = 0
RGBA = Image.fromarray(np.dstack([NOISY, ALPHA]))
WIDE = np.dstack([NOISY, ALPHA]).astype(np.uint16) * 257
PLANES = {"planarconfig": "separate", "rowsperstrip": 7}
rgb_tiff = partial(tiff, photometric="rgb")
FILES = {
    "JPEG": encoded(RGB, "JPEG"),
    "progressive JPEG": encoded(RGB, "JPEG", progressive=True),
    "JPEG of inks": encoded(RGB.convert("CMYK"), "JPEG"),
    "PNG": encoded(RGB, "PNG"),
    "RGBA PNG": encoded(RGBA, "PNG"),
    "16-bit PNG": png(WIDE[:, :, :3], bits=16),
    "palette PNG": encoded(RGB.quantize(64), "PNG"),
    "two levels": encoded(RGB.convert("1"), "PNG"),
    "WebP": encoded(RGB, "WEBP"),
    "lossless WebP": encoded(RGBA, "WEBP", lossless=True, exact=True),
    "GIF": encoded(RGB.quantize(64), "GIF"),
    "AVIF": encoded(RGB, "AVIF"),
    "BMP": encoded(RGB, "BMP"),
    "JPEG 2000": encoded(RGB, "JPEG2000"),
    "TIFF": rgb_tiff(NOISY, rowsperstrip=8),
    "deflated TIFF": rgb_tiff(NOISY, compression="zlib"),
    "TIFF in tiles": rgb_tiff(NOISY, tile=(16, 16)),
    "16-bit TIFF": rgb_tiff(WIDE[:, :, :3].copy(), rowsperstrip=16),
    "float TIFF in tiles": rgb_tiff(np.float32(WIDE / 65535), tile=(64, 48), extrasamples=[2]),
    "TIFF in planes": rgb_tiff(np.moveaxis(WIDE[:, :, :3], -1, 0).copy(), **PLANES),
    "TIFF of JPEG": encoded(RGB, "TIFF", compression="jpeg"),
}


def refuses(file: bytes, **given: int) -> bool:
    try:
        load_image(file, **given)
    except InputError as error:
        line = str(error)
        return BROKEN in line and not INTERNAL.search(line)
    return False


@pytest.mark.parametrize("name", FILES)
def test_what_is_cut_in_its_data_is_refused_and_the_whole_is_read(name):
    file = FILES[name]
    assert not refuses(file)
    for left in np.linspace(0.6, 0.95, 8):
        assert refuses(file[: int(left * len(file))]), left
    assert refuses(file[: len(file) // 2], needed=20)


@pytest.mark.parametrize("name", ["JPEG", "progressive JPEG"])
def test_jpeg_without_its_end_is_refused_and_more_bytes_after_it_are_not_read(name):
    file, whole = FILES[name], load_image(FILES[name])
    assert refuses(file[:-100])
    for more in (b"\xff\xd9", b"\xff\xd0\xff\xd8\xff\xda", bytes(999)):
        photo = load_image(file + more)
        np.testing.assert_array_equal(photo.pixels, whole.pixels)
        assert not photo.notes


def resampled(whole, height, width):
    """Pixels (h, w, channels) by Pillow: by the cubic filter if opaque, else by a triangle."""
    is_sharp = whole.shape[2] == 3
    alpha = whole[:, :, 3:] if whole.shape[2] == 4 else np.ones_like(whole[:, :, :1])
    filter_ = Image.Resampling.BICUBIC if is_sharp else Image.Resampling.BILINEAR
    planes = np.moveaxis(np.dstack([whole[:, :, :3] * alpha, alpha]), 2, 0)
    small = [np.asarray(Image.fromarray(p.copy()).resize((width, height), filter_)) for p in planes]
    color, weight = np.stack(small[:3], axis=2), small[3][:, :, None]
    color = np.divide(color, weight, out=np.zeros_like(color), where=weight > 0).clip(0, 1)
    return color if whole.shape[2] == 3 else np.dstack([color, weight])


OPAQUE = {"JPEG", "PNG", "16-bit PNG", "two levels", "BMP"}  # whose mode tells


@pytest.mark.parametrize("kind", FILES)
def test_reducing_while_decoding_is_reducing_afterwards(kind):
    file = FILES[kind]
    whole, header = load_image(file), header_of(file)
    level = LEVEL * (8 if "two levels" in kind else 1 if not has_alpha(whole.pixels) else 4)
    for size in ((WIDTH - 1, HEIGHT - 1), (101, 70), (49, 31), (16, 11)):
        photo = load_image(file, needed=lambda width, height, size=size: size)
        off = photo.pixels - resampled(whole.pixels, size[1], size[0])
        # A JPEG that is decoded at a fourth of its size has less of its noise.
        assert np.abs(off).mean() < (5 if size == (16, 11) else 1) * level
        # The whole numbers by which libvips weights 8 bits are off by half a level at times.
        assert np.abs(off.mean(axis=(0, 1))).max() < 0.8 * level
        assert (photo.width, photo.height) == size
        assert photo.original_size == whole.original_size == (WIDTH, HEIGHT)
        assert photo.notes == whole.notes
    for needed in (WIDTH, 10_000, lambda w, h: (w, h), lambda w, h: (w, 9 * h)):
        same = load_image(file, needed=needed).pixels
        assert same.tobytes() == whole.pixels.tobytes()
    assert (header.width, header.height) == (WIDTH, HEIGHT)
    assert has_alpha(whole.pixels) <= header.has_alpha <= (kind not in OPAQUE)


@pytest.mark.parametrize("source", [RGBA, np.asarray(RGBA), RGB, "opened"])
def test_what_is_in_memory_is_reduced_too_and_stays_whole(source):
    if isinstance(source, str):
        source = Image.open(io.BytesIO(encoded(RGB, "JPEG", quality=95)))
    photo = load_image(source, needed=50)
    whole = load_image(source).pixels
    off = np.abs(photo.pixels - shrunk(whole, photo.height, 50, sharp=True))
    assert off.mean() < 6 * LEVEL  # an average, a triangle and the cubic filter
    assert photo.original_size == (WIDTH, HEIGHT) == whole.shape[1::-1]


def test_a_tiff_is_never_whole_in_memory():
    file = rgb_tiff(np.zeros((3000, 1000, 3), np.uint16), rowsperstrip=30, compression="zlib")
    load_image(file, needed=50)  # what is loaded on first use
    tracemalloc.start()
    load_image(file, needed=50)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3000 * 1000 * 6 / 3
