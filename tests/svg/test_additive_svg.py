"""Properties of additive files: what their numbers sum up to, and what renderers draw of them."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from conftest import random_sum
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from gauss2svg.measure.metrics import psnr
from gauss2svg.raster import rasterize
from gauss2svg.raster.libraries import resvg
from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import cut_radius, profile
from gauss2svg.svg import SvgFormat
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
    """Return the unclipped picture of a file's numbers, and the least value of the canvas.

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


def unclipped_sum(scene: Scene) -> np.ndarray:
    y, x = np.mgrid[: round(scene.height), : round(scene.width)] + 0.5
    total = np.tile(scene.background, (*x.shape, 1))
    for mean, conic, color in zip(scene.mean, scene.conic, scene.color, strict=True):
        u = np.stack([x - mean[0], y - mean[1]], axis=-1)
        total += profile(np.sqrt(np.einsum("yxi,ij,yxj->yx", u, conic, u)))[..., None] * color
    return total


@settings(max_examples=5, phases=(Phase.explicit, Phase.generate))  # shrinking takes minutes
@given(seeds, st.sampled_from([0.1, 1.0, 4.0]))
def test_a_file_s_numbers_sum_up_to_the_model(seed, strength):
    scene = scene_with(seed)
    scene = scene.replace(color=strength * scene.color)
    summed, least = drawn_by_numpy(write_svg(scene, EXACT), 60, 44)
    phases, low, high = phases_of(scene)
    np.testing.assert_array_equal(np.sort(np.concatenate(phases)), np.arange(60))
    assert all(len(np.unique(scene.color[phase] < 0, axis=0)) == 1 for phase in phases)
    span = np.maximum(high - low, 0.1)
    off = np.abs(np.clip(summed - BETWEEN, 0, 1) - render(scene))
    # Sixty shapes, each of stops within about half a level of the canvas; and what peaks between
    # the places that were looked at.
    assert (off.max(axis=(0, 1)) < 6 * LEVEL * span + 0.01).all()
    assert off.mean() < LEVEL * span.mean()
    # The margin for rounding is 0.01 of the canvas; beyond it only what is clipped may lie.
    unclipped = unclipped_sum(scene)
    beyond = np.maximum(unclipped - high, low - unclipped).max(axis=(0, 1)) / span
    assert least > -0.02 - max(0, beyond.max())


def one_sign(sign: int, background: float) -> Scene:
    scene = scene_with(3, background=np.full(3, background))
    return scene.replace(color=sign * np.abs(scene.color) / 4)


def crowded() -> Scene:
    """Sharp Gaussians that peak between the pixels."""
    corner = np.stack([np.arange(100) % 50 + 5, np.arange(100) % 37 + 4], axis=-1)
    scene = random_sum(100, 60, 44, 18)
    return scene.replace(mean=corner, sigma=np.full((100, 2), 0.35), rho=np.zeros(100))


def broad() -> Scene:
    scene = random_sum(60, 120, 88, 5)
    return scene.replace(sigma=scene.sigma + 2)


@pytest.mark.parametrize(
    ("scene", "factor", "least"),
    [
        *((one_sign(sign, grey), 1, 40) for sign in (-1, 1) for grey in (0.0, 0.5, 1.0)),
        *((scene_with(seed), 1, 40) for seed in (3, 4, 5)),
        (scene_with(1, 0, background=np.array([0.2, 0.503, 1.0])), 1, 50),
        (scene_with(1, 1), 1, 50),
        (scene_with(6).replace(width=59.4, height=43.7), 1, 38),
        *((broad(), factor, 37) for factor in (0.5, 2, 3.7)),
        *((crowded(), factor, 40) for factor in (1, 2, 4)),
    ],
)  # fmt: skip
def test_resvg_draws_the_model_at_any_size(scene, factor, least):
    width, height = round(scene.width * factor), round(scene.height * factor)
    drawn, model = rasterize(write_svg(scene, EXACT), width, height), render(scene, width, height)
    assert psnr(drawn, model) > least
    assert factor == 1 or np.abs(drawn - model).max() < 0.1


def test_every_renderer_but_cairo_draws_a_sum(renderer):
    scene = scene_with(7)
    if renderer != "cairo":  # which refuses it
        assert psnr(rasterize(write_svg(scene, EXACT), 60, 44, renderer), render(scene)) > 36


def test_what_cancels_is_drawn_in_turns():
    color = np.where(np.arange(100) % 2, 0.5, -0.5)[:, None] * np.ones(3)
    scene = scene_with(
        9, 100, mean=np.full((100, 2), 20.0), sigma=np.full((100, 2), 5.0), rho=np.zeros(100),
        color=color, background=np.full(3, 0.5), round_index=None,
    )  # fmt: skip
    _, low, high = phases_of(scene)
    assert (high - low < 1.2).all()  # half of the count if all that adds came first


@pytest.mark.parametrize("count", [5, 8])
def test_chosen_stops_are_nearer_than_rounded_ones(count):
    levels = np.random.default_rng(2).uniform(0, 40, (50, 3))
    levels[0] = 0
    offsets, colors = whole_stops(levels, count)
    assert (np.diff(offsets, axis=1) > 0).all()
    assert ((offsets >= 0) & (offsets <= 1)).all()
    assert not colors[:, -1].any()
    assert not colors[0].any()
    x = (np.arange(4000) + 0.5) / 4000
    falloff = profile(x * cut_radius(1.0))[:, None]

    def error(level, at, values):
        drawn = np.stack([np.interp(x, at, column) for column in values.T], axis=-1)
        return float((x[:, None] * (drawn - level * falloff) ** 2).mean())

    at, values = (np.array(part) for part in gradient_stops(count))
    rounded = [error(level, at, np.round(level * values[:, None])) for level in levels]
    chosen = list(map(error, levels, offsets, colors))
    assert (np.array(chosen) <= np.array(rounded) + 1e-3).all()
    assert np.mean(chosen) < 0.7 * np.mean(rounded)


def test_layers_say_what_they_add_and_two_sums_in_one_page_keep_their_own_filter():
    first, second = (write_svg(scene_with(seed, 90), EXACT) for seed in (14, 1))
    for pattern in (r'id="(transfer-\w+)"', r'id="(additive-\w+)"'):
        one, other = re.findall(pattern, first), re.findall(pattern, second)
        assert len(one) == len(other) == 1
        assert one != other
    labels = re.findall(r'inkscape:label="Phase (\d+): (\d+) Gaussians? that ([^"]*)"', first)
    assert [int(number) for number, _, _ in labels] == [k + 1 for k in range(len(labels))]
    assert sum(int(count) for _, count, _ in labels) == first.count("<circle")


@pytest.mark.parametrize(("width", "height"), [(201, 301), (149, 100)])
def test_pixels_that_the_canvas_covers_in_part_are_no_line_along_its_edge(width, height):
    # A grey canvas, so that a line, black or white, would be off by a half.
    scene = scene_with(17, sigma=np.full((60, 2), 6.0), background=np.full(3, 0.5))
    scene = scene.replace(color=0.2 * scene.color)
    root = f'<svg width="{width}" height="{height}"'
    svg = re.sub(r'<svg ([^>]*?)height="44"([^>]*?)width="60"', rf"{root} \1\2", write_svg(scene))
    assert root in svg
    drawn = resvg(svg, width, height)  # keeps proportions, where rasterize stretches
    factor = min(width / 60, height / 44)
    offset = np.array([width - 60 * factor, height - 44 * factor]) / 2
    model = scene.scaled(factor).replace(width=width, height=height)
    off = np.abs(drawn[:, :, :3] - render(model.replace(mean=model.mean + offset)))
    assert off[drawn[:, :, 3] > 0].max() < 0.1
