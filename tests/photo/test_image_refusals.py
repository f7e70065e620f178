"""Whatever is not a photo, or broken, or too large, gives one line and exit status 2."""

import os
import struct
import zlib

import numpy as np
import pytest
from pictures import BROKEN, DATA, chunk, encoded, png, tiff
from PIL import Image

from gauss2svg.batch.inputs import is_picture
from gauss2svg.cli.main import main
from gauss2svg.errors import InputError
from gauss2svg.photo import DEFAULT_MAX_PIXELS, FORMATS
from gauss2svg.photo.load import load_image

RNG = np.random.default_rng(0)
BYTES = RNG.integers(0, 256, (12, 19, 3), dtype=np.uint8)
PICTURE = Image.fromarray(BYTES)
HEIC = (DATA / "turned.heic").read_bytes()


def psd_of(array) -> bytes:
    """A Photoshop file of one picture without layers."""
    height, width, channels = array.shape
    head = b"8BPS" + struct.pack(">H6xHIIHH", 1, channels, height, width, 8, 3)
    return head + bytes(12) + b"\0\0" + np.moveaxis(array, 2, 0).tobytes()


def file_of(name: str) -> bytes:
    """A file of 19x12 px of a format; HEIC has 16x24."""
    if name == "HEIC":
        return HEIC
    if name == "PSD":
        return psd_of(BYTES)
    sizes = {"sizes": [PICTURE.size]} if name == "ICO" else {}
    return encoded(PICTURE, name.replace(" ", ""), **sizes)


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_read_under_all_of_its_names(name, tmp_path):
    for suffix in FORMATS[name].suffixes:
        path = tmp_path / f"photo{suffix}"
        path.write_bytes(file_of(name))
        assert is_picture(path.name.upper())
        pixels = load_image(path).pixels
        assert pixels.shape == ((24, 16, 3) if name == "HEIC" else BYTES.shape)
        if name in ("PSD", "ICO"):
            np.testing.assert_allclose(pixels, BYTES / 255, atol=1e-6)
    assert not set(FORMATS[name].suffixes) & {".jxl"}  # which the studio refuses by name


@pytest.mark.parametrize("name", [*FORMATS, "array", "image"])
def test_limit_of_pixels_holds_for_every_format(name):
    file = {"array": BYTES, "image": PICTURE}.get(name)
    file = file_of(name) if file is None else file
    photo = load_image(file)
    count = photo.width * photo.height
    assert load_image(file, max_pixels=count).height == photo.height
    with pytest.raises(InputError, match=rf"at most {count - 1} px \(--max-pixels\); got .* px"):
        load_image(file, max_pixels=count - 1)
    if name in ("GIF", "WEBP", "PNG", "TIFF"):
        frames = encoded(PICTURE, name, save_all=True, append_images=[PICTURE.rotate(180)])
        with pytest.raises(InputError, match="at most 227 px"):
            load_image(frames, max_pixels=227)
    assert Image.MAX_IMAGE_PIXELS == DEFAULT_MAX_PIXELS  # as Pillow has it by itself


@pytest.mark.posix
def test_chunk_that_unpacks_to_much_takes_no_memory_and_stops_no_picture():
    import resource

    packed = zlib.compress(bytes(200_000_000), 1)
    for kind in (b"iCCP", b"zTXt", b"iTXt"):
        head = b"x\0\1\0\0\0" if kind == b"iTXt" else b"x\0\0"
        file = png(BYTES, chunk(kind, head + packed))
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        np.testing.assert_allclose(load_image(file).pixels, BYTES / 255, atol=1e-7)
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", f"must be a supported image ({', '.join(FORMATS)})"),
        (b"hello, this is a text", "got an unknown format. Try converting it"),
        (b'<svg xmlns="http://www.w3.org/2000/svg"/>', "got an SVG or other XML"),
        (b"<!DOCTYPE html><html></html>", "got a web page. Try another copy of it"),
        (b"\0\0\0\x18ftypmif1\0\0\0\0mif1heic\0\0\0\x08meta", BROKEN),
        (b"\x1f\x8b\x08" + bytes(20), "got a gzipped file"),
        (b"II*\0\x10\0\0\0CR\2\0" + bytes(20), "got a camera's raw file. Try converting it"),
        (png(np.zeros((0, 4, 3), np.uint8)), BROKEN),
        (png(BYTES)[:-16] + bytes(4) + png(BYTES)[-12:], BROKEN),  # a wrong checksum of its pixels
        (tiff(np.float32([[0, 1.5]])), "must be finite and in 0..1; got 1.5"),
        (tiff(np.int32([[-5, 7]])), "samples of type int, 1 for each pixel"),
        (png(np.zeros((1, 1, 3)), size=(50000, 40000)),
         f"{DEFAULT_MAX_PIXELS} px (--max-pixels); got 50000x40000 = 2000000000 px. Try shrinking"),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore")  # Pillow's
def test_file_that_is_no_photo_is_refused_by_what_it_is(data, message, tmp_path):
    path = tmp_path / "x.jpg"
    path.write_bytes(data)
    with pytest.raises(InputError) as refusal:
        load_image(path)
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.posix
def test_folders_pipes_and_devices_are_refused_unread(tmp_path, refusal):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    places = {
        tmp_path / "no.jpg": "No such file", tmp_path: "Try gauss2svg batch",
        "https://a.org/b.jpg": "or gauss2svg batch for URLs",
        pipe: "it is not a regular file", "/dev/zero": "it is not a regular file",
        "a\n\x1bred.jpg": r"cannot read a \x1bred.jpg: No such file",
        "bad\udcff.png": "cannot read bad\\udcff.png",
    }  # fmt: skip
    for place, message in places.items():
        line = refusal(place, "-o", tmp_path / "o.svg", "--quiet")
        assert message in line
        assert line.removesuffix("\n").isprintable()
    with pytest.raises(InputError, match="embedded null byte"):
        load_image("a\0b.png")


@pytest.mark.parametrize("compression", ["tiff_lzw", "tiff_adobe_deflate"])
def test_libraries_add_no_lines_to_ours_and_files_cannot_steer_the_terminal(
    compression, tmp_path, capfd
):
    broken = bytearray(encoded(PICTURE, "TIFF", compression=compression))
    broken[8:300] = RNG.integers(0, 256, 292, dtype=np.uint8).tobytes()
    for data in (bytes(broken), png(BYTES, chunk(b"\x1b[3m", b"\x1b[31m"))):
        path = tmp_path / "x.tif"
        path.write_bytes(data)
        assert main([str(path), "-o", str(tmp_path / "o.svg"), "--quiet"]) == 2
        err = capfd.readouterr().err
        assert err.count("\n") == 1
        assert err.removesuffix("\n").isprintable()
