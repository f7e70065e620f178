"""Measure a written SVG: what a real renderer draws of it, and how long a browser paints it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.measure import Score, metrics
from gauss2svg.photo.pixels import BLACK, has_alpha, over, stacked, views
from gauss2svg.render import render, render_rgba
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import cut_radius
from gauss2svg.scene.scene import narrowing_of
from gauss2svg.svg import Document
from gauss2svg.svg.file import file_bytes, pixels_of

# Paint time in ms from which a file counts as heavy. People perceive a response within a tenth of a
# second as immediate (Miller, "Response time in man-computer conversational transactions", 1968).
HEAVY_MS = 100.0
WIDEST_SHOWN = 1600.0  # px, about the largest width at which web pages show a picture


def round_trip(
    svg: str, scene: Scene, photo: NDArray[np.float32], raster: NDArray[np.float32]
) -> dict[str, Any]:
    """Compare the raster of a scene's SVG with the photo and the scene. Return scores for a report.

    docs/reference/report.md explains the keys. PSNR is in dB, and infinite for equal pictures.
    Differences are in levels of 255. `psnr_model` compares the fitted model with the photo, keys
    with `svg` compare the raster with the photo, and keys with `roundtrip` compare the raster with
    the model. The scene is drawn at the size of the photo, even if its canvas has another size.

    photo, raster  (h, w, 3), or (h, w, 4) if the photo has alpha
    """
    height, width = photo.shape[:2]
    over_white = over(raster)
    # Rounding in float32 may move values slightly out of 0..1, so they are clipped.
    model = render(scene, width, height)
    np.clip(model, 0, 1, out=model)
    drawn = render_rgba(scene, width, height) if has_alpha(photo) else model
    model_black, model_alpha = _psnr_with_alpha(drawn, photo)
    return {
        "psnr_model": metrics.psnr(model, over(photo)),
        **measure_pixels(raster, photo),
        "psnr_roundtrip": metrics.psnr(over_white, model),
        "largest_error_roundtrip": metrics.largest_error(over_white, model),
        "bias_roundtrip": metrics.bias(over_white, model),
        "svg_bytes": len(file_bytes(svg, gzipped=False)),
        "svgz_bytes": len(file_bytes(svg, gzipped=True)),
        "psnr_model_black": model_black,
        "psnr_model_alpha": model_alpha,
    }


def model_psnr(
    scene: Scene, picture: NDArray[np.float32], weight: NDArray[np.float32] | None = None
) -> float:
    """Return a scene's PSNR in dB against an image, over white and black if the image has alpha."""
    draw = render_rgba if has_alpha(picture) else render
    model = draw(scene, *picture.shape[1::-1])
    return metrics.psnr(stacked(model), stacked(picture), weight)


def score_of(score: Score, raster: NDArray[np.float32], photo: NDArray[np.float32]) -> float:
    """Return the score of a raster against a photo.

    If they have alpha, the score is measured over white and over black, and the worse value counts.
    """
    values = map(score.function, views(raster), views(photo))
    return max(values) if score.lower_wins else min(values)


def measure_pixels(raster: NDArray[np.float32], photo: NDArray[np.float32]) -> dict[str, Any]:
    """Return the scores of a raster against a photo of the same shape, by their keys in a report.

    The scores compare pictures over white. ssim_svg is None for images under 11 px a side.
    psnr_svg_black compares pictures over black, and psnr_svg_alpha the alpha channels. Both are
    None if the photo is opaque.

    hue_error_svg, hue_error_at and hue_error_999_svg are the local error of hue of the raster: the
    largest one, its place [x, y] in px of the raster, and the 99.9th percentile. If the photo has
    alpha, they are those over white or those over black, whichever are worse.
    """
    raster_white, photo_white = over(raster), over(photo)
    measurable = min(photo.shape[:2]) >= metrics.LEAST_SIDE_FOR_SSIM
    black, alpha = _psnr_with_alpha(raster, photo)
    hue = metrics.local_hue_error(raster, photo)
    return {
        "psnr_svg": metrics.psnr(raster_white, photo_white),
        "ssim_svg": metrics.ssim(raster_white, photo_white) if measurable else None,
        "largest_error_svg": metrics.largest_error(raster_white, photo_white),
        "bias_svg": metrics.bias(raster_white, photo_white),
        "hue_error_svg": hue.worst,
        "hue_error_at": [hue.x, hue.y],
        "hue_error_999_svg": hue.percentile,
        "psnr_svg_black": black,
        "psnr_svg_alpha": alpha,
    }


def _psnr_with_alpha(
    image: NDArray[np.float32], photo: NDArray[np.float32]
) -> tuple[float | None, float | None]:
    """Return the PSNR over black and the PSNR of alpha. Both are None if the photo is opaque."""
    if not has_alpha(photo):
        return None, None
    over_black = metrics.psnr(over(image, BLACK), over(photo, BLACK))
    return over_black, metrics.psnr(image[:, :, 3:], photo[:, :, 3:])


def drawn_pixels(scene: Scene) -> float:
    """Return the number of pixels that a renderer blends when it draws the scene at its own size.

    This is the sum of the areas of all ellipses in px^2. Each area is multiplied by the share of
    the ellipse's bounding box that is on the canvas.
    """
    half = cut_radius(scene.beta)[:, None] * scene.sigma
    size = np.array([scene.width, scene.height])
    low, high = np.clip(scene.mean - half, 0, size), np.clip(scene.mean + half, 0, size)
    return float(np.pi / 4 * (narrowing_of(scene.rho) * np.prod(high - low, axis=1)).sum())


def shown_width(document: Document, scene: Scene) -> float:
    """Return the width in px at which a web page probably shows a file.

    This is the width that --size gives. Without --size, it is the scene's width, but at most
    WIDEST_SHOWN.
    """
    sides = document.sides(scene.width, scene.height)
    return (pixels_of(sides[0]) or 0.0) if sides else min(scene.width, WIDEST_SHOWN)


def paint_ms(scene: Scene, svg: str, width: float) -> float | None:
    """Return an estimate of the CPU time in ms that a browser takes each time it paints the file.

    For n shapes the estimate is

        a n + b drawn_pixels (width / scene.width)^2 / 1e6,

    where `width` is the width in px at which the file is shown. a and b depend on how the file
    draws soft shapes. They were measured in Chromium without a GPU, and other machines may be
    several times faster or slower. Return None for a file with filters, whose time was not
    measured.
    """
    if "<filter" in svg:
        return None
    share = float("<mask" in svg)
    # A file with masks and a style sheet draws some soft shapes by masks, as <use>, and the others
    # by gradients, as <circle>.
    if share and "<style" in svg:
        masked = svg.count("<use ")
        share = masked / (masked + svg.count("<circle "))
    # ms for a shape and for a million pixels, by gradients and by masks (docs/benchmarks/paint.md)
    each, million = (1 - share) * np.array([0.03, 20.0]) + share * np.array([0.9, 52.0])
    pixels = (width / scene.width) ** 2 * drawn_pixels(scene)
    return float(each * len(scene) + million * pixels / 1e6)
