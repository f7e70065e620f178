"""A photo that is reduced while it is decoded is the whole one, reduced afterwards by Pillow."""

import tracemalloc
from functools import partial

import numpy as np
import pytest
from pictures import chunk, encoded, png, tiff
from PIL import Image, ImageCms

from gauss2svg.errors import InputError
from gauss2svg.photo.load import header_of, load_image
from gauss2svg.photo.pixels import pixels_of, shrunk

RNG = np.random.default_rng(0)
HEIGHT, WIDTH = 151, 217
SMOOTH = np.stack(
    [np.sin(np.mgrid[:HEIGHT, :WIDTH].sum(0) / k) * 90 + 120 for k in (31, 47, 19)], axis=2
)
NOISY = (SMOOTH + RNG.integers(-15, 16, SMOOTH.shape)).round().astype(np.uint8)
RGB = Image.fromarray(NOISY)
ALPHA = RNG.integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8)
ALPHA[:80, :90] = 0
RGBA = Image.fromarray(np.dstack([NOISY, ALPHA]))
WIDE = np.dstack([NOISY, ALPHA]).astype(np.uint16) * 257
P3 = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


rgb_tiff = partial(tiff, photometric="rgb")


LOSSLESS = {
    "PNG": lambda: encoded(RGB, "PNG"),
    "RGBA PNG": lambda: encoded(RGBA, "PNG"),
    "16-bit PNG": lambda: png(WIDE[:, :, :3], bits=16),
    "palette PNG": lambda: encoded(RGB.quantize(64), "PNG"),
    "clear colour PNG": lambda: png(NOISY // 64, chunk(b"tRNS", b"\0\2\0\2\0\2"), bits=8),
    "two levels": lambda: encoded(RGB.convert("1"), "PNG"),
    "WEBP": lambda: encoded(RGBA, "WEBP", lossless=True, exact=True),
    "GIF": lambda: encoded(RGB.quantize(64), "GIF"),
    "BMP": lambda: encoded(RGB, "BMP"),
    "16-bit TIFF": lambda: rgb_tiff(WIDE[:, :, :3].copy(), rowsperstrip=16),
    "float TIFF in tiles": lambda: rgb_tiff(
        np.float32(WIDE / 65535), tile=(64, 48), extrasamples=[2]
    ),
    "TIFF in planes": lambda: rgb_tiff(
        np.moveaxis(WIDE[:, :, :3], -1, 0).copy(), planarconfig="separate", rowsperstrip=7
    ),
    "premultiplied": lambda: rgb_tiff(WIDE, extrasamples=[1], planarconfig="contig"),
}


LEVEL = 1 / 255


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


OPAQUE = {"PNG", "16-bit PNG", "two levels", "BMP"}  # whose mode tells


@pytest.mark.parametrize("kind", LOSSLESS)
def test_reducing_while_decoding_is_reducing_afterwards(kind):
    file = LOSSLESS[kind]()
    whole, header = load_image(file), header_of(file)
    for size in ((WIDTH - 1, HEIGHT - 1), (101, 70), (49, 31)):
        photo = load_image(file, needed=lambda width, height, size=size: size)
        off = np.abs(pixels_of(photo) - resampled(pixels_of(whole), size[1], size[0]))
        assert off.mean() < (8 if kind == "two levels" else 4) * LEVEL
        assert (photo.width, photo.height) == size
        assert photo.full == whole.full == (WIDTH, HEIGHT)
        assert photo.notes == whole.notes
    for needed in (WIDTH, 10_000, lambda w, h: (w, h), lambda w, h: (w, 9 * h)):
        same = pixels_of(load_image(file, needed=needed))
        assert same.tobytes() == pixels_of(whole).tobytes()
    assert (header.width, header.height) == (WIDTH, HEIGHT)
    assert (whole.alpha is not None) <= header.has_alpha <= (kind not in OPAQUE)


JPEGS = {
    "plain": {}, "progressive": {"progressive": True}, "grey": {"mode": "L"},
    "all colours": {"subsampling": 0, "quality": 95}, "inks": {"mode": "CMYK"},
    "profile": {"icc_profile": P3},
}  # fmt: skip


@pytest.mark.parametrize("kind", JPEGS)
def test_colours_of_a_jpeg_are_within_a_level(kind):
    options = dict(JPEGS[kind])
    large = RGB.resize((4 * WIDTH, 4 * HEIGHT), Image.Resampling.BICUBIC)
    file = encoded(large.convert(options.pop("mode", "RGB")), "JPEG", **options)
    whole = load_image(file)
    for times in (1, 3, 4.1, 8, 13):
        side = int(4 * WIDTH / times)
        photo = load_image(file, needed=side)
        assert max(photo.width, photo.height) == side
        assert photo.full == (4 * WIDTH, 4 * HEIGHT)
        assert photo.notes == whole.notes
        off = 255 * (photo.pixels - resampled(whole.pixels, photo.height, photo.width))
        assert np.abs(off).mean() < 1
        assert np.quantile(np.abs(off), 0.98) < 2
        # The whole numbers by which libvips weights 8 bits are off by half a level at times.
        assert np.abs(off.mean(axis=(0, 1))).max() < 0.6
    with pytest.raises(InputError, match="premature end"):
        load_image(file[: len(file) // 2], needed=20)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("name", ["JPEG", "PNG", "TIFF"])
def test_orientation_is_applied_after_reducing(name, orientation):
    exif = Image.Exif()
    exif[0x0112] = orientation
    file = encoded(Image.fromarray(SMOOTH.astype(np.uint8)), name, exif=exif)
    whole, photo = load_image(file), load_image(file, needed=60)
    assert photo.full == whole.full == (whole.width, whole.height)
    assert max(photo.width, photo.height) == 60
    off = photo.pixels - resampled(whole.pixels, photo.height, photo.width)
    assert np.abs(off).mean() < LEVEL


@pytest.mark.parametrize("source", [RGBA, np.asarray(RGBA), RGB])
def test_what_is_in_memory_is_reduced_too(source):
    photo = load_image(source, needed=50)
    whole = pixels_of(load_image(source))
    off = np.abs(pixels_of(photo) - shrunk(whole, photo.height, 50, sharp=True))
    assert off.mean() < 6 * LEVEL  # an average, a triangle and the cubic filter
    assert photo.full == (WIDTH, HEIGHT)
    whole = load_image(source, matte=(1, 0.5, 0)).pixels
    photo = load_image(source, matte=(1, 0.5, 0), needed=60)
    assert np.abs(photo.pixels - shrunk(whole, photo.height, 60)).mean() < 4 * LEVEL


def test_a_tiff_is_never_whole_in_memory():
    file = rgb_tiff(np.zeros((3000, 1000, 3), np.uint16), rowsperstrip=30, compression="zlib")
    load_image(file, needed=50)  # what is loaded on first use
    tracemalloc.start()
    load_image(file, needed=50)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3000 * 1000 * 6 / 3
