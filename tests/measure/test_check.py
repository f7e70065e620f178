"""Properties of `gauss2svg check`: any SVG is scored as our own are."""

import gzip
import io
import json
import subprocess
import sys

import numpy as np
import pytest
from flat import vectorize
from PIL import Image

import gauss2svg
from gauss2svg.cli.main import main
from gauss2svg.errors import RendererError
from gauss2svg.measure.heatmap import colors_of, heatmap

XMLNS = 'xmlns="http://www.w3.org/2000/svg"'
HALVES = '<rect width="8" height="8" fill="#00f"/><rect width="4" height="8" fill="#f00"/>'


@pytest.fixture(scope="module")
def fitted(photo, tmp_path_factory):
    """A photo as a file, our SVG of it, and the report of that run."""
    folder = tmp_path_factory.mktemp("fitted")
    Image.fromarray(np.round(photo[:96, :64] * 255).astype(np.uint8)).save(folder / "photo.png")
    result = vectorize(folder / "photo.png", gaussians=60, iterations=20, scores=True)
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
    report = checked.report
    for key in ("psnr_svg", "ssim_svg", "bias_svg", "largest_error_svg", "svg_bytes", "svgz_bytes"):
        assert report[key] == pytest.approx(result.report[key], abs=1e-6), key
    for key in ("hue_error_svg", "hue_error_at", "hue_error_999_svg"):
        assert report[key] == result.report[key], key
    assert report["flip_svg"] == result.report["flip_svg"] > 0
    small = "SSIMULACRA2 is not measured: it needs at least 225 px a side"
    assert report["scores_missing"] == result.report["scores_missing"] == [small]
    np.testing.assert_allclose(checked.raster, result.raster, atol=1e-6)
    tags = report["elements_by_tag"]
    # Shapes that need no gradient are circles too.
    assert tags["circle"] == result.report["gaussians"] == 60
    assert tags["radialGradient"] == result.report["gradients"]
    assert sum(tags.values()) == report["elements"]
    assert report["layers"] == report["groups"] == result.report["rounds"]
    assert report["notes"] == []
    json.dumps(report, allow_nan=False)


@pytest.mark.parametrize("pack", [gzip.compress, io.BytesIO, bytes.decode])
def test_the_way_that_it_comes_does_not_matter(pack, fitted, drawn_here):
    photo, svg, result = fitted
    expected = gauss2svg.check(photo, str(svg)).report
    assert gauss2svg.check(photo, pack(svg.read_bytes())).report == expected
    assert gauss2svg.check(photo, result).report == expected


HEADS = [
    f'<svg {XMLNS} width="8" height="8">',
    f'<svg {XMLNS} width="100%" viewBox="0,0,8,8" preserveAspectRatio="xMinYMin">',
    f"<svg data-x='a > b' {XMLNS}\n  height='40' viewBox='0 0 8 8'>",
    f'<svg {XMLNS} viewBox="0 0 8px" height="8" width="8">',
    f'<svg {XMLNS} viewBox="0 0 96 96"><g transform="scale(12)">',
    f"<?xml version='1.0' encoding='latin-1'?><!-- <svg viewBox='0 0 1 1'> é --><!DOCTYPE svg "
    f'PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/svg>11.dtd"><svg {XMLNS} '
    'viewBox="0 0 8 8">',
]  # fmt: skip


@pytest.mark.parametrize(
    ("renderer", "head"),
    [*(("resvg", head) for head in HEADS), ("cairo", HEADS[2]), ("librsvg", HEADS[2]),
     *(("chromium", head) for head in HEADS[2:6])], indirect=["renderer"],
)  # fmt: skip
def test_any_root_is_stretched_to_the_photo(head, renderer, halves, drawn_here):
    encoding = "latin-1" if "latin-1" in head else "utf-8"
    svg, photo = f"{head}{HALVES}{'</g>' * head.count('<g ')}</svg>", halves[:12]
    checked = gauss2svg.check(photo, svg.encode(encoding), renderer=renderer)
    np.testing.assert_array_equal(checked.raster, photo)
    assert checked.report["psnr_svg"] is None


@pytest.mark.parametrize(
    ("svg", "note"),
    [
        ('viewBox="0 0 80 88">', "SVG is 80x88, not in the photo's proportions"),
        ('width="8" height="8" viewBox="0 0 8 4">', "viewBox is 8x4, not in the photo's prop"),
        ('viewBox="0 0 8 8">', "no xmlns of SVG, so browsers do not show"),
        ('viewBox="0 0 8 8"><text>a</text>',
         "not drawn, because resvg gets no fonts. Try paths, or another --renderer"),
        ('viewBox="0 0 8 8"><g><animate attributeName="x" to="1"/></g>',
         "draw these as browsers do: <animate>. Try a copy without the animation"),
        ('viewBox="0 0 8 8"><foreignObject/><set/><mesh/><pattern/>',
         "<foreignObject>, <set>, <mesh> and more. Try"),
    ],
)  # fmt: skip
def test_what_has_to_be_known_is_a_note(svg, note, halves, drawn_here):
    xmlns = XMLNS if "xmlns" not in note else ""
    notes = gauss2svg.check(halves, f"<svg {xmlns} {svg}</svg>").report["notes"]
    assert len(notes) == 1
    assert note in notes[0]


def test_same_error_has_the_same_colour_in_two_maps():
    maps = []
    for base, error in ((0.2, [9, 0, 0]), (0.7, [-2, 5, -9])):
        photo = np.full((20, 130, 3), base)
        drawn = photo.copy()
        drawn[3, 5] += np.array(error) / 255
        drawn[4, 5] += np.sign(error) * 70 / 255
        with Image.open(io.BytesIO(heatmap(drawn, photo))) as picture:
            maps.append(np.asarray(picture.convert("RGB")))
    np.testing.assert_array_equal(*maps)
    np.testing.assert_array_equal(maps[0][3, 5], colors_of(np.array(9.0)))
    np.testing.assert_array_equal(maps[0][4, 5], colors_of(np.array(64.0)))  # and above
    np.testing.assert_array_equal(maps[0][0, 0], colors_of(np.array(0.0)))


def test_command_writes_what_was_asked_for_and_too_low_a_psnr_is_status_one(
    fitted, tmp_path, capsys, drawn_here
):
    photo, svg, result = fitted
    heat, preview, report = (tmp_path / name for name in ("h.png", "p.png", "r.json"))
    asked = ["--heatmap", heat, "--preview", preview, "--report", report]
    command = ["check", *map(str, [photo, svg, *asked, "--min-psnr"])]
    assert main([*command, str(result.report["psnr_svg"] - 0.01)]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    for word in ("out.svg", "circle", "gzipped", "PSNR", "SSIM", "resvg"):
        assert word in err
    checked = gauss2svg.check(photo, svg)
    assert json.loads(report.read_text()) == checked.report
    with Image.open(preview) as drawn:
        np.testing.assert_array_equal(np.asarray(drawn), np.round(result.raster * 255))
    with Image.open(heat) as drawn:
        assert drawn.size == (64, 96)
    report.unlink()
    assert main([*command, "60", "--quiet"]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert json.loads(report.read_text())["psnr_svg"] < 60


def test_too_low_a_psnr_over_black_is_status_one_too(tmp_path, capsys, drawn_here):
    photo, svg = tmp_path / "clear.png", tmp_path / "white.svg"
    Image.new("LA", (8, 8)).save(photo)
    svg.write_text(DISC.format(9).replace("#06c", "#fff"))
    assert main(["check", str(photo), str(svg), "--min-psnr", "30", "--quiet"]) == 1
    assert "0.00 dB, below --min-psnr 30" in capsys.readouterr().err


def test_a_renderer_that_crashes_or_takes_too_long_is_an_error(halves):
    deep = "<g>" * 20_000 + "</g>" * 20_000
    with pytest.raises(RendererError, match=r"crashed on the SVG"):
        gauss2svg.check(halves, f'<svg {XMLNS} viewBox="0 0 8 8">{deep}</svg>')
    with pytest.raises(RendererError, match=r"has not drawn the SVG in 0\.001 s"):
        gauss2svg.check(halves, f'<svg {XMLNS} viewBox="0 0 8 8"/>', draw_timeout=0.001)


DISC = f'<svg {XMLNS} viewBox="0 0 8 8"><circle cx="4" cy="4" r="{{}}" fill="#06c"/></svg>'


@pytest.mark.process
@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited on Linux")
def test_a_drawing_gets_no_more_memory_than_its_limit():
    program = (
        "from gauss2svg.raster import isolated\n"
        "isolated.rasterize_sized = lambda *_: isolated.np.empty(2**31)\n"
        "try: isolated._drawn('<svg/>', 8, 8, 'resvg', False)\nexcept MemoryError: exit(2)"
    )
    assert subprocess.run([sys.executable, "-c", program]).returncode == 2
