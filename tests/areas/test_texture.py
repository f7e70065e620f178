"""Properties of the search for texture: which pictures have areas."""

import io
from pathlib import Path

import numpy as np
import pytest
import resvg_py
from PIL import Image, ImageFilter
from skimage import data

from gauss2svg.areas.texture import may_have_areas

PICTURES = Path(__file__).parents[2] / "benchmarks" / "pictures"
PHOTOS = ("astronaut", "coffee", "chelsea", "rocket", "camera", "coins", "retina")
CHANGES = {
    "as it is": lambda photo: photo,
    "blurred": lambda photo: photo.filter(ImageFilter.GaussianBlur(3)),
    "with a clipped sky": lambda photo: photo.point(lambda value: 1.6 * value + 20),
    "grey": lambda photo: photo.convert("L").convert("RGB"),
    "enlarged": lambda photo: photo.resize((2 * photo.width, 2 * photo.height)),
    "reduced": lambda photo: photo.reduce(2),
    "as JPEG": lambda photo: jpeg(photo, 50),
}


def photo_named(name: str) -> Image.Image:
    return Image.fromarray(getattr(data, name)()).convert("RGB")


def drawing(name: str, side: int) -> Image.Image:
    """Return the raster of a drawing of the benchmark, with alpha."""
    text = (PICTURES / f"{name}.svg").read_text(encoding="utf-8")
    png = resvg_py.svg_to_bytes(svg_string=text, width=side, height=side)
    return Image.open(io.BytesIO(bytes(png))).convert("RGBA")


def jpeg(picture: Image.Image, quality: int) -> Image.Image:
    file = io.BytesIO()
    picture.convert("RGB").save(file, "JPEG", quality=quality)
    return Image.open(file)


def pixels_of(picture: Image.Image):
    return (np.asarray(picture, np.float32) / 255).astype(np.float32)


def poster(share: float) -> Image.Image:
    """Return a drawing with a photo in the upper `share` of its page."""
    page = Image.new("RGB", (400, 600), (245, 240, 225))
    page.paste(drawing("flag", 160), (120, 430))
    page.paste(photo_named("coffee").crop((0, 0, 360, round(600 * share) - 20)), (20, 20))
    return page


@pytest.mark.parametrize("change", CHANGES)
def test_photos_have_no_areas(change):
    wrong = [n for n in PHOTOS if may_have_areas(pixels_of(CHANGES[change](photo_named(n))))]
    assert not wrong


def test_drawings_have_areas():
    for file in sorted(PICTURES.glob("*.svg")):
        large = drawing(file.stem, 512)
        page = Image.new("RGBA", large.size, "white")
        page.alpha_composite(large)
        for picture in (large, drawing(file.stem, 128), jpeg(page, 90), jpeg(page, 75).reduce(2)):
            assert may_have_areas(pixels_of(picture)), file.stem


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_posters_with_a_photo_have_areas(share):
    assert may_have_areas(pixels_of(poster(share)))


@pytest.mark.parametrize("shape", [(1, 1, 3), (3, 40, 4), (2, 100000, 3)])
def test_thin_pictures_are_judged(shape):
    assert not may_have_areas(np.random.default_rng(1).random(shape).astype(np.float32))
