"""Properties of runs with areas: the file has them, the report tells of them, limits are kept."""

import dataclasses
import itertools
import os
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
from flat import vectorize

import gauss2svg
from gauss2svg import Scene, SvgOptions, read_svg
from gauss2svg.cli.main import main
from gauss2svg.errors import InputError
from gauss2svg.files import as_png
from gauss2svg.measure.roundtrip import model_psnr
from gauss2svg.raster import rasterize, rasterize_rgba
from gauss2svg.scene.areas import AreaCounts, Outline
from gauss2svg.svg.file import file_bytes

SIDE = 128
SHAPES = """<circle cx="40" cy="44" r="28" fill="#c0322c"/><circle cx="40" cy="44" r="12"
fill="#fff"/><path d="M70 20h44v50z" fill="#17324d"/><path d="M12 108c30-30 70 20 104-14"
fill="none" stroke="#084" stroke-width="3"/>"""
FRAME = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 128 128">{}</svg>'
DRAWING = rasterize(FRAME.format(f'<path fill="#fff" d="M0 0h128v128H0z"/>{SHAPES}'), SIDE, SIDE)
CLEAR = rasterize_rgba(FRAME.format(SHAPES), SIDE, SIDE)
SHADES = """<linearGradient id="a"><stop stop-color="#eef"/><stop offset="1" stop-color="#347"/>
</linearGradient><path fill="url(#a)" d="M0 0h128v128H0z"/>"""
SHADED = rasterize(FRAME.format(SHADES + SHAPES), SIDE, SIDE)


@pytest.mark.parametrize("markup", ["editable", "minimal"])
@pytest.mark.parametrize("picture", [DRAWING, CLEAR], ids=["opaque", "alpha"])
def test_the_file_has_the_areas_and_nothing_else_and_the_report_counts_them(picture, markup):
    result = vectorize(picture, areas="always", markup=markup)
    report, is_clear = result.report, picture.shape[2] == 4
    counts = AreaCounts(report["area_count"], report["line_count"], report["node_count"])
    assert counts == AreaCounts.of(result.scene.areas)
    assert 2 <= counts.areas <= 4
    assert counts.lines == 1
    assert report["markup"] == markup
    assert "<circle" not in result.svg
    again = read_svg(result.svg)
    assert (len(again), again.transparent) == (0, is_clear)
    assert AreaCounts.of(again.areas) == counts
    assert repr(result).startswith(f"<gauss2svg.Result 128x128, {counts}, ")
    assert ("and 1 line, fitted and written by gauss2svg" in result.svg) == (markup == "editable")
    assert report["psnr_svg"] > 40
    assert not is_clear or report["psnr_svg_black"] > 40
    assert (report["gaussians"], report["iterations"], report["stop_reason"]) == (0, 0, "gain")
    assert 0.97 < report["area_share"] <= 1
    assert min(report["area_find_s"], report["area_refine_s"]) > 0
    assert report["area_find_s"] + report["area_refine_s"] <= report["fit_s"] <= report["total_s"]
    assert report["colors"] >= 3 + is_clear - 1


def test_memory_of_a_run_is_that_of_a_few_pictures():
    side = 4 * SIDE
    large = rasterize(FRAME.format(SHADES + SHAPES), side, side)
    vectorize(SHADED, areas="always")  # what is loaded once is no part of it
    tracemalloc.start()
    try:
        vectorize(large, areas="always")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 9.5 * large.nbytes


def test_a_run_without_areas_reports_none(photo):
    report = vectorize(photo, gaussians=5, iterations=2).report
    names = ("area_count", "line_count", "node_count", "area_share", "area_find_s", "area_refine_s")
    assert [report[name] for name in names] == [0] * 6


def test_the_user_unit_is_a_share_of_a_pixel_of_the_fit_or_the_precision():
    usual = vectorize(DRAWING, areas="always")
    reduced = vectorize(DRAWING, areas="always", max_size=64)
    coarse = vectorize(DRAWING, areas="always", precision=0.5)
    assert reduced.report["precision"] == pytest.approx(2 * usual.report["precision"])
    assert (reduced.scene.width, reduced.report["fit_width"]) == (SIDE, 64)
    assert coarse.report["precision"] == 0.5
    assert coarse.report["svg_bytes"] < usual.report["svg_bytes"]
    assert min(model_psnr(one.scene, DRAWING) for one in (usual, reduced, coarse)) > 30


@pytest.mark.parametrize(
    "given",
    [{}, {"markup": "editable"}, {"count_gzipped": True}, {"gzip": True}],
    ids=lambda given: " ".join(given) or "usual",
)
def test_a_limit_of_bytes_is_kept_by_raising_the_price_of_a_byte(given):
    free = vectorize(DRAWING, areas="always", markup=given.get("markup", "minimal"))
    gzipped = not given.keys().isdisjoint({"count_gzipped", "gzip"})
    limit = int(0.9 * len(file_bytes(free.svg, gzipped)))
    result = vectorize(DRAWING, areas="always", max_bytes=limit, **given)
    assert len(file_bytes(result.svg, gzipped)) <= limit
    assert result.scene.areas
    assert (result.report["stop_reason"], result.report["unreached"]) == ("max_bytes", [])
    assert result.report["corrections"] > 0


@pytest.mark.parametrize("limit", [None, 150])
@pytest.mark.parametrize(
    "picture",
    [np.full((20, 20, 3), 0.2), np.zeros((1, 1, 3)), np.zeros((9, 9, 4)), np.eye(40)[..., None],
     np.random.default_rng(0).random((20, 20, 3))],
    ids=["blank", "one pixel", "clear", "thin", "noise"],
)  # fmt: skip
def test_a_picture_without_areas_becomes_its_ground(picture, limit):
    given = {} if limit is None else {"max_bytes": limit}
    result = vectorize(picture, areas="always", **given)
    assert AreaCounts.of(result.scene.areas).areas == 0
    assert result.report["svg_bytes"] <= (limit or 1000)
    assert result.scene.transparent == (picture.shape[2] == 4)


def test_a_limit_below_the_bytes_of_the_ground_alone_is_refused():
    with pytest.raises(InputError, match=r"max_bytes must be at least \d+, the bytes of a file"):
        vectorize(DRAWING, areas="always", max_bytes=60)


def test_every_phase_is_told_and_the_forming_picture_has_the_areas():
    seen = []
    result = gauss2svg.vectorize(DRAWING, svg=SvgOptions(areas="always"), progress=seen.append)
    phases = list(dict.fromkeys(now.phase for now in seen))
    assert phases == ["read", "compile", "areas", "write", "measure"]
    states = [now.fit for now in seen if now.fit is not None]
    assert all(before.done < after.done for before, after in itertools.pairwise(states))
    assert states[-1].scene().areas
    assert states[-1].areas == str(AreaCounts.of(states[-1].scene().areas))
    assert states[-1].psnr > 30
    assert result.report["psnr_svg"] > 40


@pytest.mark.parametrize("calls", [1, 2, 3])
@pytest.mark.parametrize("limit", [None, 500, 1000])
def test_a_stopped_run_writes_what_is_found_so_far_within_the_limit(calls, limit):
    left = iter(range(calls - 1))
    given = {} if limit is None else {"max_bytes": limit}
    result = vectorize(DRAWING, areas="always", **given, stop=lambda: next(left, None) is None)
    assert result.report["stop_reason"] == "interrupted"
    assert result.report["svg_bytes"] <= (limit or np.inf)
    assert result.scene.areas or limit == 500  # these bytes are too few for the first areas
    assert rasterize(result.svg, 8, 8).shape == (8, 8, 3)


def test_the_command_writes_a_file_that_check_and_other_commands_read(tmp_path, capfd):
    photo, svg, npz = (tmp_path / f"drawing.{suffix}" for suffix in ("png", "svg", "npz"))
    photo.write_bytes(as_png(DRAWING))
    command = [str(photo), "-o", str(svg), "--areas", "always", "--save-scene", str(npz)]
    assert main([*command, "--outline", str(tmp_path / "outline.svg")]) == 0
    scene = Scene.load(npz)
    shapes = next(line for line in capfd.readouterr().err.splitlines() if "shapes" in line)
    assert shapes.startswith(f"shapes  {AreaCounts.of(scene.areas)}: more would improve it too")
    assert main(["check", str(photo), str(svg), "--min-psnr", "40"]) == 0
    assert main(["batch", str(photo), "-o", str(tmp_path / "many"), "--areas", "always"]) == 0
    assert (tmp_path / "many/drawing.svg").read_text() == svg.read_text()


def test_the_areas_of_a_start_are_refined_and_not_found_again():
    result = vectorize(DRAWING, areas="always")
    moved = result.scene.replace(
        areas=[
            dataclasses.replace(area, outlines=[shifted(o, 0.4) for o in area.outlines])
            for area in result.scene.areas
        ]
    )
    again = vectorize(DRAWING, areas="always", start=moved)
    counts, new = AreaCounts.of(result.scene.areas), AreaCounts.of(again.scene.areas)
    assert (new.areas, new.lines) == (counts.areas, counts.lines)
    assert again.report["psnr_svg"] > result.report["psnr_svg"] - 1
    larger = result.scene.scaled(2)
    assert vectorize(DRAWING, areas="always", start=larger).report["psnr_svg"] > 40


def shifted(outline: Outline, by: float) -> Outline:
    return dataclasses.replace(outline, points=[(x + by, y) for x, y in outline.points])


def test_a_start_has_areas_if_and_only_if_the_file_is_drawn_by_areas(tmp_path, refusal):
    result = vectorize(DRAWING, areas="always")
    with pytest.raises(InputError, match=r"start must be a scene without areas; got .* nodes"):
        vectorize(DRAWING, start=result.scene)
    photo, start = tmp_path / "drawing.png", tmp_path / "start.svg"
    photo.write_bytes(as_png(DRAWING))
    start.write_text(result.svg)
    command = [str(photo), "-o", str(tmp_path / "out.svg"), "--start", str(start)]
    assert "--start must be a scene without areas" in refusal(*command)
    start.write_text(vectorize(DRAWING, gaussians=3).svg)
    assert "start must be a scene of areas alone" in refusal(*command, "--areas=always")


@pytest.mark.process
def test_every_kernel_is_compiled_before_the_search():
    code = """
import sys
from gauss2svg.pipeline.run import compile_areas, compile_kernels
from numba.core.dispatcher import Dispatcher
import test_by_areas as pictures

def signatures():
    return {
        (name, one): len(value.signatures) for name, module in list(sys.modules.items())
        if name.startswith("gauss2svg.") for one, value in vars(module).items()
        if isinstance(value, Dispatcher)
    }

compile_kernels()
compile_areas()
before = signatures()
for picture in (pictures.DRAWING, pictures.CLEAR, pictures.SHADED):
    pictures.vectorize(picture, areas="always")
print(*[one for one, count in signatures().items() if before.get(one) != count])
"""
    paths = os.pathsep.join([*sys.path, os.path.dirname(__file__)])
    command, env = [sys.executable, "-c", code], {**os.environ, "PYTHONPATH": paths}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=env)
    assert done.stdout.strip() == ""
