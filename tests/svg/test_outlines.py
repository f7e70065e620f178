"""Laws of outlines: one stroke a shape, along the contour at half height, and nothing else."""

import gzip
import re
from xml.etree.ElementTree import fromstring as parse

import numpy as np
import pytest
from conftest import random_scene
from flat import vectorize
from PIL import Image

from gauss2svg.cli.main import main
from gauss2svg.raster import rasterize
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import half_radius
from gauss2svg.svg.document import Document
from gauss2svg.svg.read_shapes import color_of
from gauss2svg.svg.write import outline_svg

SVG = "{http://www.w3.org/2000/svg}"


def test_every_shape_is_one_stroke_in_its_colour_and_nothing_is_filled():
    scene = random_scene(40, seed=3, sigma=(1, 8)).replace(opacity=np.full(40, 0.5))
    root = parse(outline_svg(scene))
    ellipses = list(root.iter(SVG + "ellipse"))
    drawn = [color_of(e.get("stroke", ""), "stroke") for e in ellipses]
    np.testing.assert_allclose(drawn, scene.color, atol=0.51 / 255)
    assert root.get("fill") == "none"
    assert not any("fill" in element.attrib for element in root.iter() if element is not root)
    layers = root.findall(SVG + "g")
    assert [layer.get("id") for layer in layers] == ["round-1", "round-2", "round-3"]
    assert [len(layer) for layer in layers] == np.bincount(scene.round_index).tolist()


@pytest.mark.parametrize("beta", [1.0, 3.0, 16.0])
@pytest.mark.parametrize(("sigma", "rho"), [((20, 8), 0.0), ((9, 21), 0.6), ((15, 15), -0.8)])
def test_stroke_lies_where_the_falloff_is_half(sigma, rho, beta):
    scene = Scene(
        120, 100, mean=[[61, 47]], sigma=[sigma], rho=[rho], color=[[0, 0, 0]], opacity=[1],
        beta=[beta],
    )  # fmt: skip
    y, x = np.mgrid[:400, :480] / 4 + 0.125
    ink = 1 - rasterize(outline_svg(scene, stroke_width=0.5), 480, 400)[:, :, 0]
    u, v = x - 61, y - 47
    w11, w21, w22 = scene.whitening[0]
    r = np.hypot(w11 * u, w21 * u + w22 * v)
    radius = half_radius(beta)
    # Off the contour by no more than half the width and a pixel of this finer raster.
    gradient = np.hypot(*np.gradient(r, 0.25))
    distance = np.abs(r - radius) / np.maximum(gradient, 1e-9)
    assert distance[ink > 0.5].max() < 0.25 + 0.25
    assert (ink[distance < 0.1] > 0.5).all()


def test_width_is_the_same_however_thin_the_ellipse():
    scene = Scene(
        100, 60, mean=[[50, 30]], sigma=[[28, 9]], color=[[0, 0, 0]], opacity=[1], rho=[0],
    )  # fmt: skip
    ink = 1 - rasterize(outline_svg(scene, stroke_width=1), 800, 480)[:, :, 0]
    across = ink[:, 400].sum() / 8  # px of both strokes over the middle
    end = ink[240, 600:].sum() / 8  # of one at the end
    assert across == pytest.approx(2, abs=0.05)
    assert end == pytest.approx(1, abs=0.1)


def test_document_is_that_of_the_picture():
    document = Document(size="9cm", aspect="xMaxYMid meet", animate=3)
    root = parse(outline_svg(random_scene(30, seed=2), document))
    assert (root.get("width"), root.get("height")) == ("9cm", "6.75cm")
    assert root.get("preserveAspectRatio") == "xMaxYMid meet"
    assert root.find(SVG + "style") is not None
    assert "<ellipse" not in outline_svg(Scene(5, 4))


@pytest.mark.parametrize("size", [None, "responsive", "120mm", "2in"])
def test_strokes_of_pens_are_those_of_the_page_alone(size):
    scene = random_scene(60, 90, 70, 5, (4, 40), (1, 8))
    scene = scene.replace(color=np.full((60, 3), 0.0))
    svg = outline_svg(scene, Document(size=size), stroke_width=0.3, pens=1)
    at_96_dpi = 90 * 25.4 / 96
    width = {"120mm": 120.0, "2in": 50.8}.get(size, at_96_dpi)
    root = parse(svg)
    assert float(root.get("width").removesuffix("mm")) == pytest.approx(width, abs=0.001)
    assert [float(v) for v in root.get("viewBox").split()[2:]] == pytest.approx(
        [width, width * 70 / 90], abs=0.001
    )
    ends = re.findall(r"(-?[\d.]+) (-?[\d.]+)(?=A|M|\")", "".join(re.findall(r' d="[^"]*"', svg)))
    assert len(ends) > 50
    x, y = np.array(ends, float).T
    assert 0 <= x.min() < x.max() <= width + 0.005
    assert 0 <= y.min() < y.max() <= width * 70 / 90 + 0.005
    # On the page nothing has gone, and nothing has come.
    before = outline_svg(scene, stroke_width=0.3)
    ink, inside = (rasterize(one, 900, 700)[:, :, 0] for one in (before, svg))
    assert before.count("<ellipse") > svg.count("<ellipse") > 5
    away = np.abs((1 - ink) - (1 - inside))[2:-2, 2:-2]
    assert (away > 0.6).mean() < 0.002


def test_each_pen_is_a_layer_with_the_strokes_that_it_is_nearest_to():
    scene = random_scene(80, 90, 70, 5, (1, 8), (1, 8))
    root = parse(outline_svg(scene, pens=4))
    layers = root.findall(SVG + "g")
    labels = [layer.get("{http://www.inkscape.org/namespaces/inkscape}label") for layer in layers]
    assert [layer.get("id") for layer in layers] == [f"pen-{k}" for k in (1, 2, 3, 4)]
    for at, (layer, label) in enumerate(zip(layers, labels, strict=True), start=1):
        assert label == f"{at} {layer.get('stroke')}: {len(layer)} strokes"
        assert not any("stroke" in one.attrib for one in layer)
    few = scene.replace(color=np.where(np.arange(80)[:, None] < 40, [1.0, 0, 0], [0.0, 0, 1]))
    found = parse(outline_svg(few, pens=5)).findall(SVG + "g")
    assert {layer.get("stroke") for layer in found} == {"#ff0000", "#0000ff"}


def test_pens_draw_on_paper_of_less_than_a_hundredth_of_a_millimetre():
    assert 'id="pen-1"' in outline_svg(
        random_scene(60, 900, 3, 5, (4, 40), (1, 8)), Document(size="2mm"), pens=1
    )


def test_ellipse_off_the_page_is_not_drawn_and_one_round_it_neither():
    shapes = Scene(
        20, 10, mean=[[-30, 5], [10, 5], [10, 5]], sigma=[[5, 5], [50, 50], [2, 1]],
        rho=[0, 0, 0], color=np.zeros((3, 3)), opacity=[1, 1, 1],
    )  # fmt: skip
    svg = outline_svg(shapes, pens=2)
    assert svg.count("<ellipse") == 1
    assert "<path" not in svg
    assert outline_svg(Scene(5, 4), pens=2).count("<g") == 0


@pytest.mark.parametrize("name", ["outline.svg", "outline.svgz"])
def test_outline_is_another_file_beside_the_picture(name, photo, tmp_path):
    picture, out, outline = (tmp_path / n for n in ("photo.png", "o.svg", name))
    Image.fromarray(np.round(photo * 255).astype(np.uint8)).save(picture)
    quick = ["--gaussians", "40", "--iterations", "20", "--quiet", "--size", "12cm"]
    assert main([str(picture), "-o", str(out), "--outline", str(outline), *quick]) == 0
    result = vectorize(picture, gaussians=40, iterations=20, size="12cm")
    assert out.read_text() == result.svg
    data = outline.read_bytes()
    if name.endswith("z"):
        data = gzip.decompress(data)
    assert data.decode() == result.outline()
    assert len(re.findall("<ellipse", result.outline())) == len(result.scene)


def test_pens_are_the_same_in_any_order_of_the_shapes():
    scene = random_scene(120, 90, 70, 5, (2, 9), (1, 1))
    scene = scene.replace(round_index=None)
    mixed = scene.select(np.random.default_rng(1).permutation(120))
    names = [
        sorted(set(re.findall(r'stroke="(#\w+)"', outline_svg(one, stroke_width=0.3, pens=4))))
        for one in (scene, mixed)
    ]
    assert len(names[0]) == 4
    assert names[0] == names[1]
