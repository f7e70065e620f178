"""Photos of many megapixels beside vtracer: seconds, memory, bytes, PSNR of the SVG.

    python benchmarks/megapixels.py [PHOTO] [--megapixels 12 48] [--noise 0 4] [--keep FOLDER]

No photo so large comes with the repository. The given one, else `skimage.data.astronaut()`, is
enlarged by Lanczos and saved as JPEG of quality 92; with noise, in levels of 255, it is sharpened
first, as a phone's photo is. So it has the pixels and the grain of one, but not its detail. Each
command runs once, in a process of its own, in turn. PSNR is of resvg's raster of the file, 1600 px
wide, against the photo reduced to that.
"""

from __future__ import annotations

import argparse
import gzip
import itertools
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter
from skimage import data
from small import of_another_tool

from gauss2svg.measure.metrics import psnr

WIDTH = 1600  # px at which files are compared with their photo
_OURS = (sys.executable, "-m", "gauss2svg", "PHOTO", "-o", "OUT", "--quiet")
_VTRACER = "import sys, vtracer; vtracer.convert_image_to_svg_py(sys.argv[1], sys.argv[2]{})"
_POLYGONS = ", mode='polygon', path_precision=0, filter_speckle=4, layer_difference=16"
# A small process of its own, since the peak of a child counts what its parent had when it began.
_TIMED = """
import resource, subprocess, sys, time
begun = time.perf_counter()
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(time.perf_counter() - begun, used.ru_utime + used.ru_stime, used.ru_maxrss)
"""
COMMANDS: dict[str, tuple[str, ...]] = {
    "gauss2svg": _OURS,
    "vtracer, default": (sys.executable, "-c", _VTRACER.format(""), "PHOTO", "OUT"),
    "gauss2svg, `--quality draft`": (*_OURS, "--quality", "draft"),
    "vtracer, polygons": (sys.executable, "-c", _VTRACER.format(_POLYGONS), "PHOTO", "OUT"),
}


def enlarged(photo: Image.Image, megapixels: float, noise: float) -> Image.Image:
    """The photo with so many pixels; sharpened, with Gaussian noise in levels of 255, if any."""
    scale = (megapixels * 1e6 / (photo.width * photo.height)) ** 0.5
    size = round(photo.width * scale), round(photo.height * scale)
    large = photo.resize(size, Image.Resampling.LANCZOS)
    if not noise:
        return large
    pixels = np.asarray(large.filter(ImageFilter.UnsharpMask(scale, 120)), np.float32)
    grain = np.random.default_rng(0).standard_normal(pixels.shape, np.float32) * noise
    return Image.fromarray(np.uint8(np.clip(pixels + grain + 0.5, 0, 255)))


def run(command: tuple[str, ...]) -> tuple[float, float, float]:
    """Wall and CPU seconds and the largest resident size (MB) of a command."""
    done = subprocess.run([sys.executable, "-c", _TIMED, *command], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}: {done.stderr.strip()}")
    seconds, cpu, kilobytes = map(float, done.stdout.split())
    return seconds, cpu, kilobytes * 1024 / 1e6


def likeness(svg: bytes, photo: Path) -> float:
    """PSNR in dB of the file at WIDTH against the reduced photo."""
    with Image.open(photo) as image:
        size = WIDTH, round(image.height * WIDTH / image.width)
        reduced = np.asarray(image.resize(size, Image.Resampling.BOX), np.float32) / 255
    return psnr(of_another_tool(svg.decode(), reduced), reduced)


def main() -> None:
    """Print a table row for each command and size."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("photo", nargs="?", type=Path)
    parser.add_argument("--megapixels", nargs="+", type=float, default=[12, 48])
    parser.add_argument("--noise", nargs="+", type=float, default=[0, 4])
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    if given.photo:
        with Image.open(given.photo) as image:
            source = image.convert("RGB")
    else:
        source = Image.fromarray(data.astronaut())
    print("| photo, noise | tool | s | CPU s | MB of memory | MB, gzipped | PSNR, dB |", flush=True)
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        small = folder / "first.png"
        source.resize((96, 64)).save(small)
        run(tuple({"PHOTO": str(small), "OUT": str(folder / "first.svg")}.get(w, w) for w in _OURS))
        for megapixels, noise in itertools.product(given.megapixels, given.noise):
            name = f"{megapixels:g}-{noise:g}"
            photo = folder / f"{name}.jpg"
            large = enlarged(source, megapixels, noise)
            large.save(photo, quality=92)
            for number, (tool, words) in enumerate(COMMANDS.items()):
                out = folder / f"{name}-{number}.svg"
                out.unlink(missing_ok=True)
                seconds, cpu, memory = run(
                    tuple({"PHOTO": str(photo), "OUT": str(out)}.get(word, word) for word in words)
                )
                svg = out.read_bytes()
                print(
                    f"| {large.width}x{large.height}, {noise:g} | {tool} | {seconds:.1f} "
                    f"| {cpu:.1f} | {memory:.0f} | {len(svg) / 1e6:.2f}, "
                    f"{len(gzip.compress(svg)) / 1e6:.2f} | {likeness(svg, photo):.2f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
