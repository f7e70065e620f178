import gzip
import io
import json
import math
import subprocess
import sys

import numpy as np
import pytest
from conftest import needs
from flat import vectorize
from numba import get_num_threads
from PIL import Image

from gauss2svg import quantize
from gauss2svg.errors import InputError, OutputError, RendererError
from gauss2svg.measure import metrics
from gauss2svg.raster import rasterize
from gauss2svg.render import render, render_rgba
from gauss2svg.scene import Scene
from gauss2svg.svg.write import outline_svg, write_svg

PROMISED_KEYS = {
    "width", "height", "gaussians", "iterations", "rounds", "fit_s", "total_s", "stop_reason",
    "svg_bytes", "svgz_bytes", "renderer", "psnr_model", "psnr_svg", "ssim_svg",
    "psnr_roundtrip", "bias_roundtrip", "versions", "seed",
}  # fmt: skip
QUICK = {"gaussians": 120, "iterations": 30}


@pytest.fixture(scope="module")
def result(photo):
    return vectorize(photo, seed=0, **QUICK)


def test_svg_matches_the_photo_and_the_model(result):
    assert result.report["psnr_svg"] > 22
    assert result.report["psnr_svg"] > result.report["psnr_model"] - 0.5
    assert result.report["psnr_roundtrip"] > 38
    assert abs(result.report["bias_roundtrip"]) < 0.5


def test_report_holds_what_it_promises_and_is_json(result):
    assert result.report.keys() >= PROMISED_KEYS
    assert json.loads(json.dumps(result.report, allow_nan=False)) == result.report


def test_report_measures_the_file_not_the_model(photo, result):
    raster = rasterize(result.svg, 128, 128)
    assert (result.raster == raster).all()
    assert result.report["psnr_svg"] == pytest.approx(metrics.psnr(raster, photo))
    assert result.report["svg_bytes"] == len(result.svg.encode())
    assert result.report["gaussians"] == len(result.scene)


def test_same_seed_gives_the_same_bytes_on_any_number_of_threads(photo, result):
    assert vectorize(photo, seed=0, threads=1, **QUICK).svg == result.svg
    assert vectorize(photo, seed=1, init="error", **QUICK).svg != result.svg


def test_every_option_reaches_the_fit(photo, result):
    for change in ({"loss": "l1"}, {"schedule": "linear"}, {"init": "random"}):
        assert vectorize(photo, **QUICK, **change).svg != result.svg
    assert vectorize(photo, threads=1, **QUICK).report["threads"] == 1


def test_threads_are_used_inside_and_given_back(photo):
    inside = []
    before = get_num_threads()
    vectorize(photo, threads=1, progress=lambda p: inside.append(get_num_threads()), **QUICK)
    assert inside[1:] == [1] * (len(inside) - 1)
    assert get_num_threads() == before


def test_sizes_and_ssim_are_those_of_the_written_file(photo, result):
    packed = gzip.compress(result.svg.encode(), 9, mtime=0)
    assert result.report["svgz_bytes"] == len(packed) < result.report["svg_bytes"]
    assert result.report["ssim_svg"] == metrics.ssim(result.raster, photo)


def test_exact_fit_has_a_report_that_json_knows():
    report = vectorize(np.zeros((8, 8, 3)), gaussians=0).report
    assert report["psnr_svg"] is None
    json.dumps(report, allow_nan=False)


@pytest.mark.process
def test_warming_up_compiles_all_that_a_run_needs():
    code = (
        "import numpy as np; from gauss2svg import FitOptions, vectorize; "
        "from gauss2svg.pipeline.run import compile_kernels; compile_kernels(); "
        "from gauss2svg.render.cpu import add_pairs, walk_tiles; "
        "from gauss2svg.render.tiles import _find_strip_rows, _list_pairs; "
        "vectorize(np.random.default_rng(0).random((20, 20, 3)), "
        "gaussians=9, fit=FitOptions(iterations=9)); "
        "kernels = add_pairs, walk_tiles, _find_strip_rows, _list_pairs; "
        "print(*(len(kernel.signatures) for kernel in kernels))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["1"] * 4


def test_saved_file_is_the_text(result, tmp_path):
    target = tmp_path / "out.svg"
    result.save(target)
    assert target.read_text() == result.svg
    assert list(tmp_path.iterdir()) == [target]


def test_unwritable_target_is_refused_and_nothing_is_left(result, tmp_path):
    with pytest.raises(OutputError, match="it is a folder"):
        result.save(tmp_path)
    with pytest.raises(OutputError, match="No such file"):
        result.save(tmp_path / "no" / "out.svg")
    assert not list(tmp_path.iterdir())


def test_result_shows_itself_without_leaking_ids_into_the_page(result):
    page = result._repr_html_()
    assert page.startswith("<img ")
    assert "id=" not in page
    assert "Gaussians" in repr(result)


def test_smaller_fit_keeps_the_photos_size(photo):
    result = vectorize(photo, max_size=50, **QUICK)
    assert (result.report["fit_width"], result.report["fit_height"]) == (50, 50)
    assert 'height="128"' in result.svg
    assert (result.scene.width, result.scene.height) == (128, 128)
    assert result.report["psnr_svg"] > 20


def test_phases_come_in_order_and_nothing_is_printed(photo, capfd):
    phases = []
    vectorize(photo, progress=lambda p: phases.append(p.phase), **QUICK)
    assert list(dict.fromkeys(phases)) == ["read", "compile", "fit", "write", "measure"]
    assert phases.count("fit") == QUICK["iterations"]
    assert capfd.readouterr() == ("", "")


def test_cairo_measures_too(photo):
    needs("cairo")
    report = vectorize(photo, renderer="cairo", **QUICK).report
    assert report["renderer"].startswith("CairoSVG")
    assert report["psnr_roundtrip"] > 38


def test_missing_renderer_is_reported_before_the_fit(photo, monkeypatch):
    from gauss2svg.raster import libraries

    def missing():
        raise RendererError("no cairo")

    monkeypatch.setattr(libraries, "cairo_version", missing)
    with pytest.raises(RendererError, match="no cairo"):
        vectorize(photo, renderer="cairo", progress=lambda p: pytest.fail(p.phase), **QUICK)


def test_palette_trades_bytes_for_accuracy(photo):
    few, many = (vectorize(photo, palette=n, **QUICK).report for n in (16, 0))
    assert few["svg_bytes"] < 0.6 * many["svg_bytes"]
    assert few["psnr_svg"] < many["psnr_svg"]


@pytest.mark.parametrize("shape", [(1, 1, 3), (2, 5, 3), (1, 200, 3)])
def test_tiny_pictures_have_no_ssim_but_everything_else(shape):
    pixels = np.random.default_rng(0).random(shape)
    report = vectorize(pixels, **QUICK).report
    assert report["ssim_svg"] is None
    assert math.isfinite(report["psnr_svg"])


def test_no_gaussians_give_the_mean_colour(photo):
    result = vectorize(photo, gaussians=0)
    assert "<circle" not in result.svg
    assert result.report["gaussians"] == 0


@pytest.mark.parametrize(
    "call", [quantize, write_svg, outline_svg, render, render_rgba, Scene(8, 6).concatenate]
)
def test_what_takes_a_scene_refuses_anything_else(call):
    for other in (None, "scene", np.zeros(3)):
        with pytest.raises(InputError, match="scene must be a Scene; got"):
            call(other)


def test_closed_file_is_refused(tmp_path):
    path = tmp_path / "photo.png"
    path.write_bytes(b"not read")
    with path.open("rb") as file, io.BytesIO() as stream:
        pass
    for closed in (file, stream):
        with pytest.raises(InputError, match="file object must be open; got a closed one"):
            vectorize(closed, **QUICK)


def test_file_object_is_read(photo):
    stream = io.BytesIO()
    Image.fromarray(np.round(photo * 255).astype(np.uint8)).save(stream, "JPEG", quality=95)
    stream.seek(0)
    assert vectorize(stream, **QUICK).report["psnr_svg"] > 22


def test_saved_scene_writes_the_same_file(result, tmp_path):
    result.scene.save(tmp_path / "scene.npz")
    again = type(result.scene).load(tmp_path / "scene.npz")
    text = write_svg(quantize(again, palette=result.report["palette"]))
    assert len(text.encode()) == result.report["svg_bytes"]
    assert text == result.svg
