"""Properties of pixel art: its areas draw it exactly, without seams, and nothing else is taken."""

import numpy as np
import pytest
from test_find import scene_of as scene_of_areas
from test_texture import PICTURES, drawing, jpeg, photo_named
from test_texture import pixels_of as as_floats

from gauss2svg.areas.pixels import areas_of_sprite, sprite_of
from gauss2svg.measure.metrics import psnr
from gauss2svg.photo.pixels import shrunk
from gauss2svg.raster import rasterize
from gauss2svg.render import render, render_rgba
from gauss2svg.scene import Scene


def sprite(count: int, side: int, seed: int = 0, cells: int = 24):
    """Return a random picture of `count` colours, in cells of `side` px."""
    random = np.random.default_rng(seed)
    colors = random.choice(16**3, count, replace=False)[:, None] >> np.array([0, 4, 8]) & 15
    picture = (colors / np.float32(15))[random.integers(0, count, (cells, cells))]
    return picture.repeat(side, axis=0).repeat(side, axis=1).astype(np.float32)


def scene_of(picture, **options) -> Scene:
    """Return the scene of the areas of a picture, which must be pixel art."""
    found = sprite_of(picture)
    assert found is not None
    return scene_of_areas(*areas_of_sprite(found, **options), *picture.shape[1::-1])


@pytest.mark.parametrize(("count", "side"), [(2, 1), (4, 2), (16, 1), (64, 3)])
def test_each_color_but_the_background_is_an_area_and_they_draw_the_sprite_exactly(count, side):
    picture = sprite(count, side)
    scene = scene_of(picture)
    assert sprite_of(picture).side == side
    assert len(scene.areas) == count - 1
    assert len({area.paint for area in scene.areas}) == count - 1
    assert np.abs(render(scene, *picture.shape[1::-1]) - picture).max() < 1e-6


@pytest.mark.parametrize(("count", "least", "scale"), [(4, 38, 1.375), (16, 30, 2.625)])
def test_an_enlarged_sprite_has_in_each_pixel_the_mean_of_its_cells(count, least, scale):
    picture, size = sprite(count, 1), round(24 * scale)
    fine = picture.repeat(size, axis=0).repeat(size, axis=1)
    mean = shrunk(fine, size, size)
    scores = [
        psnr(render(scene_of(picture, overlap=overlap), size, size), mean)
        for overlap in (True, False)
    ]
    assert scores[0] > least
    assert scores[0] > scores[1] + 6


def test_cells_show_the_page_by_their_alpha():
    picture = np.dstack([sprite(5, 2), np.ones((48, 48))]).astype(np.float32)
    blue = (picture[..., :3] == picture[0, 0, :3]).all(axis=-1)
    picture[blue, 3] = np.float32(100 / 255)
    picture[10:20, 6:30] = 0
    drawn = render_rgba(scene_of(picture), 48, 48)
    assert np.abs(drawn[..., 3] - picture[..., 3]).max() < 0.001
    seen = picture[..., 3:] > 0
    assert np.abs(np.where(seen, drawn[..., :3] - picture[..., :3], 0)).max() < 0.001


def test_drawings_and_photos_are_no_pixel_art():
    for file in sorted(PICTURES.glob("*.svg"))[::2]:
        for side in (32, 64):
            assert sprite_of(as_floats(drawing(file.stem, side))) is None, (file.stem, side)
    for name in ("astronaut", "camera", "page"):
        for photo in (photo_named(name), photo_named(name).resize((48, 48))):
            assert sprite_of(as_floats(photo)) is None, name
            assert sprite_of(as_floats(jpeg(photo, 80))) is None, name


@pytest.mark.parametrize("radius", [2, 3, 6])
def test_cards_with_round_corners_are_no_pixel_art_and_crisp_ones_are(radius):
    card = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 300 200">'
    card += '<path fill="#fff" d="M0 0h300v200H0"/>'
    card += '<rect x="20" y="30" width="250" height="140" rx="{}" fill="#396"/></svg>'
    assert sprite_of(rasterize(card.format(radius), 300, 200)) is None
    assert sprite_of(rasterize(card.format(0), 300, 200)) is not None
