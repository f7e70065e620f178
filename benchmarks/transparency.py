"""Transparent photos: fidelity of colour and alpha, and the cost against an opaque copy.

    python benchmarks/transparency.py [--gaussians 500 2000] [--renderers resvg] [--sheets FOLDER]

Each picture is fitted with these numbers of Gaussians and with the adaptive one, then once more
flattened over white for comparison. The columns white, black and alpha are PSNR in dB of the
rasterised SVG over white, over black, and of its alpha channel. "haze" is the mean rasterised
alpha, in levels of 255, where the photo is transparent for at least 3 px around. Sheets show the
photo and the SVG over white, black and a checkerboard.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from common import eight_bits
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import gaussian_filter, maximum_filter
from skimage import data

from gauss2svg import Result, RunOptions, SvgOptions, vectorize
from gauss2svg.photo.alpha import over
from gauss2svg.pipeline.report import decibels
from gauss2svg.raster import RENDERERS

_CLEAR_OF = 7  # px: haze is measured where a square of this side is transparent
_CHECKS = 16  # px


def pictures() -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Name and picture (h, w, 4) on 8 bits."""
    astronaut, coffee, cat = data.astronaut(), data.coffee(), data.cat()
    y, x = np.mgrid[: astronaut.shape[0], : astronaut.shape[1]]
    radius = np.hypot((x - 230) / 210, (y - 200) / 230)
    yield "soft ellipse", _with_alpha(astronaut, np.clip((1 - radius) / 0.25, 0, 1))
    outline = [(165, 511), (60, 380), (110, 160), (150, 40), (230, 5), (300, 60), (310, 200)]
    outline += [(420, 290), (500, 400), (505, 511)]
    yield "cut-out", _with_alpha(astronaut, _polygon(astronaut.shape, outline))
    yield "feathered", _with_alpha(cat, gaussian_filter(_disc(cat.shape, 0.4), 4.0))
    yield "ramp", _with_alpha(coffee, np.linspace(0, 1, coffee.shape[1])[None])
    yield "logo", _without_white(np.asarray(data.logo()))
    yield "text", _text()


def _with_alpha(color: NDArray[np.uint8], alpha: NDArray[np.floating]) -> NDArray[np.uint8]:
    alpha = np.broadcast_to(alpha, color.shape[:2])
    return np.dstack([color, np.round(alpha * 255).astype(np.uint8)])


def _polygon(shape: tuple[int, ...], outline: list[tuple[int, int]]) -> NDArray[np.floating]:
    """1 inside, 0 outside, with the edge smoothed by four samples each way."""
    mask = Image.new("L", (4 * shape[1], 4 * shape[0]))
    ImageDraw.Draw(mask).polygon([(4 * x, 4 * y) for x, y in outline], fill=255)
    return np.asarray(mask.resize((shape[1], shape[0]), Image.Resampling.BOX)) / 255


def _disc(shape: tuple[int, ...], share: float) -> NDArray[np.floating]:
    height, width = shape[:2]
    y, x = np.mgrid[:height, :width]
    return (np.hypot(x - width / 2, y - height / 2) < share * height).astype(np.float64)


def _without_white(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The least alpha, and its colours, that give a picture (h, w, 4) again over white."""
    color = picture[:, :, :3] / 255
    alpha = 1 - color.min(axis=2)
    straight = 1 - (1 - color) / np.maximum(alpha, 1e-9)[:, :, None]
    return np.round(255 * np.dstack([np.clip(straight, 0, 1), alpha])).astype(np.uint8)


def _text() -> NDArray[np.uint8]:
    """Thin dark red letters on a transparent background."""
    mask = Image.new("L", (480, 160))
    pen = ImageDraw.Draw(mask)
    for top, size in ((10, 60), (90, 30), (130, 16)):
        pen.text((10, top), "Gaussians, 2D", fill=255, font=ImageFont.load_default(size))
    color = np.broadcast_to(np.array([150, 20, 40], np.uint8), (160, 480, 3))
    return np.dstack([color, np.asarray(mask)])


def haze(raster: NDArray[np.float32], photo: NDArray[np.uint8]) -> float:
    """Mean alpha of a raster (h, w, 4), in levels of 255, well clear of what the photo shows."""
    clear = maximum_filter(photo[:, :, 3], _CLEAR_OF) == 0
    return float(raster[:, :, 3][clear].mean()) * 255 if clear.any() else 0.0


def sheet(photo: NDArray[np.uint8], result: Result) -> Image.Image:
    """Photo above SVG, over white, black and a checkerboard."""
    height, width = photo.shape[:2]
    y, x = np.mgrid[:height, :width] // _CHECKS
    checks = np.where((x + y) % 2, 0.55, 0.8)[:, :, None]
    rows = []
    for rgba in (np.asarray(photo / 255, np.float32), result.raster):
        alpha = rgba[:, :, 3:]
        on_checks = rgba[:, :, :3] * alpha + (1 - alpha) * checks
        rows.append(np.concatenate([over(rgba, 1.0), over(rgba, 0.0), on_checks], axis=1))
    return eight_bits(np.concatenate(rows))


def main() -> None:
    """Parse the command line, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--gaussians", nargs="+", type=int, default=[500, 2000])
    parser.add_argument("--renderers", nargs="+", choices=RENDERERS, default=["resvg"])
    parser.add_argument("--pictures", nargs="+")
    parser.add_argument("--sheets", type=Path)
    options = parser.parse_args()
    print(
        f"{'picture':13}{'count':>6}{'used':>6}  {'renderer':9}{'white':>9}{'black':>9}{'alpha':>9}"
        f"{'haze':>6}{'kB':>6}{'s':>6} |{'flattened':>10}{'used':>6}{'kB':>6}{'s':>6}"
    )
    for name, photo in pictures():
        if options.pictures and name not in options.pictures:
            continue
        for count in (*options.gaussians, "auto"):
            flat = vectorize(photo, gaussians=count, svg=SvgOptions(matte="white")).report
            for renderer in options.renderers:
                result = vectorize(photo, gaussians=count, run=RunOptions(renderer=renderer))
                r = result.report
                shown = [r["psnr_svg"], r["psnr_svg_black"], r["psnr_svg_alpha"]]
                white, black, alpha = (decibels(p).removesuffix(" dB") for p in shown)
                print(
                    f"{name:13}{count:>6}{r['gaussians']:>6}  {renderer:9}{white:>9}{black:>9}"
                    f"{alpha:>9}{haze(result.raster, photo):>6.2f}{r['svg_bytes'] / 1000:>6.0f}"
                    f"{r['fit_s']:>6.1f} |{decibels(flat['psnr_svg']):>10}"
                    f"{flat['gaussians']:>6}{flat['svg_bytes'] / 1000:>6.0f}{flat['fit_s']:>6.1f}",
                    flush=True,
                )
                if options.sheets:
                    options.sheets.mkdir(parents=True, exist_ok=True)
                    stem = f"{name.replace(' ', '-')}-{count}-{renderer}"
                    sheet(photo, result).save(options.sheets / f"{stem}.png")


if __name__ == "__main__":
    main()
