"""Properties of reading: a file of write_svg gives its scene back, and any other is refused."""

import math
from typing import get_args
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import minimal_by_gradients, random_scene, random_sum
from svg_texts import AS_PATH, CIRCLE, assert_same, document, gradient

from gauss2svg.errors import InputError
from gauss2svg.measure import metrics
from gauss2svg.pipeline.palette import quantize
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.scene import BLURRED, PLAIN, Scene
from gauss2svg.scene.falloff import BETA_CLASSES
from gauss2svg.scene.scene import PARAMETERS
from gauss2svg.svg import STOP_COUNTS, Document, Form, SvgFormat, minimal
from gauss2svg.svg.forms import BLURS, as_written
from gauss2svg.svg.minimal import minimal_svg, rounded
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import write_svg

seeds = st.integers(0, 2**32 - 1)


def mixed_scene(count: int, seed: int, width: float = 60, height: float = 40) -> Scene:
    """Shapes of all exponents, few colours and opacities, so that files share what they can."""
    rng = np.random.default_rng(seed)
    some = rng.choice([*BETA_CLASSES, 0.7, 128.0, 256.0], count)
    sigma = np.exp(rng.uniform(-1.5, 2.5, (count, 2)) * rng.choice([1, 1, 1, 4], (count, 1)))
    return Scene(
        width, height, rng.uniform(-5, 65, (count, 2)), sigma, rng.uniform(-0.9999, 0.9999, count),
        np.round(rng.random((count, 3)) * 3) / 3, rng.choice([0.004, 0.25, 1.0, 1.0], count),
        rng.random(3), beta=some, transparent=bool(rng.integers(2)),
    )  # fmt: skip


def assert_read_as(back: Scene, scene: Scene) -> None:
    for parameter in PARAMETERS:
        mine, theirs = getattr(back, parameter.name), getattr(scene, parameter.name)
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-9)
    assert back.transparent == scene.transparent
    if not scene.transparent:
        np.testing.assert_allclose(back.background, scene.background)


@given(
    st.integers(0, 10**6), st.sampled_from([0.001, 0.01]), st.sampled_from(STOP_COUNTS),
    st.booleans(), st.sampled_from(get_args(Form)),
)  # fmt: skip
def test_an_editable_file_is_its_scene_within_the_rounding_and_then_the_same_file(
    seed, precision, stops, palette, form
):
    svg_format = SvgFormat(form=form, stops=stops, precision=precision, opacity_decimals=4)
    scene = quantize(random_scene(8, 60, 45, seed, sigma=(0.5, 25)), form, 12 * palette)
    scene = as_written(scene, form)
    large = (np.abs(scene.factor[:, [0, 1], [0, 1]]) * np.sqrt(2) > precision).all(axis=1)
    scene = as_written(scene.select(large & (scene.opacity > 1e-4)), form)
    back = read_svg(write_svg(scene, svg_format))
    solid, blurred = scene.drawn == PLAIN, scene.drawn == BLURRED
    np.testing.assert_allclose(back.beta[~solid], scene.beta[~solid], rtol=1e-12)
    step = 0.5 * precision + 1e-9
    np.testing.assert_allclose(back.mean, scene.mean, atol=step)
    np.testing.assert_allclose(back.opacity[~blurred], scene.opacity[~blurred], atol=6e-5)
    # The largest that a disc can have may be a little less.
    np.testing.assert_allclose(back.opacity[blurred], scene.opacity[blurred], atol=0.021)
    # M / R has entries rounded by step / R, with R > sqrt 2 for all exponents
    missed = np.abs(back.factor - scene.factor).max(axis=(1, 2), initial=0.0)
    assert missed[~solid & ~blurred].max(initial=0.0) <= step / math.sqrt(2)
    assert missed[blurred].max(initial=0.0) <= step / min(blur.radius for blur in BLURS)
    np.testing.assert_allclose(back.color, scene.color, atol=0.5 / 255 + 1e-9)
    np.testing.assert_array_equal(back.round_index, scene.round_index)
    assert (back.width, back.height) == (scene.width, scene.height)
    again = write_svg(back, svg_format)  # and from then on the same file
    assert write_svg(read_svg(again), svg_format) == again


@given(
    seeds, st.sampled_from([0, 1, 12]), st.sampled_from([0.001, 0.04, 0.5, 1.0]),
    st.sampled_from(STOP_COUNTS), st.sampled_from([500, 6, 0]),
)  # fmt: skip
def test_a_minimal_file_is_its_rounded_scene_and_the_same_file_again(
    seed, count, precision, stops, most_masked
):
    scene = mixed_scene(count, seed)
    written = SvgFormat(markup="minimal", precision=precision, stops=stops)
    with patch.object(minimal, "MOST_MASKED", most_masked):
        svg = write_svg(scene, written)
        back = read_svg(svg)
        assert_read_as(back, rounded(scene, precision, 6).scene)
        assert (back.width, back.height) == (scene.width, scene.height)
        assert write_svg(back, written) == svg


def test_a_minimal_file_without_a_size_is_a_scene_in_its_own_units():
    scene = mixed_scene(20, 3).replace(transparent=False)
    svg = minimal_svg(scene, 4, 3, Document(title="a", alt="b"))
    back, drawn = read_svg(svg), rounded(scene, 4, 3).scene
    assert (back.width, back.height) == (15, 10)
    np.testing.assert_allclose(4 * back.mean, drawn.mean)
    np.testing.assert_allclose(back.color, drawn.color)
    # The exponents of plain ellipses are those of their size there.
    assert_read_as(read_svg(svg.replace(" viewBox", ' width="60" height="40" viewBox')), drawn)


@pytest.mark.parametrize(
    ("root", "scale", "shift"),
    [
        ('width="40" height="30"', 1, (0, 0)),
        (f'width="{40 * 25.4 / 96}mm" height="{30 * 2.54 / 96}cm" viewBox="0 0 40 30"', 1, (0, 0)),
        ('width="40" height="30" viewBox="-10 5 40 30"', 1, (10, -5)),
        ('width="4" height="3" viewBox="0 0 40 30" data-canvas="20 15"', 0.5, (0, 0)),
    ],
)
def test_canvas_is_in_px_whatever_the_units(root, scale, shift):
    solid = read_svg(document())
    rect = '<rect x="-99" y="-99" width="999" height="999" fill="#abc"/>'
    moved = read_svg(document(root=root, rect=rect))
    np.testing.assert_allclose(moved.mean, solid.mean * scale + np.array(shift), atol=1e-9)
    np.testing.assert_allclose(moved.covariance, solid.covariance * scale**2)
    assert moved.width / moved.height == pytest.approx(4 / 3)


@pytest.mark.parametrize(
    "body",
    [
        '<circle r="1.5" transform="matrix(9 2 0 6 20 15)" style="fill:url(#a)" fill="red"/>',
        '<circle r="1" transform="translate(20,15) matrix(9,2 0,6,0-0)" fill="url(\'#a\') red"/>',
        f'<path {AS_PATH} transform="matrix(9 2 0 6 20 15)" fill="url(#a)"/>',
        '<path d="m 1,0 a 1 1 0 01-1 1 1 1 0 01-1-1 1 1 0 011-1 1 1 0 011 1z" '
        'transform="matrix(9 2 0 6 20 15)" fill="url(#a)"/>',
        '<ellipse cx="20" cy="15" rx="10" ry="7" transform="translate(20 15) matrix(9 2 0 6 0 0) '
        'translate(-20 -15)" fill="url(#moved)"/>',
        '<circle cx="4" r="1" transform="matrix(9 2 0 6 -16 7)" fill="url(#own)"/>',
        '<defs><circle id="c" r="1" fill="url(#a)"/><use id="d" href="#c"/></defs><use href="#d" '
        'x="1" y="-1" transform="matrix(9 2 0 6 11 19)"/>',
        '<circle r="1" style="Fill:url(#a);/* FILL:none; */-inkscape-stroke:none;stroke:none" '
        'transform="matrix(9 2 0 6 20 15)"><title>t</title></circle><!-- a --><metadata><x/>'
        "</metadata><sodipodi:namedview/><style/><g><title>u</title></g>",
    ],
)  # fmt: skip
def test_same_shape_however_it_is_written(body):
    defs = (
        gradient("moved", more='gradientTransform="translate(20 15)"')
        + '<radialGradient id="own" xlink:href="#moved" gradientTransform="translate(4 0)"/>'
    )
    assert_same(read_svg(document(body, defs)), read_svg(document()))


@pytest.mark.parametrize("kind", ["rotate(30 7 9)", "scale(.4)"])
def test_transforms_and_opacities_are_those_of_the_standard(kind):
    circle = f'<g style="fill-opacity:.8">{CIRCLE[:-2]} opacity=".5"/></g>'
    text = document(f'<g transform="translate(4,3) {kind} scale(2 .5)">{circle}</g>')
    back = read_svg(text)
    assert back.opacity[0] == pytest.approx(0.4)
    assert metrics.psnr(render(back), rasterize(text, 40, 30)) > 45


def group(label: str, body: str = CIRCLE) -> str:
    return f'<g inkscape:groupmode="layer" inkscape:label="{label}">{body}</g>'


@pytest.mark.parametrize(
    ("body", "rounds"),
    [
        (group("Round 2: 1 Gaussian") + group("Round 5: 2 Gaussians", 2 * CIRCLE), [1, 4, 4]),
        (f'<g id="round-3">{CIRCLE}</g><g id="round-0">{CIRCLE}</g>', [2, 3]),
        (f"<g>{CIRCLE}</g><g>{CIRCLE}<g>{CIRCLE}</g></g>{CIRCLE}", [0, 1, 1, 1]),
        (f'<g id="below-area-1-round-3">{CIRCLE}</g><g id="round-5">{CIRCLE}</g>', [2, 4]),
        (group("Round 2: 2", f'<g id="s">{CIRCLE}</g>{CIRCLE}') + CIRCLE, [1, 1, 1]),
    ],
)
def test_rounds_are_those_of_labels_ids_or_order(body, rounds):
    clipped = f'<svg inkscape:groupmode="layer" id="svg5" height="100%">{body}</svg>'
    assert read_svg(document(body)).round_index.tolist() == rounds
    assert read_svg(document(clipped)).round_index.tolist() == rounds


@pytest.mark.parametrize(
    ("root", "look"),
    [
        ("", 'fill="currentColor" color="#0f0"'),
        ("", 'style="fill:currentColor;color:#0f0"'),
        ('fill="currentColor" color="#0f0"', ""),
        ('fill="currentColor" color="red"', 'color="#0f0"'),
    ],
)
def test_current_color_is_the_color_of_the_element_in_any_order(root, look):
    rect = f'<rect width="9" height="9" {look}/>'
    (area,) = read_svg(document(rect, root=f'width="40" height="30" {root}')).areas
    assert area.paint == (0, 1, 0)


def test_a_missing_background_is_a_transparent_scene():
    assert read_svg(document(rect="")).transparent
    opaque = read_svg(document())
    np.testing.assert_allclose(opaque.background * 255, [0xAA, 0xBB, 0xCC])


SIZE = 'width="40" height="30" viewBox="0 0 40 30"'
ONE = Scene(20, 20, [[9, 9]], [[3, 2]], [0.1], [[1, 0, 0]], [0.5])
SOFT, SHEET = minimal_svg(ONE, 1, 6), minimal_by_gradients(ONE, 1, 6)
MOVING = write_svg(ONE, document=Document(fragments=True, animate=2))
FILL = 'fill="red" d="m0 0h9v9z"'
STROKE = 'fill="none" stroke="red" d="m0 0h9v9"'
STAR = "m20 2 6 20-16-12h20l-16 12z"
STOPS = '<stop offset="0"/><stop offset="1" stop-color="red"/>'
SPACE = 'gradientUnits="userSpaceOnUse"'
RED, CLEAR = '<stop offset="0" stop-color="red"/>', '<stop offset="1" stop-opacity="0" '
DEFS = (
    f'<radialGradient id="two">{RED}{CLEAR}/></radialGradient>'
    f'<radialGradient id="cone">{RED}{CLEAR} stop-color="red"/></radialGradient>'
    '<filter id="faint"><feGaussianBlur stdDeviation="20"/></filter>'
    f'<linearGradient id="again" {SPACE} spreadMethod="reflect" x2="9">{STOPS}</linearGradient>'
    f'<linearGradient id="point" {SPACE} x1="9" x2="9">{STOPS}</linearGradient>'
    f'<linearGradient id="clear" {SPACE} x2="9"><stop stop-opacity=".5"/></linearGradient>'
    f'<radialGradient id="tilt" {SPACE} cx="1" cy="1" r="1" '
    f'gradientTransform="matrix(2 1 0 1 0 0)">{STOPS}</radialGradient>'
    '<clipPath id="part"><rect width="40" height="20"/></clipPath>'
)
# What is in the place of the shape, and the line.
REFUSED = {
    '<text id="t">a</text>': '<text id="t">: .* must be paths and plain shapes alone; got text',
    '<g id="g"/><use href="#g"/>': "its reference must be to a circle",
    '<g clip-path="url(#x)"/>': "its clip-path",
    "<style>#a rect{mix-blend-mode:difference}</style>": "whose blend is 'over'.*--save-scene",
    '<g id="h" display="none"/>': '<g id="h">: .*got a hidden',
    f'<g id="o" opacity=".5">{CIRCLE}</g>': '<g id="o">: opacity of a group must be 1',
    '<circle r="nan"/>': "<circle r=\"nan\">: r must be a finite number; got 'nan'",
    '<circle r="-1"/>': "radii must be 0 or more; got -1",
    '<circle r="1" fill="url(#missing)"/>': "its reference must be to a radialGradient .*'missing'",
    '<circle r="1" fill="url(#cone)"/>': "those that write_svg writes",
    '<circle r="1" fill="url(#two)"/>': "of one colour; got 2 colours",
    '<circle r=".995" transform="scale(999)" fill="url(#a)"/>': "shows all of its gradient",
    '<circle id="b" r="5" fill="red" filter="url(#faint)"/>': '<circle id="b">: its filter must',
    "<style>g,svg>g:target~g{display:none}</style>": "the style sheet must be",
    '<circle r="1" style="fill:red!important;fill:blue"/>': "without escapes and !important",
    '<svg viewBox="0 0 9 9"/>': "its viewBox must be none; got '0 0 9 9'",
    "<g>" * 200 + "</g>" * 200: "elements must be in at most 100 groups",
    f'<circle r="9" mask="url(#a)" {STROKE}/>': "its mask must be none",
    f'<path opacity=".5" stroke="#000" {FILL}/>': "its opacity must be 1 with both a fill and a",
    f'<g clip-path="url(#part)"><path {FILL}/></g>': "its clip-path must be .* got 'url.#part.'",
    f'<path stroke-linejoin="bevel" {STROKE}/>': "stroke-linejoin must be .* got butt bevel",
    f'<path stroke-width="0" {STROKE}/>': "its stroke-width must be above 0; got '0'",
    f'<path transform="scale(1 2)" {STROKE}/>': "transforms of a stroke must be without",
    f'<path fill-rule="evenodd" fill="red" d="{STAR}"/>': "its fill-rule must be nonzero where",
    '<path fill="red" d="m0 0h9v9a5 5 0 0 2 3 3z"/>': "its d must be lines and curves",
    '<path fill="red" d="m0 0h1e999v9z"/>': "points of an outline.* must be",
    '<rect fill="red" width="1cm" height="9"/>': "width must be a finite number; got '1cm'",
    '<path fill="url(#again)" d="m0 0h9v9z"/>': "its gradient must be without",
    '<path fill="url(#point)" d="m0 0h9v9z"/>': "its gradient must be longer than 0",
    '<path fill="url(#clear)" d="m0 0h9v9z"/>': "stops of the gradient of an area must be opaque",
    '<path fill="url(#tilt)" d="m0 0h9v9z"/>': "a circle or an upright ellipse",
    '<image href="a.png" width="9" height="9"/>': "<image.* elements must be paths",
}  # fmt: skip
RANGE = r"width, height and viewBox of the SVG must be above 0 and in 1e-30\.\.1e\+30"
ROOTS = {
    'width="x" height="3"': "of a known size",
    'viewBox="0 0 40"': "of a known size, by a viewBox of 4 numbers",
    'width="1e9" viewBox="0 0 1e-29 8"': RANGE,
    'viewBox="-1e300 0 8 8"': RANGE,
    'width="80" height="30" viewBox="0 0 40 30"': "the canvas must be of the proportions",
    f'{SIZE} display="none"': "<svg.*shapes must be visible",
}
RECTANGLES = {
    '<rect width="99" height="99" transform="scale(1e300) scale(1e300)"/>': "points of an outline",
    '<rect width="99" height="99" opacity="x"/>': "opacity must be a finite number",
}
# What is changed in a style sheet of stops, or of fragments and animations, and the line.
EDITED = [
    (SHEET, "stop-opacity:0", "stop-opacity:.5", "those that write_svg writes"),
    (SHEET, "stop-opacity:.99", "stop-opacity:0", "those that write_svg writes"),
    (SHEET, "stop-opacity:.99", "display:none", "the style sheet must be"),
    (SHEET, "stop-opacity:.99", "stop-opacity:.99;stop-color:red", "the style sheet must be"),
    (SHEET, "stop-color:currentColor;", "", "the style sheet must be"),
    (SHEET, '[href="#a"]', '[href="#z"]', "its gradient must be"),
    (MOVING, "from{opacity:0}", "from{display:none}", "the style sheet must be"),
    (MOVING, "{animation:", "{display:none;animation:", "the style sheet must be"),
]
WRITTEN = {
    "another circle": (SOFT.replace('<circle r="1"', '<circle r="2"'), "its mask must be"),
    "a filter of a use": (SOFT.replace('href="#a"', 'href="#a" filter="url(#c)"'), "its filter"),
    "another mask": (SOFT.replace("<mask", '<mask maskUnits="userSpaceOnUse"'), "its mask must be"),
    "no colour": (SHEET.replace(' color="#f00"', ""), "opaque colour"),
    "an opacity of stops": (SHEET.replace("<stop", '<stop style="stop-opacity:0"'), "those that"),
    **{f"{old} as {new}": (svg.replace(old, new), line) for svg, old, new, line in EDITED},
    "a sum": (write_svg(random_sum(4, 20, 20, 1)), "<style .* whose blend is 'over'"),
    "no file": ("/none/there.svg", "cannot read /none/there.svg"),
    "no source": (5, "source must be a path"),
}  # fmt: skip
CASES = {
    **{body: (document(body, DEFS), line) for body, line in REFUSED.items()},
    **{root: (document(root=root), line) for root, line in ROOTS.items()},
    **{rect: (document(rect=rect), line) for rect, line in RECTANGLES.items()},
    **WRITTEN,
}


@pytest.mark.parametrize("case", CASES)
def test_what_write_svg_would_not_write_is_refused_in_one_line(case):
    svg, line = CASES[case]
    with pytest.raises(InputError, match=line) as caught:
        read_svg(svg)
    assert "\n" not in str(caught.value)
