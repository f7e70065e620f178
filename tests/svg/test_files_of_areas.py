"""Properties of areas in files: read as they were written, short, refused in one line."""

import dataclasses
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from outlines import box, polygon, polyline
from scenes import minimal_by_gradients, random_areas, random_scene, with_levels
from svg_texts import CIRCLE, document

from gauss2svg.errors import InputError, SceneError
from gauss2svg.measure.metrics import psnr
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.scene import PLAIN, Area, LinearGradient, Outline, RadialGradient, Scene
from gauss2svg.svg import Document, SvgFormat
from gauss2svg.svg.file import bytes_by_part
from gauss2svg.svg.minimal import minimal_svg
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.untrusted import Survey
from gauss2svg.svg.write import write_svg

seeds = st.integers(0, 2**32 - 1)
markups = st.sampled_from(["editable", "minimal"])
sides = st.sampled_from([(40, 30), (61.3, 17.7), (256, 3)])


def numbers_of(area: Area) -> list[float]:
    """All numbers of an area."""
    numbers = [area.opacity, area.width, *np.ravel([o.points[0] for o in area.outlines])]
    numbers += [v for outline in area.outlines for point in outline.points for v in point]
    return [*numbers, *area.paint]


@given(
    seeds, st.integers(0, 9), st.integers(0, 6), markups, sides,
    st.sampled_from([0.001, 0.04, 1 / 16, 0.3, 1.0]), st.sampled_from([None, "90mm", "responsive"]),
)  # fmt: skip
def test_a_file_with_areas_is_read_and_written_as_the_same_bytes(
    seed, count, gaussians, markup, size, precision, printed
):
    clear = bool(seed % 2)
    scene = random_scene(gaussians, 40, 30, seed).replace(
        width=size[0], height=size[1], areas=random_areas(count, seed), transparent=clear
    )
    scene = with_levels(scene, seed)
    svg_format = SvgFormat(markup=markup, precision=precision)
    # Minimal files do not have the size of the canvas in px beside another size.
    page = Document(size=printed) if markup == "editable" else Document()
    svg = write_svg(scene, svg_format, page)
    assert sum(bytes_by_part(svg).values()) == len(svg)
    back = read_svg(svg)
    if gaussians and markup == "editable":  # whose files are the same from the second time on
        svg = write_svg(back, svg_format, page)
        back = read_svg(svg)
    assert write_svg(back, svg_format, page) == svg


@pytest.mark.parametrize("markup", ["editable", "minimal"])
def test_gradients_are_drawn_as_areas_have_them(markup):
    whole = box(0, 0, 40, 30)
    y, x = np.mgrid[0.5:30, 0.5:40]
    ramp = ((0.0, 0.3, 1.0), ((0, 0, 1), (1, 0.2, 0), (0, 1, 1)))
    for paint in (
        LinearGradient(*ramp, (5, 3), (31, 22)),
        RadialGradient(*ramp, (12, 20), (21, 21)),
        RadialGradient(*ramp, (12, 20), (30, 11)),
    ):
        scene = Scene(40, 30, areas=[Area([whole], paint)])
        svg = write_svg(scene, SvgFormat(markup=markup))
        assert np.abs(rasterize(svg, 40, 30) - paint.at(x, y)).max() < 3 / 255
        assert read_svg(svg).areas[0].paint.at(x, y) == pytest.approx(paint.at(x, y), abs=0.01)
        # A canvas that is scaled by other factors has the same colours at the same places.
        stretched = scene.scaled(2, 3)
        drawn = rasterize(write_svg(stretched, SvgFormat(markup=markup)), 80, 90)
        assert np.abs(drawn[1::3, ::2] - paint.at(x - 0.25, y)).max() < 6 / 255


CURVE = ((0, 0), (1, 2), (3, 2), (4, 0), (5, -2), (7, -2), (8, 0))


RED = (1.0, 0.0, 0.0)


def moved(by: float, **look) -> Area:
    return Area([box(by, 0, by + 9, 9)], RED, **look)


@pytest.mark.parametrize(
    ("areas", "paths"),
    [
        ([moved(0), moved(9)], 1),
        ([moved(0), moved(8)], 2),
        ([moved(0), moved(20), moved(8)], 2),
        ([moved(0, width=1), moved(10, width=1)], 2),  # whose mitres may touch
        ([moved(0, width=1), moved(14, width=1)], 1),
    ],
)
def test_areas_share_a_path_only_if_their_boxes_do_not_overlap(areas, paths):
    scene = Scene(40, 30, areas=areas)
    svg, plain = (write_svg(scene, SvgFormat(markup=m)) for m in ("minimal", "editable"))
    assert svg.count("<path") == paths + 1  # and the background
    assert plain.count("<path") == len(areas)
    drawn = (rasterize(text, 160, 120) for text in (svg, plain))
    np.testing.assert_allclose(*drawn, atol=1.01 / 255)


@pytest.mark.parametrize("seed", range(8))
def test_a_file_draws_areas_and_gaussians_among_them_as_the_model_does(seed):
    markup = ["editable", "minimal"][seed % 2]
    soft = random_scene(12, 40, 30, seed, (2, 9), (1, 1))
    scene = with_levels(soft.replace(areas=random_areas(6, seed)), seed)
    if seed > 3:  # crisp
        rng = np.random.default_rng(seed)
        beta, opacity = np.full(12, 64.0), rng.choice([0.5, 1.0, 1.0], 12)
        color = np.round(rng.random((12, 1))) * np.ones(3)
        scene = scene.replace(beta=beta, opacity=opacity, color=color, drawn=np.full(12, PLAIN))
    drawn = rasterize(write_svg(scene, SvgFormat(markup=markup, precision=0.004)), 160, 120)
    # resvg has sixteen samples a pixel, which many edges of strokes show.
    assert psnr(drawn, render(scene, 160, 120)) > 31


def test_a_page_is_an_area_and_not_the_background():
    page = Area([box(0, 0, 40, 30)], RED)
    for markup in ("minimal", "editable"):
        svg_format = SvgFormat(markup=markup, precision=1.0)
        for transparent in (True, False):
            scene = Scene(40, 30, areas=[page], transparent=transparent)
            back = read_svg(write_svg(scene, svg_format))
            assert (back.areas, back.transparent) == (scene.areas, transparent)


TRIANGLE = Area([polygon((2, 3), (12, 3), (7, 11.5))], RED)
LINE = Area([polyline((2, 3), (12, 3), (7, 11.5))], RED, 1.0, 2.0)

CURVES = Outline((*CURVE, (9, 2), (11, 2), (12, 0)), (True,) * 3, closed=False)
SMOOTH = Area([CURVES], RED, 1.0, 1.0)


@pytest.mark.parametrize(
    ("area", "body"),
    [
        (TRIANGLE, '<path d="M 2,3 H 12 L 7,11.5 Z" style="fill:#f00;stroke:none;opacity:1"/>'),
        (TRIANGLE, '<path d="m 2 3 10 0 -5 8.5" fill="red" fill-rule="nonzero"/>'),
        (TRIANGLE, '<path d="M2,3H12L7,11.5L2,3Z" fill="red"/>'),
        (TRIANGLE, '<g fill="red" transform="translate(2,3)"><path d="m0 0h10l-5 85e-1"/></g>'),
        (TRIANGLE, '<path fill="red" transform="matrix(0 1 -1 0 0 0)" d="M3-2V-12L11.5-7z"/>'),
        (SMOOTH, '<path d="M0,0C1,2 3,2 4,0S7-2 8,0s3 2 4 0" fill="none" stroke="red"/>'),
        (LINE, '<path d="M2 3h10l-5 8.5" style="fill:none;stroke:red;stroke-width:2px;'
         'stroke-linejoin:miter;stroke-miterlimit:4;stroke-dasharray:none;marker:none"/>'),
        (LINE, '<g stroke="red" fill="none" transform="scale(2)">'
         '<path d="M1 1.5h5L3.5 5.75"/></g>'),
        (LINE, '<path fill="none" stroke="#f00" stroke-width="2" transform="rotate(90)" '
         'd="M3-2V-12L11.5-7"/>'),
    ],
)  # fmt: skip
def test_the_same_area_however_an_editor_writes_it(area, body):
    (back,) = read_svg(document(body + CIRCLE)).areas
    assert numbers_of(back) == pytest.approx(numbers_of(area))
    assert [o.closed for o in back.outlines] == [o.closed for o in area.outlines]


@pytest.mark.parametrize(
    ("markup", "color", "clear"),
    [("editable", (0.0, 0.0, 0.0), True), ("minimal", (0.8, 0.2, 0.0), False)],
)
def test_a_drawing_of_one_colour_has_it_at_the_root_alone(markup, color, clear):
    areas = [dataclasses.replace(a, paint=color, opacity=1) for a in random_areas(6, 2)]
    scene = Scene(40, 30, areas=areas, background=(0.9, 0.9, 0.9), transparent=clear)
    plain, own = (
        write_svg(scene, SvgFormat(markup=markup, current_color=is_own), Document(title="Icon"))
        for is_own in (False, True)
    )
    np.testing.assert_array_equal(rasterize(own, 80, 60), rasterize(plain, 80, 60))
    assert read_svg(own).areas == read_svg(plain).areas
    assert not Survey(own[own.index("<svg") :]).unknown
    assert own.count("#c30") == (color != (0, 0, 0))
    assert "#000" not in own
    # A page sets the colour.
    red = re.sub(' color="[^"]*"', "", own).replace("<svg", '<svg color="#f00"', 1)
    other = write_svg(
        scene.replace(areas=[dataclasses.replace(a, paint=(1, 0, 0)) for a in areas]),
        SvgFormat(markup=markup), Document(title="Icon"),
    )  # fmt: skip
    np.testing.assert_array_equal(rasterize(red, 80, 60), rasterize(other, 80, 60))
    two = scene.replace(areas=[*areas[:-1], dataclasses.replace(areas[-1], paint=(0, 1, 0))])
    svg_format = SvgFormat(markup=markup, current_color=True)
    assert write_svg(two, svg_format) == write_svg(two, SvgFormat(markup=markup))


@pytest.mark.parametrize("markup", ["editable", "minimal"])
def test_areas_of_the_background_colour_are_no_second_colour(markup):
    paints = [(0.8, 0.2, 0.0), (1.0, 1.0, 1.0)]
    areas = [dataclasses.replace(a, paint=paints[k % 2]) for k, a in enumerate(random_areas(6, 2))]
    scene = Scene(40, 30, areas=areas, background=(1, 1, 1))
    own = write_svg(scene, SvgFormat(markup=markup, current_color=True))
    assert "currentColor" in own
    assert not read_svg(own).transparent  # a white area would show on another page
    plain = write_svg(scene, SvgFormat(markup=markup))
    np.testing.assert_array_equal(rasterize(own, 80, 60), rasterize(plain, 80, 60))


def test_the_usual_title_says_whether_the_file_has_areas():
    scene = random_scene(3)
    photo, drawing = (write_svg(one) for one in (scene, scene.replace(areas=random_areas(3, 2))))
    assert "<title>Vectorised photo</title>" in photo
    assert "<title>Vectorised drawing</title>" in drawing


@pytest.mark.parametrize(("page", "is_left_out"), [((1, 1, 1), True), ((0.9, 0.9, 1), False)])
def test_an_icon_on_white_is_drawn_without_its_page(page, is_left_out):
    areas = [dataclasses.replace(a, paint=(0.8, 0.2, 0.0)) for a in random_areas(3, 2)]
    scene = Scene(40, 30, areas=areas, background=page)
    assert read_svg(write_svg(scene, SvgFormat(current_color=True))).transparent == is_left_out


@pytest.mark.parametrize("kind", ["editable", "masks", "style sheet"])
def test_two_drawings_in_one_page_are_drawn_as_each_alone(kind):
    def page(*svgs: str) -> np.ndarray:
        size = 'xmlns="http://www.w3.org/2000/svg" width="64" height="96"'
        return rasterize(f"<svg {size}>{''.join(svgs)}</svg>", 64, 96)

    svgs = []
    for seed, y in ((7, 0), (8, 48)):
        scene = random_scene(3, 64, 48, seed).replace(areas=random_areas(9, seed))
        page_size = Document(size="64px")
        write = minimal_svg if kind == "masks" else minimal_by_gradients
        svg = write(scene, 0.04, 6, page_size)
        svg = write_svg(scene, document=page_size) if kind == "editable" else svg
        svgs.append(svg[svg.index("<svg") :].replace("<svg", f'<svg y="{y}"', 1))
    ids = [set(re.findall(r'id="([a-zA-Z]+)"', svg)) - {"background", "areas"} for svg in svgs]
    assert ids[0]
    assert ids[1]
    assert not ids[0] & ids[1]
    both, first, second = page(*svgs), page(svgs[0]), page(svgs[1])
    np.testing.assert_array_equal(both, np.vstack([first[:48], second[48:]]))


def test_scenes_that_a_file_cannot_have_are_refused():
    far = Area([polygon((0, 0), (1e8, 0), (0, 9))], RED)
    wide = Area([box(0, 0, 9, 9)], LinearGradient((0, 1), (RED, RED), (0, 0), (1e8, 0)))
    for area in (far, wide):
        with pytest.raises(SceneError, match=r"an area must reach at most 4e\+06 px .* got 1e\+08"):
            write_svg(Scene(40, 30, areas=[area]))
    clear = dataclasses.replace(TRIANGLE, opacity=0.5)
    with pytest.raises(InputError, match="must be of opaque plain ellipses and areas alone"):
        write_svg(Scene(40, 30, areas=[clear]), SvgFormat(layers="inks"))
