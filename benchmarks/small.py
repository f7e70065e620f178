"""Small files at given sizes: Gaussians, match, gzipped bytes, seconds, and a WebP of equal size.

python benchmarks/small.py PHOTO... [--bytes 500,800,1500,3000,8000,20000] [--usual [MARKUP]]
    [--svgs FOLDER]

--usual measures the usual fit, in editable or minimal markup, of which editable has no room for a
Gaussian under some 700 bytes; --svgs measures another tool's files instead: FOLDER/NAME.svg for
each PHOTO NAME.jpg.
"""

from __future__ import annotations

import argparse
import io
import re
import time
from pathlib import Path

import numpy as np
from common import encoded
from PIL import Image

from gauss2svg import SvgOptions, vectorize
from gauss2svg.measure.metrics import psnr, ssim
from gauss2svg.photo.alpha import over, shrunk
from gauss2svg.photo.load import load_image
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.run import compile_kernels
from gauss2svg.pipeline.search.by_bytes import ByBytes
from gauss2svg.pipeline.search.outcome import Subject, Watch
from gauss2svg.raster import rasterize
from gauss2svg.svg.file import file_bytes

_SIDES = (16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768)


def webp(photo: np.ndarray, limit: int) -> np.ndarray:
    """The best WebP thumbnail of at most `limit` bytes, enlarged by bicubic interpolation."""
    height, width = photo.shape[:2]
    best, best_psnr = photo * 0, 0.0
    for side in _SIDES:
        scale = side / max(height, width)
        small = shrunk(photo, max(1, round(height * scale)), max(1, round(width * scale)))
        for quality in (1, 5, 10, 20, 40, 60, 80):
            file = encoded(small, "WEBP", quality=quality, method=6)
            if len(file) > limit:
                break
            picture = Image.open(io.BytesIO(file)).convert("RGB")
            large = picture.resize((width, height), Image.Resampling.BICUBIC)
            drawn = np.asarray(large, np.float32) / 255
            if psnr(drawn, photo) > best_psnr:
                best, best_psnr = drawn, psnr(drawn, photo)
    return best


def of_another_tool(svg: str, photo: np.ndarray) -> np.ndarray:
    """Its raster at the photo's size, stretched where it has a size and no viewBox."""
    if "viewBox" not in svg:
        sized = r'viewBox="0 0 \1 \2" preserveAspectRatio="none"'
        svg = re.sub(r'width="([\d.]+)" height="([\d.]+)"', sized, svg, count=1)
    return rasterize(svg, photo.shape[1], photo.shape[0])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("photos", nargs="+", type=Path)
    parser.add_argument("--bytes", default="500,800,1500,3000,8000,20000")
    parser.add_argument("--usual", nargs="?", const="editable", choices=("editable", "minimal"))
    parser.add_argument("--svgs", type=Path)
    given = parser.parse_args()
    compile_kernels()
    photos = {path.stem: over(load_image(path).pixels) for path in given.photos}
    if given.svgs is not None:
        rows = []
        for name, photo in photos.items():
            svg = (given.svgs / f"{name}.svg").read_text()
            drawn = of_another_tool(svg, photo)
            packed = len(file_bytes(svg, gzipped=True))
            rows.append([len(svg.encode()), packed, psnr(drawn, photo), ssim(drawn, photo)])
        size, packed, decibels, similar = np.mean(rows, axis=0)
        print(
            f"{given.svgs}: {size:.0f} bytes, {packed:.0f} gzipped, {decibels:.2f} dB, "
            f"{similar:.3f}"
        )
        return
    print("| bytes | Gaussians | PSNR, dB | SSIM | gzipped | CPU s | WebP, dB | SSIM |")
    print("|---|---|---|---|---|---|---|---|")
    for limit in map(int, given.bytes.split(",")):
        rows = []
        for photo in photos.values():
            begun = time.process_time()
            if given.usual:
                found = vectorize(photo, max_bytes=limit, svg=SvgOptions(markup=given.usual))
            else:
                plan = Plan(Options.from_flat({"max_bytes": limit}), by_bytes=True)
                found = ByBytes(plan, Subject.of(photo), Watch()).file()
            spent = time.process_time() - begun
            drawn = rasterize(found.svg, photo.shape[1], photo.shape[0])
            packed = len(file_bytes(found.svg, gzipped=True))
            thumbnail = webp(photo, limit)
            rows.append(
                [len(found.scene), psnr(drawn, photo), ssim(drawn, photo), packed, spent,
                 psnr(thumbnail, photo), ssim(thumbnail, photo)]
            )  # fmt: skip
        n, decibels, similar, packed, spent, webp_db, webp_ssim = np.mean(rows, axis=0)
        print(
            f"| {limit} | {n:.0f} | {decibels:.2f} | {similar:.3f} | {packed:.0f} | {spent:.1f} | "
            f"{webp_db:.2f} | {webp_ssim:.3f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
