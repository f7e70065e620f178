"""Draw photos by tracers, into folders that bench and gallery take by --peers.

python benchmarks/tracers.py tracers kodim*.png --styles vtracer1:default swag:fast
gauss2svg bench kodim*.png -o bench --peers vtracer1-default=tracers/vtracer1-default

Each style has a folder with an SVG for each photo, and a table.csv with its seconds, which include
the start of a program, and of Python. vtracer 1.0 needs a Python of its own, which the variable
GAUSS2SVG_VTRACER1 names. splatthis and neroued-vectorizer are packages, primitive and
swag-converter are programs.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from common import command_line
from numpy.typing import NDArray

from gauss2svg.compare.records import start_watch
from gauss2svg.files import as_png
from gauss2svg.photo.load import WHITE_MATTE, load_image

VTRACER1 = """import json, sys, vtracer
vtracer.Config(**json.loads(sys.argv[1])).convert_file(sys.argv[2], sys.argv[3])"""
SPLATTHIS = """import json, sys
from PIL import Image
from splatthis import SplatConverter
options = json.loads(sys.argv[1])
if side := options.pop("side", None):
    image = Image.open(sys.argv[2])
    image.thumbnail((side, side))
    options["target_size"] = image.size
converter = SplatConverter(device="cpu", seed=0, **options)
converter.convert(sys.argv[2], sys.argv[3], output_format="svg")"""
NEROUED = """import sys, neroued_vectorizer as tracer
config = tracer.VectorizerConfig()
config.pipeline_mode = tracer.PipelineMode.V2
open(sys.argv[3], "w").write(tracer.vectorize(sys.argv[2], config).svg_content)"""
SWAG = "--quality {} --max-edge 0 --background keep --workers 1 --no-measure --quiet"


def by_python(code: str, python: str = sys.executable, **options: object) -> list[str]:
    """Return the command of a package that has options."""
    return [python, "-I", "-c", code, json.dumps(options), "PHOTO", "OUT"]


def by_vtracer1(**options: object) -> list[str]:
    return by_python(VTRACER1, os.environ.get("GAUSS2SVG_VTRACER1", "python"), **options)


def by_primitive(shapes: int) -> list[str]:
    """Return a command that draws turned ellipses at the size of the photo."""
    return ["primitive", *f"-i PHOTO -o OUT -n {shapes} -m 7 -s SIDE".split()]


def by_swag(quality: str) -> list[str]:
    return ["swag", "PHOTO", "--out", "FOLDER", *SWAG.format(quality).split()]


STYLES = {
    "vtracer1:default": by_vtracer1(),
    "vtracer1:polygon": by_vtracer1(mode="polygon", optimize=2, path_precision=0),
    "vtracer1:detailed": by_vtracer1(filter_speckle=1, color_precision=8, layer_difference=4),
    "vtracer1:watershed": by_vtracer1(
        clustering="watershed", watershed_detail=512, optimize=2, path_precision=1
    ),
    # These are the defaults of its command line.
    "splatthis:default": by_python(
        SPLATTHIS, max_splats=2000, stages=[200, 150, 100, 50], quality_profile="max-fidelity"
    ),
    # It took 125 CPU seconds for an image of 160 px, so photos are reduced.
    "splatthis:fast": by_python(
        SPLATTHIS, max_splats=500, stages=[60, 40], quality_profile="fast", side=128
    ),
    "primitive:100": by_primitive(100),
    "primitive:500": by_primitive(500),
    "swag:fast": by_swag("fast"),
    "swag:balanced": by_swag("balanced"),
    "neroued:V2": by_python(NEROUED),
}


def draw(
    style: str, photos: list[str], root: Path, timeout_s: float, side: int | None = None
) -> Path:
    """Draw photos by a style, reduced to a longest side in px. Return the folder of the SVGs."""
    folder = root / style.replace(":", "-")
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "table.csv").open("w", newline="") as table:
        rows = csv.DictWriter(table, ["photo", "total_s", "cpu_s"], extrasaction="ignore")
        rows.writeheader()
        for photo in photos:
            pixels = load_image(photo, matte=WHITE_MATTE, needed=side).pixels
            out = folder / f"{Path(photo).stem}.svg"
            rows.writerow({"photo": photo} | draw_one(STYLES[style], pixels, out, timeout_s))
    return folder


def draw_one(
    command: list[str], pixels: NDArray[np.float32], target: Path, timeout_s: float
) -> dict[str, float]:
    """Draw a photo by a command. Return its cost."""
    with tempfile.TemporaryDirectory() as scratch:
        out, png = Path(scratch, "out"), Path(scratch, "photo.png")
        out.mkdir()
        png.write_bytes(as_png(pixels))
        words = {"PHOTO": str(png), "OUT": str(out / "out.svg"), "FOLDER": str(out)}
        words["SIDE"] = str(max(pixels.shape[:2]))
        cost = start_watch()
        call = [words.get(word, word) for word in command]
        subprocess.run(call, check=True, timeout=timeout_s, stdout=subprocess.DEVNULL)
        costs = cost()
        [svg] = out.glob("*.svg")
        target.write_bytes(svg.read_bytes())
    return costs


def main() -> None:
    """Draw the photos of the command line, and print what --peers takes."""
    parser = command_line(__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("photos", nargs="+")
    parser.add_argument("--styles", nargs="+", required=True, choices=STYLES, metavar="STYLE")
    parser.add_argument("--timeout", type=float, default=4000.0, help="seconds of a photo")
    args = parser.parse_args()
    folders = [draw(style, args.photos, args.folder, args.timeout) for style in args.styles]
    print("--peers", ",".join(f"{folder.name}={folder}" for folder in folders))


if __name__ == "__main__":
    main()
