"""Properties of noisy and enlarged drawings: their areas are those of the clean drawing."""

import numpy as np
import pytest
from flat import vectorize
from PIL import Image
from scipy.ndimage import gaussian_filter
from scipy.spatial import KDTree
from test_find import DRAWINGS, color_of, drawn, points_of
from test_texture import jpeg, pixels_of

from gauss2svg.areas.clean import cleaned, noise_of, without_shading
from gauss2svg.areas.texture import undoubled
from gauss2svg.measure.metrics import psnr
from gauss2svg.raster import rasterize


def image_of(picture):
    """Return a picture as one of Pillow, in 8 bits."""
    return Image.fromarray(np.round(picture * 255).astype(np.uint8))


def as_jpeg(picture, quality: int, subsampling: str = "4:2:0"):
    """Return a picture that was saved as JPEG."""
    return pixels_of(jpeg(image_of(picture), quality, subsampling))


def enlarged(picture, times: float, resampling=Image.Resampling.LANCZOS):
    """Return an enlarged picture."""
    size = tuple(round(times * side) for side in picture.shape[1::-1])
    return np.asarray(image_of(picture).resize(size, resampling), np.float32) / 255


def off(areas, others):
    """Return the distances (n,) in px of points of outlines from each other."""
    first, second = points_of(areas), points_of(others)
    return np.append(KDTree(first).query(second)[0], KDTree(second).query(first)[0])


@pytest.mark.parametrize(
    ("name", "change"), [("two apart", (75, "4:2:0")), ("discs in discs", (85, "4:4:4"))]
)
def test_a_jpeg_has_the_areas_of_the_clean_drawing(name, change):
    areas, picture = DRAWINGS[name], as_jpeg(drawn(DRAWINGS[name]), *change)
    found = vectorize(picture, max_bytes=10000).scene
    assert len(areas) <= len(found.areas) <= 1 + len(areas)
    assert len(found) == 0
    # JPEG of quality 75 hides some px of an outline between colours of like luma. What it adds may
    # be one small area more.
    far = off(areas, found.areas)[: len(points_of(areas))]
    assert np.quantile(far, 0.98) < 0.5
    assert far.mean() < 0.05
    assert np.quantile(off(areas, found.areas), 0.98) < 3
    for area in areas:
        own = [np.abs(color_of(area) - color_of(other)).max() for other in found.areas]
        assert min(own) < 8 / 255


def test_grey_lines_of_a_jpeg_stay_grey_far_from_colours():
    """As a mixture of white and of a green core anywhere, they would be green."""
    page = np.ones((160, 240, 3), np.float32)
    page[30:130, 20:100] = (0.49, 0.68, 0.53)
    for y in (20, 60, 100, 140):
        page[y : y + 2, 130:] = 0.8
    page[10:150, 220:222] = 0.25
    picture = as_jpeg(page, 85)
    far = cleaned(picture, 6 / 255)[:, 140:]
    assert np.ptp(far, axis=2).max() < 5 / 255


def test_a_dark_card_keeps_its_edge_above_its_shadow():
    """Its edge is fainter than many shadows are."""
    ground, card = np.array([(15, 23, 42), (28, 38, 56)]) / 255
    inside = np.zeros((100, 140), bool)
    inside[25:75, 30:110] = True
    shadow = 0.4 * gaussian_filter(np.roll(inside, 12, axis=0).astype(float), 5)
    picture = np.where(inside[..., None], card, (1 - shadow[..., None]) * ground)
    crisp = without_shading(picture.astype(np.float32))
    for part, color in ((inside, card), (~inside, ground)):
        assert np.abs(crisp[part] - color).max() < 2 / 255


@pytest.mark.parametrize("name", ["BILINEAR", "BICUBIC", "LANCZOS"])
def test_a_doubled_drawing_is_halved(name):
    drawing = drawn(DRAWINGS["a polygon"])
    for picture in (drawing, enlarged(drawing, 1.5)):
        assert undoubled(picture) is picture
    doubled = enlarged(drawing, 2.0, Image.Resampling[name])
    assert undoubled(doubled).shape == drawing.shape
    assert undoubled(enlarged(doubled, 4.0)).shape[0] >= 2 * drawing.shape[0]  # twice at most


def test_a_drawing_with_details_of_a_pixel_was_not_doubled():
    soft = gaussian_filter(drawn(DRAWINGS["a polygon"]), (1, 1, 0))
    assert undoubled(soft) is not soft
    rows, columns = np.indices(soft.shape[:2])
    details = np.where((rows + columns) % 2, 0.05, -0.05)[..., None]
    sharp = np.clip(soft + details, 0, 1).astype(np.float32)
    assert undoubled(sharp) is sharp


STROKES = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 160 120"><path fill="#fff"
d="M0 0h160v120H0z"/><path d="M20 100L50 20l30 80L45 80M100 100V25l35 70V20" fill="none"
stroke="#111" stroke-width="{}" stroke-linecap="round" stroke-linejoin="round"/></svg>"""


@pytest.mark.parametrize(
    ("width", "change", "least"),
    [
        (12, lambda picture: gaussian_filter(picture, (0.412, 0.412, 0)), 36),
        (12, lambda picture: gaussian_filter(picture, (0.5, 0.5, 0)), 36),
        (12, lambda picture: gaussian_filter(picture, (0.6, 0.6, 0)), 36),
        pytest.param(3, lambda picture: enlarged(picture, 1.5), 28, marks=pytest.mark.sweep),
        pytest.param(
            3, lambda picture: enlarged(picture, 1.5, Image.Resampling.BICUBIC), 28,
            marks=pytest.mark.sweep,
        ),
    ],
)  # fmt: skip
def test_a_drawing_with_soft_edges_is_crisp_when_enlarged(width, change, least):
    """Outlines that followed a blur were serrated, or the picture was drawn as a photo."""
    source = STROKES.format(width)
    soft = np.round(255 * change(rasterize(source, 160, 120))).astype(np.uint8)
    result = vectorize(soft)
    assert any("soft" in note for note in result.report["notes"])
    assert psnr(rasterize(result.svg, 960, 720), rasterize(source, 960, 720)) > least


def test_a_soft_picture_may_have_a_transparent_pixel():
    """Its areas are opaque, unlike the picture with which they are compared."""
    picture = gaussian_filter(rasterize(STROKES.format(12), 160, 120, alpha=True), (0.6, 0.6, 0))
    picture[0, 0, 3] = 0.5
    assert vectorize(picture).report["area_count"] > 0


@pytest.mark.sweep
def test_a_limit_of_bytes_is_filled_by_what_is_closer_to_a_soft_picture():
    picture = gaussian_filter(rasterize(STROKES.format(12), 160, 120), (0.6, 0.6, 0))
    scores = [
        vectorize(picture, max_bytes=9000, areas=a).report["psnr_svg"] for a in ("auto", "never")
    ]
    assert scores[0] > scores[1] - 0.1


def test_an_enlarged_drawing_has_the_areas_of_its_source():
    areas = DRAWINGS["discs in discs"]
    found = vectorize(enlarged(drawn(areas), 2), max_bytes=10000).scene
    assert len(found.areas) == len(areas)
    assert off(areas, found.scaled(0.5, 0.5).areas).max() < 0.4


def test_lines_on_a_shaded_ground_as_a_jpeg_are_no_photo():
    ys, xs = np.mgrid[:200, :200] / 200
    shade = 0.3 * xs * (1 - ys)
    picture = np.stack([0.7 + 0.6 * shade, 0.05 + shade, 0.1 + shade], axis=2)
    ground = picture.copy()
    for left, top, right, bottom in [(30, 45, 170, 150), (45, 95, 95, 140), (55, 60, 85, 95)]:
        box = np.s_[top:bottom, left:right]
        inner = np.s_[top + 5 : bottom - 5, left + 5 : right - 5]
        picture[box], picture[inner] = 1, ground[inner]
    for top in range(85, 130, 15):
        picture[top : top + 5, 110:155] = 1
    assert noise_of(as_jpeg(picture, 60)) > 0
