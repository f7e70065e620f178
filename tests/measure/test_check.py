"""Laws of `gauss2svg check`: any SVG is scored as our own are, and files are whole or untouched."""

import base64
import contextlib
import gzip
import io
import itertools
import json
import os
import subprocess
import sys

import numpy as np
import pytest
from conftest import has_ended
from flat import vectorize
from PIL import Image

import gauss2svg
from gauss2svg.cli.main import main
from gauss2svg.errors import InputError, RendererError
from gauss2svg.files import as_png
from gauss2svg.measure import metrics
from gauss2svg.measure.check import sized_svg
from gauss2svg.measure.heatmap import colors_of, heatmap
from gauss2svg.photo.alpha import shrunk
from gauss2svg.raster import BROWSERS, program, rasterize

XMLNS = 'xmlns="http://www.w3.org/2000/svg"'
HALVES = '<rect width="8" height="8" fill="#00f"/><rect width="4" height="8" fill="#f00"/>'


@pytest.fixture(scope="module")
def fitted(photo, tmp_path_factory):
    """A photo as a file, our SVG of it, and the report of that run."""
    folder = tmp_path_factory.mktemp("fitted")
    Image.fromarray(np.round(photo[:96, :64] * 255).astype(np.uint8)).save(folder / "photo.png")
    result = vectorize(folder / "photo.png", gaussians=60, iterations=20)
    result.save(folder / "out.svg")
    return folder / "photo.png", folder / "out.svg", result


@pytest.fixture(scope="module")
def halves():
    """Red left, blue right, 16 x 16 px."""
    picture = np.zeros((16, 16, 3), np.float32)
    picture[:, :8, 0] = picture[:, 8:, 2] = 1
    return picture


def test_our_own_file_has_the_numbers_of_its_report(fitted):
    photo, svg, result = fitted
    checked = gauss2svg.check(photo, svg)
    for key in ("psnr_svg", "ssim_svg", "bias_svg", "largest_error_svg", "svg_bytes", "svgz_bytes"):
        assert checked.report[key] == pytest.approx(result.report[key], abs=1e-6), key
    np.testing.assert_allclose(checked.raster, result.raster, atol=1e-6)
    tags = checked.report["elements_by_tag"]
    # Shapes that need no gradient are circles too.
    assert tags["circle"] == result.report["gaussians"] == 60
    assert tags["radialGradient"] == result.report["gradients"]
    assert sum(tags.values()) == checked.report["elements"]
    assert checked.report["layers"] == checked.report["groups"] == result.report["rounds"]
    assert checked.report["notes"] == []
    assert checked.report["ms_ssim_svg"] is None  # under 176 px
    json.dumps(checked.report, allow_nan=False)


def test_large_pictures_have_an_ms_ssim(drawn_here):
    photo = np.random.default_rng(0).random((176, 180, 3))
    svg = f'<svg {XMLNS} viewBox="0 0 1 1"><rect width="1" height="1" fill="gray"/></svg>'
    checked = gauss2svg.check(photo, svg)
    assert checked.ms_ssim == gauss2svg.measure.metrics.ms_ssim(checked.raster, checked.photo)


@pytest.mark.parametrize(
    "pack", [lambda b: b, gzip.compress, io.BytesIO, bytes.decode, lambda b: b.decode("utf-8-sig")]
)
def test_the_way_that_it_comes_does_not_matter(pack, fitted, drawn_here):
    photo, svg, _ = fitted
    assert gauss2svg.check(photo, pack(svg.read_bytes())).report == (
        gauss2svg.check(photo, str(svg)).report
    )


@pytest.mark.parametrize("renderer", ["resvg", "cairo", "chromium", "librsvg"], indirect=True)
@pytest.mark.parametrize(
    "head",
    [
        f'<svg {XMLNS} viewBox="0 0 8 8">',
        f'<svg {XMLNS} width="8" height="8">',
        f'<svg {XMLNS} width="8px" height="6pt">',
        f'<svg {XMLNS} width="100%" viewBox="0,0,8,8" preserveAspectRatio="xMinYMin">',
        f"<svg data-x='a > b' {XMLNS}\n  height='40' viewBox='0 0 8 8'>",
        f"<?xml version='1.0' encoding='latin-1'?><!-- <svg viewBox='0 0 1 1'> é --><!DOCTYPE svg "
        f'PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/svg>11.dtd"><svg {XMLNS} '
        'viewBox="0 0 8 8">',
    ],
)  # fmt: skip
def test_any_root_is_stretched_to_the_photo(head, renderer, halves, drawn_here):
    encoding = "latin-1" if "latin-1" in head else "utf-8"
    checked = gauss2svg.check(halves, f"{head}{HALVES}</svg>".encode(encoding), renderer=renderer)
    np.testing.assert_array_equal(checked.raster, halves)
    assert checked.report["psnr_svg"] is None
    assert checked.psnr == np.inf


def test_prefixed_names_are_the_same_names(halves, drawn_here):
    svg = HALVES.replace("<rect", "<ns0:rect")
    svg = f'<ns0:svg xmlns:ns0="http://www.w3.org/2000/svg" viewBox="0 0 8 8">{svg}</ns0:svg>'
    checked = gauss2svg.check(halves, svg)
    assert checked.report["elements_by_tag"] == {"rect": 2, "svg": 1}
    assert checked.psnr == np.inf


def test_what_is_transparent_is_white(drawn_here):
    checked = gauss2svg.check(np.ones((4, 4, 3)), f'<svg {XMLNS} viewBox="0 0 1 1"/>')
    assert checked.psnr == np.inf


@pytest.mark.parametrize(
    ("svg", "note"),
    [
        ('viewBox="0 0 8 8">', None),
        ('viewBox="0 0 80 82">', None),  # half a pixel at 16 px
        ('viewBox="0 0 80 88">', "SVG is 80x88, not in the photo's proportions"),
        (
            'width="8" height="8" viewBox="0 0 8 4">',
            "viewBox is 8x4, not in the photo's proportions",
        ),
        ('viewBox="0 0 8 8"><text>a</text>', "text (1) is not drawn, because resvg gets no fonts"),
        ('viewBox="0 0 8 8"><foreignObject/>', "foreignObject (1) is left out"),
        ('viewBox="0 0 8 8"><script/>', "script (1) is left out"),
        ('viewBox="0 0 8 8"><g><animate/></g>', "animate (1) is left out"),
    ],
)
def test_what_has_to_be_known_is_a_note(svg, note, halves, drawn_here):
    notes = gauss2svg.check(halves, f"<svg {XMLNS} {svg}</svg>").notes
    assert len(notes) == (note is not None)
    assert all(note in told for told in notes)


@pytest.mark.parametrize("renderer", BROWSERS)
def test_what_browsers_draw_is_not_called_left_out(renderer, halves, monkeypatch):
    monkeypatch.setattr("gauss2svg.measure.check.renderer_version", str)
    monkeypatch.setattr("gauss2svg.measure.check.draw", lambda *_: halves)
    svg = f'<svg {XMLNS} viewBox="0 0 8 8"><foreignObject/><script/></svg>'
    assert gauss2svg.check(halves, svg, renderer=renderer).notes == (
        "script (1) is left out by the renderer", "foreignObject (1) is drawn only by browsers",
    )  # fmt: skip


@pytest.mark.posix
def test_nothing_is_left_of_a_drawing_that_takes_too_long(halves, tmp_path, monkeypatch):
    fake, begun = (tmp_path / name for name in ("rsvg-convert", "begun"))
    fake.write_text(
        '#!/bin/sh\n[ "$1" = --version ] && echo fake 1.0 && exit\n'
        f"sleep 600 & echo $$ $! > {begun}; wait\n"
    )
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    program.version_line.cache_clear()
    svg = f'<svg {XMLNS} viewBox="0 0 8 8"/>'
    try:
        for seconds in (2, 8, 32):  # more where the machine is too busy for it to begin
            with pytest.raises(RendererError, match=f"has not drawn the SVG in {seconds} s"):
                gauss2svg.check(halves, svg, renderer="librsvg", draw_timeout=seconds)
            if begun.exists():
                break
    finally:
        program.version_line.cache_clear()
    assert all(has_ended(int(number)) for number in begun.read_text().split())


def test_drawing_imports_nothing_from_the_current_folder(halves, tmp_path, monkeypatch):
    (tmp_path / "numpy.py").write_text("raise ValueError('from the current folder')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend("")
    assert gauss2svg.check(halves, f'<svg {XMLNS} viewBox="0 0 8 8">{HALVES}</svg>').psnr == np.inf


@pytest.mark.parametrize(
    ("failure", "line"),
    [
        ("1 / 0", "librsvg cannot draw the SVG: ZeroDivisionError: division by zero"),
        pytest.param(
            "isolated.np.ones(2**31)",
            "librsvg is out of memory. Try a smaller or simpler SVG",
            marks=pytest.mark.skipif(sys.platform != "linux", reason="memory is limited on Linux"),
        ),
    ],
)
def test_failure_of_a_renderer_is_one_line_that_names_it(failure, line):
    program = (
        "import sys; from gauss2svg.raster import isolated; sys.argv = ['', '8', '8', 'librsvg']\n"
        f"isolated.rasterize_sized = lambda *_: {failure}\nsys.exit(isolated.main())"
    )
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, input=b"<svg/>", capture_output=True, check=False)
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr.decode().strip() == line


def test_embedded_images_are_drawn_and_reported(halves, drawn_here):
    stream = io.BytesIO()
    Image.fromarray(np.uint8(halves * 255)).save(stream, "PNG")
    data = base64.b64encode(stream.getvalue()).decode()
    svg = (
        f'<svg {XMLNS} viewBox="0 0 16 16"><image width="16" height="16" '
        f'href="data:image/png;base64,{data}"/></svg>'
    )
    checked = gauss2svg.check(halves, svg)
    assert checked.psnr > 50
    assert "embedded images (1)" in checked.notes[0]


def test_same_error_has_the_same_colour_in_two_maps():
    maps = []
    for base, error in ((0.2, [9, 0, 0]), (0.7, [-2, 5, -9])):
        photo = np.full((20, 130, 3), base)
        drawn = photo.copy()
        drawn[3, 5] += np.array(error) / 255
        drawn[4, 5] += np.sign(error) * 70 / 255
        with Image.open(io.BytesIO(heatmap(drawn, photo))) as picture:
            maps.append(np.asarray(picture))
            assert "0 to pale yellow 64" in picture.info["Description"]
    np.testing.assert_array_equal(*maps)
    np.testing.assert_array_equal(maps[0][3, 5], colors_of(np.array(9.0)))
    np.testing.assert_array_equal(maps[0][4, 5], colors_of(np.array(64.0)))  # and above
    np.testing.assert_array_equal(maps[0][0, 0], colors_of(np.array(0.0)))
    np.testing.assert_array_equal(maps[0][20, [0, -1]], colors_of(np.array([0.0, 64.0])))


def test_colours_of_errors_are_those_of_inferno():
    matplotlib = pytest.importorskip("matplotlib")
    levels = np.linspace(0, 64, 256)
    inferno = np.array(matplotlib.colormaps["inferno"].colors) * 255
    np.testing.assert_allclose(colors_of(levels), inferno, atol=7)


def test_command_writes_what_was_asked_for(fitted, tmp_path, capsys, drawn_here):
    photo, svg, result = fitted
    heat, preview, report = (tmp_path / name for name in ("h.png", "p.png", "r.json"))
    asked = ["--heatmap", heat, "--preview", preview, "--report", report]
    assert main(["check", *map(str, [photo, svg, *asked])]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    for word in ("out.svg", "circle", "gzipped", "PSNR", "MS-SSIM", "resvg"):
        assert word in err
    assert json.loads(report.read_text()) == gauss2svg.check(photo, svg).report
    with Image.open(preview) as drawn:
        np.testing.assert_array_equal(np.asarray(drawn), np.round(result.raster * 255))
    with Image.open(heat) as drawn:
        assert drawn.width == 64
        assert drawn.height > 96


def test_too_low_a_psnr_is_status_one_and_the_files_are_there(fitted, tmp_path, capsys, drawn_here):
    photo, svg, result = fitted
    report = tmp_path / "r.json"
    arguments = ["check", str(photo), str(svg), "--quiet", "--report", str(report), "--min-psnr"]
    assert main([*arguments, str(result.report["psnr_svg"] - 0.01)]) == 0
    assert capsys.readouterr().err == ""
    report.unlink()
    assert main([*arguments, "60"]) == 1
    assert capsys.readouterr().err.count("below --min-psnr 60\n") == 1
    assert json.loads(report.read_text())["psnr_svg"] < 60


@pytest.mark.process
@pytest.mark.parametrize("which", [0, 1])
def test_standard_input_is_a_stream(which, fitted):
    paths = [str(path) for path in fitted[:2]]
    data = fitted[which].read_bytes()
    paths[which] = "-"
    command = [sys.executable, "-m", "gauss2svg", "check", *paths, "--min-psnr", "5", "--quiet"]
    done = subprocess.run(command, input=data, capture_output=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-", "-"], "photo and svg must not both be -"),
        (["no.png", "SVG"], "cannot read no.png"),
        (["PHOTO", "no.svg"], "cannot read no.svg"),
        (["PHOTO", "PHOTO"], "an svg in utf-8; got"),
        (["SVG", "SVG"], "must be a supported image"),
        (["PHOTO", "SVG", "--report", "SVG"], "is also the svg"),
        (["PHOTO", "SVG", "--heatmap", "PHOTO"], "is also the photo"),
        (["PHOTO", "SVG", "--heatmap", "X", "--preview", "X"], "is also another output"),
        (["PHOTO", "SVG", "--heatmap", "no/such/folder/x"], "cannot write"),
        (["PHOTO", "SVG", "--min-psnr", "nan"], "--min-psnr must be a number above 0"),
        (
            ["PHOTO", "SVG", "--max-svg-bytes", "9k"],
            "got more. try to raise --max-svg-bytes",
        ),
        (
            ["PHOTO", "SVG", "--max-elements", "9"],
            "got more. try to raise --max-elements",
        ),
        (
            ["PHOTO", "SVG", "--draw-timeout", "0"],
            "number above 0 and at most 86400; got 0",
        ),
        (
            ["PHOTO", "SVG", "--draw-timeout", "1e10"],
            "number above 0 and at most 86400; got 10000000000",
        ),
        (["PHOTO", "SVG", "--draw-timeout", "nan"], "number above 0 and at most 86400; got nan"),
        (["PHOTO", "SVG", "--draw-timeout", "1e-9"], "try a longer --draw-timeout"),
        (["PHOTO", "SVG", "--renderer", "paint"], "paint"),
        (["PHOTO"], "svg"),
    ],
)
def test_mistake_is_one_line_status_two_and_no_file(arguments, message, fitted, tmp_path, capsys):
    names = {"PHOTO": str(fitted[0]), "SVG": str(fitted[1]), "X": str(tmp_path / "x")}
    before = [path.read_bytes() for path in fitted[:2]]
    given = [names.get(argument, argument) for argument in arguments]
    if "--report" not in given:
        given += ["--report", str(tmp_path / "r.json")]
    assert main(["check", *given]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err.lower()
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
    assert [path.read_bytes() for path in fitted[:2]] == before


RANGE = r"width, height and viewBox of the SVG must be above 0 and in 1e-30\.\.1e\+30"
ROOTS = {
    "": "of a known size",
    'width="8"': "of a known size",
    'width="100%" height="100%"': "of a known size",
    'viewBox="0 0 8"': "viewBox must be .* got '0 0 8'",
    'viewBox="0 0 8 inf"': "viewBox must be 4 finite numbers",
    'viewBox="0 0 8 0"': RANGE,
    'width="0" height="8"': RANGE,
    'width="8" height="-8" viewBox="0 0 8 8"': RANGE,
    'width="1e-320" height="8"': RANGE,
    'width="1e9" viewBox="0 0 1e-29 8"': RANGE,
    'viewBox="0 0 1e-300 1e-300"': RANGE,
    'viewBox="-1e300 0 8 8"': RANGE,
}


@pytest.mark.parametrize("root", ROOTS)
def test_svg_without_a_size_that_renderers_hold_is_refused(root, halves):
    with pytest.raises(InputError, match=ROOTS[root]):
        gauss2svg.check(halves, f"<svg {XMLNS} {root}/>")


NUMBERS = ("1e-320", "1e-45", "1e-31", "1e-30", "1e-9", "1", "1e9", "1e30", "1e31", "1e300")
FRAMES = (
    'viewBox="0 0 {0} {1}"', 'width="{0}" height="{1}"', 'height="{0}" viewBox="0 0 {1} 1"',
    'width="{0}" height="{1}" viewBox="0 0 8 8"', 'viewBox="{0} -{1} 8 8"',
)  # fmt: skip


@pytest.mark.parametrize("root", FRAMES)
def test_frame_is_one_that_renderers_hold(root):
    let_through = 0
    for numbers in itertools.product(NUMBERS, NUMBERS):
        with contextlib.suppress(InputError):
            _, frame, _ = sized_svg(f"<svg {XMLNS} {root.format(*numbers)}/>", 8, 8, "resvg", 9)
            assert min(frame.width, frame.height, *frame.view_box[2:]) >= 1e-30
            assert max(frame.width, frame.height, *map(abs, frame.view_box)) <= 1e30
            let_through += 1
    assert let_through >= 15


@pytest.mark.parametrize("side", ["1e-30", "1e-12", "1e12", "1e30"])
def test_scale_of_the_coordinates_does_not_matter(side, halves, drawn_here):
    half = float(side) / 2
    svg = (
        f'<svg {XMLNS} viewBox="0 0 {side} {side}"><rect width="{side}" height="{side}" '
        f'fill="#00f"/><rect width="{half!r}" height="{side}" fill="#f00"/></svg>'
    )
    assert gauss2svg.check(halves, svg).psnr == np.inf


def test_crash_of_a_renderer_is_an_error(halves):
    deep = "<g>" * 20_000 + "</g>" * 20_000
    with pytest.raises(RendererError, match=r"crashed on the SVG \(killed by SIG"):
        gauss2svg.check(halves, f'<svg {XMLNS} viewBox="0 0 8 8">{deep}</svg>')


DISC = f'<svg {XMLNS} viewBox="0 0 8 8"><circle cx="4" cy="4" r="{{}}" fill="#06c"/></svg>'


def drawn_at(svg, side):
    return rasterize(svg, side, side)


def test_reference_is_what_the_svg_is_compared_with_enlarged(drawn_here):
    source, other = DISC.format(3), DISC.format(2.9)
    checked = gauss2svg.check(drawn_at(source, 16), other, reference=source)
    larger = checked.enlarged
    assert (larger.scale, larger.width, larger.height) == (4, 64, 64)
    assert larger.psnr == pytest.approx(metrics.psnr(drawn_at(other, 64), drawn_at(source, 64)))
    assert checked.report["psnr_svg_enlarged"] == larger.psnr
    assert checked.report["ssim_svg_enlarged"] == larger.ssim < 1
    assert checked.report["reference_scale"] == 4
    exact = gauss2svg.check(drawn_at(source, 16), source, reference=source, reference_scale=2.5)
    assert (exact.enlarged.psnr, exact.enlarged.width) == (np.inf, 40)
    assert exact.report["psnr_svg_enlarged"] is None


def test_reference_may_be_a_larger_picture_which_is_reduced(drawn_here):
    source = DISC.format(3)
    photo, larger = drawn_at(source, 16), drawn_at(source, 96)
    of_picture = gauss2svg.check(photo, source, reference=larger, reference_scale=3).enlarged
    expected = metrics.psnr(drawn_at(source, 48), shrunk(larger, 48, 48))
    assert of_picture.psnr == pytest.approx(expected)


def test_photo_is_measured_as_without_a_reference(drawn_here):
    source, photo = DISC.format(3), drawn_at(DISC.format(3.1), 16)
    without, beside = (gauss2svg.check(photo, source, reference=r).report for r in (None, source))
    keys = {"reference_scale", "psnr_svg_enlarged", "ssim_svg_enlarged"}
    assert {k for k in beside if beside[k] != without[k]} <= keys
    assert all(without[key] is None for key in keys)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"reference_scale": 2}, "reference must be given for reference_scale; got none. Try"),
        ({"reference": DISC.format(3), "reference_scale": 0}, "reference_scale must be"),
        (
            {"reference": DISC.format(3), "reference_scale": 1e4},
            "reference_scale must be a size of at most .* Try a small",
        ),
        (
            {"reference": np.zeros((24, 48, 3))},
            "size of the reference must be at least 64x64 px, 4 times the photo's; got 48x24. Try "
            "an SVG, or --reference-scale 1.5",
        ),
        ({"reference": "missing.svg"}, "cannot read missing.svg"),
        ({"reference": "<svg/>"}, "SVG"),
    ],
)
def test_reference_that_cannot_be_used_is_refused(given, message, halves, drawn_here):
    with pytest.raises(InputError, match=message):
        gauss2svg.check(halves, DISC.format(3), **given)


def test_another_option_is_named(halves):
    with pytest.raises(TypeError, match=r"option of check must be one of renderer, .*; got foo"):
        gauss2svg.check(halves, DISC.format(3), foo=1)


def test_command_reports_the_enlargement(tmp_path, capsys, drawn_here):
    source, photo = tmp_path / "source.svg", tmp_path / "photo.png"
    source.write_text(DISC.format(3))
    photo.write_bytes(as_png(drawn_at(DISC.format(3), 16)))
    svg, report = tmp_path / "out.svg", tmp_path / "check.json"
    svg.write_text(DISC.format(2.9))
    arguments = ["check", str(photo), str(svg), "--reference", str(source)]
    assert main([*arguments, "--report", str(report)]) == 0
    score = json.loads(report.read_text())["psnr_svg_enlarged"]
    said = "".join(capsys.readouterr())
    assert f"{score:.2f} dB" in said.split("enlarged")[1].splitlines()[0]
    assert main([*arguments[:3], "--reference-scale", "3"]) == 2
    assert "reference must be given" in capsys.readouterr().err
    assert main([*arguments, "--heatmap", str(source)]) == 2
