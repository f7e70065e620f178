"""Laws of additive scenes as SVG: what the file's numbers sum up to, and what renderers draw."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from conftest import random_sum
from flat import fit_config
from hypothesis import given
from hypothesis import strategies as st

from gauss2svg.errors import RendererError
from gauss2svg.fit.fit import fit
from gauss2svg.measure.metrics import psnr
from gauss2svg.pipeline.palette import quantize
from gauss2svg.raster import rasterize, resvg
from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import cut_radius, profile
from gauss2svg.svg.document import SvgFormat
from gauss2svg.svg.headroom import phases_of
from gauss2svg.svg.stops import gradient_stops, whole_stops
from gauss2svg.svg.write import write_svg

SVG = "{http://www.w3.org/2000/svg}"
EXACT = SvgFormat(stops=8, precision=0.01)
LEVEL = 1 / 255
BETWEEN = 0.25 * LEVEL  # added for renderers that cut to whole levels
seeds = st.integers(0, 2**32 - 1)


def levels_of(text: str) -> np.ndarray:
    digits = text[1:] if len(text) == 7 else "".join(2 * digit for digit in text[1:])
    return np.array([int(digits[k : k + 2], 16) for k in (0, 2, 4)]) / 255


def drawn_by_numpy(svg: str, width: int, height: int) -> tuple[np.ndarray, float]:
    """The picture that a file's numbers are, unclipped, and the least that a canvas was left with.

    It draws on real numbers: |v - s| for every shape and rectangle, then the filter.
    """
    root = ET.fromstring(svg)
    view = [float(v) for v in root.get("viewBox").split()]
    scale = np.array([width / view[2], height / view[3]])
    ramps = {
        g.get("id"): (
            [float(stop.get("offset")) for stop in g],
            np.array([levels_of(stop.get("stop-color")) for stop in g]),
        )
        for g in root.iter(SVG + "radialGradient")
    }
    group = root.find(SVG + "g")
    assert re.fullmatch(r"url\(#transfer-[0-9a-f]{8}\)", group.get("filter"))
    first, *others = group
    canvas = np.broadcast_to(levels_of(first.get("fill")), (height, width, 3)).copy()
    y, x = np.mgrid[:height, :width] + 0.5
    least = 1.0
    for element in [e for other in others for e in other.iter()]:
        if element.tag == SVG + "rect":
            canvas = np.abs(canvas - levels_of(element.get("fill")))
        if element.tag != SVG + "circle":
            continue
        numbers = [float(v) for v in re.findall(r"-?[\d.]+", element.get("transform"))]
        matrix = np.array(numbers).reshape(3, 2).T * scale[:, None]
        inverse = np.linalg.inv(matrix[:, :2])
        r = np.hypot(*np.einsum("ij,jyx->iyx", inverse, [x - matrix[0, 2], y - matrix[1, 2]]))
        offsets, colors = ramps[element.get("fill")[5:-1]]
        drawn = np.stack([np.interp(r, offsets, column) for column in colors.T], axis=-1)
        canvas -= drawn * (r <= 1)[:, :, None]
        least = min(least, float(canvas.min()))
        canvas = np.abs(canvas)
    mapped = next(root.iter(SVG + "feComponentTransfer"))
    slope, intercept = (np.array([float(f.get(n)) for f in mapped]) for n in ("slope", "intercept"))
    return slope * canvas + intercept, least


def scene_with(seed: int = 0, count: int = 60, **changes) -> Scene:
    return random_sum(count, 60, 44, seed).replace(**changes)


def drawn_within(scene: Scene, width: int | None = None, height: int | None = None) -> float:
    """PSNR in dB of what resvg draws against the model."""
    width, height = width or round(scene.width), height or round(scene.height)
    model = render(scene, width, height)
    return psnr(rasterize(write_svg(scene, EXACT), width, height), model)


@pytest.mark.sweep
@given(seeds, st.sampled_from([0.1, 1.0, 4.0]))
def test_a_file_s_numbers_sum_up_to_the_model(seed, strength):
    scene = scene_with(seed)
    scene = scene.replace(color=strength * scene.color)
    summed, least = drawn_by_numpy(write_svg(scene, EXACT), 60, 44)
    _, low, high = phases_of(scene)
    span = np.maximum(high - low, 0.1)
    off = np.abs(np.clip(summed - BETWEEN, 0, 1) - render(scene))
    # Sixty shapes, each of stops within about half a level of the canvas; and what peaks between
    # the places that were looked at.
    assert (off.max(axis=(0, 1)) < 6 * LEVEL * span + 0.01).all()
    assert off.mean() < LEVEL * span.mean()
    # The margin for rounding is 0.01 of the canvas; beyond it only what is clipped may lie.
    unclipped = render_sum(scene, np.arange(len(scene)))
    beyond = np.maximum(unclipped - high, low - unclipped).max(axis=(0, 1)) / span
    assert least > -0.02 - max(0, beyond.max())


@pytest.mark.parametrize("background", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("sign", [-1, 0, 1])
def test_resvg_draws_sums_of_one_sign_and_of_both(background, sign):
    scene = scene_with(3, background=np.full(3, background))
    if sign:
        scene = scene.replace(color=sign * np.abs(scene.color) / 4)
    assert drawn_within(scene) > 40


@pytest.mark.sweep
@given(seeds)
def test_resvg_draws_what_the_model_is(seed):
    scene = scene_with(seed)
    _, low, high = phases_of(scene)
    lost = 20 * np.log10(np.sqrt(np.mean((high - low) ** 2)))  # dB: rounding, scaled back up
    assert drawn_within(scene) > 46 - lost


@pytest.mark.parametrize("count", [0, 1])
def test_few_gaussians_are_drawn_too(count):
    scene = scene_with(1, count, background=np.array([0.2, 0.503, 1.0]))
    assert drawn_within(scene) > 50
    assert write_svg(scene).count("<circle") == count


@pytest.mark.parametrize("factor", [0.5, 2, 3.7])
def test_a_sum_has_no_resolution(factor):
    # Wide enough that no partial sum peaks between the pixels of the canvas.
    scene = random_sum(60, 120, 88, 5)
    scene = scene.replace(sigma=scene.sigma + 2)
    assert drawn_within(scene, round(120 * factor), round(88 * factor)) > 37


@pytest.mark.parametrize("factor", [1, 2, 4])
def test_peaks_between_the_pixels_do_not_fold(factor):
    scene = random_sum(100, 60, 44, 18)
    corner = np.stack([np.arange(100) % 50 + 5, np.arange(100) % 37 + 4], axis=-1)
    scene = scene.replace(mean=corner, sigma=np.full((100, 2), 0.35), rho=np.zeros(100))
    width, height = round(60 * factor), round(44 * factor)
    off = rasterize(write_svg(scene, EXACT), width, height) - render(scene, width, height)
    assert np.abs(off).max() < 0.1
    assert drawn_within(scene, width, height) > 40


@pytest.fixture(scope="module")
def fitted(photo) -> Scene:
    return fit(photo[::2, ::2], fit_config(150, 60, blend="add")).scene


@pytest.mark.parametrize("factor", [1, 1.5, 2])
def test_resvg_draws_a_fitted_sum(fitted, factor):
    side = round(64 * factor)
    drawn = rasterize(write_svg(fitted), side, side)
    assert psnr(drawn, render(fitted, side, side)) > (42 if factor == 1 else 40)


def test_chromium_draws_a_fitted_sum(fitted, browser):
    drawn = rasterize(write_svg(fitted), 64, 64, "chromium")
    assert psnr(drawn, render(fitted)) > 42


def test_a_canvas_need_not_be_whole():
    scene = scene_with(6).replace(width=59.4, height=43.7)
    assert drawn_within(scene) > 38


@pytest.mark.parametrize(("width", "height"), [(301, 201), (201, 301), (149, 100)])
def test_pixels_that_the_canvas_covers_in_part_are_no_line_along_its_edge(width, height):
    # A grey canvas, so that a line, black or white, would be off by a half.
    scene = scene_with(17, sigma=np.full((60, 2), 6.0), background=np.full(3, 0.5))
    scene = scene.replace(color=0.2 * scene.color)
    root = f'<svg width="{width}" height="{height}"'
    svg = re.sub(r'<svg ([^>]*?)height="44"([^>]*?)width="60"', rf"{root} \1\2", write_svg(scene))
    assert root in svg
    drawn = resvg.draw(svg, width, height)  # keeps proportions, where rasterize stretches
    factor = min(width / 60, height / 44)
    offset = np.array([width - 60 * factor, height - 44 * factor]) / 2
    model = scene.scaled(factor).replace(width=width, height=height)
    off = np.abs(drawn[:, :, :3] - render(model.replace(mean=model.mean + offset)))
    assert off[drawn[:, :, 3] > 0].max() < 0.1


def test_every_renderer_but_cairo_draws_a_sum(renderer):
    scene = scene_with(7)
    svg = write_svg(scene, EXACT)
    if renderer == "cairo":
        with pytest.raises(RendererError, match=r"one of resvg.*mix-blend-mode"):
            rasterize(svg, 60, 44, renderer)
    else:
        assert psnr(rasterize(svg, 60, 44, renderer), render(scene)) > 36


def test_each_gaussian_is_in_one_phase_and_phases_have_one_pattern_of_signs():
    scene = scene_with(8, 200)
    phases, _, _ = phases_of(scene)
    np.testing.assert_array_equal(np.sort(np.concatenate(phases)), np.arange(200))
    for phase in phases:
        assert len(np.unique(scene.color[phase] < 0, axis=0)) == 1


@pytest.mark.parametrize("count", [100, pytest.param(1200, marks=pytest.mark.sweep)])
def test_what_cancels_is_drawn_in_turns(count):
    scene = scene_with(9, count)
    color = np.where(np.arange(count) % 2, 0.5, -0.5)[:, None] * np.ones(3)
    scene = scene.replace(
        mean=np.full((count, 2), 20.0), sigma=np.full((count, 2), 5.0), rho=np.zeros(count),
        color=color, background=np.full(3, 0.5), round_index=None,
    )  # fmt: skip
    _, low, high = phases_of(scene)
    assert (high - low < 1.2).all()  # half of the count if all that adds came first


@pytest.mark.sweep
def test_partial_sums_leave_the_canvas_only_where_the_picture_does():
    scene = scene_with(10)
    phases, low, high = phases_of(scene)
    fine = scene.scaled(5)  # between the samples that were looked at
    picture = render_sum(fine, np.arange(60))
    least, most = picture.min(axis=(0, 1)), picture.max(axis=(0, 1))
    assert (low <= np.maximum(least, 0.5 * least) + 0.04).all()
    assert (high >= np.minimum(most, 0.5 * (1 + most)) - 0.04).all()
    for k in range(len(phases)):
        total = render_sum(fine, np.concatenate(phases[: k + 1]))
        assert (total > np.minimum(low, picture) - 0.04).all()
        assert (total < np.maximum(high, picture) + 0.04).all()


def render_sum(scene: Scene, index: np.ndarray) -> np.ndarray:
    """The sum of some of a scene's Gaussians, not clipped."""
    y, x = np.mgrid[: round(scene.height), : round(scene.width)] + 0.5
    total = np.tile(scene.background, (*x.shape, 1))
    for i in index:
        u = np.stack([x - scene.mean[i, 0], y - scene.mean[i, 1]], axis=-1)
        r = np.sqrt(np.einsum("yxi,ij,yxj->yx", u, scene.conic[i], u))
        total += profile(r)[..., None] * scene.color[i]
    return total


@pytest.mark.parametrize("count", [5, 8])
def test_chosen_stops_are_nearer_than_rounded_ones(count):
    levels = np.random.default_rng(2).uniform(0, 40, (50, 3))
    levels[0] = 0
    offsets, colors = whole_stops(levels, count)
    assert (np.diff(offsets, axis=1) > 0).all()
    assert ((offsets >= 0) & (offsets <= 1)).all()
    assert (colors[:, -1] == 0).all()
    assert (colors[0] == 0).all()
    x = (np.arange(4000) + 0.5) / 4000
    wanted = levels[:, None, :] * profile(x * cut_radius(1.0))[:, None]

    def error(i, at, values):
        drawn = np.stack([np.interp(x, at, column) for column in values.T], axis=-1)
        return float((x[:, None] * (drawn - wanted[i]) ** 2).mean())

    at, values = (np.array(part) for part in gradient_stops(count))
    chosen = [error(i, offsets[i], colors[i]) for i in range(50)]
    rounded = [error(i, at, np.round(levels[i] * values[:, None])) for i in range(50)]
    assert (np.array(chosen) <= np.array(rounded) + 1e-3).all()
    assert np.mean(chosen) < 0.7 * np.mean(rounded)


def test_settling_keeps_signs_and_as_many_colours_as_the_palette_has():
    scene = scene_with(11, 200)
    kept = quantize(scene, palette=20)
    assert len(np.unique(kept.color, axis=0)) == 20
    assert kept.color.min() < -0.2
    assert kept.color.max() > 0.2
    np.testing.assert_array_equal(quantize(kept, palette=20).color, kept.color)
    fewer = quantize(scene, palette=4)
    assert psnr(render(kept), render(scene)) > psnr(render(fewer), render(scene)) + 3
    np.testing.assert_array_equal(quantize(scene, palette=200).color, scene.color)


def test_colours_settle_within_the_error_allowed():
    scene = scene_with(12, 200)
    coarse = quantize(scene, color_error=1e-2)
    fine = quantize(scene, color_error=1e-3)
    assert len(np.unique(coarse.color, axis=0)) < len(np.unique(fine.color, axis=0)) < 200


def test_two_sums_in_one_page_keep_their_own_transfer():
    first, second = (write_svg(scene_with(seed, 20)) for seed in (1, 2))
    for pattern in (r'id="(transfer-\w+)"', r'id="(additive-\w+)"'):
        one, other = re.findall(pattern, first), re.findall(pattern, second)
        assert len(one) == len(other) == 1
        assert one != other


def test_gradients_are_shared_by_colour():
    svg = write_svg(quantize(scene_with(13, 200), palette=10))
    assert svg.count("<radialGradient") <= 10
    assert svg.count("<circle") > 150


def test_layers_say_what_they_add_and_take():
    svg = write_svg(scene_with(14, 90), EXACT)
    labels = re.findall(r'inkscape:label="Phase (\d+): (\d+) Gaussians? that ([^"]*)"', svg)
    assert [int(number) for number, _, _ in labels] == [k + 1 for k in range(len(labels))]
    assert sum(int(count) for _, count, _ in labels) == svg.count("<circle")
    for _, _, does in labels:
        assert sorted(re.findall("red|green|blue", does)) == ["blue", "green", "red"]
