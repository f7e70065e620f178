"""A file whose data end before its picture does is refused, in whichever format it is."""

import io
import struct
import time
import zlib
from collections.abc import Iterator

import numpy as np
import pytest
import tifffile
from pictures import chunk, encoded, png, tiff
from PIL import Image, features

from gauss2svg.errors import InputError
from gauss2svg.photo.load import load_image

RNG = np.random.default_rng(0)
SMOOTH = np.uint8(np.mgrid[:48, :64].sum(0)[:, :, None] * [2, 1, 1] + [20, 60, 100])
NOISY = Image.fromarray(SMOOTH + RNG.integers(0, 30, SMOOTH.shape, dtype=np.uint8))
ENDS_EARLY = r"must be a complete image; got a broken, truncated or unsupported: .*"
JPEGS = {
    "plain": {},
    "progressive": {"progressive": True},
    "all colours": {"subsampling": 0},
    "restarts": {"restart_marker_blocks": 3},
    "own codes": {"optimize": True, "quality": 40},
    "grey": {"mode": "L"},
    "inks": {"mode": "CMYK"},
}


def jpeg_of(name: str) -> bytes:
    options = dict(JPEGS[name])
    return encoded(NOISY.convert(options.pop("mode", "RGB")), "JPEG", **options)


def refuses(file: bytes) -> bool:
    try:
        load_image(file)
    except InputError as error:
        return "must be a complete image" in str(error)
    return False


def ends_of_scans(jpeg: bytes) -> Iterator[tuple[int, int]]:
    """Where the data of each scan begin and end; the pictures here have no thumbnail."""
    place = jpeg.find(b"\xff\xda")
    while place >= 0:
        begin = place + 2 + int.from_bytes(jpeg[place + 2 : place + 4], "big")
        end = begin
        while jpeg[end] != 0xFF or jpeg[end + 1] == 0 or 0xD0 <= jpeg[end + 1] < 0xD8:
            end += 1
        yield begin, end
        place = jpeg.find(b"\xff\xda", end)


@pytest.mark.parametrize("name", JPEGS)
def test_jpeg_whose_scans_end_early_is_refused(name):
    whole = jpeg_of(name)
    expected = load_image(whole).pixels
    for begin, end in ends_of_scans(whole):
        for left in (0, 0.1, 0.5, 0.9):
            data = whole[begin : begin + int(left * (end - begin))].rstrip(b"\xff")
            shorter = whole[:begin] + data + whole[end:]
            # One that says nothing changes nothing, and one that says little is noted.
            if not refuses(shorter):
                photo = load_image(shorter)
                changed = (photo.pixels != expected).any(axis=2).mean()
                assert changed == 0 or any("the rest is guessed" in note for note in photo.notes)
                assert changed < 0.1, (begin, left)
            assert refuses(whole[:begin] + data + b"\xff\xd9"), (begin, left)


def test_jpeg_without_its_last_scans_is_refused():
    whole = jpeg_of("progressive")
    *ends, _ = (end for _, end in ends_of_scans(whole))
    assert len(ends) > 3
    for end in ends:
        with pytest.raises(InputError, match="some of its scans are missing"):
            load_image(whole[:end] + b"\xff\xd9")


@pytest.mark.parametrize("name", ["plain", "progressive", "restarts", "grey"])
def test_jpeg_that_claims_more_rows_than_it_has_says_where_they_end(name):
    file = bytearray(jpeg_of(name))
    place = file.index(b"\xff\xc2" if name == "progressive" else b"\xff\xc0") + 5
    file[place : place + 2] = struct.pack(">H", 6550)
    with pytest.raises(InputError, match=r"its data end at row (\d+) of 6550") as caught:
        load_image(bytes(file))
    assert 40 <= int(str(caught.value).split("at row ")[1].split()[0]) <= 48


@pytest.mark.parametrize("name", JPEGS)
@pytest.mark.parametrize("size", [(1, 1), (7, 9), (8, 8), (17, 33), (64, 48)])
def test_whole_jpeg_is_read_whatever_follows_it(name, size):
    options = dict(JPEGS[name])
    picture = NOISY.crop((0, 0, *size)).convert(options.pop("mode", "RGB"))
    whole = encoded(picture, "JPEG", **options)
    expected = load_image(whole).pixels
    for more in (b"\xff\xd9", b"\xff\xd0\xff\xd8\xff\xc0", bytes(RNG.bytes(200)), whole[:90]):
        np.testing.assert_array_equal(load_image(whole + more).pixels, expected)


@pytest.mark.parametrize("interlaced", [False, True])
@pytest.mark.parametrize(("channels", "bits"), [(1, 1), (1, 4), (1, 16), (3, 8), (4, 16)])
def test_png_whose_rows_end_early_is_refused(channels, bits, interlaced):
    samples = RNG.integers(0, 1 << bits, (11, 13, channels))
    whole = png(samples, bits=bits, interlaced=interlaced)
    assert not refuses(whole)
    place = whole.index(b"IDAT") - 4
    rows = zlib.decompress(whole[place + 8 : -16])
    last_row = 1 + -(-13 * channels * bits // 8)
    for left in (0, len(rows) // 2, len(rows) - last_row, len(rows) - 1):
        packed = zlib.compress(rows[:left])  # complete in itself
        for data in ((packed,), (packed[:5], packed[5:])):
            parts = b"".join(chunk(b"IDAT", part) for part in data)
            assert refuses(whole[:place] + parts + chunk(b"IEND", b""))
    assert not refuses(whole[:place] + chunk(b"IDAT", zlib.compress(rows + b"abc")) + whole[-12:])


@pytest.mark.parametrize("width", [1000, 1023, 262143, 349525, 600001])
def test_png_that_packs_well_is_whole(width):
    assert not refuses(png(np.zeros((3, width, 3), np.uint8)))


def test_time_grows_no_faster_than_a_file_of_markers():
    whole = jpeg_of("plain")
    (begin, end), *_ = ends_of_scans(whole)
    filled = whole[:end] + b"\xff" * 1_000_000 + whole[end:]
    begun = time.process_time()
    np.testing.assert_array_equal(load_image(filled).pixels, load_image(whole).pixels)
    short = whole[: (begin + end) // 2].rstrip(b"\xff")
    assert refuses(short + b"\xff" * 1_000_000 + b"\xff\xd9")
    scan = whole[whole.index(b"\xff\xda") : end]
    refuses(whole[:end] + scan[:14] * 50_000 + whole[end:])  # or not
    assert time.process_time() - begun < 2


def without(file: bytes, tag: int, kept: int) -> bytes:
    """A TIFF whose tag has zeros from the kept one on."""
    with tifffile.TiffFile(io.BytesIO(file)) as tiff:
        found = tiff.pages[0].tags[tag]
    size = {3: 2, 4: 4}[int(found.dtype)]
    assert found.count > kept + 1
    begin, end = (found.valueoffset + size * n for n in (kept, found.count))
    return file[:begin] + bytes(end - begin) + file[end:]


TIFFS = {
    "bytes": (np.asarray(NOISY), {}),
    "deflated": (np.asarray(NOISY), {"compression": "zlib"}),
    "16 bits": (np.asarray(NOISY).astype(np.uint16) * 257, {}),
    "16-bit alpha": (RNG.integers(0, 65536, (48, 64, 4), np.uint16), {"extrasamples": [2]}),
    "floats": (np.float32(np.asarray(NOISY) / 255), {}),
    "deflated floats": (np.float32(np.asarray(NOISY) / 255), {"compression": "zlib"}),
}


@pytest.mark.parametrize("name", TIFFS)
@pytest.mark.parametrize("parts", [{"rowsperstrip": 8}, {"tile": (16, 16)}])
@pytest.mark.parametrize("planar", ["contig", "separate"])
def test_tiff_without_some_of_its_parts_says_how_many(name, parts, planar):
    array, options = TIFFS[name]
    array = np.moveaxis(array, 2, 0).copy() if planar == "separate" else array
    whole = tiff(array, photometric="rgb", planarconfig=planar, **parts, **options)
    load_image(whole)
    offsets, counts = (324, 325) if "tile" in parts else (273, 279)
    number = (6 if "rowsperstrip" in parts else 12) * (array.shape[0] if planar != "contig" else 1)
    for tag in (offsets, counts):
        for kept in (0, 1, number - 2):
            with pytest.raises(InputError, match=ENDS_EARLY) as caught:
                load_image(without(whole, tag, kept))
            lacking = f"{number - kept} of its {number} strips or tiles have no data"
            assert lacking in str(caught.value) or "decoder error" in str(caught.value)


def test_tiff_that_claims_more_rows_than_it_has_is_refused():
    for name in ("bytes", "floats"):
        array, _ = TIFFS[name]
        file = tiff(array, photometric="rgb", rowsperstrip=8)
        with tifffile.TiffFile(io.BytesIO(file)) as pages:
            tag = pages.pages[0].tags[257]
        at, size = tag.valueoffset, {3: 2, 4: 4}[int(tag.dtype)]
        with pytest.raises(InputError, match="812 of its 818 strips or tiles have no data"):
            load_image(file[:at] + (6544).to_bytes(size, "little") + file[at + size :])


@pytest.mark.parametrize("compression", ["jpeg", "group3", "group4", "tiff_ccitt"])
@pytest.mark.parametrize("strip_size", [65536, 1600])
def test_compressed_part_of_a_tiff_that_ends_early_is_refused(compression, strip_size):
    picture = NOISY if compression == "jpeg" else NOISY.convert("1")
    options = {
        "compression": compression,
        "strip_size": strip_size // (1 if picture == NOISY else 8),
    }
    whole = encoded(picture, "TIFF", **options)
    assert not refuses(whole)
    with tifffile.TiffFile(io.BytesIO(whole)) as tiff:
        tag = tiff.pages[0].tags[279]
    for left in (0.1, 0.3, 0.6, 0.9):
        last = int(left * tag.value[-1])
        size = {3: 2, 4: 4}[int(tag.dtype)]
        at = tag.valueoffset + size * (tag.count - 1)
        file = whole[:at] + last.to_bytes(size, "little") + whole[at + size :]
        assert refuses(file), left
        if compression == "jpeg":  # complete in itself
            begin = tifffile.TiffFile(io.BytesIO(whole)).pages[0].tags[273].value[-1]
            end = begin + max(last, whole.index(b"\xff\xda", begin) + 14 - begin)
            assert refuses(whole[:end].rstrip(b"\xff") + b"\xff\xd9" + whole[end + 2 :]), left


@pytest.mark.parametrize(
    "name", ["GIF", "lossless WEBP", "WEBP", "alpha WEBP", "BMP", "RLE", "AVIF"]
)
def test_other_formats_that_end_early_are_refused_by_their_decoders(name):
    if name == "AVIF" and not features.check("avif"):
        pytest.skip("this build of Pillow has no AVIF")
    for left in (0.6, 0.8, 0.95):
        assert refuses(ended(name, left)), left
    assert not refuses(ended(name, 1))


def ended(name: str, left: float) -> bytes:
    """A file whose lengths agree, of a share of its data."""
    if name == "GIF":
        file = encoded(NOISY.quantize(16), "GIF")
        short = encoded(NOISY.quantize(16).crop((0, 0, 64, round(48 * left))), "GIF")
        place = short.index(b",\0\0\0\0")
        return short[:6] + file[6:10] + short[10 : place + 5] + file[6:10] + short[place + 9 :]
    if name == "RLE":
        file = encoded(NOISY.quantize(16), "BMP")
        start = int.from_bytes(file[10:14], "little")
        rows = b"".join(bytes((64, row, 0, 0)) for row in range(round(48 * left))) + b"\0\1"
        head = file[:30] + struct.pack("<II", 1, len(rows)) + file[38:start]
        return head[:28] + b"\x08\0" + head[30:] + rows
    if name.endswith("WEBP"):
        picture = NOISY.copy()
        if name.startswith("alpha"):
            picture.putalpha(Image.fromarray(RNG.integers(0, 256, (48, 64), dtype=np.uint8)))
        file = encoded(picture, "WEBP", lossless=name.startswith("lossless"))
        place = file.index({"a": b"ALPH", "l": b"VP8L", "W": b"VP8 "}[name[0]])
        length = int.from_bytes(file[place + 4 : place + 8], "little")
        kept = int(length * left) & ~1 if left < 1 else length
        rest = file[place + 8 + length + length % 2 :]
        body = file[:place] + file[place : place + 4] + struct.pack("<I", kept)
        body += file[place + 8 : place + 8 + kept + kept % 2] + rest
        return body[:4] + struct.pack("<I", len(body) - 8) + body[8:]
    file = encoded(NOISY, name)
    if name == "BMP" or left == 1:
        return file[: int(left * len(file))]
    start = file.index(b"mdat")
    return file[: start + int(left * (len(file) - start))]
