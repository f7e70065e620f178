"""Properties of small logos: they are areas and lines at any size, also as JPEG."""

import numpy as np
import pytest
from PIL import Image

from gauss2svg import RunOptions, vectorize
from gauss2svg.raster import rasterize


def wordmark(width: int, height: int, ink=(10, 46, 31)) -> Image.Image:
    """Return rings, bars and slanted bars in one ink on white."""
    y, x = (np.mgrid[: 4 * height, : 4 * width] + 0.5) / (4 * height)
    k, x = np.divmod(x, 0.8)
    radius = np.hypot(x - 0.4, y - 0.55)
    bar = (np.abs(x - 0.3) < 0.09) & (y > 0.1) & (y < 0.9)
    slant = (np.abs(x - 0.1 - 0.5 * y) < 0.08) & (y > 0.15)
    inside = np.choose(k.astype(int) % 3, [(radius > 0.18) & (radius < 0.33), bar, slant])
    page = np.where(inside[..., None], np.array(ink, np.uint8), np.uint8(255))
    return Image.fromarray(page).reduce(4)


@pytest.mark.parametrize("size", [(300, 200), pytest.param((500, 333), marks=pytest.mark.sweep)])
def test_a_logo_has_no_gaussians_whatever_its_size(size):
    result = vectorize(np.asarray(wordmark(*size, ink=(0, 0, 0))))
    assert len(result.scene) == 0
    assert len(result.svg) < 4000


def boxes(resample: Image.Resampling) -> np.ndarray:
    """Return boxes of a gradient with narrow gaps on a transparent page, reduced by a filter."""
    y, x = np.mgrid[:320, :480]
    inside = (x % 160 > 24) & (y % 160 > 24)
    page = np.stack([x / 2, 120 + 0 * x, 255 - x / 2, 255 * inside], axis=2).astype(np.uint8)
    return np.asarray(Image.fromarray(page).resize((120, 80), resample))


@pytest.mark.parametrize("resample", [Image.Resampling.BOX, Image.Resampling.LANCZOS])
def test_gaps_of_a_transparent_page_are_no_lines(resample):
    result = vectorize(boxes(resample))
    assert len(result.scene) == 0
    assert all(area.opacity > 0 for area in result.scene.areas)
    assert result.report["psnr_svg"] > 35


@pytest.mark.parametrize("is_clear", [False, True])
def test_outlines_of_a_reduced_logo_are_where_its_edges_are(is_clear):
    mark = np.asarray(wordmark(570, 190))
    if is_clear:
        mark = np.concatenate([np.zeros_like(mark), 255 - mark[..., :1]], axis=2)
    result = vectorize(mark, run=RunOptions(max_size=400))
    assert result.report["psnr_svg"] > 38
    assert len(result.scene.areas) < 8


@pytest.mark.parametrize("size", [16, 24, 64])
@pytest.mark.parametrize("gap", [0.0, 0.3])
def test_a_disc_that_touches_the_edges_of_the_page_has_no_knobs(size, gap):
    y, x = (np.mgrid[: 8 * size, : 8 * size] + 0.5) / 8
    page = np.full((8 * size, 8 * size, 3), 255, np.uint8)
    radius = size / 2 - gap
    page[np.hypot(x - size / 2, y - size / 2) < radius] = 220, 40, 60
    page[np.hypot(x - 0.4 * size, y - 0.45 * size) < 0.3 * radius] = 255
    result = vectorize(np.asarray(Image.fromarray(page).reduce(8)))
    drawn = rasterize(result.svg, 8 * size, 8 * size)
    is_red = drawn[..., 1] < 0.5
    far = np.hypot(x - size / 2, y - size / 2)[is_red].max()
    assert far < radius + 0.6
    assert len(result.scene.areas) < 4


def test_no_paler_lines_are_along_the_edges_of_a_transparent_logo():
    y, x = np.mgrid[:960, :960]
    inside = (np.abs(x - 480) < 54) | (np.abs(y - 480) < 54)
    cross = np.stack([98 + 0 * x, 93 + 0 * x, 245 + 0 * x, 255 * inside], axis=2).astype(np.uint8)
    reduced = Image.fromarray(cross).resize((120, 120), Image.Resampling.LANCZOS)
    result = vectorize(np.asarray(reduced))
    assert len({area.paint for area in result.scene.areas}) == 1
