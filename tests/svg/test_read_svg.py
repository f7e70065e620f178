"""Laws of reading: what write_svg wrote comes back, whatever an editor made of its elements."""

import gzip
import math
from typing import get_args

import numpy as np
import pytest
from conftest import random_scene
from hypothesis import given
from hypothesis import strategies as st
from svg_texts import AS_PATH, CIRCLE, assert_same, document, gradient

from gauss2svg.errors import InputError
from gauss2svg.measure import metrics
from gauss2svg.pipeline.palette import quantize
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import BETA_CLASSES
from gauss2svg.svg.blur import BLURS, GRADIENT, drawn_blurs, snapped
from gauss2svg.svg.document import STOP_COUNTS, Form, SvgFormat
from gauss2svg.svg.plain_ellipse import is_plain
from gauss2svg.svg.reader.read import read_svg
from gauss2svg.svg.stops import gradient_stops
from gauss2svg.svg.syntax.values import compose, parse_transform
from gauss2svg.svg.write import write_svg


def drawn(scene: Scene, svg_format: SvgFormat) -> Scene:
    """The scene without the shapes that are written as nothing."""
    factor = np.abs(scene.factor[:, [0, 1], [0, 1]]) * np.sqrt(2)
    large = (factor > svg_format.precision).all(axis=1)
    return scene.select(large & (scene.opacity > 10.0**-svg_format.opacity_decimals))


@given(
    st.integers(0, 10**6),
    st.sampled_from([0.001, 0.01]),
    st.sampled_from(STOP_COUNTS),
    st.booleans(),
    st.sampled_from(get_args(Form)),
)
def test_written_scene_comes_back_within_the_rounding(seed, precision, stops, palette, form):
    svg_format = SvgFormat(form=form, stops=stops, precision=precision, opacity_decimals=4)
    scene = quantize(random_scene(25, 60, 45, seed, sigma=(0.5, 25)), form, 12 * palette)
    scene = drawn(snapped(scene, form), svg_format)
    back = read_svg(write_svg(scene, svg_format))
    scene = snapped(scene, form)
    solid = is_plain(scene)
    blurred = ~solid & (drawn_blurs(scene) >= 0) & (form != GRADIENT)
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


@pytest.mark.parametrize("seed", range(6))
def test_scene_read_back_is_drawn_alike(seed):
    svg_format = SvgFormat(precision=0.01, opacity_decimals=3)
    scene = snapped(random_scene(60, 120, 80, seed, (0.7, 20)), GRADIENT)
    text = write_svg(scene, svg_format)
    back = read_svg(text)
    assert metrics.psnr(render(back), render(scene)) > 52
    again = write_svg(back, svg_format)
    assert metrics.psnr(rasterize(again, 120, 80), rasterize(text, 120, 80)) > 80


@pytest.mark.parametrize("seed", range(4))
def test_plain_ellipses_come_back_as_plain_as_they_were(seed):
    svg_format = SvgFormat(precision=0.01, opacity_decimals=3)
    scene = random_scene(400, 300, 200, seed, (2, 60), (6, 64))
    scene = snapped(scene.select(is_plain(scene)), GRADIENT)
    assert len(scene) > 5
    text = write_svg(scene, svg_format)
    back = read_svg(text)
    assert is_plain(back).all()
    assert metrics.psnr(render(back), render(scene)) > 42
    again = write_svg(back, svg_format)
    assert again.count("<circle") == text.count("<circle")
    assert metrics.psnr(rasterize(again, 300, 200), rasterize(text, 300, 200)) > 60


@pytest.mark.parametrize("count", STOP_COUNTS)
@pytest.mark.parametrize("beta", BETA_CLASSES)
def test_every_exponent_is_told_by_its_stops(beta, count):
    circle = '<circle r="2" transform="matrix(9 2 0 6 20 15)" fill="url(#b)" fill-opacity=".5"/>'
    back = read_svg(document(circle, gradient("b", beta, "#123456", count)))
    assert back.beta.tolist() == [beta]
    np.testing.assert_allclose(back.color[0] * 255, [0x12, 0x34, 0x56])
    assert back.opacity.tolist() == [0.5]


def test_source_is_a_path_text_or_bytes(tmp_path):
    text = write_svg(random_scene(9, seed=1))
    (tmp_path / "a.svg").write_text(text)
    (tmp_path / "a.svgz").write_bytes(gzip.compress(text.encode()))
    expected = read_svg(text)
    sources = tmp_path / "a.svg", str(tmp_path / "a.svgz"), text.encode(), "\ufeff\n" + text
    for source in sources:
        assert_same(read_svg(source), expected)


@pytest.mark.parametrize(
    "root",
    [
        'width="40" height="30"',
        'width="40px" height="30px" viewBox="0 0 40 30"',
        'viewBox="0 0 40 30"',
        'width="100%" height="100%" viewBox="0 0 40 30"',
        f'width="{40 * 25.4 / 96}mm" height="{30 * 2.54 / 96}cm" viewBox="0 0 40 30"',
        'width="30pt" height="22.5pt" viewBox="0 0 40 30"',
        f'width="{40 / 96}in" height="{30 / 16}pc" viewBox="0 0 40 30"',
        'width="90mm" height="9cm" viewBox="0 0 40 30" data-canvas="40 30"',
        'width="40" height="30" viewBox="0 0 400 300" data-canvas="40 30"',
    ],
)
def test_canvas_is_in_px_whatever_the_units(root):
    body = f'<g transform="scale(10)">{CIRCLE}</g>' if "400 300" in root else CIRCLE
    assert_same(read_svg(document(body, root=root)), read_svg(document()))


@pytest.mark.parametrize(
    ("root", "scale", "shift"),
    [
        ('width="80" height="60" viewBox="0 0 40 30"', 2, (0, 0)),
        ('width="40" height="30" viewBox="-10 5 40 30"', 1, (10, -5)),
        ('width="4" height="3" viewBox="0 0 40 30" data-canvas="20 15"', 0.5, (0, 0)),
        ('width="200" height="30" viewBox="0 0 40 30" preserveAspectRatio="xMinYMin slice"', 5,
         (0, 0)),
        ('width="80" height="30" viewBox="0 0 40 30" preserveAspectRatio="xMaxYMid"', 1, (40, 0)),
    ],
)  # fmt: skip
def test_viewbox_maps_user_units_onto_the_canvas(root, scale, shift):
    solid = read_svg(document())
    rect = '<rect x="-99" y="-99" width="999" height="999" fill="#abc"/>'
    moved = read_svg(document(root=root, rect=rect))
    np.testing.assert_allclose(moved.mean, solid.mean * scale + np.array(shift), atol=1e-9)
    np.testing.assert_allclose(moved.covariance, solid.covariance * scale**2)


def test_stretched_canvas_stretches_shapes():
    root = 'width="80" height="30" viewBox="0 0 40 30" preserveAspectRatio="none"'
    assert_same(read_svg(document(root=root)), read_svg(document()).scaled(2, 1))


@pytest.mark.parametrize(
    "body",
    [
        '<circle r="1.5" transform="matrix(9 2 0 6 20 15)" style="fill:url(#a)" fill="red"/>',
        '<circle r="1" transform="translate(20,15) matrix(9,2 0,6,0-0)" fill="url(\'#a\') red"/>',
        '<g transform="translate(20 15)"><g><circle r="1" transform="matrix(9 2 0 6 0 0)" '
        'fill="url(#a)"/></g></g>',
        '<g fill="url(#a)"><circle r="1" transform="matrix(-9-2,0-6 2e1 1.5e1)"/></g>',
        f'<path {AS_PATH} transform="matrix(9 2 0 6 20 15)" fill="url(#a)"/>',
        '<path d="m 1,0 a 1 1 0 01-1 1 1 1 0 01-1-1 1 1 0 011-1 1 1 0 011 1z" '
        'transform="matrix(9 2 0 6 20 15)" fill="url(#a)"/>',
        '<path d="M1 0A1 1 0 1 0-1 0A1 1 0 1 0 1 0Z" transform="matrix(9 2 0 6 20 15)" '
        'fill="url(#a)"/>',
        '<ellipse cx="20" cy="15" rx="10" ry="7" transform="translate(20 15) matrix(9 2 0 6 0 0) '
        'translate(-20 -15)" fill="url(#moved)"/>',
        '<path d="M1 0A1 1 0 0 0 0-1A1 1 0 0 0-1 0 1 1 0 0 0 0 1 1 1 0 0 0 1 0z" '
        'transform="matrix(9 2 0 6 20 15)" fill="url(#a)"/>',
        '<circle cx="4" r="1" transform="matrix(9 2 0 6 -16 7)" fill="url(#own)"/>',
        '<circle r="1" transform="matrix(9 2 0 6 20 15)" fill="url(#template)"/>',
        '<circle r="1" transform="matrix(9 2 0 6 20 15)" fill="url(#stopless)"/>',
        '<circle cx="0" cy="0" r="1" transform="matrix(9 2 0 6 20 15)" fill="url(#box)"/>',
    ],
)  # fmt: skip
def test_same_shape_however_it_is_written(body):
    stops = "".join(
        f'<stop offset="{100 * o}%" style="stop-color:rgb(255,136,0);stop-opacity:{v}"/>'
        for o, v in zip(*gradient_stops(6), strict=True)
    )
    defs = (
        gradient("moved", more='gradientTransform="translate(20 15)"')
        + '<radialGradient id="own" xlink:href="#moved" gradientTransform="translate(4 0)"/>'
        + f'<radialGradient id="template" xlink:href="#a">{stops}</radialGradient>'
        + f'<linearGradient id="swatch">{stops}</linearGradient>'
        + '<radialGradient id="half" gradientUnits="userSpaceOnUse" cx="0" cy="0" r="1" '
        + 'href="#swatch"/><radialGradient id="stopless" xlink:href="#half"/>'
        + f'<radialGradient id="box">{stops}</radialGradient>'
    )
    assert_same(read_svg(document(body, defs)), read_svg(document()))


def test_tilted_arcs_are_a_turned_ellipse():
    # as Inkscape 1.2 writes a circle under matrix(50 20 0 200 900 200), made a path and turned
    path = (
        '<path fill="#0f0" d="M 967.42679,348.97028 A 49.735632,201.06309 18.489639 0 1 '
        "858.87853,501.01394 49.735632,201.06309 18.489639 0 1 887.13833,277.18056 "
        "49.735632,201.06309 18.489639 0 1 995.68659,125.13689 49.735632,201.06309 18.489639 0 1 "
        '967.42679,348.97028 Z"/>'
    )
    ellipse = (
        '<ellipse fill="#0f0" cx="927.28" cy="313.06" rx="49.735632" ry="201.06309" '
        'transform="rotate(18.489639 927.28256 313.07541) translate(.00256 .01541)"/>'
    )
    scale = '<g transform="scale(.03)">'
    back, turned = (read_svg(document(f"{scale}{body}</g>")) for body in (path, ellipse))
    assert_same(back, turned, 1e-5)


def test_opacities_multiply_from_group_to_stop():
    faded = "".join(
        f'<stop offset="{o}" stop-color="#f80" stop-opacity="{v / 2}"/>'
        for o, v in zip(*gradient_stops(6), strict=True)
    )
    body = (
        '<g opacity="50%"><g style="fill-opacity:.8"><circle r="1" opacity=".5" '
        'transform="matrix(9 2 0 6 20 15)" fill="url(#f)"/></g></g>'
    )
    defs = f'<radialGradient id="f" xlink:href="#a">{faded}</radialGradient>'
    assert read_svg(document(body, defs)).opacity[0] == pytest.approx(
        0.5 * 0.8 * 0.5 * 0.5, abs=1e-4
    )


@pytest.mark.parametrize("kind", ["rotate(30)", "rotate(30 7 9)", "skewX(20)", "skewY(-20)"])
def test_transforms_are_those_of_the_standard(kind):
    # resvg draws the same with the list as with the matrix it is read as
    listed = f"translate(4,3) {kind} scale(2 .5)"
    pictures = []
    for text in (listed, f"matrix{compose(parse_transform(listed), (1, 0, 0, 1, 0, 0))}"):
        body = f'<g transform="{text}">{CIRCLE}</g>'
        pictures.append(rasterize(document(body), 40, 30))
    np.testing.assert_allclose(pictures[0], pictures[1], atol=2 / 255)
    scene = read_svg(document(f'<g transform="{listed}">{CIRCLE}</g>'))
    assert metrics.psnr(render(scene), pictures[0]) > 45


def group(label: str, body: str = CIRCLE) -> str:
    return f'<g inkscape:groupmode="layer" inkscape:label="{label}">{body}</g>'


@pytest.mark.parametrize(
    ("body", "rounds"),
    [
        (group("Round 2: 1 Gaussians") + group("Round 5: 2 Gaussians", 2 * CIRCLE), [1, 4, 4]),
        (f'<g id="round-3">{CIRCLE}</g><g id="round-4">{CIRCLE}</g>', [2, 3]),
        (f"<g>{CIRCLE}</g><g>{CIRCLE}<g>{CIRCLE}</g></g>{CIRCLE}", [0, 1, 1, 1]),
        (group("Round 3: 1") + group("Round 1: 1") + group("sky"), [2, 2, 3]),
        (group("Round 2: 2", f'<g id="s">{CIRCLE}</g>{CIRCLE}') + CIRCLE, [1, 1, 1]),
        (f"<g>{group('Round 1: 1')}{group('Round 2: 1')}</g><g>{group('Round 2: 1')}</g>",
         [0, 1, 1]),
        (2 * CIRCLE, [0, 0]),
    ],
)  # fmt: skip
def test_rounds_are_those_of_labels_ids_or_order(body, rounds):
    assert read_svg(document(body)).round_index.tolist() == rounds


def test_what_draws_nothing_is_skipped():
    body = (
        "<!-- a --><title>t</title><desc>d</desc><metadata><x/></metadata><sodipodi:namedview/>"
        "<style>/* g{opacity:0} */ @keyframes in{from{opacity:0}to{opacity:1}} "
        "g{animation:in 1s}</style>"
        '<circle r="1" transform="matrix(9 2 0 6 20 15)" fill="url(#a)"><title>t</title></circle>'
    )
    assert_same(read_svg(document(body)), read_svg(document()))


def test_missing_background_is_a_transparent_scene_and_a_glassy_one_is_asked_for():
    text = document(rect="")
    assert read_svg(text).transparent
    assert not read_svg(text, background=(0, 0.5, 1)).transparent
    assert read_svg(text, background=(0, 0.5, 1)).background.tolist() == [0, 0.5, 1]
    glass = document(rect='<rect width="40" height="30" fill="#fff" opacity=".5"/>')
    with pytest.raises(InputError, match=r"opacity of the background must be 1; got 0\.5"):
        read_svg(glass)
    np.testing.assert_allclose(read_svg(glass, background=(0, 0.5, 1)).background, [0.5, 0.75, 1])
    opaque = read_svg(document(), background=(0, 0, 0))
    np.testing.assert_allclose(opaque.background * 255, [0xAA, 0xBB, 0xCC])


def test_hidden_shapes_are_left_out_where_that_is_asked_for():
    hidden = group("Round 1: 1", CIRCLE).replace("<g", '<g style="display:none"')
    shown = read_svg(document(hidden + group("Round 2: 1")), skip_hidden=True)
    assert shown.round_index.tolist() == [1]
