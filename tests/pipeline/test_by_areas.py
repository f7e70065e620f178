"""Properties of runs with areas: the file has them, the report tells of them, limits are kept."""

import itertools
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flat import vectorize
from pictures import clouds
from PIL import Image
from scipy import ndimage
from skimage import data

from gauss2svg import Scene, read_svg
from gauss2svg.areas.find import find_areas
from gauss2svg.errors import InputError
from gauss2svg.fit import FitResult
from gauss2svg.measure.metrics import psnr
from gauss2svg.measure.roundtrip import model_psnr
from gauss2svg.photo.pixels import over
from gauss2svg.pipeline.outcome import Outcome, best_of
from gauss2svg.raster import rasterize
from gauss2svg.scene.areas import Area, AreaCounts, Outline
from gauss2svg.scene.inks import ink_colors, ink_name
from gauss2svg.svg.file import file_bytes
from gauss2svg.svg.write import write_svg

SIDE = 128
SHAPES = """<circle cx="40" cy="44" r="28" fill="#c0322c"/><circle cx="40" cy="44" r="12"
fill="#fff"/><path d="M70 20h44v50z" fill="#17324d"/><path d="M12 108c30-30 70 20 104-14"
fill="none" stroke="#084" stroke-width="3"/>"""
FRAME = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 128 128">{}</svg>'
SQUARE = Outline(((9, 9), (99, 9), (99, 99), (9, 99)), (False,) * 4)
OTHER = Scene(SIDE, SIDE, areas=[Area([SQUARE], (0.8, 0.2, 0.2))])
OPAQUE = FRAME.format(f'<path fill="#fff" d="M0 0h128v128H0z"/>{SHAPES}')
DRAWING = rasterize(OPAQUE, SIDE, SIDE)
CLEAR = rasterize(FRAME.format(SHAPES), SIDE, SIDE, alpha=True)
SHADES = """<linearGradient id="a"><stop stop-color="#eef"/><stop offset="1" stop-color="#347"/>
</linearGradient><path fill="url(#a)" d="M0 0h128v128H0z"/>"""
SHADED = rasterize(FRAME.format(SHADES + SHAPES), SIDE, SIDE)
PALETTE = np.array([[20, 12, 28], [208, 70, 72], [109, 170, 44], [222, 238, 214]], np.uint8)
CELLS = np.random.default_rng(0).integers(0, 4, (24, 24)).repeat(2, axis=0).repeat(2, axis=1)
SPRITE = PALETTE[CELLS]
CLEAR_SPRITE = np.dstack([SPRITE, np.where(CELLS == 3, 0, 255).astype(np.uint8)])


@pytest.fixture(scope="module")
def drawing():
    """The result of the drawing by default."""
    return vectorize(DRAWING)


@pytest.mark.parametrize(
    ("picture", "markup"), [(DRAWING, "editable"), (CLEAR, "minimal")], ids=["opaque", "alpha"]
)
def test_the_file_has_the_areas_and_nothing_else_and_the_report_counts_them(picture, markup):
    result = vectorize(picture, areas="always", markup=markup)
    report, is_clear = result.report, picture.shape[2] == 4
    counts = AreaCounts(report["area_count"], report["line_count"], report["node_count"])
    assert counts == AreaCounts.of(result.scene.areas)
    assert 2 <= counts.areas <= 4
    assert counts.lines == 1
    assert report["markup"] == markup
    again = read_svg(result.svg)
    assert (len(again), again.transparent) == (0, is_clear)
    assert AreaCounts.of(again.areas) == counts
    assert repr(result).startswith(f"<gauss2svg.Result {SIDE}x{SIDE}, {counts}, ")
    assert report["psnr_svg"] > 40
    assert not is_clear or report["psnr_svg_black"] > 40
    assert (report["gaussians"], report["iterations"], report["stop_reason"]) == (0, 0, "gain")
    assert 0.97 < report["area_share"] <= 1
    assert 0 < report["area_find_s"] + report["area_refine_s"] <= report["fit_s"]


@pytest.mark.parametrize("gzip", [False, True])
def test_a_limit_of_bytes_is_kept_by_raising_the_price_of_a_byte(drawing, gzip):
    limit = int(0.9 * len(file_bytes(drawing.svg, gzip)))
    result = vectorize(DRAWING, areas="always", max_bytes=limit, gzip=gzip, markup="editable")
    assert 0.8 * limit < len(file_bytes(result.svg, gzip)) <= limit
    assert result.scene.areas
    assert (result.report["stop_reason"], result.report["unreached"]) == ("max_bytes", [])
    assert result.report["corrections"] > 0


@pytest.mark.parametrize("limit", [None, 150])
@pytest.mark.parametrize(
    "picture",
    [np.full((20, 20, 3), 0.2), np.zeros((1, 1, 3)), np.zeros((9, 9, 4))],
    ids=["blank", "one pixel", "clear"],
)
def test_a_picture_without_areas_becomes_its_ground(picture, limit):
    given = {} if limit is None else {"max_bytes": limit}
    result = vectorize(picture, areas="always", **given)
    assert AreaCounts.of(result.scene.areas).areas == len(result.scene) == 0
    assert result.report["svg_bytes"] <= (limit or 1000)
    assert result.scene.transparent == (picture.shape[2] == 4)


LARGE = rasterize(FRAME.format(SHADES + SHAPES), 400, 400)  # areas take longer than a call


@pytest.mark.parametrize(
    ("picture", "calls", "limit"),
    [(DRAWING, 0, None), (DRAWING, 2, 1000), (LARGE, 0, 1000), (LARGE, 6, 3000)],
)
def test_a_stopped_run_writes_what_it_has_within_the_limit_and_is_not_blank(picture, calls, limit):
    left = iter(range(calls))
    result = vectorize(picture, max_bytes=limit, stop=lambda: next(left, None) is None)
    assert result.report["stop_reason"] == "interrupted"
    assert result.report["svg_bytes"] <= (limit or np.inf)
    blank = Scene(*picture.shape[1::-1])
    assert result.report["psnr_svg"] > model_psnr(blank, picture) + 5


def test_a_page_that_is_stopped_before_its_areas_are_found_can_be_recognised():
    bars = [
        f'<path d="M{20 + 36 * x} {20 + 18 * y}h{8 + (7 * x + 5 * y) % 22}v6h-9v4z"/>'
        for x in range(10)
        for y in range(20)
    ]
    page = '<path fill="#fff" d="M0 0h400v400H0z"/>'
    picture = rasterize(FRAME.replace("128", "400").format(page + "".join(bars)), 400, 400)
    result = vectorize(picture, stop=lambda: True)
    assert result.report["area_count"] == 0
    assert result.report["psnr_svg"] > model_psnr(Scene(400, 400), picture) + 6.5


def test_areas_that_no_frame_of_a_film_changes_stay_as_they_are():
    rest = SHAPES.split("<path", 1)[1]
    page = '<path fill="#fff" d="M0 0h128v128H0z"/>'
    square = '<path d="M24 28h32v32H24z" fill="#c0322c" {}/>'
    frames = [
        rasterize(FRAME.format(page + square.format(one) + "<path" + rest), SIDE, SIDE)
        for one in ("", 'transform="translate(9 4)"')
    ]
    start = vectorize(frames[0])
    result, new = vectorize(frames[1], start=start.scene), vectorize(frames[1])
    # Kept areas may cost a tenth of the squared error, and 0.15.
    assert result.report["psnr_svg"] > new.report["psnr_svg"] - 1
    paths = [set(re.findall(r' d="(.*?)"', one.svg)) for one in (start, result)]
    assert len(paths[0] & paths[1]) >= 2  # the triangle and the line


def test_a_start_has_areas_if_and_only_if_the_file_may_have_them(drawing):
    for given in ({"areas": "never"}, {"gaussians": 9}, {"falloff": "gaussian"}):
        with pytest.raises(InputError, match=r"start must be a scene without areas; got .* nodes"):
            vectorize(DRAWING, start=drawing.scene, **given)
    with pytest.raises(InputError, match="start must be a scene that has areas; got 3 Gaussians"):
        vectorize(DRAWING, start=vectorize(DRAWING, gaussians=3).scene, areas="always")


def glowing(side):
    """Return crisp shapes above soft spots, at any size."""
    shapes = rasterize(FRAME.format(SHAPES), side, side, alpha=True)
    return over(shapes, clouds(side))


GLOWS = glowing(SIDE)


@pytest.fixture(scope="module")
def glows():
    """The result of crisp shapes above soft spots by default."""
    return vectorize(GLOWS)


def test_areas_and_gaussians_are_closer_than_either_alone_at_any_size(glows):
    found, never = find_areas(GLOWS), vectorize(GLOWS, areas="never")
    areas = Scene(SIDE, SIDE, background=found.background, areas=found.areas)
    assert glows.report["area_count"] > 1
    assert glows.report["gaussians"] == len(glows.scene) > 1
    for side in (SIDE, 4 * SIDE):
        both, *others = (
            psnr(rasterize(svg, side, side), glowing(side))
            for svg in (glows.svg, write_svg(areas), never.svg)
        )
        assert both > max(others) + 1
    assert f"{len(glows.scene)} Gaussians" in repr(glows)
    assert 255 * np.abs(glows.raster - GLOWS)[:12, -20:].max() < 3  # the page is plain there


@pytest.mark.sweep
def test_more_bytes_are_never_worse():
    limits = 300, 600, 2000
    # If the renderer made the picture, fewer nodes may by chance match its antialiasing better.
    large = rasterize(OPAQUE, 8 * SIDE, 8 * SIDE).reshape(SIDE, 8, SIDE, 8, 3)
    picture = large.mean(axis=(1, 3), dtype=np.float64).astype(np.float32)
    reports = [vectorize(picture, max_bytes=limit).report for limit in limits]
    assert all(one["svg_bytes"] <= limit for one, limit in zip(reports, limits, strict=True))
    for few, many in itertools.pairwise(reports):
        assert many["psnr_svg"] > few["psnr_svg"] - 0.1


@pytest.mark.parametrize("given", [{}, {"max_bytes": 3000}], ids=str)
def test_a_photo_has_the_file_that_it_has_without_areas(photo, given):
    photo = photo[::2, ::2]
    usual, never = (vectorize(photo, iterations=8, areas=a, **given) for a in ("auto", "never"))
    assert usual.svg == never.svg
    assert usual.report["area_count"] == 0


@pytest.mark.parametrize(
    "given", [{"blend": "add"}, {"areas": "never"}, {"inks": 3, "gaussians": 9}]
)
@pytest.mark.parametrize("picture", [DRAWING, SPRITE], ids=["drawing", "sprite"])
def test_a_drawing_has_no_areas_if_the_paper_or_other_shapes_are_asked_for(picture, given):
    result = vectorize(picture, iterations=4, quality="draft", **given)
    assert result.scene.areas == ()
    assert result.report["gaussians"] > 0


INKS = "#ffffff,#d03020,#203050,#108040"


def nearest_inks(picture):
    """Return a picture in its nearest inks."""
    inks = ink_colors(INKS)
    return inks[np.square(picture[:, :, None] - inks).sum(axis=-1).argmin(axis=-1)]


@pytest.mark.parametrize(
    ("picture", "given"), [(CLEAR, {"max_bytes": 2000}), (SHADED, {})], ids=["alpha", "gradient"]
)
def test_a_drawing_in_inks_is_areas_that_each_have_one_of_them(picture, given):
    result = vectorize(picture, inks=INKS, **given)
    assert result.report["area_count"] >= 2
    assert len(result.scene) == 0
    assert {ink_name(ink) for ink in result.scene.inks} <= set(INKS.split(","))
    # Antialiased pixels along outlines mix two inks. All others have one.
    large = rasterize(result.svg, 512, 512)
    assert (np.abs(large - nearest_inks(large)).max(axis=-1) > 0.01).mean() < 0.05
    plates = [rasterize(svg, SIDE, SIDE)[..., 0] for svg in result.plates().values()]
    assert np.sum(plates, axis=0).max() < len(plates) + 0.1


@pytest.mark.parametrize(("picture", "most"), [(DRAWING, 0.04), (SPRITE / 255, 0.0)])
def test_a_drawing_and_pixel_art_have_the_nearest_ink_everywhere(picture, most):
    result = vectorize(picture.astype(np.float32), inks=INKS)
    assert result.report["gaussians"] == 0
    is_off = np.abs(result.raster - nearest_inks(picture)).max(axis=-1) > 0.1
    assert is_off.mean() <= most


def test_a_drawing_with_a_photo_in_it_has_ellipses_in_inks():
    picture = SHADED.copy()
    picture[8:104, 8:104] = data.astronaut()[40:136, 180:276] / 255
    assert vectorize(picture, inks=4, quality="draft").report["area_count"] == 0


@pytest.mark.parametrize(
    ("picture", "given", "said"),
    [
        (DRAWING, {"animate": 4, "fragments": True}, "--animate and --fragments have no effect"),
        (GLOWS, {"animate": 4}, "--animate has no effect, because the file has no rounds"),
        (DRAWING, {"start": OTHER}, "differs from the picture, so its areas were found anew"),
        (DRAWING, {"current_color": True}, "the file has more than one colour. Try --inks 2"),
        (GLOWS, {"current_color": True}, "the file has Gaussians. Try --areas always"),
        (DRAWING, {"current_color": True, "inks": 2}, ""),
        (DRAWING, {"current_color": True, "inks": 3}, "the file has more than one colour"),
    ],
)
def test_an_option_that_has_no_effect_is_a_note(picture, given, said):
    notes = vectorize(picture, **given).report["notes"]
    assert len(notes) == bool(said)
    assert "".join(notes).count("--inks") == said.count("--inks")
    assert said in "".join(notes)


@pytest.mark.parametrize(
    ("picture", "target", "needs_gaussians"),
    [(DRAWING, 30, False), (GLOWS, 36, True)],
    ids=["flat", "glows"],
)
def test_a_target_is_met_by_areas_alone_if_they_can_and_by_gaussians_if_not(
    picture, target, needs_gaussians
):
    report = vectorize(picture, target_psnr=target).report
    assert (report["stop_reason"], report["unreached"]) == ("target_psnr", [])
    assert report["psnr_svg"] >= target
    assert report["area_count"] > 0
    assert (report["gaussians"] > 0) == needs_gaussians


@pytest.mark.sweep
def test_a_target_that_is_missed_with_areas_is_met_by_shapes_alone():
    report = vectorize(DRAWING, target_psnr=46).report
    assert (report["stop_reason"], report["unreached"]) == ("target_psnr", [])
    assert report["area_count"] == 0


@pytest.mark.sweep
def test_a_target_that_areas_miss_asks_for_no_more_shapes_than_pay():
    kept = vectorize(DRAWING, target_psnr=60, areas="always").report
    assert kept["area_count"] > 0
    assert kept["gaussians"] <= 1000
    assert "shapes, the most for this picture" in kept["unreached"][0]


def test_a_run_that_is_stopped_while_it_fits_gaussians_keeps_its_areas():
    phases, states = [], []

    def progress(now):
        phases.append(now.phase)
        if now.fit is not None:
            counts = AreaCounts.of(now.fit.scene().areas), len(now.fit.scene())
            states.append((now.fit.areas, now.fit.gaussians, *counts))

    stop = lambda: phases.count("fit") > 20  # noqa: E731
    result = vectorize(GLOWS, target_psnr=46, progress=progress, stop=stop)
    assert [state[:2] for state in states] == [(str(counts), n) for *_, counts, n in states]
    assert states[0][1] == 0 < states[-1][1]
    assert result.report["stop_reason"] == "interrupted"
    assert min(result.report["area_count"], result.report["gaussians"]) > 0


def test_areas_and_gaussians_of_a_start_are_refined(glows):
    again = vectorize(GLOWS, start=read_svg(glows.svg))
    assert again.report["area_count"] == glows.report["area_count"]
    assert again.report["psnr_svg"] > glows.report["psnr_svg"] - 0.1
    bound = vectorize(GLOWS, start=glows.scene, max_bytes=glows.report["svg_bytes"])
    assert bound.report["svg_bytes"] <= glows.report["svg_bytes"]
    assert bound.report["psnr_svg"] > glows.report["psnr_svg"] - 1


def test_a_photo_in_a_poster_is_one_area_below_gaussians():
    shapes = rasterize(FRAME.format(SHAPES), SIDE, SIDE, alpha=True)
    poster = np.full((SIDE + 140, 200, 3), [0.75, 0.85, 0.95], np.float32)
    poster[140:, 36:164] = over(shapes, (0.75, 0.85, 0.95))
    poster[10:130, 20:180] = data.coffee()[150:270, 200:360] / 255
    result = vectorize(poster)
    photo, page = np.s_[10:130, 20:180], np.s_[140:, :30]
    areas = rasterize(write_svg(result.scene.select([])), *poster.shape[1::-1])
    assert result.report["area_count"] <= 6  # the photo, and those of the drawing
    assert psnr(result.raster[photo], poster[photo]) > psnr(areas[photo], poster[photo]) + 10
    assert 255 * np.abs(result.raster - poster)[page].max() < 5
    assert result.report["psnr_svg"] > 35.2  # as close as the preset asks for without areas


@pytest.mark.sweep
def test_thin_lines_of_a_large_drawing_keep_their_color():
    waves = "M60 150q160-120 320 0t320 0 320 0M60 190q160-120 320 0t320 0 320 0"
    chart = f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1200 600"><path fill="#fff"
    d="M0 0h1200v600H0z"/><g fill="none" stroke-width="2"><path d="{waves}" stroke="#111"/>
    <path d="M60 330h1080v230H60z" stroke="#b02030"/></g></svg>"""
    result = vectorize(rasterize(chart, 1200, 600))
    colors = np.array([area.paint for area in result.scene.areas])
    for color in ((17, 17, 17), (176, 32, 48)):
        assert np.abs(255 * colors - color).max(axis=1).min() < 8
    assert result.report["measured_width"] == 1200
    assert vectorize(rasterize(chart, 1200, 600), max_memory="8G").svg == result.svg


@pytest.mark.sweep
def test_an_enlarged_drawing_is_reduced():
    large = Image.fromarray(np.uint8(255 * DRAWING)).resize((1152, 1152), Image.Resampling.BICUBIC)
    assert vectorize(large).report["measured_width"] < 1152


@pytest.mark.sweep
def test_a_glow_around_letters_is_no_noise_of_jpeg():
    """Taken for noise, it became forty contours with torn ends."""
    letters = FRAME.format("""<path d="M24 24v80M24 64h44M68 24v80M94 24v80" fill="none"
    stroke="#fff" stroke-width="9"/>""")
    alpha = rasterize(letters, 512, 512, alpha=True)[..., 3:]
    glow = 1.2 * ndimage.gaussian_filter(alpha, (4, 4, 0)) * (0.1, 0.7, 0.8) + (0.01, 0.01, 0.05)
    picture = np.round(255 * np.clip(glow + alpha * (1 - glow), 0, 1)) / 255
    result = vectorize(np.float32(picture))
    assert result.report["psnr_svg"] > 40
    assert result.report["area_count"] < 20


def test_a_shadow_on_a_transparent_page_leaves_no_veil():
    shadow, color = np.zeros((96, 128)), np.zeros((96, 128, 3))
    shadow[24:80, 20:108] = 0.7
    alpha = ndimage.gaussian_filter(shadow, 8)
    alpha[22:74, 22:106] = color[22:74, 22:106] = 1
    color[30:40, 30:70], color[50:66, 60:96] = (0.8, 0.1, 0.1), (0.1, 0.3, 0.7)
    result = vectorize(np.float32(np.round(255 * np.dstack([color, alpha])) / 255))
    off = np.abs(result.raster[..., 3] - alpha)
    assert max(off[[0, -1]].max(), off[:, [0, -1]].max()) < 0.05
    assert result.report["psnr_svg_alpha"] > 39


@pytest.mark.sweep
def test_cairo_draws_the_gradients_of_a_large_drawing():
    rows = np.linspace(0, 1, 400)[:, None]
    sky = np.stack([0.2 + 0.6 * rows, 0.3 + 0.2 * rows, 0.9 - 0.5 * rows], axis=-1)
    picture = np.repeat(sky, 1100, axis=1)
    picture[300:, 300:] = [0.1, 0.3, 0.1]
    result = vectorize(np.float32(picture))
    assert psnr(rasterize(result.svg, 1100, 400, "cairo"), picture) > 40


@pytest.mark.parametrize(("sprite", "limit"), [(SPRITE, None), (CLEAR_SPRITE, 8000)])
def test_a_sprite_is_exact_in_few_bytes_and_its_file_is_read_again(sprite, limit):
    result = vectorize(sprite, max_bytes=limit)
    assert (over(result.raster) == over(sprite / np.float32(255))).all()
    assert (len(result.scene.areas), len(result.scene)) == (3, 0)
    # vtracer has 28 kB, by polygons that are not exact.
    assert result.report["svg_bytes"] < 5000
    again = read_svg(result.svg)
    assert [area.paint for area in again.areas] == [area.paint for area in result.scene.areas]
    assert result.scene.transparent == (sprite is CLEAR_SPRITE)


def test_a_file_within_the_limit_is_exact_and_another_one_has_what_fits():
    whole = vectorize(SPRITE, markup="minimal").report["svg_bytes"]
    for limit, is_exact in ((whole, True), (whole - 300, True), (800, False)):
        result = vectorize(SPRITE, max_bytes=limit)
        assert result.report["svg_bytes"] <= limit
        assert (result.report["psnr_svg"] is None) == is_exact


@pytest.mark.sweep
def test_a_sprite_of_over_two_megapixels_is_exact():
    large = SPRITE[::2, ::2].repeat(64, axis=0).repeat(64, axis=1)
    result = vectorize(large)
    assert result.photo.shape[0] < 1536
    assert (rasterize(result.svg, 1536, 1536) == large / np.float32(255)).all()


@pytest.mark.sweep
def test_a_glossy_picture_is_drawn_by_shapes_that_are_closer():
    # Many gradients that meet at soft edges leave areas no core, and their file looks torn.
    numbers, shapes = np.random.default_rng(3), []
    for k in range(25):
        corners = " ".join(f"{x:.1f} {y:.1f}" for x, y in numbers.uniform(6, 90, (3, 2)))
        first, last = ("#" + bytes(numbers.integers(0, 255, 3).tolist()).hex() for _ in range(2))
        stops = f'<stop stop-color="{first}"/><stop offset="1" stop-color="{last}"/>'
        shapes.append(f'<linearGradient id="g{k}">{stops}</linearGradient>')
        shapes.append(f'<path fill="url(#g{k})" d="M{corners}z"/>')
    soft = '<filter id="b"><feGaussianBlur stdDeviation=".45"/></filter>'
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 96 96">{soft}<g filter="url(#b)">'
    picture = rasterize(f"{svg}{''.join(shapes)}</g></svg>", 96, 96)
    in_areas = vectorize(picture, areas="always").report["psnr_svg"]
    # It is 2.8 dB.
    assert vectorize(picture).report["psnr_svg"] > in_areas + 1


@pytest.mark.parametrize(
    ("limit", "larger_is_best"), [(None, [False, True]), (10**6, [True, True])]
)
def test_without_a_limit_twice_the_bytes_must_be_closer_by_more_than_a_hair(limit, larger_is_best):
    plan: Any = SimpleNamespace(
        aim=None, goal=SimpleNamespace(byte_limit=limit or np.inf, is_limited=limit is not None)
    )
    run: Any = SimpleNamespace(ended=False)
    fitted = FitResult(Scene(8, 8), 0, 0, 0.0, 0.0, 0, "gain")

    def outcome(size: int, psnr: float) -> Outcome:
        file: Any = SimpleNamespace(size=size)
        subject: Any = SimpleNamespace(psnr=lambda *_: psnr, photo=None)
        return Outcome(plan, subject, file, fitted, np.zeros((8, 8, 3), np.float32), 0)

    for closer, is_larger in zip((0.3, 1.0), larger_is_best, strict=True):
        best = best_of([outcome(40_000, 35.0 + closer), outcome(20_000, 35.0)], plan, run)
        assert (best.file.size == 40_000) == is_larger


def test_a_note_tells_of_areas_that_are_far_from_the_picture(monkeypatch):
    assert not any("--areas never" in note for note in vectorize(DRAWING).report["notes"])
    monkeypatch.setattr("gauss2svg.pipeline.report.SOFT", 80.0)
    assert any("--areas never" in note for note in vectorize(DRAWING).report["notes"])
    assert not any(
        "--areas never" in note for note in vectorize(DRAWING, areas="always").report["notes"]
    )


ICON = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 128 128"><linearGradient id="a"
x2=".6" y2="1"><stop stop-color="#fc0"/><stop offset="1" stop-color="#c0c"/></linearGradient><path
fill="#eef" d="M0 0h128v128H0z"/><rect width="112" height="112" x="8" y="8" rx="28"
fill="url(#a)"/><g fill="none" stroke="#fff" stroke-width="10"><circle cx="64" cy="64" r="22"/><rect
x="26" y="26" width="76" height="76" rx="20"/></g></svg>"""


@pytest.mark.parametrize("side", [40, 48])
def test_an_icon_is_drawn_by_crisp_areas_that_are_closer_when_enlarged(side):
    icon, large = rasterize(ICON, side, side), rasterize(ICON, 8 * side, 8 * side)
    result, shapes = vectorize(icon), vectorize(icon, areas="never")
    assert result.report["area_count"] > 0 == result.report["gaussians"]
    scores = [psnr(rasterize(one.svg, 8 * side, 8 * side), large) for one in (result, shapes)]
    assert scores[0] > scores[1] + 0.3
    assert result.report["svg_bytes"] < 0.3 * shapes.report["svg_bytes"]


SQUARES = "".join(
    f'<path fill="#c22" d="M{60 + 6 * i + k} {88 + 6 * j + k}h3v3h-3z"/>'
    for i, j, k in itertools.product(range(6), range(4), (0, 3))
)
BADGE = f"""<path fill="#fff" d="M0 0h128v128H0z"/><path fill="#124" d="M10 10h108v70H10z"/><circle
cx="40" cy="45" r="24" fill="#e84"/>{SQUARES}"""


@pytest.mark.parametrize(
    "picture",
    [
        Image.fromarray(data.coffee()).resize((48, 32), Image.Resampling.LANCZOS),
        rasterize(FRAME.format(BADGE), 48, 48),  # areas miss a part of it
    ],
)
def test_a_small_picture_that_areas_miss_is_drawn_by_shapes_with_soft_rims(picture):
    """Rims that are sharper than a pixel become discs when the file is enlarged."""
    scene = vectorize(picture).scene
    assert not scene.areas
    assert len(scene) > 0
    assert (scene.beta == 1).all()


FADE = """<linearGradient id="a" gradientUnits="userSpaceOnUse" {}><stop stop-color="{}"/><stop
offset="1" stop-color="{}"/></linearGradient>"""
ARROW = (
    FADE.format('x1="0" y1="20" x2="0" y2="90"', "#fff", "#48c")
    + """<path fill="url(#a)"
d="M20 100V60l40-44 44 44v40l-44-30z"/>"""
)
LETTERS = (
    FADE.format('x1="0" y1="0" x2="256" y2="0"', "#327", "#97d")
    + """<path fill="none"
stroke="url(#a)" stroke-width="4.3" d="M4 0l10 26 10-26M34 0v26h20M66 0v26M66 13l16-13M66 13l16 13
M112 0h-16v26h16M96 13h10M126 26V0l20 26V0M160 26V0l12 18 12-18v26M200 26l10-26 10 26M204 18h12
M236 0v26M226 0h20"/>"""
)


@pytest.mark.parametrize(
    ("shapes", "width", "height", "scale"), [(ARROW, 128, 128, 2), (LETTERS, 256, 26, 1)]
)
def test_a_gradient_that_fades_or_runs_through_letters_is_drawn_by_areas(
    shapes, width, height, scale
):
    frame = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}">'
    svg = f'{frame}<path fill="#fff" d="M0 0h{width}v{height}H0z"/>{shapes}</svg>'
    result = vectorize(rasterize(svg, scale * width, scale * height))
    assert result.report["gaussians"] == 0
    assert len(result.svg) < 8000
    size = 6 * width, 6 * height
    assert psnr(rasterize(result.svg, *size), rasterize(svg, *size)) > 28
