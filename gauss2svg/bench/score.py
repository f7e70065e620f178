"""What a peer drew, measured as our own files are."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

from gauss2svg.errors import RendererError
from gauss2svg.measure.roundtrip import measure_pixels
from gauss2svg.photo.load import WHITE, load_image
from gauss2svg.raster import DEFAULT_RENDERER, rasterize, renderer_version

_WHITE = (1.0, 1.0, 1.0)  # peers are compared as a page shows them


def score(drawn: Path, image: str) -> dict[str, Any]:
    """Size of an SVG or a picture in bytes, PSNR in dB and SSIM against the photo.

    An SVG is drawn at the photo's size. Raises RendererError for one that cannot be drawn
    and for a picture of another size.
    """
    photo = load_image(image, matte=WHITE).pixels
    height, width = photo.shape[:2]
    data = drawn.read_bytes()
    if drawn.suffix == ".svg":
        renderer = renderer_version(DEFAULT_RENDERER)
        raster = rasterize(data.decode(), width, height)
    else:
        renderer = "Pillow"
        raster = load_image(data, matte=WHITE).pixels
        if raster.shape != photo.shape:
            raise RendererError(
                f"picture is {raster.shape[1]}x{raster.shape[0]} px; needed is {width}x{height}"
            )
    measured = measure_pixels(raster, photo)
    return {
        "width": width,
        "height": height,
        "renderer": renderer,
        "psnr_model": None,
        "psnr_svg": measured["psnr_svg"],
        "ssim_svg": measured["ssim_svg"],
        "bytes_raw": len(data),
        "bytes_gzipped": len(gzip.compress(data, compresslevel=9, mtime=0)),
    }
