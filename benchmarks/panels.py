"""Panels and charts of the documentation's figures: pictures under titles, tables as lines."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from common import ROOT, Pixels, encoded, resized, vectorized
from matplotlib.figure import Figure
from PIL import Image

from gauss2svg import Result, Scene

WIDTH_IN, TITLE_IN = 7.2, 0.3
MOST_BYTES = 60_000
BICUBIC = Image.Resampling.BICUBIC


def tiles(pictures: Sequence[Pixels], titles: Sequence[str], columns: int | None = None) -> Figure:
    """Return pictures of one shape under their titles, in a row or in columns, for phones too."""
    size = 8 if columns is None else 12  # pt
    columns = columns or len(pictures)
    rows = -(-len(pictures) // columns)
    ratios = [p.shape[1] / p.shape[0] for p in pictures[:columns]]
    figure, axes = plt.subplots(
        rows, columns, figsize=(WIDTH_IN, rows * (WIDTH_IN / sum(ratios) + TITLE_IN) + 0.15),
        layout="constrained", squeeze=False, width_ratios=ratios,
    )  # fmt: skip
    for axis in axes.flat:
        axis.axis("off")
    for axis, picture, title in zip(axes.flat, pictures, titles, strict=False):
        axis.imshow(np.clip(picture, 0, 1), interpolation="lanczos")
        axis.set_title(title, fontsize=size)
    return figure


def said(result: Result, pattern: str) -> str:
    """Return a title by numbers of the report, and kilobytes as {kB}."""
    report = result.report
    return pattern.format(kB=report["svg_bytes"] / 1000, gz=report["svgz_bytes"] / 1000, **report)


def compared(photo: Pixels, pattern: str, settings: Sequence[dict[str, Any]], last: str) -> Figure:
    """Return a photo by some options in two columns; the photo itself ends them under `last`."""
    results = [vectorized(photo, **options) for options in settings]
    shown, titles = [r.raster for r in results], [said(r, pattern) for r in results]
    return tiles([*shown, photo][:4], [*titles, last], columns=2)


def enlarged(pixels: Pixels, factor: int, how: Image.Resampling) -> Pixels:
    """Return an image in 0..1 `factor` times as large."""
    return resized(pixels, factor * pixels.shape[0], factor * pixels.shape[1], how)


def part(pixels: Pixels, left: float, top: float, share: float) -> Pixels:
    """Return a part of an image; its corner and its sides are shares of the sides of the image."""
    height, width = pixels.shape[:2]
    y, x = round(top * height), round(left * width)
    return pixels[y : y + round(share * height), x : x + round(share * width)]


def upto(scene: Scene, share: float) -> Scene:
    """Return the first rounds of a scene: a share of them, and at least one."""
    return scene.select(scene.round_index <= round(share * scene.round_index.max()))


def table_of(page: str, first: str) -> list[list[str]]:
    """Return the cells of a table of docs/benchmarks, by the beginning of its first line."""
    lines = (ROOT / "docs/benchmarks" / page).read_text(encoding="utf-8").splitlines()
    start = next(k for k, text in enumerate(lines) if text.startswith(first))
    end = next(k for k in range(start, len(lines)) if not lines[k].startswith("|"))
    rows = [[cell.strip() for cell in text.strip("|").split("|")] for text in lines[start:end]]
    return [rows[0], *rows[2:]]


def chart(height_in: float, x: str, y: str, ticks: dict[float, str], **limits: Any) -> Any:
    """Return a figure and its axes, whose x axis is logarithmic."""
    figure, axis = plt.subplots(figsize=(WIDTH_IN, height_in), layout="constrained")
    axis.set(xscale="log", **limits)
    axis.set_xlabel(x, fontsize=12)
    axis.set_ylabel(y, fontsize=12)
    axis.tick_params(labelsize=12)
    axis.set_xticks(list(ticks), list(ticks.values()))
    axis.minorticks_off()
    return figure, axis


def png(figure: Figure, dpi: float) -> Image.Image:
    """Return a figure as an image."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=dpi)
    plt.close(figure)
    return Image.open(stream).convert("RGB")


def small_webp(image: Image.Image) -> bytes:
    """Return an image as WebP of at most MOST_BYTES, as good as that allows."""
    smaller = image.resize((image.width * 3 // 4, image.height * 3 // 4), Image.Resampling.LANCZOS)
    exact = encoded(image, "WEBP", lossless=True, method=4)  # smaller for lines
    for picture in (image, smaller):
        for quality in (80, 72, 64, 56):
            file = min(exact, encoded(picture, "WEBP", quality=quality, method=6), key=len)
            if len(file) <= MOST_BYTES:
                return file
    return file
