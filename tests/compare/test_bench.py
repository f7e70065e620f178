"""The benchmark as a whole: its runs, tables and plots; few runs are real, for they are slow."""

import json
import math
import os
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from batches import PoolHere
from conftest import has_ended
from galleries import BLANK, cells_expected, cells_of, program, save
from PIL import Image

from gauss2svg.cli.main import main
from gauss2svg.compare import table
from gauss2svg.compare.peers import PEERS, convert_by
from gauss2svg.compare.records import finite
from gauss2svg.compare.run import in_own_process, measure_alone
from gauss2svg.compare.table import NAMES, plots_of, run_bench, summarise
from gauss2svg.errors import InputError
from gauss2svg.measure.scores import SCORES

pytestmark = pytest.mark.process

PROMISED = {
    "key", "tool", "image", "width", "height", "settings", "used", "gaussians", "rounds",
    "stop_reason", "psnr_model", "psnr_svg", "ssim_svg", "ssimulacra2_svg", "flip_svg",
    "psnr_roundtrip", "svg_bytes", "svgz_bytes", "fit_s", "fit_cpu_s", "total_s",
    "cpu_s", "warmup_s", "peak_bytes", "renderer", "threads", "machine", "versions", "date",
}  # fmt: skip

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture
def picture(photo, tmp_path):
    return save(photo[:48, :64], tmp_path / "photo.png")


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
            "psnr_svg": 20 + math.log2(1 + count), "ssim_svg": 0.5, "psnr_model": None,
            "ssimulacra2_svg": 9.0 - count, "flip_svg": 0.5 / count,
            "cpu_s": 0.01 * count, "total_s": 0.01 * count, "peak_bytes": 10**8,
            "svg_bytes": 200 * count, "svgz_bytes": 20 * count, "gaussians": count,
        }  # fmt: skip

    monkeypatch.setattr(table, "Pool", PoolHere)
    monkeypatch.setattr(table, "measure_alone", answer)
    return asked


def request_of(tool, picture, **settings):
    """A request for a run of a tool."""
    options = {"seed": 0, "threads": 1, "max_pixels": 10**6}
    about = {"tool": tool, "settings": settings, "source": str(picture)}
    return about | {"peer_timeout": 60, "options": options}


def counts(rows):
    return [row["settings"]["gaussians"] for row in rows]


def summary_in(folder):
    return json.loads((folder / "bench.json").read_text())["summary"]


@pytest.fixture(scope="module")
def measured(photo, tmp_path_factory):
    """One real benchmark: a run, one that fails, and raster images."""
    folder = tmp_path_factory.mktemp("bench")
    save(photo[:48, :64], folder / "photo.png")
    arguments = ["bench", str(folder / "photo.png"), "-o", str(folder / "out"), "--threads", "1"]
    arguments += ["--axis", "gaussians=10", "--axis", "iterations=3"]
    # No program is on this path, which is known only once the run has begun.
    arguments += ["--axis", "renderer=resvg,inkscape"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", str(folder))
        status = main([*arguments, "--peers", "jpeg,avif:10,avif:90", "--quiet"])
    return status, folder / "out", json.loads((folder / "out" / "bench.json").read_text())


def test_real_run_has_all_that_was_promised_and_a_failing_one_is_an_error_row(measured):
    status, folder, document = measured
    good, bad, *others = document["rows"]
    assert status == 1
    assert good.keys() >= PROMISED
    assert (good["gaussians"], good["used"]["init"], good["threads"]) == (10, "selective", 1)
    assert good["cpu_s"] >= good["fit_cpu_s"] > 0
    assert good["svg_bytes"] > good["svgz_bytes"] > 0
    assert "inkscape" in bad["error"]
    assert "\n" not in bad["error"]
    assert "psnr_svg" not in bad
    assert bad["error"] in (folder / "summary.md").read_text()
    assert all(row["psnr_model"] is None for row in others)
    assert cells_of(folder / "bench.csv") == cells_expected(document["rows"])


@pytest.mark.parametrize("tool", ["jpeg", "avif"])
def test_bytes_and_fidelity_of_images_rise_with_quality(measured, tool):
    if PEERS[tool].version() is None:
        pytest.skip("Pillow is built without it")
    rows = [row for row in measured[2]["rows"] if row["tool"] == tool]
    rows.sort(key=lambda row: row["settings"]["quality"])
    assert len(rows) == {"jpeg": 4, "avif": 2}[tool]
    for name in ("svg_bytes", "psnr_svg", "ssim_svg", "flip_svg"):
        values = [-row[name] if name == "flip_svg" else row[name] for row in rows]
        assert values == sorted(set(values)), name


def test_memory_of_a_run_is_its_own(picture, tmp_path):
    ours = np.ones(40_000_000)  # 320 MB, which the child must not be charged with
    row = in_own_process(convert_by, "jpeg", {"quality": 30}, picture, tmp_path / "output.jpg")
    assert ours.nbytes / 2 > row["peak_bytes"] > 5e6


def test_resuming_runs_only_what_is_missing(picture, tmp_path, requests, capsys):
    out, seen = tmp_path / "out", []
    first = run_bench([picture], out, axes={"gaussians": [5, 13]})
    rows = run_bench([picture], out, axes={"gaussians": [5, 13, 7]}, progress=seen.append)
    assert counts(requests) == [5, 13, 13, 7]
    assert counts(rows) == [5, 13, 7]
    assert rows[0] == first[0]
    assert (seen[0].kept, seen[-1].done, seen[-1].total) == (1, 3, 3)
    assert main(["bench", str(picture), "-o", str(out), "--axis", "gaussians=5,7"]) == 0
    assert len(requests) == 4
    assert "2 runs, 2 of them kept" in capsys.readouterr().err


def test_interrupted_benchmark_keeps_what_is_finished(picture, tmp_path, requests, monkeypatch):
    answer = table.measure_alone

    def interrupt(request):
        if request["settings"]["gaussians"] == 7:
            raise KeyboardInterrupt
        return answer(request)

    monkeypatch.setattr(table, "measure_alone", interrupt)
    assert main(["bench", str(picture), "-o", str(tmp_path), "--axis", "gaussians=5,7,9"]) == 130
    assert counts(json.loads((tmp_path / "bench.json").read_text())["rows"]) == [5]
    monkeypatch.setattr(table, "measure_alone", answer)
    requests.clear()
    run_bench([picture], tmp_path, axes={"gaussians": [5, 7, 9]})
    assert counts(requests) == [7, 9]


def test_what_a_run_depends_on_is_run_again_and_nothing_else_is(
    photo, picture, tmp_path, requests, monkeypatch
):
    monkeypatch.setenv("PATH", str(tmp_path))

    def tools(path, **options):
        requests.clear()
        run_bench([path], tmp_path / "out", axes={"gaussians": [5]}, peers=["jpeg:30"], **options)
        return [request["tool"] for request in requests]

    assert tools(picture) == ["gauss2svg", "jpeg"]
    moved = picture.rename(tmp_path / "moved.png")
    assert tools(moved) == []
    # Other tools are given neither seed nor threads.
    assert tools(moved, seed=1) == tools(moved, threads=1) == ["gauss2svg"]
    save(photo[:40, :64], moved)
    assert tools(moved) == ["gauss2svg", "jpeg"]
    for text in ("<svg/>", "<svg></svg>"):  # another source is another run
        (tmp_path / "moved.svg").write_text(text)
        assert tools(moved, references=tmp_path) == ["gauss2svg", "jpeg"]
        assert tools(moved, references=tmp_path) == []
    assert tools(moved, references=tmp_path, reference_scale=2) == ["gauss2svg", "jpeg"]
    assert [request["reference"][1] for request in requests] == [2, 2]
    (tmp_path / "moved.svg").unlink()
    with pytest.raises(InputError, match="references must be a folder with an SVG for each photo"):
        tools(moved, references=tmp_path)


def test_absent_peer_is_named_and_left_out(picture, tmp_path, requests, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    arguments = ["-o", str(tmp_path / "out"), "--axis", "gaussians=5", "--peers", "primitive,webp"]
    assert main(["bench", str(picture), *arguments]) == 0
    assert "skipped, not installed: primitive\n" in capsys.readouterr().err
    document = json.loads((tmp_path / "out" / "bench.json").read_text())
    assert document["peers_absent"] == ["primitive"]
    assert {row["tool"] for row in document["rows"]} == {"gauss2svg", "webp"}


@pytest.mark.posix
def test_peer_writes_an_svg_that_is_scored_or_fails_or_times_out(picture, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path), os.pathsep)

    def line(body, seconds=60):
        program(tmp_path / "primitive", body)
        request = request_of("primitive", picture, shapes=3) | {"peer_timeout": seconds}
        return in_own_process(measure_alone, request)["error"]

    assert "status 3: no luck" in line("echo no luck >&2; exit 3")
    assert line("exit 0") == "primitive wrote no file. Try running it by hand"
    for seconds in (2, 8, 32):  # more where the machine is too busy for it to begin
        begun = f"echo $$ > {tmp_path}/pid; exec sleep 600"
        assert f"timed out after {seconds} s" in line(begun, seconds)
        if (tmp_path / "pid").exists():
            break
    assert has_ended(int((tmp_path / "pid").read_text()))


def test_output_of_a_peer_is_not_part_of_its_row(picture, tmp_path, monkeypatch):
    module = (
        "def convert_image_to_svg_py(png, drawn):\n"
        "    print('chatter')\n"
        f"    open(drawn, 'w').write({BLANK!r})\n"
    )
    (tmp_path / "vtracer.py").write_text(module)
    monkeypatch.syspath_prepend(tmp_path)
    row = measure_alone(request_of("vtracer", picture, style="default"))
    with Image.open(picture) as white:
        error = np.mean((1 - np.asarray(white, np.float64) / 255) ** 2)
    assert row["psnr_svg"] == pytest.approx(-10 * math.log10(error), abs=1e-4)
    assert row["svg_bytes"] == len(BLANK)


def test_image_of_a_peer_that_is_exact_has_no_finite_psnr(tmp_path):
    picture = save(np.full((16, 16, 3), 128 / 255), tmp_path / "gray.png")
    row = finite(measure_alone(request_of("jpeg", picture, quality=90)))
    assert (row["psnr_svg"], row["ssim_svg"]) == (None, 1.0)
    assert json.loads(json.dumps(row, allow_nan=False)) == row


def test_summary_means_over_pictures_and_leaves_out_the_unfinished(photo, tmp_path, requests):
    paths = [save(photo[: 20 + at, :20], tmp_path / f"{at}.png") for at in range(2)]
    rows = run_bench(paths, tmp_path, axes={"gaussians": [5, 7, 13]})
    for row, seconds in zip(rows, (1.0, 3.0, 4.0, 6.0, 0, 0), strict=True):
        if "error" not in row:
            row["cpu_s"] = seconds
    five, seven = summarise(rows, 2)
    assert (five["images"], five["cpu_s"], seven["cpu_s"]) == (2, 2.0, 5.0)
    assert five["below_both_dB"] == seven["below_both_dB"] == 0
    rows[2]["cpu_s"] = rows[3]["cpu_s"] = 0.5
    five, seven = summarise(rows, 2)
    assert five["below_seconds_dB"] == pytest.approx(math.log2(8 / 6))
    assert five["below_both_dB"] == 0  # for it is smaller
    assert [row["settings"] for row in summarise(rows[:3], 2)] == [{"gaussians": 5}]
    rows[2]["psnr_svg"] = None  # of a picture that is exact
    assert [row["below_seconds_dB"] for row in summarise(rows, 2)] == [0, None]


def shown_in(path, count):
    """Tooltips, looks and texts of a plot."""
    root = ElementTree.fromstring(path.read_text())
    points = root.findall(f".//{SVG}g[@class]/{SVG}title/..")[:count]
    titles = [point.findtext(f"{SVG}title") for point in points]
    looks = [(p.get("class"), p.find(f"{SVG}g")[1].tag) for p in points]
    return titles, looks, {text.text for text in root.iter(f"{SVG}text")}


def test_plots_have_a_point_a_tooltip_and_a_mark_for_each_setting(picture, tmp_path, requests):
    run_bench([picture], tmp_path, axes={"quality": ["draft", "fast"]}, peers=["jpeg"])
    summary = summary_in(tmp_path)
    assert len(summary) == 6
    for axis, name in zip(np.repeat(SCORES, 2), NAMES, strict=True):
        titles, looks, texts = shown_in(tmp_path / name, 6)
        for row, title in zip(summary, titles, strict=True):
            assert title.startswith(f"{row['label']}: {axis.text(row[axis.key])}, ")
        assert len(set(looks)) == 3  # each preset, and all of a peer
        assert looks[2:] == looks[2:3] * 4
        assert {"draft", "fast", "jpeg"} <= texts
        assert "other settings" not in texts
    assert plots_of(summary) == {name: (tmp_path / name).read_text() for name in NAMES}
    assert plots_of([]) == {}
    # A line joins the front, of which an equal score at a higher price is no part.
    row = summary[0]
    rows = [{**row, "label": str(n), "cpu_s": n, "psnr_svg": 30 + n // 3} for n in range(1, 6)]
    (line,) = re.findall('<polyline[^>]*points="([^"]*)"', plots_of(rows)["psnr_seconds.svg"])
    assert line.count(",") == 2


@pytest.mark.parametrize(("count", "is_named"), [(8, True), (9, False)])
def test_other_settings_have_names_and_colours_of_their_own_while_there_are_few(
    count, is_named, picture, tmp_path, requests
):
    axes = {"gaussians": [5], "iterations": list(range(1, count + 1))}
    run_bench([picture], tmp_path, axes=axes, peers=["jpeg"])
    own = {row["label"] for row in summary_in(tmp_path) if row["tool"] != "jpeg"}
    assert len(own) == count
    _, looks, texts = shown_in(tmp_path / "psnr_bytes.svg", count)
    assert (own <= texts, "other settings" in texts) == (is_named, not is_named)
    assert len({colour for colour, _ in looks}) == (count if is_named else 1)


def test_score_that_was_not_measured_has_no_plot_and_no_plot_of_it_stays(
    picture, tmp_path, requests
):
    run_bench([picture], tmp_path, axes={"gaussians": [5]})
    assert {path.name for path in tmp_path.glob("*_*.svg")} == set(NAMES)
    rows = (tmp_path / "rows.jsonl").read_text()
    (tmp_path / "rows.jsonl").write_text(rows.replace('"flip_svg": 0.1', '"flip_svg": null'))
    run_bench([picture], tmp_path, axes={"gaussians": [5]})
    left = {name for name in NAMES if not name.startswith("flip")}
    assert {path.name for path in tmp_path.glob("*_*.svg")} == left


def test_score_of_an_enlargement_is_a_column_where_it_was_measured(picture, tmp_path):
    source = tmp_path / "source.svg"
    source.write_text('<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 3"/>')
    request = request_of("gauss2svg", picture, gaussians=2, iterations=1)
    assert measure_alone(request | {"reference": (source, 2.0)})["psnr_svg_enlarged"] > 0
    assert measure_alone(request)["psnr_svg_enlarged"] is None
