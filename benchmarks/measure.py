"""Measure the command on pictures: scores, bytes and seconds, beside versions and other tools.

    python benchmarks/measure.py PICTURE... [--set "OPTIONS"] [--family NAME] [--also "OPTIONS"]
        [--columns NAME,...] [--tree LABEL=FOLDER] [--beside lanczos,webp,vtracer] [--scale 0.5]
        [--workers 2] [--keep FOLDER]

    python benchmarks/measure.py kodim*.png --set "--gaussians 1000 --tune psnr"
    python benchmarks/measure.py sources --set "--max-bytes 10k" --beside lanczos,vtracer
    python benchmarks/measure.py kodim*.png drawings --family bytes --workers 2

A PICTURE is a file, the name of a picture of scikit-image, or a set: `drawings` (ten, without a
vector source), `faces` (two) and `sources` (26 SVGs). No two may have the same name. An SVG is
rasterised at 256 px and fitted, and its file is compared with it at four and at eight times that
size as well, in the columns `enlarged` and `enlarged8`.

Each --set has options of the command. A --family has some sets of rising limits, targets or counts,
to each of which --also adds options; a single one needs "=", as in --also=--count-gzipped. Every
run is the command in a process of its own, of one thread if there are several workers. --tree names
another checkout to measure. --keep names a folder, which gets each picture as a PNG, and whose
finished runs are not run again. Beside them stand the picture enlarged by Lanczos, and WebP's and
vtracer's files of at most as many bytes as a set has in --max-bytes: each column has the best value
of all these files, those but PSNR and `enlarged` the best value of the six closest.

--columns takes psnr, enlarged, enlarged8, ssim, ssimulacra2, flip, flat, hue, hue_999 and the
numbers of a report by short names: bytes, gzipped, shapes, areas, lines, nodes, cpu_s, s,
fit_cpu_s, model, roundtrip, rollbacks.

The script prints a line for each picture and set, means over the pictures, and for each family how
often more is worse: a step is down if a file is more than .1 dB worse, up to 50 dB, than the best
smaller one. A file of a vector source that has 41 dB at its own size is compared with others that
have, enlarged, and then .3 dB count.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shlex
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from common import (
    Picture,
    Pixels,
    command_line,
    drawn,
    eight_bits,
    flat_error,
    head,
    line,
    pictures,
    resized,
    vtracer_files,
    webps,
)  # fmt: skip
from PIL import Image

from gauss2svg.measure import metrics, perceptual
from gauss2svg.measure.metrics import local_hue_error
from gauss2svg.options import byte_size
from gauss2svg.pipeline.plan import PRESETS
from gauss2svg.svg.file import file_bytes

_KB = (500, 1000, 2000, 5000, 10_000, 20_000, 20_001, 30_000, 50_000, 60_000, 100_000, 200_000)
FAMILIES = {
    "presets": [f"--quality {name}" for name in PRESETS],
    "counts": [f"--gaussians {count}" for count in (256, 512, 1000, 2000, 4000, 8000)],
    "seconds": [f"--time-limit {limit}" for limit in (1, 2, 4, 8, 16, 32)],
    "bytes": [f"--max-bytes {size}" for size in _KB],
    "limits": [f"--max-bytes {kb}k" for kb in (3, 6, 9, 12, 16, 20, 25, 29, 31, 40, 50, 80)],
    "gzipped": [f"--max-bytes {kb}k --count-gzipped" for kb in (1, 2, 4, 6, 10, 20)],
    "psnr": [f"--target-psnr {target}" for target in range(20, 44, 4)],
    "ssimulacra2": [f"--target-ssimulacra2 {target}" for target in (10, 30, 50, 70, 80)],
}
STEP, DECIDED_BY_8_BITS = 0.1, 50.0  # dB (docs/decisions/monotone.md)
ENLARGED_STEP, SEEN_UP_TO = 0.3, 41.0  # dB, of vector sources (docs/decisions/areas.md)


@dataclass(frozen=True)
class File:
    """What a file shows, at its own size and at others, and what is known of it besides."""

    raster: Pixels = field(repr=False)
    at_size: Callable[[int, int], Pixels] | None = field(default=None, repr=False)
    report: dict[str, Any] = field(default_factory=dict, repr=False)


def enlarged_psnr(up: int) -> Callable[[File, Picture], float]:
    """Return a score: the PSNR of a file against the source of its picture, `up` times as large."""

    def psnr(file: File, picture: Picture) -> float:
        large = picture.enlarged(up)
        assert file.at_size is not None
        return metrics.psnr(file.at_size(*large.shape[:2]), large)

    return psnr


# Each score of a file, and which of several files is the best one.
SCORES = {
    "psnr": (lambda file, picture: metrics.psnr(file.raster, picture.pixels), max),
    "enlarged": (enlarged_psnr(4), max),
    "enlarged8": (enlarged_psnr(8), max),
    "ssim": (lambda file, picture: metrics.ssim(file.raster, picture.pixels), max),
    "ssimulacra2": (
        lambda file, picture: perceptual.ssimulacra2(file.raster, picture.pixels), max,
    ),
    "flip": (lambda file, picture: perceptual.flip(file.raster, picture.pixels), min),
    "flat": (lambda file, picture: flat_error(file.raster, picture.pixels), min),
    "hue": (lambda file, picture: local_hue_error(file.raster, picture.pixels).worst, min),
    "hue_999": (lambda file, picture: local_hue_error(file.raster, picture.pixels).percentile, min),
}  # fmt: skip
FOR_ALL, SCORED = ("psnr", "enlarged"), 6  # other scores take longer, and are of the best by PSNR
# Each number of a run, by its name in the report.
NUMBERS = {
    "bytes": "svg_bytes", "gzipped": "svgz_bytes", "shapes": "gaussians", "areas": "area_count",
    "lines": "line_count", "nodes": "node_count", "cpu_s": "cpu_s", "s": "s",
    "fit_cpu_s": "fit_cpu_s", "model": "psnr_model", "roundtrip": "psnr_roundtrip",
    "rollbacks": "rollbacks",
}  # fmt: skip
_WHOLE = dict.fromkeys(
    ("bytes", "gzipped", "shapes", "areas", "lines", "nodes", "rollbacks"), 0
)  # fmt: skip
DECIMALS = _WHOLE | {"cpu_s": 1, "s": 1, "ssim": 3, "flip": 4}


def svg_file(svg: str, picture: Picture, report: dict[str, Any]) -> File:
    """Return an SVG, rasterised at the size of its picture and of its enlarged source."""
    sizes = {"svg_bytes": len(svg.encode()), "svgz_bytes": len(file_bytes(svg, gzipped=True))}
    return File(drawn(svg, *picture.pixels.shape[:2]), partial(drawn, svg), report | sizes)


def run(tree: str, words: list[str], png: Path, stem: Path) -> None:
    """Run the command of a checkout, and write stem.svg and stem.json; a refusal has no SVG.

    What an earlier run has written is left as it is.
    """
    report = Path(f"{stem}.json")
    if report.exists():
        return
    command = [sys.executable, "-m", "gauss2svg", str(png), "-o", f"{stem}.svg", *words]
    command += ["--report", f"{stem}.report.json", "--quiet", "--overwrite"]
    begun = time.perf_counter()
    with subprocess.Popen(
        command, cwd=png.parent, env=os.environ | {"PYTHONPATH": str(Path(tree).resolve())},
        stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stderr is not None
        complaint = process.stderr.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    found = {"s": time.perf_counter() - begun, "cpu_s": used.ru_utime + used.ru_stime}
    if process.returncode not in (0, 2):  # 2 is a refusal, such as of too few bytes
        raise SystemExit(f"{shlex.join(command)}: {complaint}")
    if process.returncode == 0:
        found |= json.loads(Path(f"{stem}.report.json").read_text())
    report.write_text(json.dumps(found))


def own(picture: Picture, stem: Path) -> list[File]:
    """Return the file of a run, or none if it was refused."""
    svg, report = Path(f"{stem}.svg"), json.loads(Path(f"{stem}.json").read_text())
    return [svg_file(svg.read_text(), picture, report)] if svg.exists() else []


def beside(tool: str, limit: int, picture: Picture, folder: Path) -> list[File]:
    """Return the files of another tool of at most `limit` bytes, the best by PSNR first."""
    pixels = picture.pixels
    if tool == "lanczos":
        return [File(pixels, partial(resized, pixels, how=Image.Resampling.LANCZOS))]
    if tool == "webp":
        files = [File(shown) for shown in webps(pixels, limit)]
    else:
        known = folder / f"{picture.name}.vtracer.json"
        if not known.exists():
            known.write_text(json.dumps(list(dict.fromkeys(vtracer_files(pixels)))))
        svgs = [svg for svg in json.loads(known.read_text()) if len(svg.encode()) <= limit]
        files = [svg_file(svg, picture, {}) for svg in svgs]
    return sorted(files, key=lambda file: -metrics.psnr(file.raster, pixels))


def value(column: str, files: list[File], picture: Picture) -> float:
    """Return a column of the best of some files, NaN if they lack it."""
    if column in NUMBERS:
        number = files[0].report.get(NUMBERS[column]) if files else None
        return math.nan if number is None else float(number)
    has_both = files and picture.source is not None and files[0].at_size is not None
    if not files or (column.startswith("enlarged") and not has_both):
        return math.nan
    score, best = SCORES[column]
    scored = files if column in FOR_ALL else files[:SCORED]
    return float(best(score(file, picture) for file in scored))


def texts(columns: list[str], values: list[float]) -> Iterator[str]:
    """Yield the cells of a line."""
    for column, number in zip(columns, values, strict=True):
        text = f"{number:.{DECIMALS.get(column, 2)}f}"
        yield "-" if math.isnan(number) else "exact" if math.isinf(number) else text


def steps_down(scores: Sequence[float]) -> list[float]:
    """Return how far each score is under the best one before it, up to 50 dB."""
    known = np.minimum([score for score in scores if not math.isnan(score)], DECIDED_BY_8_BITS)
    return [max(0.0, max(known[: k + 1]) - after) for k, after in enumerate(known[1:])]


def source_steps_down(own: Sequence[float], enlarged: Sequence[float]) -> list[float]:
    """Return how far each file of a vector source is under the best smaller one, in dB."""
    steps = steps_down(list(np.minimum(own, SEEN_UP_TO)))
    for k in range(1, len(own)):
        good = [enlarged[j] for j in range(k) if min(own[j], own[k]) >= SEEN_UP_TO]
        down = max(good, default=-math.inf) - enlarged[k]
        steps[k - 1] = max(steps[k - 1], down if down > ENLARGED_STEP else 0.0)
    return steps


def scaled(picture: Picture, scale: float) -> Picture:
    """Return a picture at another scale, without its source."""
    if scale == 1:
        return picture
    height, width = (round(side * scale) for side in picture.pixels.shape[:2])
    pixels = resized(picture.pixels, height, width, Image.Resampling.BOX)
    return Picture(f"{picture.name}-{scale:g}", pixels)


def limit_of(options: str) -> int:
    """Return the limit of bytes among some options, or 0."""
    words = shlex.split(options)
    if "--max-bytes" not in words:
        return 0
    return byte_size("max_bytes", words[words.index("--max-bytes") + 1])


def files_of(
    chosen: list[Picture], sets: list[str], given: argparse.Namespace, folder: Path
) -> Iterator[tuple[Picture, str, str, list[File]]]:
    """Yield the files of each picture by each set of options, tree and other tool."""
    here = f"now={Path(__file__).resolve().parents[1]}"
    trees = dict(tree.split("=", 1) for tree in given.tree or [here])
    threads = ["--threads", "1"] if given.workers > 1 else []
    for label in trees:
        (folder / label).mkdir(exist_ok=True)
    with ThreadPoolExecutor(given.workers) as pool:
        jobs = []
        for picture, options in product(chosen, sets):
            png = folder / f"{picture.name}.png"
            eight_bits(picture.pixels).save(png)
            for label, tree in trees.items():
                stem = folder / label / "-".join([picture.name, *shlex.split(options)])
                words = [*shlex.split(options), *threads]
                jobs.append(
                    (picture, options, label, stem, pool.submit(run, tree, words, png, stem))
                )
        for picture, options, label, stem, job in jobs:
            job.result()
            yield picture, options, label, own(picture, stem)
            if label == list(trees)[-1]:
                for tool in filter(None, given.beside.split(",")):
                    others = beside(tool, limit_of(options), picture, folder)
                    yield picture, options, tool, others


def main() -> None:
    """Parse the command line, print the table."""
    parser = command_line(__doc__)
    parser.add_argument("pictures", nargs="+")
    parser.add_argument("--set", dest="sets", action="append", default=[], metavar="OPTIONS")
    parser.add_argument("--family", dest="families", action="append", default=[], choices=FAMILIES)
    parser.add_argument("--also", default="", metavar="OPTIONS")
    parser.add_argument("--columns", default="psnr,enlarged,ssim,bytes,gzipped,shapes,cpu_s,s")
    parser.add_argument("--tree", action="append", metavar="LABEL=FOLDER")
    parser.add_argument("--beside", default="")
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    columns = given.columns.split(",")
    families = {
        name: [f"{one} {given.also}".strip() for one in FAMILIES[name]] for name in given.families
    }
    sets = [*given.sets, *(one for family in families.values() for one in family)] or [""]
    chosen = [scaled(picture, given.scale) for picture in pictures(given.pictures)]
    for name, times in Counter(picture.name for picture in chosen).items():
        if times > 1:
            parser.error(f"pictures must have names of their own; got {times} named {name}")
    rows: dict[tuple[str, str], list[list[float]]] = defaultdict(list)
    scores: dict[tuple[str, str, str], tuple[float, float]] = {}
    print(head(["picture", "options", "by", *columns]))
    with tempfile.TemporaryDirectory() as temporary:
        folder = (given.keep or Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        for picture, options, by, files in files_of(chosen, sets, given, folder):
            by_column = {c: value(c, files, picture) for c in dict.fromkeys([*columns, *FOR_ALL])}
            values = [by_column[column] for column in columns]
            rows[options, by].append(values)
            scores[by, picture.name, options] = by_column["psnr"], by_column["enlarged"]
            print(line([picture.name, options, by, *texts(columns, values)]), flush=True)
    for (options, by), lines in rows.items():
        table = np.array(lines)
        known = [column[~np.isnan(column)] for column in table.T]
        means = [float(column.mean()) if len(column) else math.nan for column in known]
        print(line([f"mean of {len(lines)}", options, by, *texts(columns, means)]))
    for (family, options_of), by in product(families.items(), dict.fromkeys(by for _, by in rows)):
        steps = []
        for picture in chosen:
            own_scores, enlarged = zip(
                *(scores[by, picture.name, options] for options in options_of), strict=True
            )
            known = not np.isnan([*own_scores, *enlarged]).any()
            steps += source_steps_down(own_scores, enlarged) if known else steps_down(own_scores)
        down = [step for step in steps if step > STEP]
        most = max(down, default=0)
        print(f"{family}, {by}: {len(down)} of {len(steps)} steps down, {most:.2f} dB at most")


if __name__ == "__main__":
    main()
