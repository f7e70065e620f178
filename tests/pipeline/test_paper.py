"""Properties of sketches on paper: the file has their strokes, and nothing of the paper."""

import io
import re

import numpy as np
import pytest
from flat import vectorize
from pictures import antialiased_badge, ball
from PIL import Image, ImageDraw
from scipy import ndimage
from skimage import data

from gauss2svg.measure.metrics import psnr
from gauss2svg.pipeline.paper import evened
from gauss2svg.raster import rasterize
from gauss2svg.scene.inks import ink_colors, ink_name

WIDTH, HEIGHT = 320, 240
PATHS = {
    "M30 60C90-20 150 140 290 30": 4.0,
    "M40 200l120-90": 3.0,
    "M50 110l110 90": 4.0,
    "M190 215l20-110": 3.0,
    "M240 110q50 50 20 100": 2.5,
}
Y, X = np.mgrid[:HEIGHT, :WIDTH, :1][:2] / WIDTH


def lines(color="#1c1c22"):
    """Return the lines (h, w, 3) on white."""
    strokes = "".join(f'<path d="{d}" stroke-width="{width}"/>' for d, width in PATHS.items())
    svg = f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}"><path
    fill="#fff" d="M0 0h{WIDTH}v{HEIGHT}H0z"/><g fill="none" stroke="{color}"
    stroke-linecap="round">{strokes}</g></svg>"""
    return rasterize(svg, WIDTH, HEIGHT)


def in_8_bits(picture, quality=None):
    """Return a picture in levels of 255, saved as JPEG if a quality is given."""
    image, file = Image.fromarray(np.uint8(np.round(255 * np.clip(picture, 0, 1)))), io.BytesIO()
    image.save(file, *(["PNG"] if quality is None else ["JPEG"]), quality=quality or 0)
    return np.asarray(Image.open(file), np.float32) / 255


def on_paper(picture, quality=None, grain=0.01):
    """Return a picture on yellowish paper with the shadow of a hand, a stain, grain and blur."""
    shadow = ndimage.gaussian_filter(((X > 0.6) & (Y < 0.4)).astype(float), (6, 6, 0))
    stain = 0.06 * (np.hypot(X - 0.3, Y - 0.5) < 0.1)
    light = (0.7 + 0.3 * X) * (1 - 0.25 * shadow) * (1 - stain) * [0.97, 0.95, 0.9]
    photo = ndimage.gaussian_filter(picture * light, (0.6, 0.6, 0))
    return in_8_bits(photo + np.random.default_rng(0).normal(0, grain, X.shape), quality)


SKETCH = on_paper(lines())


def _middle(area):
    """Return the middle of an area along x."""
    x = np.concatenate([outline.nodes[:, 0] for outline in area.outlines])
    return (x.min() + x.max()) / 2


def widths(scene):
    """Return the widths of the strokes of a scene that has nothing else."""
    assert len(scene) == 0
    assert all(area.width for area in scene.areas)
    return sorted(area.width for area in scene.areas for _ in area.outlines)


@pytest.mark.parametrize(("color", "quality"), [("#1d3f9a", None), ("#777777", 85)])
def test_a_sketch_becomes_its_strokes_on_paper_of_one_colour(color, quality):
    result = vectorize(on_paper(lines(color), quality))
    scene, report = result.scene, result.report
    assert widths(scene) == pytest.approx(sorted(PATHS.values()), rel=0.05)
    paper, ink = ink_colors(report["sketch"])
    assert np.abs(ink / paper - ink_colors(color)).max() < 0.12
    assert np.abs(scene.background - paper).max() < 1e-6
    assert {area.paint for area in scene.areas} == {tuple(ink)}


@pytest.fixture(scope="module")
def usual():
    """The result of the sketch by default."""
    return vectorize(SKETCH)


def test_the_match_is_that_with_the_even_sketch_and_a_note_has_the_other(usual):
    bare = usual.photo[-20:]  # no line is there
    assert (bare == bare[0, 0]).all()
    assert usual.report["psnr_svg"] == pytest.approx(psnr(usual.raster, usual.photo))
    assert usual.report["psnr_svg"] > 38
    (note,) = usual.report["notes"]
    assert f"With them it is {psnr(usual.raster, SKETCH):.2f} dB" in note
    assert usual.report["psnr_photo"] == pytest.approx(psnr(usual.raster, SKETCH))


@pytest.mark.parametrize("inks", [2, "#b01020,#fff8e0"])
def test_two_inks_have_the_same_strokes_and_a_plate_for_each(inks, usual):
    result = vectorize(SKETCH, inks=inks)
    assert widths(result.scene) == pytest.approx(widths(usual.scene), abs=0.1)
    names = result.report["inks"].split(",")
    assert names == (usual.report["sketch"] if inks == 2 else inks).split(",")
    assert [ink_name(ink) for ink in result.scene.inks] == sorted(names)
    plates = {name: rasterize(svg, WIDTH, HEIGHT) for name, svg in result.plates().items()}
    darker = min(names, key=lambda name: ink_colors(name).sum())
    assert psnr(plates[darker], lines("#000")) > 30
    assert plates.keys() == set(names)
    assert np.abs(sum(plates.values()) - 1).max() < 0.02


@pytest.mark.parametrize(
    "given", [{"areas": "never", "gaussians": 9}, {"target_psnr": 22}], ids=str
)
def test_other_options_draw_the_picture_as_it_is(given):
    result = vectorize(SKETCH, iterations=4, **given)
    assert result.report["sketch"] is None
    assert len(result.scene) > 0
    assert np.abs(result.photo - SKETCH).max() < 1e-6


@pytest.mark.parametrize("name", ["page", "text"])
def test_uneven_pages_are_sketches(name):
    gray = getattr(data, name)()
    page = np.repeat(gray[..., None], 3, axis=2).astype(np.float32) / 255
    picture = evened(page, page, None)[0]
    is_ink = picture[..., 0] < picture[..., 0].mean(axis=(0, 1))
    assert all(is_ink[:, k::4].mean() < 0.2 for k in range(4))


def _in_pencil():
    """Return soft lines of uneven darkness on paper that a scanner has made white."""
    rng = np.random.default_rng(0)
    dark = ndimage.gaussian_filter((1 - lines("#000")) * rng.uniform(0.3, 0.9, X.shape), (1, 1, 0))
    return in_8_bits(1 - dark + rng.normal(0, 0.0025, X.shape))


@pytest.mark.parametrize("name", ["pale", "white paper"])
def test_pencil_is_a_sketch(name):
    sketch = on_paper(lines("#b4b0aa"), grain=0.005) if name == "pale" else _in_pencil()
    found = evened(sketch, sketch, None)
    assert found is not None
    picture = found[0]
    ink = (picture - picture.max(axis=(0, 1))) / np.ptp(picture, axis=(0, 1))
    assert psnr(1 + ink, lines("#000")) > 17


def test_a_scan_in_two_colours_has_smooth_edges():
    """Drawn as pixel art, its enlarged lines were stairs. Blurred, it had no lines of 1 px."""
    source = lines("#000")
    source[-20, 30:90] = 0
    result = vectorize(np.float32(source > 0.5))
    raster = rasterize(result.svg, WIDTH, HEIGHT)
    assert psnr(raster, source) > psnr(np.float32(source > 0.5), source) + 2
    assert raster[-20, 40:80].max() < 0.5


@pytest.mark.sweep
def test_each_ink_of_a_sketch_keeps_its_colour_and_has_a_pen():
    colors = "#aa0000", "#0000aa", "#222222"
    thirds = np.select([X < 0.35, X < 0.65], [lines(colors[0]), lines(colors[1])], lines(colors[2]))
    result = vectorize(on_paper(thirds, 90))
    found = ink_colors(result.report["sketch"])[1:]
    assert len(found) == len(colors)
    for color in ink_colors(",".join(colors)):
        nearest = found[np.abs(found - color).max(axis=1).argmin()]
        assert np.abs(nearest - color).max() < 0.2
    for x in (0.2, 0.5, 0.8):  # the ink of a stroke is that of its third
        own = [np.array(a.paint) for a in result.scene.areas if abs(_middle(a) / WIDTH - x) < 0.1]
        index = 0 if x < 0.35 else 1 if x < 0.65 else 2
        assert all(np.abs(c - ink_colors(colors[index])).max() < 0.2 for c in own)
    assert len(set(re.findall(r'stroke="(#\w+)"', result.plot().svg))) == len(colors)


SPOTS = np.where(np.hypot(X - 0.5, Y - 0.4) < 0.15, [0.4, 1.0, 0.5], 1.0)
COFFEE = np.asarray(Image.fromarray(data.coffee()).resize((WIDTH, HEIGHT)), np.float32) / 255
PENS = "#aa0000", "#0000aa", "#222222", "#e08000", "#a000c0", "#008040"
AXIS = np.where((np.abs(Y - 0.7) < 0.006) & (X < 0.5), 0.0, 1.0)


def blurred(picture, sigma):
    """Return a picture without the edges of a drawing, as JPEG."""
    return in_8_bits(ndimage.gaussian_filter(picture, (sigma, sigma, 0)), 80)


def cartoon():
    """Return pale discs with black outlines."""
    picture = np.ones((HEIGHT, WIDTH, 3))
    for k, (x, y) in enumerate(np.random.default_rng(1).uniform([30, 30], [290, 210], (14, 2))):
        distance = np.hypot(X * WIDTH - x, Y * WIDTH - y)
        picture = np.where(distance < 22, np.roll([1, 0.93, 0.88], k), picture)
        picture = np.where(np.abs(distance - 22) < 1, 0, picture)
    return picture


def pale_text():
    """Return a page of small grey letters."""
    page = Image.new("RGB", (640, 480), "white")
    words = "lorem ipsum dolor sit amet consectetur adipiscing elit sed do eiusmod tempor "
    words += "incididunt ut labore et dolore"
    for y in range(8, 460, 15):
        ImageDraw.Draw(page).text((10, y), words, fill="#aaa", font_size=10)
    return np.asarray(page, np.float32) / 255


OTHERS = {
    "drawn": in_8_bits(lines()),
    "drawn on a gradient": in_8_bits(lines() * (0.7 + 0.15 * X + 0.2 * Y)),
    "with a coloured area": on_paper(lines() * SPOTS),
    "in six colours": on_paper(
        np.select([k / 6 > X for k in range(1, 6)], [lines(c) for c in PENS[:5]], lines(PENS[5]))
    ),
    "out of focus": ndimage.gaussian_filter(SKETCH, (4, 4, 0)),
    "on black": 1 - SKETCH,
    "without a line": on_paper(np.ones((HEIGHT, WIDTH, 3))),
    "on a photo": np.minimum(lines(), COFFEE),
    "with alpha": np.dstack([SKETCH, X]),
    "in grey, with a black axis": blurred(np.minimum(lines("#999"), AXIS), 1.1),
    "a pale cartoon": blurred(cartoon(), 1.4),
    "pale text": pale_text(),
    "of one colour": np.full((300, 300, 3), 0.9, np.float32),
    "pixel art": np.float32(lines("#000")[::8, ::8] > 0.5).repeat(8, axis=0).repeat(8, axis=1),
    "hatched": np.float32((np.indices(X.shape)[:2].sum(axis=0) % 3 > 0) | (lines("#000") > 0.5)),
    "a ball": ball(256),
    "a badge": antialiased_badge(256),
}
PHOTOS = "astronaut", "clock", "coins", "moon"


@pytest.mark.parametrize("name", OTHERS)
def test_other_pictures_are_no_sketches(name):
    assert evened(OTHERS[name], OTHERS[name], None) is None


@pytest.mark.parametrize("name", PHOTOS)
def test_photos_and_parts_of_them_are_no_sketches(name):
    photo = np.asarray(Image.fromarray(getattr(data, name)()).convert("RGB"), np.float32) / 255
    parts = [photo[y::times, x::times] for times in (2, 4) for x in (0, 96) for y in (0, 96)]
    for part in (*parts, photo[:200, :200], photo[-200:, -200:], np.minimum(1.5 * photo, 1)):
        assert evened(part, part, None) is None
