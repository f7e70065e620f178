"""How the command refuses files that are not photos, or are broken, hostile or too large.

    python benchmarks/bad_inputs.py

The script makes each file in a temporary folder, passes it to the command and prints a Markdown
table: the input, the exit status and the line on standard error.
"""

from __future__ import annotations

import contextlib
import io
import os
import struct
import tempfile
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import tifffile
from common import encoded
from PIL import Image

from gauss2svg.cli.main import main as command

_SIDE = 64  # px


def main() -> None:
    """Print the table."""
    print("| input | status | line |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        for what, given in bad_inputs():
            stderr = io.StringIO()
            with contextlib.redirect_stderr(stderr):
                status = command([*given, "-o", "out.svg", "--quiet"])
            line = stderr.getvalue().removesuffix("\n")
            if "\n" in line or Path("out.svg").exists():
                raise SystemExit(f"{what} must give one line and no file; got\n{line}")
            message = line.removeprefix("gauss2svg: ").replace("|", "\\|")
            print(f"| {what} | {status} | `{message}` |")


def bad_inputs() -> Iterator[tuple[str, list[str]]]:
    """The name of each input, and the command's arguments; files go to the current folder."""
    noise = np.random.default_rng(0).integers(0, 256, (_SIDE, _SIDE, 3), np.uint8)
    picture = Image.fromarray(noise)
    png, jpeg = (encoded(picture, kind) for kind in ("PNG", "JPEG"))
    colors = np.asarray(picture, np.float32) / 255
    beyond, missing = colors.copy(), colors.copy()
    beyond[2, 5, 1], missing[3, 7, 0] = 1.25, np.nan
    os.mkdir("folder")
    os.mkfifo("pipe")
    yield "a file that is missing", ["missing.jpg"]
    yield "a name with a line break and an escape", ["a\n\x1b[31mred.jpg"]
    yield "a folder", ["folder"]
    yield "a pipe that nobody writes to", ["pipe"]
    yield "an endless device", ["/dev/zero"]
    for what, name, data in (
        ("an empty file", "empty.jpg", b""),
        ("a text", "text.jpg", b"To whom it may concern"),
        ("an SVG", "drawing.svg", b'<svg xmlns="http://www.w3.org/2000/svg"/>'),
        ("a web page", "page.png", b"<!DOCTYPE html><html></html>"),
        ("a PDF", "paper.pdf", b"%PDF-1.7\n"),
        ("PostScript", "figure.eps", b"%!PS-Adobe-3.0 EPSF-3.0\n"),
        ("a Photoshop file", "layers.psd", b"8BPS\0\1" + bytes(20)),
        ("HEIC", "phone.heic", b"\0\0\0\x18ftypheic" + bytes(12)),
        ("JPEG 2000", "scan.jp2", b"\0\0\0\x0cjP  \r\n\x87\n" + bytes(20)),
        ("a camera's raw file", "raw.cr2", b"II*\0\x10\0\0\0CR\2\0" + bytes(20)),
        ("half of a JPEG", "half.jpg", jpeg[: len(jpeg) // 2]),
        ("half of a PNG", "half.png", png[: len(png) // 2]),
        ("a part of a WebP", "part.webp", encoded(picture, "WEBP")[:2000]),
        ("a part of a TIFF", "part.tif", encoded(picture, "TIFF")[:2000]),
        ("a part of a GIF", "part.gif", encoded(picture, "GIF")[:2000]),
        ("a part of a BMP", "part.bmp", encoded(picture, "BMP")[:2000]),
        ("a PNG with a wrong checksum", "sum.png", png[:29] + bytes(4) + png[33:]),
        ("a PNG without pixels", "none.png", _png(0, 4)),
        ("a bomb: 2000 million pixels in a PNG", "bomb.png", _png(50_000, 40_000)),
        ("a TIFF with a value over 1", "beyond.tif", _tiff(beyond)),
        ("a TIFF with a NaN", "nan.tif", _tiff(missing)),
        ("a TIFF of complex numbers", "complex.tif", _tiff(colors[:, :, 0] + 1j)),
    ):
        Path(name).write_bytes(data)
        yield what, [name]
    Path("photo.png").write_bytes(png)
    yield "a photo over `--max-pixels 200`", ["photo.png", "--max-pixels", "200"]
    yield "`--max-pixels 0`", ["photo.png", "--max-pixels", "0"]


def _tiff(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    tifffile.imwrite(stream, array, photometric="rgb" if array.ndim == 3 else "minisblack")
    return stream.getvalue()


def _png(width: int, height: int, extra: bytes = b"") -> bytes:
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = _chunk(b"IHDR", head) + extra + _chunk(b"IDAT", zlib.compress(bytes(52)))
    return b"\x89PNG\r\n\x1a\n" + body + _chunk(b"IEND", b"")


def _chunk(kind: bytes, data: bytes) -> bytes:
    checksum = zlib.crc32(kind + data)
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", checksum)


if __name__ == "__main__":
    main()
