"""Scores of a peer's file, measured as those of our own files."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

from gauss2svg.errors import RendererError
from gauss2svg.measure.perceptual import perceptual_scores
from gauss2svg.measure.roundtrip import measure_pixels
from gauss2svg.measure.scores import ON_REQUEST
from gauss2svg.photo.load import WHITE, load_image
from gauss2svg.raster import DEFAULT_RENDERER, rasterize, renderer_version


def score(output: Path, image: str) -> dict[str, Any]:
    """Size (bytes) and scores of an SVG or an image against the photo.

    An SVG is rasterised at the photo's size. Raises RendererError for one that cannot be
    rasterised and for an image of another size.
    """
    photo = load_image(image, matte=WHITE).pixels
    height, width = photo.shape[:2]
    data = output.read_bytes()
    if output.suffix == ".svg":
        renderer = renderer_version(DEFAULT_RENDERER)
        raster = rasterize(data.decode(), width, height)
    else:
        renderer = "Pillow"
        raster = load_image(data, matte=WHITE).pixels
        if raster.shape != photo.shape:
            raise RendererError(
                f"image must be {width}x{height} px; got {raster.shape[1]}x{raster.shape[0]}"
            )
    measured, perceptual = measure_pixels(raster, photo), perceptual_scores(raster, photo)
    return {
        "width": width,
        "height": height,
        "renderer": renderer,
        "psnr_model": None,
        "psnr_svg": measured["psnr_svg"],
        "ssim_svg": measured["ssim_svg"],
        **{score.key: perceptual.report[score.key] for score in ON_REQUEST},
        "bytes_raw": len(data),
        "bytes_gzipped": len(gzip.compress(data, compresslevel=9, mtime=0)),
    }
