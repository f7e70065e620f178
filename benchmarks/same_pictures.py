"""Compare the pictures of this tree with those of another commit, on one machine.

    python benchmarks/same_pictures.py OLD [--only NAME,...] [--work FOLDER]

The script unpacks commit OLD into a folder, runs both packages as programs on the same pictures,
and prints which files are equal byte for byte. For an SVG that is not it prints the PSNR against
the picture, the bytes and the CPU seconds of both.

FOLDER keeps the commit and the files of both; by default it is temporary.
The exit status is 1 if a run fails or a file differs. On all machines the same files differ
(docs/decisions/same-file.md).
"""

from __future__ import annotations

import gzip
import io
import math
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

import numpy as np
import tifffile
from common import ROOT, command_line
from PIL import Image
from skimage import data

from gauss2svg.raster import rasterize

# The command of each case. None has a time limit, because its result would depend on the clock.
CASES = {
    "draft": "photo.png --quality draft",
    "fast": "photo.png --quality fast",
    "balanced": "photo.png",
    "high": "photo.png --quality high",
    "max": "small.png --quality max",
    "count": "photo.png --gaussians 1000 --tune psnr --palette 0",
    "jpeg": "photo.jpg --quality fast --max-size 200",
    "grey-16-bits": "grey16.png --gaussians 300",
    "color-16-bits": "color16.tif --gaussians 300 --falloff gaussian",
    "drawing": "drawing.png",
    "alpha": "alpha.png --gaussians 200",
    "matte": "alpha.png --gaussians 200 --matte white",
    "target": "photo.png --target-psnr 28",
    "bytes-editable": "photo.png --max-bytes 20k --markup editable",
    "bytes-minimal": "photo.png --max-bytes 3k --markup minimal",
    "bytes-drawing": "drawing.png --max-bytes 4k",
    "bytes-gzipped": "photo.png --max-bytes 4k --count-gzipped",
    "gzip": "photo.png --gaussians 200 --gzip",
    "placeholder": "placeholder photo.png --format svg",
    "inks": "drawing.png --gaussians 150 --inks 4 --separations plate.svg",
    "plot": "small.png --gaussians 100 --outline outline.svg --plot plot.svg",
    "additive": "small.png --gaussians 200 --blend add",
    "portable": "small.png --gaussians 200 --blend add --portable",
    "ssim": "small.png --gaussians 100 --loss mse+ssim",
    "blur": "small.png --gaussians 100 --form blur --renderer chromium",
    "layers": "small.png --gaussians 200 --animate 3 --fragments",
}


def run(tree: Path, folder: Path, pictures: Path) -> tuple[dict[str, bytes], float]:
    """Return the files of a case by their names, and the CPU seconds of its process.

    tree    folder that has the package `gauss2svg`
    folder  folder for the files, whose name is that of the case
    """
    words = CASES[folder.name].split()
    command = [sys.executable, "-m", "gauss2svg", *words, "-o", "-", "--quiet"]
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(pictures, folder)
    before = cpu_s()
    with (folder / "out.svg").open("wb") as out:
        environment = os.environ | {"PYTHONPATH": str(tree)}
        subprocess.run(command, cwd=folder, env=environment, stdout=out, check=True)
    used_s = cpu_s() - before
    written = {p.name for p in folder.iterdir()} - {p.name for p in pictures.iterdir()}
    return {name: (folder / name).read_bytes() for name in sorted(written)}, used_s


def cpu_s() -> float:
    """Return the CPU seconds of all processes that this one has started and awaited."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def make_pictures(folder: Path) -> dict[str, np.ndarray]:
    """Write the pictures of all cases to a folder; return each over white: (h, w, 3) in 0..1."""
    astronaut = Image.fromarray(data.astronaut())
    logo = Image.fromarray(data.logo()).resize((128, 128))  # a drawing with alpha
    drawing = Image.new("RGBA", logo.size, "white")
    drawing.alpha_composite(logo)
    grey = np.linspace(0, 1, 96) ** 2 * np.linspace(1, 0.2, 80)[:, None]
    color = np.stack([grey, grey[::-1], grey[:, ::-1]], axis=-1)
    folder.mkdir()
    images = {
        "photo.png": astronaut.resize((160, 160)),
        "small.png": astronaut.resize((96, 96)),
        "photo.jpg": astronaut,
        "drawing.png": drawing.convert("RGB"),
    }
    for name, image in images.items():
        image.save(folder / name)
    logo.save(folder / "alpha.png")
    Image.fromarray(np.uint16(grey * 65535)).save(folder / "grey16.png")
    tifffile.imwrite(folder / "color16.tif", np.uint16(color * 65535), photometric="rgb")
    pictures = {name: np.asarray(image) / 255 for name, image in images.items()}
    return pictures | {
        "alpha.png": pictures["drawing.png"],
        "grey16.png": np.stack([grey] * 3, axis=-1),
        "color16.tif": color,
    }


def psnr(case: str, svg: bytes, picture: np.ndarray) -> float:
    """Return the PSNR in dB of a rasterised SVG, gzipped or not, against a picture."""
    text = (gzip.decompress(svg) if svg[:2] == b"\x1f\x8b" else svg).decode()
    height, width = picture.shape[:2]
    # resvg draws blurs wrongly.
    raster = rasterize(text, width, height, "chromium" if case == "blur" else "resvg")
    return -10 * math.log10(np.mean((raster - picture) ** 2))


def unpack(commit: str, folder: Path) -> None:
    """Write the package of a commit to a folder, unless an earlier run did."""
    if not folder.is_dir():
        archive = ["git", "-C", str(ROOT), "archive", commit, "gauss2svg"]
        packed = subprocess.run(archive, capture_output=True, check=True).stdout
        with tarfile.open(fileobj=io.BytesIO(packed)) as files:
            files.extractall(folder, filter="data")
        if (folder / "gauss2svg/core").is_dir():
            command = [sys.executable, "-m", "gauss2svg.core.build"]
            subprocess.run(command, cwd=folder, check=True)


def compare(commit: str, cases: list[str], work: Path) -> bool:
    """Print a line for each case, and return whether all files are equal."""
    parse = ["git", "-C", str(ROOT), "rev-parse", "--verify", f"{commit}^{{commit}}"]
    sha = subprocess.run(parse, capture_output=True, text=True, check=True).stdout.strip()
    unpack(sha, work / sha)
    shutil.rmtree(work / "pictures", ignore_errors=True)
    pictures = make_pictures(work / "pictures")
    differences, different = [], 0
    for case in cases:
        old_files, old_s = run(work / sha, work / f"{sha}-files" / case, work / "pictures")
        new_files, new_s = run(ROOT, work / "new-files" / case, work / "pictures")
        names = old_files.keys() | new_files.keys()
        changed = sorted(name for name in names if old_files.get(name) != new_files.get(name))
        words, change = f"equal: {', '.join(sorted(names))}", 0.0
        different += bool(changed)
        if changed and "out.svg" not in changed:
            words = f"DIFFERENT: {', '.join(changed)}"
        elif changed:
            [picture] = [pictures[word] for word in CASES[case].split() if word in pictures]
            svgs = old_files["out.svg"], new_files["out.svg"]
            dbs = [psnr(case, svg, picture) for svg in svgs]
            change = dbs[1] - dbs[0]
            words = (
                f"DIFFERENT: {', '.join(changed)}; {dbs[0]:.3f} -> {dbs[1]:.3f} dB "
                f"({change:+.3f}), {len(svgs[0])} -> {len(svgs[1])} B"
            )
        differences.append(change)
        print(f"{case:15}{old_s:6.1f} -> {new_s:4.1f} CPU s  {words}", flush=True)
    mean = statistics.fmean(differences)
    largest = max(abs(change) for change in differences)
    print(f"{len(cases)} cases, {different} different: at most {largest:.3f}, mean {mean:+.4f} dB")
    return not different


def main() -> int:
    """Parse the command line, compare, and return the exit status."""
    parser = command_line(__doc__)
    parser.add_argument("old")
    parser.add_argument("--only", default=",".join(CASES))
    parser.add_argument("--work", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        work = arguments.work.resolve() if arguments.work else Path(temporary)
        work.mkdir(parents=True, exist_ok=True)
        return 0 if compare(arguments.old, arguments.only.split(","), work) else 1


if __name__ == "__main__":
    sys.exit(main())
