"""Drawings in files of given sizes, beside the best of a grid of vtracer's settings.

    python benchmarks/small_drawings.py [--bytes 2000,5000,10000,20000,50000] [--only NAME,...]
        [--peers FILE] [--sheet FOLDER]

One line per drawing and size: PSNR in dB, FLIP, bytes and markup of ours; PSNR of vtracer's file of
at most as many bytes that has the highest, and the least FLIP of its _SCORED best by PSNR. FILE
keeps vtracer's results between runs. FOLDER gets one sheet at twice the size.
"""

from __future__ import annotations

import argparse
import json
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from common import eight_bits
from drawings import drawings
from drawn_pictures import flat_faces
from PIL import Image
from small import of_another_tool

from gauss2svg.files import as_png
from gauss2svg.measure.metrics import psnr
from gauss2svg.measure.perceptual import flip
from gauss2svg.photo.alpha import shrunk
from gauss2svg.pipeline.vectorize import vectorize

_SCORED = 6
_SHARED = {
    "colormode": ("color", "binary"),
    "filter_speckle": (1, 4, 10),
    "color_precision": (5, 8),
    "layer_difference": (8, 16, 32, 64),
    "path_precision": (0, 2),
}
_GRIDS = (
    {"mode": ("none",), **_SHARED},
    {"mode": ("polygon",), **_SHARED},
    {"mode": ("spline",), **_SHARED, "corner_threshold": (45, 90), "length_threshold": (3.5, 8)},
)  # fmt: skip
_SCALES = (1.0, 0.5)  # of the picture that vtracer gets
_ZOOM, _ON_SHEET = 2, (5000, 20_000)


def settings() -> list[dict[str, Any]]:
    """Those of the grid; with two colours neither precision nor difference of colours counts."""
    found = [
        dict(zip(grid, values, strict=True))
        for grid in _GRIDS
        for values in product(*grid.values())
    ]
    first = {"color_precision": 5, "layer_difference": 8}
    return [s for s in found if s["colormode"] == "color" or first.items() <= s.items()]


def traced(picture: np.ndarray, limits: list[int]) -> dict[str, Any]:
    """Vtracer's best files by PSNR and by FLIP under each limit: (score, SVG), or None."""
    import vtracer  # pyright: ignore[reportMissingImports]

    height, width = picture.shape[:2]
    files: dict[str, float] = {}
    for scale in _SCALES:
        png = as_png(shrunk(picture, round(scale * height), round(scale * width)))
        for given in settings():
            svg = vtracer.convert_raw_image_to_svg(png, img_format="png", **given)
            if len(svg.encode()) <= max(limits) and svg not in files:
                files[svg] = psnr(of_another_tool(svg, picture), picture)
    flips: dict[str, float] = {}
    best: dict[str, Any] = {}
    for limit in limits:
        within = sorted((f for f in files if len(f.encode()) <= limit), key=files.__getitem__)
        best[str(limit)] = None
        if within:
            for svg in within[-_SCORED:]:
                flips[svg] = flips.get(svg) or flip(of_another_tool(svg, picture), picture)
            clean = min(within[-_SCORED:], key=flips.__getitem__)
            best[str(limit)] = [files[within[-1]], within[-1], flips[clean], clean]
    return best


def sheet(name: str, picture: np.ndarray, panels: list[str], folder: Path) -> None:
    """The picture and SVGs of it, side by side at twice the size."""
    height, width = (_ZOOM * side for side in picture.shape[:2])
    page = Image.new("RGB", ((1 + len(panels)) * (width + 4), height), "#808080")
    rasters = [np.repeat(np.repeat(picture, _ZOOM, 0), _ZOOM, 1)]
    rasters += [of_another_tool(svg, rasters[0]) for svg in panels]
    for at, raster in enumerate(rasters):
        page.paste(eight_bits(raster), (at * (width + 4), 0))
    folder.mkdir(parents=True, exist_ok=True)
    page.save(folder / f"{name.replace(' ', '_')}.png")


def main() -> None:
    """Parse the command line, print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--bytes", default="2000,5000,10000,20000,50000")
    parser.add_argument("--only", help="names, between commas; smile and bear as well")
    parser.add_argument("--peers", type=Path)
    parser.add_argument("--sheet", type=Path)
    given = parser.parse_args()
    limits = [int(limit) for limit in given.bytes.split(",")]
    pictures = dict(drawings())
    names = given.only.split(",") if given.only else list(pictures)
    pictures |= dict(flat_faces())
    known = json.loads(given.peers.read_text()) if given.peers and given.peers.exists() else {}
    ahead = {limit: [0, 0] for limit in limits}
    print("| drawing | bytes | PSNR, dB | FLIP | bytes | markup | vtracer, dB | FLIP |")
    print("|---|---|---|---|---|---|---|---|")
    for name in names:
        picture = pictures[name]
        peers = known.get(name, {})
        if not {str(limit) for limit in limits} <= set(peers):
            peers = known[name] = traced(picture, limits)
            if given.peers:
                given.peers.write_text(json.dumps(known))
        panels = []
        for limit in limits:
            result, peer = vectorize(picture, max_bytes=limit), peers[str(limit)]
            score, error = result.report["psnr_svg"], flip(result.raster, picture)
            ahead[limit][0] += peer is None or score > peer[0]
            ahead[limit][1] += peer is None or error < peer[2]
            theirs = f"{peer[0]:.2f} | {peer[2]:.4f}" if peer else "- | -"
            size, markup = result.report["svg_bytes"], result.report["markup"]
            print(
                f"| {name} | {limit} | {score:.2f} | {error:.4f} | {size} | {markup} | {theirs} |",
                flush=True,
            )
            if limit in _ON_SHEET:
                panels += [result.svg, *([peer[1]] if peer else [])]
        if given.sheet:
            sheet(name, picture, panels, given.sheet)
    for limit, (by_psnr, by_flip) in ahead.items():
        print(f"{limit}: ahead in PSNR on {by_psnr}, in FLIP on {by_flip} of {len(names)}")


if __name__ == "__main__":
    main()
