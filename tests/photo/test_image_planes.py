"""A TIFF whose samples are stored plane by plane is the picture that is stored pixel by pixel."""

import io
import logging
import zlib

import numpy as np
import pytest
import tifffile
from pictures import encoded, tiff, tiff_file
from PIL import Image

from gauss2svg.errors import InputError
from gauss2svg.photo.load import load_image

RNG = np.random.default_rng(0)
VALUES = RNG.uniform(0.2, 1, (37, 45, 4))
KINDS = {  # photometric, channels, extra sample
    "colours": ("rgb", 3, None),
    "straight alpha": ("rgb", 4, "unassalpha"),
    "premultiplied alpha": ("rgb", 4, "assocalpha"),
    "unknown fourth": ("rgb", 4, "unspecified"),
    "grey and alpha": ("minisblack", 2, "unassalpha"),
    "inverted grey and alpha": ("miniswhite", 2, "unassalpha"),
    "inks": ("separated", 4, None),
}
TYPES = {"8": np.uint8, "16": np.uint16, "float": np.float32}
LAYOUTS = {"one strip": {}, "strips": {"rowsperstrip": 8}, "tiles": {"tile": (16, 32)}}


def planes(array, kind: str, **options) -> bytes:
    """A TIFF of (h, w, n) samples in planes."""
    photometric, _, extra = KINDS[kind]
    extras = {"extrasamples": [extra]} if extra else {}
    stored = np.ascontiguousarray(np.moveaxis(array, -1, 0))
    return tiff(stored, photometric=photometric, planarconfig="separate", **extras, **options)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("type_name", TYPES)
@pytest.mark.parametrize("kind", KINDS)
def test_planes_are_the_samples_that_were_stored(kind, type_name, compression, layout, order):
    photometric, channels, extra = KINDS[kind]
    values = VALUES[:, :, :channels].copy()
    premultiplied = values * values[:, :, -1:] if extra == "assocalpha" else values
    stored = np.dstack([premultiplied[:, :, :-1], values[:, :, -1:]])
    dtype = TYPES[type_name]
    top = 1 if dtype is np.float32 else np.iinfo(dtype).max
    samples = (stored * top).round().astype(dtype) if top > 1 else stored.astype(dtype)
    options = LAYOUTS[layout]
    photo = load_image(planes(samples, kind, compression=compression, byteorder=order, **options))
    color = values[:, :, :-1] if extra else values
    if photometric == "miniswhite":
        color = 1 - color
    if photometric == "separated":
        color = (1 - values[:, :, :3]) * (1 - values[:, :, 3:])
    # Dividing by an alpha of at least 0.2 enlarges the error of both, inks have 8 bits.
    levels = 255 if type_name == "8" or photometric == "separated" else 65535
    np.testing.assert_allclose(photo.pixels, color * np.ones(3), atol=6 / levels)
    if extra in (None, "unspecified"):
        assert photo.alpha is None
    else:
        np.testing.assert_allclose(photo.alpha, values[:, :, -1], atol=1 / levels)
    reduced = any(note.endswith("bits per channel reduced to 8") for note in photo.notes)
    assert reduced == (photometric == "separated" and type_name != "8")


def packed(samples, predictor: int) -> bytes:
    """The LZW data of (h, w, n) samples after a predictor (TIFF 6.0, section 14; note 3)."""
    height, _, count = samples.shape
    bytes_each = samples.itemsize
    stored = samples
    if predictor == 2:
        stored = samples.view(f"u{bytes_each}")
    elif predictor == 3:
        by_byte = samples.astype(f">f{bytes_each}").view(np.uint8).reshape(height, -1, bytes_each)
        stored = np.ascontiguousarray(np.moveaxis(by_byte, 2, 1)).reshape(height, -1, count)
    if predictor > 1:
        stored = np.concatenate([stored[:, :1], np.diff(stored, axis=1)], axis=1)
    data = stored.tobytes()
    flat = Image.frombytes("L", (len(data), 1), data)
    file = encoded(flat, "TIFF", compression="tiff_lzw", strip_size=len(data))
    with tifffile.TiffFile(io.BytesIO(file)) as tiff:
        page = tiff.pages[0]
        (begin,), (count,) = page.dataoffsets, page.databytecounts
    return file[begin : begin + count]


@pytest.mark.parametrize(
    ("dtype", "predictor"),
    [(np.uint16, 1), (np.uint16, 2), (np.float32, 1), (np.float32, 2), (np.float32, 3),
     (np.float16, 1), (np.float64, 1), (np.float64, 3)],
)  # fmt: skip
@pytest.mark.parametrize("count", [2, 4])
def test_kinds_that_pillow_does_not_know_may_be_compressed_by_lzw(count, dtype, predictor):
    top = 1 if np.dtype(dtype).kind == "f" else 65535
    samples = (VALUES[:, :, :count] * top).astype(dtype)
    photo = load_image(
        tiff_file(
            packed(samples, predictor), t256=45, t257=37, t258=[8 * samples.itemsize] * count,
            t259=5, t262=2 if count > 2 else 1, t277=count, t278=37, t317=predictor, t338=[2],
            t339=[3 if top == 1 else 1] * count,
        )
    )  # fmt: skip
    expected = samples.astype(np.float64) / top
    np.testing.assert_allclose(photo.pixels, expected[:, :, :-1] * np.ones(3), atol=1e-6)
    np.testing.assert_allclose(photo.alpha, expected[:, :, -1], atol=1e-6)


@pytest.mark.parametrize("kind", ["F", "I", "I;16"])
def test_compressed_grey_of_the_other_byte_order_is_the_same(kind):
    values = (VALUES[:, :, 0] * (1 if kind == "F" else 30000)).astype(
        {"F": ">f4", "I": ">i4", "I;16": ">i2"}[kind]
    )
    top = 1 if kind == "F" else 65535
    file = tiff(values, byteorder=">", compression="zlib", photometric="minisblack")
    photo = load_image(file)
    np.testing.assert_allclose(photo.pixels[:, :, 0], values / top, atol=1e-6)


def test_orientation_turns_planes_as_well():
    samples = np.uint16(VALUES[:, :, :3] * 65535)
    file = planes(samples, "colours", extratags=[(274, "H", 1, 6, True)])
    photo = load_image(file)
    np.testing.assert_allclose(photo.pixels, np.rot90(samples, -1) / 65535, atol=1e-7)


@pytest.mark.parametrize("separate", [False, True])
@pytest.mark.parametrize("bits", [1, 2, 4, 12])
def test_few_bits_of_a_tiff_spread_over_the_range(bits, separate):
    samples = RNG.integers(0, 1 << bits, (6, 9, 3), dtype=np.uint16)
    rows = np.moveaxis(samples, -1, 0).reshape(18, 9) if separate else samples.reshape(6, 27)
    digits = (rows[:, :, None] >> np.arange(bits)[::-1] & 1).astype(np.uint8)
    data = np.packbits(digits.reshape(len(rows), -1), axis=1)
    parts = [part.tobytes() for part in np.split(data, 3 if separate else 1)]
    file = tiff_file(
        *parts, t256=9, t257=6, t258=[bits] * 3, t259=1, t262=2, t277=3, t278=6,
        t284=1 + separate,
    )  # fmt: skip
    np.testing.assert_allclose(load_image(file).pixels, samples / (2**bits - 1), atol=1e-6)


def test_only_a_compressed_tiff_is_advised_to_be_saved_without_compression():
    for scheme, advice in ((1, "Try re-saving it"), (8, "Try saving it without compression")):
        stream = io.BytesIO()
        tifffile.imwrite(
            stream, np.zeros((4, 4, 3), np.float32), photometric="rgb",
            compression=None if scheme == 1 else "zlib", extratags=[(34675, "B", 4, b"abcd", True)],
        )  # fmt: skip
        file = stream.getvalue()
        with tifffile.TiffFile(io.BytesIO(file)) as tiff:
            begin = tiff.pages[0].dataoffsets[0]
            place = tiff.pages[0].tags[256].offset + 8
        file = file[:begin] + b"\xff" * 8 + file[begin + 8 :]
        if scheme == 1:
            file = file[:place] + b"\x7f\xff" + file[place + 2 :]
        with pytest.raises(InputError, match=advice) as caught:
            load_image(file)
        assert ("without" in str(caught.value)) == (scheme == 8)


def test_what_is_said_of_a_broken_tiff_is_not_printed_by_its_reader():
    with pytest.raises(InputError):
        load_image(tiff_file(b"", t256=4, t257=4, t258=[8] * 5, t262=2, t277=5))
    handlers = logging.getLogger("tifffile").handlers
    assert any(isinstance(handler, logging.NullHandler) for handler in handlers)


@pytest.mark.parametrize("compression", [1, 5, 8])
def test_a_strip_that_ends_early_is_named(compression):
    samples = (VALUES[:, :, :2] * 65535).astype(np.uint16)
    data = {1: samples.tobytes(), 5: packed(samples, 1), 8: zlib.compress(samples.tobytes())}
    tags = {"t256": 45, "t257": 37, "t258": [16, 16], "t262": 1, "t277": 2, "t278": 37}
    whole = data[compression]
    load_image(tiff_file(whole, t259=compression, **tags))
    short = tiff_file(whole[: len(whole) // 2], t259=compression, **tags)
    with pytest.raises(InputError, match=r"broken or truncated one: .* Try re-saving it"):
        load_image(short)
