"""Properties of texture: which pictures have areas, and what becomes of a photo in a drawing."""

import io
from pathlib import Path

import numpy as np
import pytest
import resvg_py
from PIL import Image, ImageFilter
from skimage import data

from gauss2svg.areas.find import find_areas
from gauss2svg.areas.texture import is_flat, is_shaded, may_have_areas

PICTURES = Path(__file__).parents[2] / "benchmarks" / "pictures"
PHOTOS = ("astronaut", "rocket", "camera", "coins")
CHANGES = {
    "as it is": lambda photo: photo,
    "blurred": lambda photo: photo.filter(ImageFilter.GaussianBlur(3)),
    "with a clipped sky": lambda photo: photo.point(lambda value: 1.6 * value + 20),
    "enlarged": lambda photo: photo.resize((2 * photo.width, 2 * photo.height)),
    "as JPEG": lambda photo: jpeg(photo, 50),
}


def photo_named(name: str) -> Image.Image:
    return Image.fromarray(getattr(data, name)()).convert("RGB")


def drawing(name: str, side: int) -> Image.Image:
    """Return the raster of a drawing of the benchmark, with alpha."""
    text = (PICTURES / f"{name}.svg").read_text(encoding="utf-8")
    png = resvg_py.svg_to_bytes(svg_string=text, width=side, height=side)
    return Image.open(io.BytesIO(bytes(png))).convert("RGBA")


def jpeg(picture: Image.Image, quality: int, subsampling: str = "4:2:0") -> Image.Image:
    file = io.BytesIO()
    picture.convert("RGB").save(file, "JPEG", quality=quality, subsampling=subsampling)
    return Image.open(file)


def pixels_of(picture: Image.Image):
    return (np.asarray(picture, np.float32) / 255).astype(np.float32)


@pytest.mark.parametrize("change", CHANGES)
def test_photos_have_no_areas(change):
    wrong = [n for n in PHOTOS if may_have_areas(pixels_of(CHANGES[change](photo_named(n))))]
    assert not wrong


def test_drawings_have_areas():
    for file in sorted(PICTURES.glob("*.svg"))[::3]:
        large = drawing(file.stem, 256)
        page = Image.new("RGBA", large.size, "white")
        page.alpha_composite(large)
        for picture in (large, drawing(file.stem, 128), jpeg(page, 90), jpeg(page, 75).reduce(2)):
            assert may_have_areas(pixels_of(picture)), file.stem


def chart_of_a_thin_line():
    """Return a white page with a frame and one line of a px."""
    page = np.ones((240, 320, 3), np.float32)
    page[[20, 220], 30:300] = page[20:221, [30, 299]] = 0
    across = np.arange(40, 290)
    page[np.int32(120 + 80 * np.sin(across / 30)), across] = (0.1, 0.4, 0.7)
    return page


def pale_waves(step):
    """Return waves of one colour each, which differ from their neighbours by a few levels."""
    rows, columns = np.mgrid[:200, :200]
    wave, below = np.divmod(rows + 12 * np.sin(columns / 25) + 12, 40)
    wave += np.minimum(below, 1)  # their rims are antialiased
    return np.float32(np.round(np.array([200, 120, 80]) + step * wave[..., None]) / 255)


@pytest.mark.parametrize("picture", [chart_of_a_thin_line(), pale_waves(6)], ids=["chart", "waves"])
def test_what_is_flat_has_areas_however_thin_or_pale_its_parts_are(picture):
    assert may_have_areas(picture)


def test_slow_shading_has_no_areas():
    rows, columns = np.mgrid[:200, :200]
    shade = np.round(80 + rows / 8 + columns / 12)[..., None].repeat(3, 2)
    assert not may_have_areas(np.float32(shade / 255))


def test_a_flat_chart_a_glow_and_a_photo_are_apart():
    rows, columns = np.mgrid[-1:1:200j, -1:1:200j]
    glow = np.where(np.hypot(rows, columns) < 0.6, 1 - np.hypot(rows + 0.2, columns + 0.2), 1)
    glow = np.float32(np.round(255 * glow) / 255)[..., None].repeat(3, 2)
    chart = chart_of_a_thin_line()
    assert (is_flat(chart), is_shaded(chart)) == (True, False)
    assert (is_flat(glow), is_shaded(glow)) == (False, True)
    assert not any(is_flat(pixels_of(photo_named(name))) for name in PHOTOS)


def test_flat_areas_that_differ_by_a_few_levels_are_apart():
    found = find_areas(pale_waves(6), is_clean=True)
    assert len(found.areas) + 1 == 7
    assert found.psnr > 50


def page_with(part):
    """Return a page with a flag, and the same with a part on it."""
    page = Image.new("RGBA", (240, 230), "white")
    page.alpha_composite(drawing("flag", 60), (20, 165))
    page = pixels_of(page.convert("RGB"))
    with_part = page.copy()
    with_part[30:150, 60:220] = part
    return page, with_part


def boxed(area):
    """Return left, top, right and bottom (4,) of an area."""
    points = np.concatenate([outline.segments.reshape(-1, 2) for outline in area.outlines])
    return np.append(points.min(axis=0), points.max(axis=0))


def texture():
    return pixels_of(photo_named("coffee").crop((200, 150, 360, 270)))


def test_a_photo_in_a_drawing_is_one_area_of_its_outline():
    flag, areas = (find_areas(picture).areas for picture in page_with(texture()))
    assert len(areas) == len(flag) + 1
    assert min(np.abs(boxed(area) - (60, 30, 220, 150)).max() for area in areas) < 0.1


@pytest.mark.parametrize("deviation", [3, 20])
def test_noise_has_no_areas(deviation):
    noise = np.random.default_rng(1).normal(0.5, deviation / 255, (200, 240, 3))
    assert not find_areas(np.float32(noise.clip(0, 1))).areas
