"""Drawings fitted at 256 px and drawn at four times the size, where their sources tell the truth.

    python benchmarks/enlarged.py [--bytes 10000 | --quality balanced] [--only NAME,...]
        [--svgs FOLDER] [--tree LABEL=FOLDER ...] [--peers FILE] [--keep FOLDER] [--sheet FILE]

The script rasterises each source at 256 px, fits that with the package of each tree, this one if
none is given, and compares the rasters at 256 and at 1024 px with the source's. Each line has PSNR
in dB at both sizes: of the 256 px picture enlarged by Lanczos, of vtracer's best file at each size
(--peers, a file that keeps its results), and of each tree, with its seconds of CPU. --svgs takes
the sources from a folder. Files that --keep has are not made again. The sheet has the 64 px square
of each drawing where the first tree is worst, six times enlarged: source, vtracer, trees.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from common import eight_bits, largest_square
from numpy.typing import NDArray
from PIL import Image
from small import of_another_tool
from small_drawings import traced
from vector_drawings import vector_drawings

from gauss2svg.files import as_png
from gauss2svg.measure.metrics import psnr
from gauss2svg.raster import rasterize

Pixels = NDArray[np.float32]

_SIDE, _UP = 256, 4
_CROP, _ZOOM = 64, 6
_ROOT = Path(__file__).parents[1]


def made(
    picture: Pixels, name: str, wanted: int | str, label: str, tree: str, keep: Path | None
) -> tuple[str, float]:
    """The SVG that a tree's command makes of a picture, and its CPU seconds."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(keep or folder, label, f"{name}-{wanted}.svg")
        seconds = path.with_suffix(".txt")
        if not seconds.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            seconds.write_text(str(_fitted(picture, wanted, tree, path)))
        return path.read_text(), float(seconds.read_text())


def _fitted(picture: Pixels, wanted: int | str, tree: str, svg: Path) -> float:
    """Write the SVG of so many bytes, or of a preset; returns CPU seconds."""
    with tempfile.TemporaryDirectory() as folder:
        photo = Path(folder, "photo.png")
        photo.write_bytes(as_png(picture))
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [sys.executable, "-m", "gauss2svg", photo, "-o", svg.resolve(),
             "--quality" if isinstance(wanted, str) else "--max-bytes", str(wanted),
             "--threads", "1", "--quiet", "--overwrite"],
            check=True,
            cwd=tree,  # from which -m takes the package
        )  # fmt: skip
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def by_lanczos(picture: Pixels) -> Pixels:
    """The picture at four times the size."""
    height, width = picture.shape[:2]
    size = width * _UP, height * _UP
    large = eight_bits(picture).resize(size, Image.Resampling.LANCZOS)
    return np.asarray(large, np.float32) / np.float32(255)


def best(svgs: list[str], picture: Pixels, truth: Pixels) -> list[float]:
    """The highest PSNR at 256 px and at 1024 px of some SVGs."""
    return [max(psnr(of_another_tool(s, at), at) for s in svgs) for at in (picture, truth)]


def line_of(truth: str, svgs: list[str]) -> Image.Image:
    """The square where the first SVG is worst: the truth, then the SVGs, enlarged."""
    side = _SIDE * _ZOOM
    drawn = [of_another_tool(svg, np.zeros((side, side, 3))) for svg in (truth, *svgs)]
    crop = _CROP * _ZOOM
    top, left = largest_square(np.square(drawn[1] - drawn[0]).sum(axis=2), crop)
    page = Image.new("RGB", (len(drawn) * (crop + 4), crop + 4), "#808080")
    for k, raster in enumerate(drawn):
        page.paste(eight_bits(raster[top : top + crop, left : left + crop]), (k * (crop + 4), 0))
    return page


def stacked_lines(lines: list[Image.Image]) -> Image.Image:
    """One picture of all lines; what a tool has no file for is grey."""
    height = lines[0].height
    page = Image.new("RGB", (max(line.width for line in lines), height * len(lines)), "#808080")
    for k, line in enumerate(lines):
        page.paste(line, (0, k * height))
    return page


def main() -> None:
    """Parse the command line, print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--bytes", default="10000")
    parser.add_argument("--quality", help="presets, between commas, instead of bytes; no --peers")
    parser.add_argument("--only", help="names, between commas")
    parser.add_argument("--svgs", type=Path)
    parser.add_argument("--tree", action="append", metavar="LABEL=FOLDER")
    parser.add_argument("--peers", type=Path)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--sheet", type=Path)
    given = parser.parse_args()
    sources = vector_drawings()
    if given.svgs:
        sources = {path.stem: path.read_text() for path in sorted(given.svgs.glob("*.svg"))}
    names = given.only.split(",") if given.only else list(sources)
    limits = [int(limit) for limit in given.bytes.split(",")]
    wanted: list[int] | list[str] = given.quality.split(",") if given.quality else limits
    trees = dict(tree.split("=", 1) for tree in given.tree or [f"now={_ROOT}"])
    known: dict[str, Any] = {}
    if given.peers and given.peers.exists():
        known = json.loads(given.peers.read_text())
    heads = ["Lanczos", *(["vtracer"] if given.peers else []), *trees]
    print("| drawing | bytes |", " | ".join(f"{head} 1x | 4x" for head in heads), "| CPU s |")
    print("|---" * (3 + 2 * len(heads)) + "|")
    rows: dict[int | str, list[list[float]]] = {one: [] for one in wanted}
    lines = []
    for name in names:
        picture, truth = (rasterize(sources[name], s, s) for s in (_SIDE, _SIDE * _UP))
        lanczos = psnr(by_lanczos(picture), truth)
        if given.peers and not {str(limit) for limit in limits} <= set(known.get(name, {})):
            known[name] = traced(picture, limits)
            given.peers.write_text(json.dumps(known))
        for limit in wanted:
            found = [made(picture, name, limit, *tree, given.keep) for tree in trees.items()]
            svgs = [svg for svg, _ in found]
            scores = [best([svg], picture, truth) for svg in svgs]
            if given.peers:
                peer = known[name][str(limit)]
                theirs = [peer[1], peer[3]] if peer else []
                scores.insert(0, best(theirs, picture, truth) if theirs else [math.nan] * 2)
                svgs += theirs[:1]
            drawn = [score for pair in scores for score in pair]
            cells = [math.inf, lanczos, *drawn, *(seconds for _, seconds in found)]
            rows[limit].append(cells)
            print(f"| {name} | {limit} | {_texts(cells, len(found))} |", flush=True)
            lines.append(line_of(sources[name], svgs))
    for limit, cells in rows.items():
        means = [float(np.nanmean(column)) for column in zip(*cells, strict=True)]
        print(f"| mean of {len(names)} | {limit} | {_texts(means, len(trees))} |")
    if given.sheet:
        stacked_lines(lines).save(given.sheet)


def _texts(cells: list[float], trees: int) -> str:
    scores, seconds = cells[:-trees], cells[-trees:]
    texts = [f"{value:.2f}" if math.isfinite(value) else "-" for value in scores]
    return " | ".join([*texts, ", ".join(f"{value:.0f}" for value in seconds)])


if __name__ == "__main__":
    main()
