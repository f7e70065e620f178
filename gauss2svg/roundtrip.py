"""The number that counts: the SVG, drawn by a real renderer, against the photo."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg import metrics
from gauss2svg.raster import DEFAULT_RENDERER, rasterize, renderer_version
from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.svg import file_bytes

_LEAST_SIDE_FOR_SSIM = 3


@dataclass(frozen=True, eq=False)
class RoundTrip:
    """What came back from a renderer; PSNR in dB, differences in levels of 255.

    psnr_model       fitted model against the photo
    psnr_svg, ssim_svg, largest_error_svg, bias_svg   raster against the photo
    psnr_roundtrip, largest_error_roundtrip, bias_roundtrip   raster against the model
    ssim_svg is None for pictures under 3 px a side
    """

    raster: NDArray[np.float32]
    renderer: str
    psnr_model: float
    psnr_svg: float
    ssim_svg: float | None
    largest_error_svg: float
    bias_svg: float
    psnr_roundtrip: float
    largest_error_roundtrip: float
    bias_roundtrip: float
    svg_bytes: int
    svgz_bytes: int


def round_trip(
    svg: str, scene: Scene, photo: NDArray[np.float32], renderer: str = DEFAULT_RENDERER
) -> RoundTrip:
    """Draw the SVG of a scene and measure it against photo (h, w, 3) and scene.

    Both are compared at the photo's size. Raises RendererError if the renderer cannot draw.
    """
    height, width = photo.shape[:2]
    raster = rasterize(svg, width, height, renderer)
    # The exact composite lies in 0..1; float32 may pass the ends by a rounding.
    model = render(scene, width, height)
    np.clip(model, 0, 1, out=model)
    return RoundTrip(
        raster=raster,
        renderer=renderer_version(renderer),
        psnr_model=metrics.psnr(model, photo),
        **measure_pixels(raster, photo),
        psnr_roundtrip=metrics.psnr(raster, model),
        largest_error_roundtrip=metrics.largest_error(raster, model),
        bias_roundtrip=metrics.bias(raster, model),
        svg_bytes=len(file_bytes(svg, gzipped=False)),
        svgz_bytes=len(file_bytes(svg, gzipped=True)),
    )


def measure_pixels(raster: NDArray[np.float32], photo: NDArray[np.float32]) -> dict[str, Any]:
    """Those of RoundTrip's numbers that take nothing but a raster and the photo."""
    measurable = min(photo.shape[:2]) >= _LEAST_SIDE_FOR_SSIM
    return {
        "psnr_svg": metrics.psnr(raster, photo),
        "ssim_svg": metrics.ssim(raster, photo) if measurable else None,
        "largest_error_svg": metrics.largest_error(raster, photo),
        "bias_svg": metrics.bias(raster, photo),
    }
