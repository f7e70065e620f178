"""Properties of the clip: nothing is drawn beside the picture, and nothing else changes."""

import base64
import re
from functools import partial

import numpy as np
import pytest
from outlines import polygon, polyline
from scenes import minimal_by_gradients, random_scene, random_sum
from screens import drawn_in_pages

from gauss2svg.raster import rasterize
from gauss2svg.scene import PLAIN, Area, Scene
from gauss2svg.svg import Document, SvgFormat
from gauss2svg.svg.encode import outline_svg
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import plate_svg, write_svg

WIDTH, HEIGHT = 40, 30
BESIDE = Area([polygon((0, 0), (-9, 9), (9, 9))], (1, 0, 0))
# A line that reaches beyond the canvas only by its stroke.
EDGE = Area([polyline((9, 29), (30, 29))], (0, 0, 1), width=3)
MINIMAL = SvgFormat(markup="minimal", precision=0.5)
# What writes each kind of file that has a clip.
CLIPPED = {
    "gradient": write_svg,
    "blur": partial(write_svg, svg_format=SvgFormat(form="blur")),
    "animated": partial(write_svg, document=Document(animate=1.0, fragments=True)),
    "slice": partial(write_svg, document=Document(aspect="xMidYMid slice")),
    "transparent": lambda scene: write_svg(scene.replace(transparent=True)),
    "inks": lambda scene: write_svg(in_inks(scene), SvgFormat(layers="inks")),
    "plate": lambda scene: plate_svg(in_inks(scene), "#ff0000"),
    "masks": partial(write_svg, svg_format=MINIMAL),
    "sheet": partial(minimal_by_gradients, unit=0.5),
    "arcs": lambda scene: write_svg(in_inks(scene), MINIMAL),
    "areas": lambda scene: write_svg(with_areas(scene)),
    "minimal areas": lambda scene: write_svg(with_areas(scene), MINIMAL),
    "outline": outline_svg,
    "clear arcs": lambda scene: write_svg(in_inks(scene).replace(transparent=True), MINIMAL),
}


def spilling(seed: int = 3) -> Scene:
    """A scene of which shapes reach beyond all sides of the canvas."""
    scene = random_scene(30, WIDTH, HEIGHT, seed, sigma=(3.0, 9.0))
    edge = [[0, 15], [40, 15], [20, 0], [20, 30]]
    mean = np.concatenate([edge, scene.mean[4:]])
    return scene.replace(mean=mean, opacity=np.clip(scene.opacity, 0.6, 1))


def in_inks(scene: Scene) -> Scene:
    color = np.resize([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], (len(scene), 3))
    plain = scene.replace(color=color, opacity=np.ones(len(scene)), background=[0.0, 0.0, 1.0])
    return plain.replace(drawn=np.full(len(scene), PLAIN), round_index=None)


def with_areas(scene):
    """An area and a line without Gaussians, so that they alone reach beyond the canvas."""
    return scene.select([]).replace(areas=[BESIDE, EDGE])


def without_clip(svg: str) -> str:
    """The text of a file without its inner <svg>. Fails if there is not exactly one."""
    bare, count = re.subn(
        r'<svg(?: inkscape:groupmode="layer")?>(.*)</svg></svg>', r"\1</svg>", svg
    )
    assert count == 1
    return bare


@pytest.mark.parametrize("kind", CLIPPED)
def test_the_clip_changes_neither_the_scene_that_is_read_nor_a_pixel_of_the_page(kind):
    svg = CLIPPED[kind](spilling())
    bare = without_clip(svg)
    assert len(svg) - len(bare) in (11, 38)
    # Strokes are not read.
    one, other = (read_svg(text) for text in (svg, bare)) if kind != "outline" else 2 * [spilling()]
    for name in ("mean", "sigma", "rho", "color", "opacity", "beta", "round_index", "background"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    if kind != "blur":  # which resvg does not draw
        for scale in (1, 3):
            drawn = (rasterize(text, scale * WIDTH, scale * HEIGHT) for text in (svg, bare))
            np.testing.assert_array_equal(*drawn)


@pytest.mark.browser
@pytest.mark.parametrize("kind", [*CLIPPED, "additive"])
def test_beside_a_picture_a_browser_shows_the_page_alone(kind, browser):
    a_sum = random_sum(30, WIDTH, HEIGHT, 2)  # which needs no clip
    svg = write_svg(a_sum) if kind == "additive" else CLIPPED[kind](spilling())
    uri = "data:image/svg+xml;base64," + base64.b64encode(svg.encode()).decode()
    box = "position:absolute;left:20px;width:240px;height:60px;"
    root = re.sub(' (width|height)="[\\d.]+(mm)?"', "", svg.partition("?>\n")[2] or svg, count=2)
    # A picture that fills its box by "slice" itself reaches beyond the box.
    overflow, left = ("hidden", 20) if kind == "slice" else ("visible", 100)
    inline = root.replace("<svg ", f'<svg style="{box}top:220px;overflow:{overflow}" ', 1)
    places = (
        f'<img style="{box}top:20px" src="{uri}">',
        f'<div style="{box}top:120px;background:url({uri}) 0 0/100% 100%"></div>{inline}',
    )
    body = '<div style="position:absolute;inset:0;background:{}">{}</div>'
    pages = {"#fff": (255.0, 255.0, 255.0), "#123": (17.0, 34.0, 51.0)}
    screens = drawn_in_pages([body.format(name, "".join(places)) for name in pages], 280, 300)
    for drawn, color in zip(screens, pages.values(), strict=True):
        for top in (20, 120, 220):
            picture = drawn[top : top + 60, left : 280 - left]
            assert picture.std() > 5
            picture[:] = color
        np.testing.assert_array_equal(drawn, np.broadcast_to(color, drawn.shape))
