"""Laws of minimal markup: short, well-formed, and drawn as the scene that it is said to draw."""

import io
import re
from xml.etree import ElementTree

import numpy as np
import pytest
import resvg_py
from conftest import needs
from flat import vectorize
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from gauss2svg.errors import InputError, RendererError
from gauss2svg.measure.metrics import psnr
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import (
    BY_BYTES_UP_TO,
    EDITABLE_FROM,
    EDITABLE_IS_CLOSER,
    MINIMAL_FROM,
    UNASKED_UP_TO,
    Plan,
)
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import BETA_CLASSES
from gauss2svg.svg import minimal_shapes
from gauss2svg.svg.document import Document, SvgFormat
from gauss2svg.svg.element import number
from gauss2svg.svg.file import bytes_by_part
from gauss2svg.svg.minimal import minimal_rounded, minimal_svg, whole_unit
from gauss2svg.svg.write import write_svg

SIDE = 96
# dB against the model. Three stops differ from the profile by .011, and a mask rounds to 8 bits.
NEAR = 41.0
# And an ellipse's edge is a pixel's coverage, where the model takes its centre.
NEAR_CRISP = 38.0
_NUMBER = re.compile(r"-?(?:\d+\.?\d*|\.\d+)")


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


def match(scene: Scene, unit: float, digits: int = 6, renderer: str = "resvg") -> float:
    """PSNR of the file of a scene against what minimal_rounded says that it draws."""
    drawn = rasterize(minimal_svg(scene, unit, digits), SIDE, SIDE, renderer)
    return psnr(drawn, render(minimal_rounded(scene, unit, digits), SIDE, SIDE))


@pytest.mark.parametrize("unit", [0.04, 1.5])
@pytest.mark.parametrize("make", [lambda: soft_scene(40), several_falloffs], ids=["one", "several"])
@pytest.mark.parametrize("most_masked", [500, 25, 0], ids=["masks", "both", "gradients"])
def test_the_file_draws_the_rounded_scene(make, unit, most_masked, monkeypatch):
    monkeypatch.setattr(minimal_shapes, "MOST_MASKED", most_masked)
    scene = make()
    assert match(scene, unit) > (NEAR if scene.beta.max() == 1 else NEAR_CRISP)


def test_shapes_change_from_masks_to_gradients_one_by_one(monkeypatch):
    monkeypatch.setattr(minimal_shapes, "MOST_MASKED", 20)
    scene = soft_scene(44)
    files = [minimal_svg(scene.select(np.arange(n)), 1.5, 6) for n in range(16, 35)]
    masked = [text.count("<use") for text in files]
    assert masked == [16, 17, 18, 19, 20, 18, 16, 14, 12, 10, 8, 6, 4, 2, 0, 0, 0, 0, 0]
    sizes = [len(text) for text in files]
    assert sizes == sorted(sizes)


@pytest.mark.parametrize("most_masked", [500, 25, 0], ids=["masks", "both", "gradients"])
@pytest.mark.parametrize(
    "renderer",
    [
        pytest.param("librsvg", marks=pytest.mark.process),
        pytest.param("chromium", marks=pytest.mark.browser),
    ],
)
def test_other_renderers_draw_the_same(renderer, most_masked, monkeypatch):
    needs(renderer)
    monkeypatch.setattr(minimal_shapes, "MOST_MASKED", most_masked)
    assert match(soft_scene(40), 1.5, renderer=renderer) > NEAR
    assert match(several_falloffs(), 1.5, renderer=renderer) > NEAR_CRISP


@pytest.mark.parametrize("unit", [0.04, 1.5])
@pytest.mark.parametrize("digits", [3, 6])
def test_a_rounded_scene_is_written_as_the_same_file_and_is_its_own_rounding(unit, digits):
    scene = several_falloffs(3)
    rounded = minimal_rounded(scene, unit, digits)
    again = minimal_rounded(rounded, unit, digits)
    assert minimal_svg(rounded, unit, digits) == minimal_svg(scene, unit, digits)
    for name in ("mean", "sigma", "rho", "color", "opacity", "beta", "background"):
        assert np.allclose(getattr(again, name), getattr(rounded, name)), name


def test_an_empty_file_takes_under_120_bytes():
    svg = minimal_svg(Scene(768, 512, background=np.array([0.2, 0.53, 0.67])), 256)
    assert len(svg) < 110
    assert svg.endswith(' viewBox="0 0 3 2"><path fill="#38a" d="M0 0h3v2H0"/></svg>')


def test_a_gaussian_takes_about_60_bytes_at_a_64th_of_the_side():
    sizes = [len(minimal_svg(soft_scene(count), SIDE / 64)) for count in (20, 50)]
    assert (sizes[1] - sizes[0]) / 30 < 65
    # The falloff, its mask and its circle.
    assert sizes[0] - 20 * 65 < 120 + 290


def test_a_minimal_file_is_shorter_than_an_editable_one_of_the_same_scene():
    scene = several_falloffs()
    editable = write_svg(scene, SvgFormat(precision=0.1))
    assert len(minimal_svg(scene, 0.1, 6)) < 0.4 * len(editable)


def test_xml_is_well_formed_ids_are_unique_and_every_reference_is_defined(monkeypatch):
    for most_masked in (500, 0):
        monkeypatch.setattr(minimal_shapes, "MOST_MASKED", most_masked)
        svg = minimal_svg(several_falloffs(), 1.5)
        root = ElementTree.fromstring(svg)
        ids = [e.get("id") for e in root.iter() if e.get("id")]
        used = set(re.findall(r"(?:href=\"|url\(|\[href=\")#(\w+)", svg))
        assert len(ids) == len(set(ids))
        assert used == set(ids)
        assert "\n" not in svg


def test_numbers_are_written_as_short_as_they_go():
    svg = minimal_svg(several_falloffs(), 1.5)
    for matrix in re.findall(r"matrix\(([^)]*)\)", svg):
        assert " -" not in matrix
        assert all(number(float(n), 0) == n for n in _NUMBER.findall(matrix))
    assert not re.search(r"[ \"]-?0\.\d", svg.replace(' viewBox="0 0 ', ""))


def test_crisp_opaque_shapes_are_plain_ellipses():
    scene = soft_scene(12).replace(beta=np.full(12, 128.0), rho=np.zeros(12))
    svg = minimal_svg(scene, 1.5)
    assert len(re.findall(r"\da\d", svg)) == 12
    assert not re.search("mask|Gradient|transform|use", svg)
    assert match(scene, 1.5) > NEAR_CRISP


def test_an_opaque_ellipse_takes_about_25_bytes_among_others_of_its_colour():
    scene = soft_scene(60).replace(beta=np.full(60, 128.0), color=np.tile([0.2, 0.4, 0.6], (60, 1)))
    svg = minimal_svg(scene, 0.4)
    assert svg.count("<path") == 2
    assert len(svg) / 60 < 27
    assert match(scene, 0.4) > NEAR_CRISP


def test_common_attributes_are_written_once():
    scene = soft_scene(30)
    one = scene.replace(color=np.tile([0.2, 0.4, 0.6], (30, 1)), opacity=np.full(30, 0.5))
    svg = minimal_svg(one, 1.5)
    assert svg.count("#369") == svg.count('opacity=".5"') == 1
    assert match(one, 1.5) > NEAR
    # Two alternating colours, and a run of crisp ellipses of one.
    two = one.replace(color=np.tile([[0.2, 0.4, 0.6], [1.0, 0.8, 0.0]], (15, 1)))
    assert minimal_svg(two, 1.5).count("#fc0") == 1
    assert match(two, 1.5) > NEAR
    crisp = one.replace(beta=np.full(30, 128.0), rho=np.zeros(30), opacity=np.ones(30))
    assert minimal_svg(crisp, 1.5).count("#369") == 1
    assert match(crisp, 1.5) > NEAR_CRISP


def test_colours_have_three_or_six_digits():
    scene = soft_scene(10)
    assert max(map(len, re.findall('#([0-9a-f]+)"', minimal_svg(scene, 1.5, 3)))) == 3
    rounded = minimal_rounded(scene, 1.5, 3)
    assert np.abs(rounded.color - scene.color).max() <= 0.5 / 15 + 1e-9
    assert np.abs(minimal_rounded(scene, 1.5, 6).color - scene.color).max() <= 0.5 / 255 + 1e-9


def test_black_is_the_default_and_not_written():
    svg = minimal_svg(Scene(64, 64, background=np.zeros(3)), 1)
    assert 'viewBox="0 0 64 64"><path d="M0 0h64v64H0"/></svg>' in svg


@pytest.mark.parametrize("size", [(1, 1), (1, 4000), (0.02, 0.01), (30000, 20000)])
def test_extreme_canvases_keep_their_proportions(size):
    svg = minimal_svg(Scene(*size), max(max(size) / 64, 0.001))
    width, height = map(float, re.findall(r'viewBox="0 0 (\S+) (\S+)"', svg)[0])
    assert width / height == pytest.approx(size[0] / size[1], rel=0.03)
    assert (rasterize(svg, 3, 3) == 1).all()


SIZES = [(768, 512), (333, 97), (767, 511), (97, 333), (600, 401), (5000, 1), (1, 1), (756, 1008)]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("about", [0, 3, 64, 500])
@pytest.mark.parametrize("find", [whole_unit, lambda w, h, about: max(w, h) / max(about, 1)])
def test_a_file_drawn_by_one_side_of_its_photo_has_the_other_to_the_pixel(size, about, find):
    width, height = size
    svg = minimal_svg(Scene(width, height), find(width, height, about))
    for side in ({}, {"width": width}, {"height": height}):
        png = resvg_py.svg_to_bytes(svg_string=svg, **side)
        across, down = Image.open(io.BytesIO(bytes(png))).size
        scale = 1 if side else width / across
        assert (across * scale, down * scale) == pytest.approx(size)


@pytest.mark.parametrize("size", SIZES)
def test_units_that_are_whole_on_both_sides_need_no_size(size):
    for about in (0, min(3, max(size)), max(size) / 4):
        unit = whole_unit(*size, about)
        svg = minimal_svg(Scene(*size), unit)
        assert " width=" not in svg
        width, height = map(int, re.findall(r'viewBox="0 0 (\d+) (\d+)"', svg)[0])
        assert width * size[1] == height * size[0]
        assert max(width, height) * unit == pytest.approx(max(size))


@given(
    st.floats(-200, 300), st.floats(1e-3, 1e4), st.floats(1e-3, 1e4),
    st.floats(-0.999999, 0.999999), st.sampled_from([0.5, *BETA_CLASSES, 256.0]),
    st.floats(0, 1), st.sampled_from([0.1, 1.0, 3.0]),
)  # fmt: skip
def test_tiny_huge_and_thin_shapes_are_drawn_or_left_out(x, sx, sy, rho, beta, opacity, unit):
    scene = Scene(
        SIDE, SIDE, np.array([[x, 40.0]]), np.array([[sx, sy]]), np.array([rho]),
        np.array([[0.2, 0.4, 0.9]]), np.array([opacity]), beta=np.array([beta]),
    )  # fmt: skip
    svg, rounded = minimal_svg(scene, unit), minimal_rounded(scene, unit)
    ElementTree.fromstring(svg)
    assert minimal_svg(rounded, unit) == svg
    assert bool(re.search(r"matrix|\da\d", svg)) == bool(len(rounded))


def test_names_and_sizes_are_written_only_where_they_are_given():
    scene = Scene(60, 40)
    plain = minimal_svg(scene, 1)
    assert not re.search("title|desc|role| width|height", plain)
    document = Document(title="A <b>&", alt="a & b", size="30mm", aspect="xMidYMid slice")
    root = ElementTree.fromstring(minimal_svg(scene, 1, document=document))
    assert [e.text for e in root][:2] == ["A <b>&", "a & b"]
    assert (root.get("width"), root.get("height"), root.get("role")) == ("30mm", "20mm", "img")
    assert root.get("preserveAspectRatio") == "xMidYMid slice"


def test_a_transparent_scene_has_no_background():
    svg = minimal_svg(soft_scene(3).replace(transparent=True), 1.5)
    assert "<path" not in svg


@pytest.mark.parametrize(
    "given",
    [
        {"animate": 2.0}, {"fragments": True}, {"blend": "add"},
        {"form": "blur", "renderer": "chromium"},
    ],
)  # fmt: skip
def test_the_plan_refuses_minimal_markup_and_auto_does_not_choose_it(given):
    with pytest.raises(InputError, match="markup must be editable with"):
        Plan(Options.from_flat({"markup": "minimal", **given}))
    assert Plan(Options.from_flat({"max_bytes": 5000, **given})).markup == "editable"


def test_auto_tries_each_markup_that_may_be_the_closest_in_its_bytes():
    def searches(**given):
        plan = Plan(Options.from_flat(given))
        return [(search.markup, search.by_bytes) for search in plan.searches()]

    small, minimal, editable = ("minimal", True), ("minimal", False), ("editable", False)
    assert searches() == [editable]
    last = int(EDITABLE_IS_CLOSER * UNASKED_UP_TO)
    for least, most, found in (
        (1, EDITABLE_FROM - 1, [small]),
        (EDITABLE_FROM, MINIMAL_FROM - 1, [small, editable]),
        (MINIMAL_FROM, BY_BYTES_UP_TO, [small, minimal, editable]),
        (BY_BYTES_UP_TO + 1, last, [minimal, editable]),
        (last + 1, 10 * last, [editable]),
    ):
        assert searches(max_bytes=least) == searches(max_bytes=most) == found
    for more in ({"markup": "editable"}, {"renderer": "cairo"}, {"fragments": True}):
        assert searches(max_bytes=EDITABLE_FROM, **more) == [editable]
    assert searches(max_bytes=10 * last, markup="minimal") == [minimal]
    assert searches(max_bytes=20_000, time_limit=5) == [minimal]
    with pytest.raises(RendererError, match="renderer must be one of resvg"):
        searches(markup="minimal", renderer="cairo")


def test_a_limit_beyond_that_of_minimal_files_is_not_worse_than_theirs():
    most = UNASKED_UP_TO
    plan = Plan(Options.from_flat({"max_bytes": most + 1}))
    assert [search.goal.byte_limit for search in plan.searches()] == [most, most + 1]


def test_the_switch_writes_minimal_files_and_the_summary_says_why():
    photo = render(soft_scene(12), SIDE, SIDE)
    asked = vectorize(photo, gaussians=20, iterations=20, markup="minimal")
    assert asked.svg == write_svg(asked.scene, SvgFormat(
        markup="minimal", precision=asked.report["precision"], stops=asked.report["stops"],
    ))  # fmt: skip
    assert asked.report["psnr_roundtrip"] > NEAR
    assert asked.report["notes"] == []
    assert sum(bytes_by_part(asked.svg).values()) == len(asked.svg)
    small = vectorize(photo, max_bytes=1500, iterations=20)
    assert small.report["markup"] == "minimal"
    assert len(small.svg) <= 1500
    assert any("minimal markup" in note for note in small.report["notes"])


@pytest.mark.parametrize("limit", [6_000, pytest.param(40_000, marks=pytest.mark.sweep)])
def test_auto_is_the_closer_of_both_markups(photo, limit):
    part = photo[:64, 40:104]

    def found(**given):
        report = vectorize(part, max_bytes=limit, iterations=5, tune="psnr", **given).report
        return report["psnr_svg"], report["markup"]

    assert found() == max(found(markup="minimal"), found(markup="editable"))


def test_a_mask_is_not_measured_by_cairo_which_draws_it_wrongly():
    with pytest.raises(RendererError, match="a mask"):
        rasterize(minimal_svg(soft_scene(3), 1.5), SIDE, SIDE, "cairo")


def test_a_file_of_units_under_a_pixel_has_the_size_of_its_canvas():
    assert ' width="60" height="40" ' in minimal_svg(Scene(60, 40), 0.04)
