"""A file whose data end before its picture does is refused, in whichever format it is."""

import io
import zlib

import numpy as np
import pytest
import tifffile
from pictures import chunk, encoded, png, tiff
from PIL import Image

from gauss2svg.errors import InputError
from gauss2svg.photo.load import load_image

RNG = np.random.default_rng(0)
SMOOTH = np.uint8(np.mgrid[:48, :64].sum(0)[:, :, None] * [2, 1, 1] + [20, 60, 100])
NOISY = Image.fromarray(SMOOTH + RNG.integers(0, 30, SMOOTH.shape, dtype=np.uint8))
REFUSED = "must be a complete image of a supported kind; got one that is broken, truncated or"
ALPHA = NOISY.copy()
ALPHA.putalpha(Image.fromarray(RNG.integers(0, 256, (48, 64), dtype=np.uint8)))
BILEVEL, INDEXED = NOISY.convert("1"), NOISY.quantize(16)
TILED = {"photometric": "rgb", "tile": (16, 16)}
FILES = {
    "JPEG": encoded(NOISY, "JPEG"),
    "progressive JPEG": encoded(NOISY, "JPEG", progressive=True),
    "JPEG with restarts": encoded(NOISY, "JPEG", restart_marker_blocks=3),
    "PNG": encoded(NOISY, "PNG"),
    "16-bit interlaced PNG": png(np.uint16(NOISY) * 257, bits=16, interlaced=True),
    "WebP": encoded(NOISY, "WEBP"),
    "lossless WebP": encoded(ALPHA, "WEBP", lossless=True),
    "GIF": encoded(INDEXED, "GIF"),
    "AVIF": encoded(NOISY, "AVIF"),
    "BMP": encoded(NOISY, "BMP"),
    "JPEG 2000": encoded(NOISY, "JPEG2000"),
    "TIFF": tiff(np.asarray(NOISY), photometric="rgb", rowsperstrip=8),
    "deflated TIFF": tiff(np.asarray(NOISY), photometric="rgb", compression="zlib"),
    "TIFF in tiles": tiff(np.asarray(NOISY), **TILED),
    "TIFF of JPEG": encoded(NOISY, "TIFF", compression="jpeg"),
    "TIFF of fax 4": encoded(BILEVEL, "TIFF", compression="group4"),
}


def refuses(file: bytes) -> bool:
    try:
        load_image(file)
    except InputError as error:
        return REFUSED in str(error) and "\n" not in str(error)
    return False


@pytest.mark.parametrize("name", FILES)
def test_what_is_cut_in_its_data_is_refused_and_the_whole_is_read(name):
    file = FILES[name]
    assert not refuses(file)
    for left in np.linspace(0.6, 0.95, 8):
        assert refuses(file[: int(left * len(file))]), left


@pytest.mark.parametrize("name", ["JPEG", "progressive JPEG"])
def test_jpeg_without_its_end_marker_is_read_with_a_note(name):
    file, whole = FILES[name], load_image(FILES[name])
    for cut in (1, 2):
        photo = load_image(file[:-cut])
        np.testing.assert_array_equal(photo.pixels, whole.pixels)
        assert photo.notes == (*whole.notes, "its end marker is missing")
        preview = b"\xff\xef" + (len(file) + 2).to_bytes(2, "big") + file
        assert load_image(file[:2] + preview + file[2:-cut]).notes == photo.notes
    assert refuses(file[:-100])
    assert refuses(file[:-100] + b"\xff\xd9")  # complete in itself
    for more in (b"\xff\xd9", b"\xff\xd0\xff\xd8\xff\xda", bytes(RNG.bytes(200)), bytes(999)):
        photo = load_image(file + more)
        np.testing.assert_array_equal(photo.pixels, whole.pixels)
        assert not photo.notes
    if name == "progressive JPEG":  # without its last scans
        shorter = load_image(file[: file.rindex(b"\xff\xda")] + b"\xff\xd9").pixels
        assert np.abs(shorter - whole.pixels).mean() < 8 / 255


def test_png_with_text_that_is_no_unicode_is_read():
    text = chunk(b"tEXt", b"\x93key\x94\0\x94") + chunk(b"iTXt", b"a\0\0\0\0\0\x94")
    assert not refuses(png(RNG.integers(0, 255, (5, 4, 3)), text))


@pytest.mark.parametrize("interlaced", [False, True])
@pytest.mark.parametrize(("channels", "bits"), [(1, 1), (1, 4), (1, 16), (3, 8), (4, 16)])
def test_png_whose_rows_end_early_is_refused(channels, bits, interlaced):
    samples = RNG.integers(0, 1 << bits, (11, 13, channels))
    whole = png(samples, bits=bits, interlaced=interlaced)
    place = whole.index(b"IDAT") - 4
    rows = zlib.decompress(whole[place + 8 : -16])
    for left in (0, len(rows) // 2, len(rows) - 1):
        packed = zlib.compress(rows[:left])  # complete in itself
        assert refuses(whole[:place] + chunk(b"IDAT", packed) + whole[-12:])
    assert not refuses(whole[:place] + chunk(b"IDAT", zlib.compress(rows + b"abc")) + whole[-12:])


def without(file: bytes, tag: int) -> bytes:
    """A TIFF whose tag has zeros after its first value."""
    with tifffile.TiffFile(io.BytesIO(file)) as pages:
        found = pages.pages[0].tags[tag]
    size = {3: 2, 4: 4}[int(found.dtype)]
    begin, end = (found.valueoffset + size * n for n in (1, found.count))
    return file[:begin] + bytes(end - begin) + file[end:]


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("array", [np.asarray(NOISY), np.float32(NOISY) / 255])
def test_tiff_without_some_of_its_parts_is_refused(array, compression):
    for parts, tags in (({"rowsperstrip": 8}, (273, 279)), ({"tile": (16, 16)}, (324, 325))):
        whole = tiff(array, photometric="rgb", compression=compression, **parts)
        assert not refuses(whole)
        for tag in tags:
            with pytest.raises(InputError):
                load_image(without(whole, tag))
