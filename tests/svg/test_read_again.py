"""The law of reading: every file of write_svg gives its scene back, and then the same file."""

import re
from unittest.mock import patch

import numpy as np
import pytest
from conftest import random_scene, random_sum
from hypothesis import given
from hypothesis import strategies as st
from svg_texts import assert_same

from gauss2svg.errors import InputError
from gauss2svg.pipeline.palette import quantize
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import BETA_CLASSES
from gauss2svg.scene.parameters import PARAMETERS
from gauss2svg.svg import minimal_shapes
from gauss2svg.svg.document import STOP_COUNTS, Document, SvgFormat
from gauss2svg.svg.minimal import minimal_rounded, minimal_svg
from gauss2svg.svg.reader.read import read_svg
from gauss2svg.svg.write import write_svg

PER_SHAPE = [parameter.name for parameter in PARAMETERS]
seeds = st.integers(0, 2**32 - 1)


def mixed_scene(count: int, seed: int, width: float = 60, height: float = 40) -> Scene:
    """Shapes of all exponents, few colours and opacities, so that files share what they can."""
    rng = np.random.default_rng(seed)
    some = rng.choice([*BETA_CLASSES, 0.7, 128.0, 256.0], count)
    return Scene(
        width, height, rng.uniform(-5, 65, (count, 2)), np.exp(rng.uniform(-1.5, 2.5, (count, 2))),
        rng.uniform(-0.98, 0.98, count), np.round(rng.random((count, 3)) * 3) / 3,
        rng.choice([0.004, 0.25, 1.0, 1.0], count), rng.random(3), beta=some,
        transparent=bool(rng.integers(2)),
    )  # fmt: skip


def assert_read_as(back: Scene, scene: Scene, **within: float) -> None:
    for name in PER_SHAPE:
        np.testing.assert_allclose(getattr(back, name), getattr(scene, name), **within)
    assert back.transparent == scene.transparent
    if not scene.transparent:
        np.testing.assert_allclose(back.background, scene.background)


@given(
    seeds, st.sampled_from([0, 1, 12, 70]), st.sampled_from([0.001, 0.04, 0.5, 1.0]),
    st.sampled_from(STOP_COUNTS), st.sampled_from([500, 40, 0]),
)  # fmt: skip
def test_a_minimal_file_is_its_rounded_scene_and_the_same_file_again(
    seed, count, precision, stops, most_masked
):
    scene = mixed_scene(count, seed)
    written = SvgFormat(markup="minimal", precision=precision, stops=stops)
    with patch.object(minimal_shapes, "MOST_MASKED", most_masked):
        svg = write_svg(scene, written)
        back = read_svg(svg)
        assert_read_as(back, minimal_rounded(scene, precision, 6), rtol=1e-9, atol=1e-9)
        assert (back.width, back.height) == (scene.width, scene.height)
        assert write_svg(back, written) == svg


@given(seeds, st.sampled_from([0.037, 0.7, 1.0]), st.sampled_from([(61.7, 40.3), (60.0, 41.25)]))
def test_a_minimal_file_of_sides_that_are_no_whole_units_is_read_within_their_rounding(
    seed, precision, size
):
    scene = mixed_scene(20, seed, *size)
    back = read_svg(write_svg(scene, SvgFormat(markup="minimal", precision=precision)))
    rounded = minimal_rounded(scene, precision, 6)
    np.testing.assert_allclose(back.mean, rounded.mean, atol=0.05 * precision)
    np.testing.assert_allclose(back.color, rounded.color)
    assert (back.width, back.height) == size


def test_a_minimal_file_without_a_size_is_a_scene_in_its_own_units():
    scene = mixed_scene(20, 3).replace(transparent=False)
    svg = minimal_svg(scene, 4, 3, Document(title="a", alt="b"))
    back, rounded = read_svg(svg), minimal_rounded(scene, 4, 3)
    assert (back.width, back.height) == (15, 10)
    np.testing.assert_allclose(4 * back.mean, rounded.mean)
    np.testing.assert_allclose(back.color, rounded.color)
    # The exponents of plain ellipses are those of their size there.
    sized = read_svg(svg.replace(" viewBox", ' width="60" height="40" viewBox'))
    assert_read_as(sized, rounded, rtol=1e-9, atol=1e-9)


@given(seeds, st.sampled_from(STOP_COUNTS), st.sampled_from([0.001, 0.04]), st.booleans())
def test_an_editable_file_is_the_same_file_again(seed, stops, precision, palette):
    written = SvgFormat(stops=stops, precision=precision)
    scene = quantize(random_scene(25, 60, 45, seed, sigma=(0.5, 25)), palette=12 * palette)
    svg = write_svg(read_svg(write_svg(scene, written)), written)
    assert write_svg(read_svg(svg), written) == svg


SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 20 20">'
SOFT = minimal_svg(Scene(20, 20, [[9, 9]], [[3, 2]], [0.1], [[1, 0, 0]], [0.5]), 1, 6, masked=True)
SHEET = minimal_svg(
    Scene(20, 20, [[9, 9]], [[3, 2]], [0.1], [[1, 0, 0]], [0.5]), 1, 6, masked=False
)
SUM = write_svg(random_sum(4, 20, 20, 1))


@pytest.mark.parametrize(
    ("svg", "message"),
    [
        (SOFT.replace("<mask", '<mask maskUnits="userSpaceOnUse"'), "its mask must be the same"),
        (SOFT.replace('<circle r="1"', '<circle r="2"'), "its mask must be the same"),
        (SOFT.replace("#fff", "#ffe"), "greys of minimal markup"),
        (SOFT.replace("#fff", "#eee"), "greys of minimal markup"),
        (re.sub("<stop[^>]*>", "", SOFT), "greys of minimal markup"),
        (SOFT.replace('href="#a"', 'href="#c"'), "its reference must be to a circle"),
        (SOFT.replace('href="#a"', 'href="#a" filter="url(#c)"'), "filter of a use must be none"),
        (SOFT.replace('href="#a"', 'href="#a" mask="url(#b)"'), "its mask must be none"),
        (SOFT.replace('href="#a"', 'href="#a" visibility="hidden"'), "got a hidden one"),
        (SVG + '<use id="u" href="#u"/></svg>', "used through at most 3 others"),
        (SVG + '<g id="g"/><use href="#g"/></svg>', "unlink the clone"),
        (SVG + '<path fill="red" opacity=".5" d="M1 1a2 2 0 101 0m9 9a2 2 0 101 0"/></svg>',
         "ellipses of one path must be opaque"),
        (SVG + '<path fill="red" d="M1 1a2 2 0 101 1"/></svg>', "two or four arcs"),
        (SVG + '<path fill="red" d="M1 1a.2 .2 0 101 0"/></svg>', "two or four arcs"),
        (SHEET.replace("stop-opacity", "opacity"), "must be animation only"),
        (SHEET.replace("stop+stop{", "stop~stop{"), "must be animation only"),
        (SHEET.replace(' color="red"', "").replace(' color="#f00"', ""), "opaque colour"),
        (SUM, "<style .*: blend must be 'over' .*--save-scene"),
    ],
)  # fmt: skip
def test_what_write_svg_would_not_write_so_is_refused_in_one_line(svg, message):
    with pytest.raises(InputError, match=message) as caught:
        read_svg(svg)
    assert "\n" not in str(caught.value)


def test_a_path_of_more_shapes_than_elements_are_allowed_is_refused():
    arcs = "M1 1" + "a2 2 0 101 0m1 1" * 50 + "a2 2 0 101 0"
    svg = f'{SVG}<path fill="red" d="{arcs}"/></svg>'
    assert len(read_svg(svg)) == 51
    with pytest.raises(InputError, match="at most 50 shapes"):
        read_svg(svg, max_elements=50)


def test_a_file_is_read_the_same_after_another(tmp_path):
    (tmp_path / "a.svg").write_text(SOFT)
    assert_same(read_svg(tmp_path / "a.svg"), read_svg(SOFT.encode()))
