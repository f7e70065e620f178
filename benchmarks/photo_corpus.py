"""Photos by many tools: each is read here and by a second decoder, and the two are compared.

    python benchmarks/photo_corpus.py

Files are made by Pillow, tifffile and imagecodecs, and by ImageMagick, cjpeg, jpegtran, tiffcp,
cwebp and heif-enc where they are installed: those that are not are named. None that is whole may be
refused, and none may differ by more than its format loses. Exit status 1 if one does.
"""

from __future__ import annotations

import importlib.util
import io
import itertools
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from common import encoded
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.errors import InputError
from gauss2svg.photo.load import load_image
from gauss2svg.photo.pixels import over, pixels_of

SIZES = ((45, 37), (64, 48), (131, 7), (1, 1))
MODES = ("L", "RGB", "RGBA", "LA", "P", "1", "CMYK")
LOSSLESS, LOSSY = 2.5, 14.0  # mean levels of 255 over white that a file may differ by
PROGRAMS = {
    name: shutil.which(name)
    for name in ("convert-im6", "cjpeg", "jpegtran", "tiffcp", "cwebp", "heif-enc")
}
Made = tuple[str, bytes, NDArray[np.float64] | None, float]  # name, file, wanted or None, levels


def picture(size: tuple[int, int], mode: str) -> Image.Image:
    """Waves of colour with alpha of at least a fifth."""
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    planes = [127 + 100 * np.sin(x / a + y / b) for a, b in ((9, 14), (17, 8), (11, 23))]
    alpha = np.clip(80 + 3 * x + 2 * y, 51, 255)
    whole = Image.fromarray(np.stack([*planes, alpha], axis=2).round().astype(np.uint8))
    if mode in ("RGBA", "LA"):
        return whole.convert(mode)
    if mode == "P":
        return whole.convert("RGB").quantize(32)
    return whole.convert("RGB").convert(mode)


def shown(image: Image.Image) -> NDArray[np.float64]:
    """Return an image of Pillow over white, (h, w, 3) in 0..255."""
    rgba = np.asarray(image.convert("RGBA"), np.float64)
    return rgba[:, :, :3] * rgba[:, :, 3:] / 255 + 255 - rgba[:, :, 3:]


def grid(**choices: tuple[Any, ...]) -> Iterator[dict[str, Any]]:
    """Every combination of options; None leaves one out."""
    for values in itertools.product(*choices.values()):
        named = zip(choices, values, strict=True)
        yield {name: value for name, value in named if value is not None}


def by_pillow() -> Iterator[Made]:
    """Every format, mode and option that Pillow writes."""
    jpeg = grid(
        quality=(30, 75, 95), subsampling=(0, 1, 2), progressive=(None, True),
        restart_marker_blocks=(None, 3), optimize=(None, True),
    )  # fmt: skip
    kinds: list[tuple[str, tuple[str, ...], float, list[dict[str, Any]]]] = [
        ("JPEG", ("L", "RGB", "CMYK"), LOSSY, list(jpeg)),
        ("PNG", ("L", "RGB", "RGBA", "LA", "P", "1"), LOSSLESS,
         list(grid(compress_level=(0, 9), bits=(None,)))),
        ("WEBP", ("RGB", "RGBA"), LOSSY, list(grid(quality=(40, 90), method=(0, 6)))),
        ("WEBP", ("RGB", "RGBA"), LOSSLESS, [{"lossless": True, "method": m} for m in (0, 4)]),
        ("GIF", ("L", "P", "1"), LOSSLESS, list(grid(interlace=(0, 1)))),
        ("BMP", ("L", "RGB", "RGBA", "P", "1"), LOSSLESS, [{}]),
        ("AVIF", ("RGB", "RGBA"), LOSSY, [{"quality": 80, "speed": 9}]),
        ("TIFF", MODES, LOSSLESS, list(grid(
            compression=(None, "tiff_lzw", "tiff_adobe_deflate", "packbits", "zstd", "lzma"),
            tiffinfo=(None, {274: 6}, {274: 3}, {278: 5}), big_tiff=(None, True)))),
        ("TIFF", ("1",), LOSSLESS, [{"compression": c} for c in ("group3", "group4")]),
        ("TIFF", ("L", "RGB"), LOSSY, [{"compression": "jpeg", "quality": q} for q in (75, 95)]),
    ]  # fmt: skip
    for size in SIZES:
        for name, modes, levels, options in kinds:
            for mode, option in itertools.product(modes, options):
                try:
                    file = encoded(picture(size, mode), name, **option)
                except (OSError, ValueError, KeyError, SystemError):
                    continue  # not a combination that Pillow writes
                yield f"Pillow {name} {mode} {size} {option}", file, None, levels


def by_tifffile() -> Iterator[Made]:
    """Kinds of samples, planes, layouts and byte orders; what is wanted is known exactly."""
    codecs = importlib.util.find_spec("imagecodecs") is not None
    kinds = (("rgb", 3, None), ("rgb", 4, "unassalpha"), ("rgb", 4, "assocalpha"),
             ("minisblack", 1, None), ("minisblack", 2, "unassalpha"), ("miniswhite", 1, None),
             ("separated", 4, None))  # fmt: skip
    layouts: tuple[dict[str, Any], ...] = ({}, {"rowsperstrip": 5}, {"tile": (16, 32)})
    types: tuple[Any, ...] = (np.uint8, np.uint16, np.float16, np.float32, np.float64)
    packings = (None, "zlib", *(("lzw", "packbits", "zstd") if codecs else ()))
    for (photometric, count, extra), dtype, planar, order, layout, packing in itertools.product(
        kinds, types, ("contig", "separate"), "<>", layouts, packings
    ):
        if count == 1 and planar == "separate":
            continue
        values = np.asarray(picture((45, 37), "RGBA"), np.float64)[:, :, [0, 1, 2, 3]] / 255
        values = values[:, :, [3] if count == 1 else [0, 3] if count == 2 else slice(count)]
        stored = values.copy()
        if extra == "assocalpha":
            stored[:, :, :-1] *= stored[:, :, -1:]
        top = 1 if np.dtype(dtype).kind == "f" else np.iinfo(dtype).max
        samples = (stored * top).round().astype(dtype) if top > 1 else stored.astype(dtype)
        samples = samples[:, :, 0] if count == 1 else samples
        if planar == "separate":
            samples = np.ascontiguousarray(np.moveaxis(samples, -1, 0))
        stream = io.BytesIO()
        options: dict[str, Any] = {"byteorder": order, "compression": packing, **layout}
        options |= {"planarconfig": planar} if count > 1 else {}
        options |= {"extrasamples": [extra]} if extra else {}
        tifffile.imwrite(stream, samples, photometric=photometric, **options)
        color = values[:, :, :-1] if extra else values
        if photometric == "miniswhite":
            color = 1 - color
        if photometric == "separated":
            color = (1 - color[:, :, :3]) * (1 - color[:, :, 3:])
        alpha = values[:, :, -1:] if extra else 1
        wanted = 255 * (color * alpha + 1 - alpha) * np.ones(3)
        name = f"tifffile {photometric}{count} {extra} {np.dtype(dtype)} {planar} {order} {layout}"
        yield f"{name} {packing}", stream.getvalue(), wanted, LOSSLESS


def run(folder: Path, given: bytes, suffix: str, output: str, *command: str) -> bytes:
    """Return what a program makes of a file, b"" where it refuses the options."""
    source, target = folder / f"in.{suffix}", folder / f"out.{output}"
    source.write_bytes(given)
    target.unlink(missing_ok=True)
    filled = [part.replace("IN", str(source)).replace("OUT", str(target)) for part in command]
    done = subprocess.run(filled, capture_output=True, check=False)
    return target.read_bytes() if done.returncode == 0 and target.exists() else b""


def by_programs(folder: Path) -> Iterator[Made]:
    """Return what the installed programs make of PNGs, PPMs, JPEGs and TIFFs by their options."""
    jobs: list[tuple[str, bytes, str, str, tuple[str, ...], float]] = []
    wanted = {}  # of copies by tiffcp: ImageMagick misreads grey with alpha in planes
    for size in SIZES[:3]:
        for mode in ("L", "RGB", "RGBA", "1"):
            png = encoded(picture(size, mode), "PNG")
            for depth, packing, layer in itertools.product(
                # Grey of one bit with alpha ImageMagick reads as black itself.
                ("2" if mode == "RGBA" else "1", "4", "8", "16"), ("none", "lzw", "zip", "rle"),
                ((), ("-interlace", "plane"), ("-define", "tiff:tile-geometry=32x16"),
                 ("-endian", "msb"), ("-define", "tiff:alpha=associated")),
            ):  # fmt: skip
                what = ("IN", "-depth", depth, "-compress", packing, *layer, "OUT")
                jobs.append(("convert-im6", png, "png", "tif", what, LOSSLESS))
            for depth, kind in itertools.product(("8", "16"), ("png", "bmp", "gif", "webp")):
                for layer in ((), ("-interlace", "PNG"), ("-colors", "7")):
                    what = ("IN", "-depth", depth, *layer, "OUT")
                    jobs.append(("convert-im6", png, "png", kind, what, LOSSY))
            for space in ("sRGB", "Gray", "CMYK"):
                for way in ("none", "plane", "line"):
                    what = ("IN", "-colorspace", space, "-interlace", way, "OUT")
                    jobs.append(("convert-im6", png, "png", "jpg", what, LOSSY))
            for quality in ("20", "90"):
                for more in ((), ("-lossless",), ("-m", "6"), ("-alpha_q", "20"), ("-exact",)):
                    what = ("-q", quality, *more, "IN", "-o", "OUT")
                    jobs.append(("cwebp", png, "png", "webp", what, LOSSY))
            for quality in ("40", "90"):
                what = ("-A", "-q", quality, "IN", "-o", "OUT")
                jobs.append(("heif-enc", png, "png", "avif", what, LOSSY))
        ppm, jpeg = encoded(picture(size, "RGB"), "PPM"), encoded(picture(size, "RGB"), "JPEG")
        for quality, sample, more in itertools.product(
            ("10", "60", "98"), ("1x1", "2x1", "1x2", "2x2", "4x1", "4x2"),
            ((), ("-progressive",), ("-arithmetic",), ("-restart", "2B"), ("-optimize",),
             ("-grayscale",), ("-rgb",), ("-dct", "float"), ("-smooth", "20")),
        ):  # fmt: skip
            what = ("-quality", quality, "-sample", sample, *more, "-outfile", "OUT", "IN")
            jobs.append(("cjpeg", ppm, "ppm", "jpg", what, LOSSY))
        turns = (("-rotate", "90"), ("-rotate", "180"), ("-flip", "vertical"), ("-transpose",), ())
        for turn, more in itertools.product(
            turns, (("-progressive",), ("-arithmetic",), ("-optimize",), ("-grayscale",), ())
        ):
            what = (*turn, *more, "-outfile", "OUT", "IN")
            jobs.append(("jpegtran", jpeg, "jpg", "jpg", what, LOSSY))
        for mode, packing, planar, layout, order in itertools.product(
            ("L", "RGB", "RGBA", "CMYK", "1", "LA"),
            ("none", "lzw", "lzw:2", "zip:2", "packbits", "zstd"),
            ("contig", "separate"), (("-s",), ("-r", "3"), ("-t", "-w", "16", "-l", "32")),
            ("-B", "-L"),
        ):  # fmt: skip
            tiff = encoded(picture(size, mode), "TIFF")
            wanted[tiff] = shown(picture(size, mode))
            what = ("-c", packing, "-p", planar, *layout, order, "IN", "OUT")
            jobs.append(("tiffcp", tiff, "tif", "tif", what, LOSSLESS))
    for program, given, suffix, output, command, levels in jobs:
        path = PROGRAMS[program]
        if path and (made := run(folder, given, suffix, output, path, *command)):
            yield f"{program} {' '.join(command)}", made, wanted.get(given), levels


def second(file: bytes, folder: Path) -> NDArray[np.float64] | None:
    """Return the photo over white in 0..255, as ImageMagick or else Pillow decodes it.

    Pillow for BMP and AVIF too: ImageMagick 6 shows what a BMP does not use as alpha, and drops
    that of an AVIF. None where it has no answer.
    """
    try:
        if PROGRAMS["convert-im6"] is None or file[:2] == b"BM" or file[4:12] == b"ftypavif":
            with Image.open(io.BytesIO(file)) as image:
                return shown(image)
        flat = ("-auto-orient", "-background", "white", "-alpha", "remove", "-colorspace", "sRGB")
        command = (PROGRAMS["convert-im6"], "IN[0]", *flat, "-depth", "8", "OUT")
        png = run(folder, file, "photo", "png", *command)
        return shown(Image.open(io.BytesIO(png))) if png else None
    except (OSError, ValueError):
        return None


def main() -> int:
    """Print which files are refused or wrong, and how many there are."""
    warnings.simplefilter("ignore")
    missing = [name for name, path in PROGRAMS.items() if path is None]
    if importlib.util.find_spec("imagecodecs") is None:
        missing.append("imagecodecs")
    print(f"not installed, left out: {', '.join(missing) or 'none'}")
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as made_in:
        folder = Path(made_in)
        makers: tuple[Callable[[], Iterator[Made]], ...] = (
            by_pillow, by_tifffile, lambda: by_programs(folder)
        )  # fmt: skip
        for name, file, wanted, levels in itertools.chain.from_iterable(m() for m in makers):
            counts["files"] += 1
            expected = second(file, folder) if wanted is None else wanted
            try:
                seen = 255 * over(pixels_of(load_image(file)))
            except InputError as error:
                verdict = f"refused ({error})"
            else:
                if expected is None:
                    counts["without a second answer"] += 1
                    continue
                same = seen.shape == expected.shape
                off = float(np.abs(seen - expected).mean()) if same else np.inf
                verdict = "right" if off <= levels else f"wrong by {off:.1f} levels"
            counts[verdict.split()[0]] += 1
            if verdict != "right":
                print(f"{name}: {verdict}")
    print(", ".join(f"{count} {what}" for what, count in counts.items()))
    return int(counts["refused"] + counts["wrong"] > 0)


if __name__ == "__main__":
    sys.exit(main())
