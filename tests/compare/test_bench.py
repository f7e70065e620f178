"""The benchmark as a whole: its runs, tables and plots; few runs are real, for they are slow."""

import json
import math

import pytest
from batches import PoolHere
from galleries import cells_expected, cells_of, save

from gauss2svg.cli.main import main
from gauss2svg.compare import table
from gauss2svg.compare.records import COUNTS
from gauss2svg.compare.table import run_bench, summarise
from gauss2svg.errors import InputError


@pytest.fixture
def requests(monkeypatch):
    """The requests of a benchmark, answered without a process."""
    asked = []

    def answer(request):
        asked.append(request)
        count = request["settings"].get("gaussians", 100)
        if count == 13:
            raise InputError("unlucky")
        return {
            "psnr_svg": None if count == 99 else 20 + math.log2(1 + count), "renderer": "resvg",
            "ssim_svg": 0.5, "psnr_model": None,
            "ssimulacra2_svg": 9.0 - count, "flip_svg": 0.5 / count,
            "cpu_s": 0.01 * count, "total_s": 0.01 * count, "peak_bytes": 10**8,
            "svg_bytes": 200 * count, "svgz_bytes": 20 * count, "gaussians": count,
            "area_count": 3 * count, "line_count": count // 2, "node_count": 9 * count,
        }  # fmt: skip

    monkeypatch.setattr(table, "Pool", PoolHere)
    monkeypatch.setattr(table, "measure_run", answer)
    return asked


@pytest.mark.process
def test_real_run_has_all_that_was_promised_and_a_failing_one_is_an_error_row(
    picture, tmp_path, monkeypatch
):
    """A run, one that fails, and a raster image."""
    folder = tmp_path / "out"
    words = ["bench", str(picture), "-o", str(folder), "--threads", "1", "--peers", "jpeg:30"]
    words += ["--axis", "gaussians=10", "--axis", "iterations=3"]
    # No program is on this path, which is known only once the run has begun.
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main([*words, "--axis", "renderer=resvg,inkscape", "--quiet"]) == 1
    document = json.loads((folder / "bench.json").read_text())
    good, bad, *others = document["rows"]
    assert good.keys() >= {"key", "machine", "versions", "date", "peak_bytes", "flip_svg", *COUNTS}
    assert (good["gaussians"], good["used"]["init"], good["threads"]) == (10, "selective", 1)
    assert good["cpu_s"] >= good["fit_cpu_s"] > 0
    assert good["svg_bytes"] > good["svgz_bytes"] > 0
    assert "inkscape" in bad["error"]
    assert "\n" not in bad["error"]
    assert "psnr_svg" not in bad
    assert bad["error"] in (folder / "summary.md").read_text()
    assert all(row["psnr_model"] is None for row in others)
    assert cells_of(folder / "bench.csv") == cells_expected(document["rows"])


@pytest.mark.process
def test_resuming_runs_only_what_is_missing(picture, tmp_path, requests, capsys):
    out = tmp_path / "out"
    first = run_bench([picture], out, axes={"gaussians": [5, 13]})
    rows = run_bench([picture], out, axes={"gaussians": [5, 13, 7]})
    assert [request["settings"]["gaussians"] for request in requests] == [5, 13, 13, 7]
    assert rows[0] == first[0]
    assert main(["bench", str(picture), "-o", str(out), "--axis", "gaussians=5,7"]) == 0
    assert "2 done, 0 failed" in capsys.readouterr().err


@pytest.mark.process
def test_summary_means_over_pictures_and_leaves_out_the_unfinished(photo, tmp_path, requests):
    paths = [save(photo[: 20 + at, :20], tmp_path / f"{at}.png") for at in range(2)]
    rows = run_bench(paths, tmp_path, axes={"gaussians": [5, 7, 13]})
    for row, seconds in zip(rows, (1.0, 3.0, 4.0, 6.0, 0, 0), strict=True):
        if "error" not in row:
            row["cpu_s"] = row["peak_bytes"] = seconds
    exact = tmp_path / "exact"
    exact.mkdir()
    (exact / "psnr_bytes.svg").touch()  # of an earlier benchmark
    run_bench(paths, exact, axes={"gaussians": [99]})
    assert "| gaussians 99 | inf |" in (exact / "summary.md").read_text()
    assert cells_of(exact / "bench.csv")[0]["psnr_svg"] == "inf"
    plots = {path.name for path in exact.glob("*_bytes.svg")}
    assert "psnr_bytes.svg" not in plots
    assert "ssim_bytes.svg" in plots
    five, seven = summarise(rows, 2)
    assert (five["images"], five["cpu_s"], seven["cpu_s"]) == (2, 2.0, 5.0)
    assert (five["peak_bytes"], seven["peak_bytes"]) == (3.0, 6.0)
    assert [five[key] for key in COUNTS] == [15, 2, 45, 5]
    assert "| 15.0 | 2.0 | 45.0 | 5.0 |" in (tmp_path / "summary.md").read_text()
    assert five["below_both_dB"] == seven["below_both_dB"] == 0
    rows[2]["cpu_s"] = rows[3]["cpu_s"] = 0.5
    five, seven = summarise(rows, 2)
    assert five["below_seconds_dB"] == pytest.approx(math.log2(8 / 6))
    assert five["below_both_dB"] == 0  # for it is smaller
    assert [row["settings"] for row in summarise(rows[:3], 2)] == [{"gaussians": 5}]


def test_a_picture_that_a_setting_draws_exactly_is_named_and_counts_in_no_mean_of_psnr(
    photo, tmp_path, requests, monkeypatch
):
    paths = [save(photo[: 20 + at, :20], tmp_path / f"{at}.png") for at in range(3)]
    rows = run_bench(paths, tmp_path / "own", axes={"gaussians": [5, 7]})
    five, seven = [row["psnr_svg"] for row in summarise(rows, 3)]
    rows[3]["psnr_svg"] = None  # it is exact, and the others have their PSNR
    rows[0]["psnr_svg"] = 99
    means = summarise(rows, 3)
    assert [row["psnr_svg"] for row in means] == pytest.approx([five, seven])
    assert [row["below_both_dB"] for row in means] == [0, 0]
    assert [row["images"] for row in means] == [3, 3]
    for row in rows[4:]:  # of all pictures
        row["psnr_svg"] = None
    assert [row["below_both_dB"] for row in summarise(rows, 3)] == [0, None]
    answer = table.measure_run
    requests.clear()

    def exact_once(request):
        return answer(request) | ({"psnr_svg": None} if len(requests) == 1 else {})

    monkeypatch.setattr(table, "measure_run", exact_once)
    run_bench(paths[:2], tmp_path / "out", axes={"gaussians": [7]})
    text = (tmp_path / "out" / "summary.md").read_text()
    assert "PSNR leaves out 1 that a setting draws exactly: 0.png." in text
    assert "| **gaussians 7** | 23.00 |" in text
