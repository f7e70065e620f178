"""Whatever is not a photo, or broken, or too large, gives one line and exit status 2."""

import io
import os
import struct
import subprocess
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from flat import vectorize
from pictures import chunk, encoded, png, tiff
from PIL import Image

from gauss2svg.batch.inputs import is_picture
from gauss2svg.cli.main import main
from gauss2svg.errors import InputError
from gauss2svg.photo.formats import DEFAULT_MAX_PIXELS, FORMATS, MOST_PIXELS
from gauss2svg.photo.load import load_image
from gauss2svg.photo.photo import Photo
from gauss2svg.studio.uploads import REFUSED

RNG = np.random.default_rng(0)
BYTES = RNG.integers(0, 256, (12, 19, 3), dtype=np.uint8)
BROKEN = "must be a complete image of a supported kind; got one that is broken, truncated or"
PICTURE = Image.fromarray(BYTES)
HEIC = (Path(__file__).parents[1] / "data" / "turned.heic").read_bytes()


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
        photo = load_image(path)
        assert photo.pixels.shape == ((24, 16, 3) if name == "HEIC" else BYTES.shape)
        if name in ("PNG", "TIFF", "BMP", "PSD", "ICO", "JPEG 2000"):
            np.testing.assert_allclose(photo.pixels, BYTES / 255, atol=1e-6)
    assert not set(FORMATS[name].suffixes) & set(REFUSED)


def bmp_of(width: int, height: int) -> bytes:
    return b"BM" + struct.pack("<IHHIIiiHHIIiiII", 54, 0, 0, 54, 40, width, height, 1, 24, *[0] * 6)


def tiff_of(*entries: tuple[int, int, int]) -> bytes:
    """A TIFF of one directory of numbers."""
    tags = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in entries)
    return b"II*\0\x08\0\0\0" + struct.pack("<H", len(entries)) + tags + bytes(4)


def float_tiff(array) -> bytes:
    return tiff(array, photometric="rgb" if array.ndim == 3 else "minisblack")


def png_head(width: int, height: int) -> bytes:
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", b"") + chunk(b"IEND", b"")


def gif_head(width: int, height: int) -> bytes:
    frame = b"," + struct.pack("<HHHHB", 0, 0, width, height, 0) + b"\x08\x01\0\0;"
    return b"GIF89a" + struct.pack("<HHBBB", width, height, 0x80, 0, 0) + bytes(6) + frame


def webp_head(width: int, height: int) -> bytes:
    sides = b"".join((side - 1).to_bytes(3, "little") for side in (width, height))
    chunks = b"VP8X" + struct.pack("<I", 10) + bytes(4) + sides
    return b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WEBP" + chunks


def jpeg_head(width: int, height: int) -> bytes:
    file = bytearray(encoded(Image.new("L", (8, 8)), "JPEG"))
    place = file.index(b"\xff\xc0") + 5
    file[place : place + 4] = struct.pack(">HH", height, width)
    return bytes(file)


BOMBS = {
    "PNG": png_head(50000, 40000),
    "BMP": bmp_of(50000, 40000),
    "GIF": gif_head(50000, 40000),
    "JPEG": jpeg_head(50000, 40000),
    "TIFF": tiff_of((256, 4, 50000), (257, 4, 40000), (258, 3, 8), (262, 3, 1), (273, 4, 8)),
    "float TIFF": tiff_of(
        (256, 4, 50000), (257, 4, 40000), (258, 3, 32), (262, 3, 2), (273, 4, 8), (277, 3, 3),
        (278, 4, 40000), (279, 4, 8), (339, 3, 3),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BOMBS)
def test_bomb_is_refused_before_it_is_decoded(name, tmp_path, capsys):
    path = tmp_path / "bomb"
    path.write_bytes(BOMBS[name])
    assert main([str(path), "-o", str(tmp_path / "o.svg"), "--quiet"]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert "2000000000" in line
    assert f"at most {DEFAULT_MAX_PIXELS} px (--max-pixels)" in line
    assert line.endswith("px. Try shrinking it\n")  # no limit is so high
    assert sorted(tmp_path.iterdir()) == [path]


def test_animated_bomb_is_refused_as_well():
    with pytest.raises(InputError, match=r"must be at most 89478485 px|broken"):
        load_image(webp_head(16000, 16000))
    frames = [Image.new("RGB", (40, 30), (level, 0, 0)) for level in (200, 100)]
    for name in ("GIF", "WEBP", "PNG", "TIFF"):
        file = encoded(frames[0], name, save_all=True, append_images=frames[1:])
        with pytest.raises(InputError, match=r"must be at most 1199 px .*; got 40x30 = 1200 px"):
            load_image(file, max_pixels=1199)


@pytest.mark.parametrize("name", FORMATS)
def test_limit_of_pixels_holds_for_every_format(name):
    file = file_of(name)
    photo = load_image(file)
    count = photo.width * photo.height
    assert load_image(file, max_pixels=count).height == photo.height
    with pytest.raises(InputError, match=rf"at most {count - 1} px \(--max-pixels\); got .* px"):
        load_image(file, max_pixels=count - 1)


def test_limit_of_pixels_is_heeded_by_both_commands(tmp_path, drawn_here, capsys):
    path, svg = tmp_path / "photo.png", tmp_path / "o.svg"
    path.write_bytes(encoded(Image.fromarray(BYTES), "PNG"))
    result = vectorize(path, gaussians=2, iterations=1, max_pixels=228)
    result.save(svg)
    before = svg.read_bytes()
    few = ["--quiet", "--max-pixels", "227"]
    advice = f"raising --max-pixels, up to {MOST_PIXELS}"
    assert main([str(path), "-o", str(svg), *few]) == 2
    assert main(["check", str(path), str(svg), *few]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == lines[1]
    assert advice in lines[0]
    assert "at most 227 px (--max-pixels); got 19x12 = 228 px" in lines[0]
    assert svg.read_bytes() == before
    assert main(["check", str(path), str(svg), "--quiet", "--max-pixels", "228"]) == 0
    for command in (["--help-all"], ["check", "--help"]):
        assert main(command) == 0
        assert f"{DEFAULT_MAX_PIXELS}" in capsys.readouterr().out


def test_limit_of_the_process_is_left_alone_and_changes_nothing(monkeypatch):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 20)
    for name in ("PNG", "WEBP", "TIFF", "GIF", "BMP"):
        assert load_image(file_of(name)).pixels.shape == BYTES.shape
    assert Image.MAX_IMAGE_PIXELS == 20


@pytest.mark.posix
@pytest.mark.parametrize("kind", [b"iCCP", b"zTXt", b"iTXt"])
def test_chunk_that_unpacks_to_much_takes_no_memory_and_stops_no_picture(kind):
    import resource

    packed = zlib.compress(bytes(200_000_000), 6)
    head = b"x\0\1\0\0\0" if kind == b"iTXt" else b"x\0\0"
    file = png(BYTES, chunk(kind, head + packed))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    np.testing.assert_allclose(load_image(file).pixels, BYTES / 255, atol=1e-7)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", f"must be a supported image ({', '.join(FORMATS)})"),
        (b"", "got an empty file"),
        (b"hello, this is a text", "got an unknown format. Try converting it"),
        (b'<svg xmlns="http://www.w3.org/2000/svg"/>', "got an SVG or other XML"),
        (b'<?xml version="1.0"?><svg/>', "got an SVG or other XML"),
        (b"<!DOCTYPE html><html></html>", "got a web page"),
        (b"%PDF-1.7\n", "got a PDF"),
        (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "got a PostScript file"),
        (b"\0\0\0\x18ftypmif1\0\0\0\0mif1heic\0\0\0\x08meta", BROKEN),
        (b"\0\0\0\x20ftypisom" + bytes(20), "got a video"),
        (b"\0\0\0\x0cjP  \r\n\x87\n", BROKEN),
        (b"\x1f\x8b\x08" + bytes(20), "got a gzipped file"),
        (b"P6 2 2 255\n" + bytes(12), "got a Netpbm file"),
        (b"8BPS\0\1" + bytes(20), BROKEN),
        (b"\0\0\1\0\1\0" + bytes(20), BROKEN),
        (b"\x89PNG\r\n\x1a\n", BROKEN),
        (b"\xff\xd8\xff\xe0", BROKEN),
        (b"RIFF\0\0\0\0WEBPVP8 ", BROKEN),
        (b"II*\0\x08\0\0\0", BROKEN),
        (b"II*\0\x10\0\0\0CR\2\0" + bytes(20), "got a camera's raw file. Try converting it"),
        (b"\xff\x0a" + bytes(20), "got a JPEG XL file"),
        (png(np.zeros((0, 4, 3), np.uint8)), BROKEN),
        (png(BYTES)[:-16] + bytes(4) + png(BYTES)[-12:], BROKEN),  # a wrong checksum of its pixels
        (png(BYTES)[:-16], BROKEN),  # or without any
        (float_tiff(np.float32([[0, 1.5]])), "must be finite and in 0..1; got 1.5 at row 0"),
        (float_tiff(np.full((2, 3, 3), np.nan, np.float32)), "got nan at row 0, column 0"),
        (float_tiff(np.int32([[-5, 7]])), "samples of type int, 1 for each pixel"),
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
def test_folders_pipes_and_devices_are_refused_unread(tmp_path, capsys):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    places = {
        tmp_path / "no.jpg": "No such file",
        tmp_path: "it is a folder",
        pipe: "it is a pipe or a device",
        "/dev/zero": "it is a pipe or a device",
        tmp_path / "no.jpg" / "x": "No such file",
        "a\n\x1bred.jpg": r"cannot read a \x1bred.jpg: No such file",
    }
    with pytest.raises(InputError, match="embedded null byte"):
        load_image("a\0b.png")
    for place, message in places.items():
        assert main([str(place), "-o", str(tmp_path / "o.svg"), "--quiet"]) == 2
        err = capsys.readouterr().err
        assert message in err
        assert err.count("\n") == 1


def test_no_program_is_started_for_a_photo(tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise AssertionError("a program was started")

    monkeypatch.setattr(subprocess, "Popen", refuse)
    monkeypatch.setattr(os, "system", refuse)
    eps = io.BytesIO()
    Image.fromarray(BYTES).save(eps, "EPS")
    for data in (eps.getvalue(), b"\xc5\xd0\xd3\xc6" + bytes(40)):
        with pytest.raises(InputError, match="PostScript"):
            load_image(data)


def photo_or_refusal(data: bytes) -> Photo | InputError:
    try:
        return load_image(data, max_pixels=100_000)
    except InputError as error:
        return error


def test_colours_without_their_palette_are_refused():
    data = encoded(Image.new("P", (4, 4)), "PNG")
    at = data.index(b"PLTE") - 4
    length = int.from_bytes(data[at : at + 4], "big") + 12
    with pytest.raises(InputError, match=BROKEN):
        load_image(data[:at] + data[at + length :])


@pytest.mark.parametrize("name", FORMATS)
def test_file_that_is_cut_off_is_refused_or_whole(name):
    file = file_of(name)
    whole = load_image(file).pixels
    refused = 0
    for length in range(0, len(file), 1 if len(file) < 2000 else 3):
        photo = photo_or_refusal(file[:length])
        if isinstance(photo, InputError):
            refused += 1
        else:
            np.testing.assert_array_equal(photo.pixels, whole)
    assert refused > 0.25 * len(file)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", [*FORMATS, "float TIFF", "16-bit PNG"])
def test_file_with_wrong_bytes_is_a_photo_or_an_input_error(name):
    exif = Image.Exif()
    exif[0x0112], exif[0x011A], exif[0x011B] = 6, 300.0, 150.0
    if name == "float TIFF":
        file = float_tiff(np.float32(BYTES / 255))
    elif name == "16-bit PNG":
        file = png(BYTES.astype(np.uint16) * 257, chunk(b"gAMA", b"\0\1\2\3"), bits=16)
    else:
        tagged = name in ("JPEG", "PNG", "WebP", "TIFF", "AVIF")
        file = encoded(PICTURE, name, exif=exif) if tagged else file_of(name)
    rng = np.random.default_rng(1)
    for _ in range(150):
        wrong = bytearray(file)
        for place in rng.integers(0, min(len(file), 400), rng.integers(1, 6)):
            wrong[place] = rng.integers(0, 256)
        photo = photo_or_refusal(bytes(wrong))
        if not isinstance(photo, InputError):
            assert 0 <= photo.pixels.min() <= photo.pixels.max() <= 1


@pytest.mark.parametrize("compression", ["tiff_lzw", "tiff_adobe_deflate"])
def test_libraries_add_no_lines_to_ours(compression, tmp_path, capfd):
    file = bytearray(encoded(Image.fromarray(BYTES), "TIFF", compression=compression))
    file[8:300] = RNG.integers(0, 256, 292, dtype=np.uint8).tobytes()
    path = tmp_path / "x.tif"
    path.write_bytes(file)
    assert main([str(path), "-o", str(tmp_path / "o.svg"), "--quiet"]) == 2
    assert capfd.readouterr().err.count("\n") == 1


def test_name_cannot_steer_the_terminal(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a\nb\x1b[31m.png", "a\u202egnp.x", "\x9b2J", "bad\udcff.png"):
        assert main([name, "-o", "o.svg", "--quiet"]) == 2
        err = capsys.readouterr().err
        assert err.count("\n") == 1
        assert err.removesuffix("\n").isprintable()
    assert "cannot read bad\\udcff.png" in err


def test_text_of_the_file_cannot_steer_the_terminal(tmp_path, capsys):
    path = tmp_path / "x.png"
    path.write_bytes(png(BYTES, chunk(b"\x1b[3m", b"\x1b[31m")))
    assert main([str(path), "-o", str(tmp_path / "o.svg"), "--quiet"]) == 2
    assert capsys.readouterr().err.removesuffix("\n").isprintable()


def test_cut_photos_are_refused_by_threads_that_load_at_once():
    stream = io.BytesIO()
    Image.effect_noise((400, 300), 60).convert("RGB").save(stream, "JPEG")
    cut = stream.getvalue()[: len(stream.getvalue()) // 2]

    def load(_):
        with pytest.raises(InputError):
            load_image(cut)

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(load, range(24)))
