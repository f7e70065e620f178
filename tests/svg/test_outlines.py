"""Laws of outlines: one stroke a shape, along the contour at half height, and nothing else."""

import gzip
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import random_scene
from flat import vectorize
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from gauss2svg.cli.main import main
from gauss2svg.errors import InputError
from gauss2svg.raster import rasterize
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import half_radius, profile
from gauss2svg.svg.document import Document
from gauss2svg.svg.syntax.values import color
from gauss2svg.svg.write import outline_svg

SVG = "{http://www.w3.org/2000/svg}"


def parse(svg: str) -> ElementTree.Element:
    return ElementTree.fromstring(svg.encode())


@given(st.floats(0.5, 256))
def test_contour_is_at_half_height(beta):
    assert profile(half_radius(beta), beta) == pytest.approx(0.5, abs=1e-9)


def test_every_shape_is_one_stroke_in_its_colour_and_nothing_is_filled():
    scene = random_scene(40, seed=3, sigma=(1, 8)).replace(opacity=np.full(40, 0.5))
    root = parse(outline_svg(scene))
    ellipses = list(root.iter(SVG + "ellipse"))
    drawn = [color(e.get("stroke", ""), "stroke") for e in ellipses]
    np.testing.assert_allclose(drawn, scene.color, atol=0.51 / 255)
    assert root.get("fill") == "none"
    assert not any("fill" in element.attrib for element in root.iter() if element is not root)
    names = {element.tag.removeprefix(SVG) for element in root.iter()}
    assert names == {"svg", "title", "desc", "defs", "g", "ellipse"}
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
    document = Document(
        title="<t>",
        alt="a & b",
        size="9cm",
        aspect="xMaxYMid meet",
        segments=np.array([[1, 2]]),
        animate=3,
    )
    scene = random_scene(30, seed=2)
    root = parse(outline_svg(scene, document))
    assert [root[0].text, root[1].text] == ["<t>", "a & b"]
    assert (root.get("width"), root.get("height")) == ("9cm", "6.75cm")
    assert root.get("preserveAspectRatio") == "xMaxYMid meet"
    assert root.find(SVG + "style") is not None
    assert {g.get("id")[8:] for g in root.findall(f"{SVG}g/{SVG}g")} <= {"segment-1", "segment-2"}


def test_shapes_that_are_not_drawn_have_no_stroke():
    scene = random_scene(3, seed=1).replace(
        opacity=[0.001, 1, 1], sigma=[[5, 5], [0.001, 5], [5, 5]], rho=[0, 0, 0]
    )
    assert outline_svg(scene).count("<ellipse") == 1
    assert "<ellipse" not in outline_svg(Scene(5, 4))


@pytest.mark.parametrize("width", [0, -1, float("nan"), 1e9, "thin"])
def test_stroke_of_no_width_is_refused(width):
    with pytest.raises(InputError, match="stroke_width must be"):
        outline_svg(Scene(5, 4), stroke_width=width)


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
