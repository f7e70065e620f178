"""Properties of minimal markup: short, well-formed, and drawn as the scene that it stands for."""

import io
import re

import numpy as np
import pytest
import resvg_py
from conftest import needs
from PIL import Image

from gauss2svg.measure.metrics import psnr
from gauss2svg.pipeline.by_bytes import whole_unit
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import MOST_BETA
from gauss2svg.svg import SvgFormat, minimal
from gauss2svg.svg.minimal import minimal_svg, rounded
from gauss2svg.svg.write import write_svg

SIDE = 96
# dB against the model. Three stops differ from the profile by .011, and a mask rounds to 8 bits.
NEAR = 40.5
# And an ellipse's edge is a pixel's coverage, where the model takes its centre.
NEAR_CRISP = 38.0


def soft_scene(count: int, seed: int = 0, side: int = SIDE) -> Scene:
    """Opaque Gaussians, broad enough for a coarse grid."""
    rng = np.random.default_rng(seed)
    return Scene(
        side, side, rng.uniform(0, side, (count, 2)), rng.uniform(3, 14, (count, 2)),
        rng.uniform(-0.8, 0.8, count), rng.random((count, 3)), np.ones(count), rng.random(3),
    )  # fmt: skip


def several_falloffs(seed: int = 0) -> Scene:
    scene = soft_scene(48, seed)
    opacity = np.random.default_rng(seed).choice([0.3, 0.7, 1.0], 48)
    return scene.replace(beta=np.tile([1.0, 1.7, 3.0, 6.0, 16.0, 64.0], 8), opacity=opacity)


def crisp_scene(count: int, seed: int = 0, colors: int = 3) -> Scene:
    """Opaque shapes with crisp rims, of so many colours."""
    rng = np.random.default_rng(seed)
    palette = np.round(rng.random((colors, 3)) * 15) / 15
    return soft_scene(count, seed).replace(
        sigma=rng.uniform(2, 12, (count, 2)), color=palette[rng.integers(colors, size=count)],
        beta=np.full(count, MOST_BETA),
    )  # fmt: skip


def match(scene: Scene, unit: float, digits: int = 6, renderer: str = "resvg") -> float:
    """PSNR of the file of a scene against what `rounded` says that it draws."""
    drawn = rasterize(minimal_svg(scene, unit, digits), SIDE, SIDE, renderer)
    return psnr(drawn, render(rounded(scene, unit, digits).scene, SIDE, SIDE))


@pytest.mark.parametrize(
    "renderer",
    [
        "resvg",
        pytest.param("librsvg", marks=pytest.mark.process),
        pytest.param("chromium", marks=pytest.mark.browser),
    ],
)
@pytest.mark.parametrize("most_masked", [500, 25, 0], ids=["masks", "both", "gradients"])
def test_the_file_draws_the_rounded_scene(renderer, most_masked, monkeypatch):
    if renderer != "resvg":
        needs(renderer)
    monkeypatch.setattr(minimal, "MOST_MASKED", most_masked)
    kinds = [(soft_scene(40), NEAR), (several_falloffs(), NEAR_CRISP)]
    for unit in (0.04, 1.5):
        for scene, least in kinds if renderer != "chromium" else kinds[unit > 1 :][:1]:
            assert match(scene, unit, renderer=renderer) > least


def test_files_take_the_bytes_that_are_stated():
    empty = minimal_svg(Scene(768, 512, background=np.array([0.2, 0.53, 0.67])), 256)
    assert len(empty) < 110
    assert empty.endswith(' viewBox="0 0 3 2"><path fill="#38a" d="M0 0h3v2H0"/></svg>')
    fewer, more = (len(minimal_svg(soft_scene(count), SIDE / 64)) for count in (20, 50))
    assert (more - fewer) / 30 < 65
    assert fewer - 20 * 65 < 120 + 290  # the falloff, its mask and its circle
    scene = several_falloffs()
    editable = write_svg(scene, SvgFormat(precision=0.1))
    assert len(minimal_svg(scene, 0.1, 6)) < 0.4 * len(editable)
    svg = minimal_svg(crisp_scene(60, colors=1), 0.4)
    assert svg.count("<path") == 2
    assert len(svg) / 60 < 27


@pytest.mark.parametrize("size", [(97, 333), (60, 41), (500, 1)])
def test_a_file_drawn_by_one_side_of_its_photo_has_the_other_to_the_pixel(size):
    for about in (0, 3, 64):
        for unit in (whole_unit(*size, about), max(size) / max(about, 1)):
            svg = minimal_svg(Scene(*size), unit)
            for side in ({}, {"width": size[0]}, {"height": size[1]}):
                png = resvg_py.svg_to_bytes(svg_string=svg, **side)
                across, down = Image.open(io.BytesIO(bytes(png))).size
                scale = 1 if side else size[0] / across
                assert (across * scale, down * scale) == pytest.approx(size)
    unit = whole_unit(*size, max(size) / 4)  # whole on both sides
    svg = minimal_svg(Scene(*size), unit)
    assert " width=" not in svg
    width, height = map(int, re.findall(r'viewBox="0 0 (\d+) (\d+)"', svg)[0])
    assert width * size[1] == height * size[0]
    assert max(width, height) * unit == pytest.approx(max(size))


@pytest.mark.parametrize(("unit", "seed"), [(0.01, 1), (0.4, 2), (1.5, 3)])
def test_arcs_draw_what_the_editable_file_draws_with_fewer_changes_of_colour(unit, seed):
    scene = crisp_scene(60, seed)
    svg, drawn = minimal_svg(scene, unit, 6), rounded(scene, unit, 6).scene
    exact = SvgFormat(precision=0.001)
    arcs, circles = (rasterize(text, 192, 192) for text in (svg, write_svg(drawn, exact)))
    assert psnr(arcs, circles) > 43
    assert svg.count("<path") < 0.7 * np.count_nonzero(np.diff(scene.color, axis=0).any(axis=1))
    if unit == 0.01:
        assert psnr(arcs, rasterize(write_svg(scene, exact), 192, 192)) > 35
