"""Laws of the written file; read back by the standard library's own XML parser."""

import re
from xml.etree.ElementTree import fromstring as parse

import numpy as np
import pytest
from conftest import random_scene
from hypothesis import given
from hypothesis import strategies as st

from gauss2svg.pipeline import palette as quantize_module
from gauss2svg.pipeline.palette import Palette, best_palette, quantize, visible_mass
from gauss2svg.raster import rasterize
from gauss2svg.scene import Scene
from gauss2svg.svg.document import Document
from gauss2svg.svg.element import number, short_id
from gauss2svg.svg.plain_ellipse import is_plain
from gauss2svg.svg.write import write_svg

SVG = "{http://www.w3.org/2000/svg}"
INKSCAPE = "{http://www.inkscape.org/namespaces/inkscape}"


def test_size_background_title_and_layers_are_there():
    scene = random_scene(30, width=70, height=50)
    root = parse(write_svg(scene, document=Document(title="A <b>&")))
    assert (root.get("width"), root.get("height")) == ("70", "50")
    assert root.get("viewBox") == "0 0 1750 1250"  # of 0.04 px
    assert root.findtext(SVG + "title") == "A <b>&"
    assert "gauss2svg" in (root.findtext(SVG + "desc") or "")
    layers = root.findall(SVG + "g")
    assert [g.get(INKSCAPE + "groupmode") for g in layers] == ["layer"] * 3
    assert [len(g) for g in layers] == np.bincount(scene.round_index).tolist()
    backdrop = root.find(SVG + "rect")
    assert backdrop is not None
    assert re.fullmatch("#[0-9a-f]{3}([0-9a-f]{3})?", backdrop.get("fill", ""))


def test_every_gradient_is_used_and_every_reference_defined():
    root = parse(write_svg(quantize(random_scene(200), palette=20)))
    defined = [g.get("id") for g in root.iter(SVG + "radialGradient")]
    for gradient in root.iter(SVG + "radialGradient"):  # resvg is 13 dB worse without the focus
        assert float(gradient.get("fx")) / float(gradient.get("r")) == 0.001
    fills = {c.get("fill", "") for c in root.iter(SVG + "circle")}
    used = {fill[5:-1] for fill in fills if not fill.startswith("#")}
    assert len(defined) == len(set(defined)) <= 20
    assert set(defined) == used


def test_empty_scene_is_a_rectangle():
    root = parse(write_svg(Scene(8, 6, background=np.array([1, 0, 0]))))
    backdrop = root.find(SVG + "rect")
    assert backdrop is not None
    assert backdrop.get("fill") == "#f00"
    assert not list(root.iter(SVG + "circle"))


@pytest.mark.parametrize(
    ("value", "decimals", "text"),
    [
        (0.0, 1, "0"), (-0.04, 1, "0"), (0.05, 2, ".05"), (-0.5, 1, "-.5"), (1.0, 3, "1"),
        (10.0, 1, "10"), (100, 0, "100"), (1234.56, 1, "1234.6"), (0.9996, 3, "1"),
    ],
)  # fmt: skip
def test_numbers_are_written_as_short_as_they_go(value, decimals, text):
    assert number(value, decimals) == text


@given(st.floats(-1e6, 1e6), st.integers(0, 6))
def test_written_number_is_the_rounded_one(value, decimals):
    assert float(number(value, decimals)) == pytest.approx(value, abs=0.5000001 * 10.0**-decimals)


def test_palette_is_weighted_by_what_shows(monkeypatch):
    scene = random_scene(300, seed=8)
    weights = []
    real = quantize_module.best_palette
    monkeypatch.setattr(
        quantize_module,
        "best_palette",
        lambda c, b, w, *rest: (weights.append(w), real(c, b, w, *rest))[1],
    )
    quantize(scene, palette=20)
    shaded = ~is_plain(scene)
    np.testing.assert_array_equal(weights[0], visible_mass(scene)[0][shaded])


def test_ids_are_distinct_letters():
    ids = [short_id(k) for k in range(6000)]
    assert len(set(ids)) == 6000
    assert all(re.fullmatch("[A-Za-z]{1,3}", text) for text in ids)
    assert ids[:2] == ["a", "b"]


def colors_of(color, weight, count: int, allowed: float = 0.0) -> Palette:
    """The palette of Gaussians."""
    return best_palette(color, np.ones(len(color)), weight, count, allowed)


def test_pairs_of_colour_and_exponent_are_told_apart_as_far_as_the_palette_goes():
    color = np.repeat([[0.2, 0.4, 0.6], [1.0, 0.0, 0.0]], 10, axis=0)
    beta = np.resize([1.0, 3.2], 20)
    full = best_palette(color, beta, np.ones(20), 4)
    assert (full.color[full.entry] == np.round(color * 255)).all()
    assert (full.beta[full.entry] == np.resize([1.0, 3.0], 20)).all()
    # colours lie further apart than exponents, so that these are given up first
    half = best_palette(color, beta, np.ones(20), 2)
    assert (half.color[half.entry] == np.round(color * 255)).all()
    assert len(half.beta) == 2


def test_few_colours_are_kept_exactly():
    color = np.repeat([[0.2, 0.4, 0.6], [1.0, 0.0, 0.0]], 10, axis=0)
    palette = colors_of(color, np.ones(20), 2)
    assert (palette.color[palette.entry] == np.round(color * 255)).all()


def test_palette_serves_what_shows_and_never_grows_past_its_size():
    rng = np.random.default_rng(4)
    color = rng.random((3000, 3))
    weight = np.where(np.arange(3000) < 300, 1000.0, 0.1)
    palette, even = colors_of(color, weight, 64), colors_of(color, np.ones(3000), 64)
    assert len(palette.color) <= 64
    error, even_error = (
        np.sum((p.color[p.entry] / 255 - color) ** 2, axis=1) for p in (palette, even)
    )
    assert error[:300].sum() < 0.8 * even_error[:300].sum()


def test_visible_mass_is_zero_under_an_opaque_cover():
    cover = np.array([[20.0, 15.0]])
    scene = random_scene(5).replace(opacity=np.full(5, 0.5), mean=np.tile(cover, (5, 1)))
    top = Scene(40, 30, cover, np.full((1, 2), 1e6), np.zeros(1), np.zeros((1, 3)), np.ones(1))
    mass, pixels = visible_mass(scene.concatenate(top))
    assert (mass[:5] < 1e-6 * mass[5]).all()
    assert pixels == 40 * 30
    assert mass[5] == pytest.approx(pixels, rel=1e-3)


def test_allowed_error_is_kept_with_few_colours():
    rng = np.random.default_rng(5)
    color, weight = rng.random((2000, 3)), rng.random(2000) + 0.1
    counts = []
    for allowed in (20.0, 2.0, 0.5):
        palette = colors_of(color, weight, 2000, allowed)
        missed = palette.color[palette.entry] / 255 - color
        assert 0.6 * allowed < np.sum(weight[:, None] * missed**2) <= allowed
        counts.append(len(palette.color))
    assert counts == sorted(counts)
    assert len(colors_of(color, weight, 50, 0.5).color) <= 50


def test_allowed_error_under_the_rounding_keeps_every_colour():
    color = np.random.default_rng(6).random((50, 3))
    palette = colors_of(color, np.ones(50), 50, 1e-9)
    assert (palette.color[palette.entry] == np.round(color * 255)).all()


def test_allowed_error_writes_fewer_gradients():
    scene = random_scene(300, seed=8, beta=(1, 1))
    texts = [write_svg(quantize(scene, color_error=e)) for e in (3e-3, 3e-4, 0.0)]
    gradients = [t.count("<radialGradient") for t in texts]
    assert gradients[0] < gradients[1] < gradients[2]
    drawn = [rasterize(t, 40, 30) for t in texts]
    for error, few in zip((3e-3, 3e-4), drawn, strict=False):
        added = np.mean((few - drawn[2]) ** 2)
        assert added < 1.5 * error + 1e-6
