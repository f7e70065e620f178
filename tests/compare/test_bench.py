"""The benchmark as a whole: its runs, tables and plots; few runs are real, for they are slow."""

import json
import math
import os
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import has_ended
from galleries import BLANK, cells_expected, cells_of, program, save
from PIL import Image

from gauss2svg.cli.main import main
from gauss2svg.compare import table
from gauss2svg.compare.peers import check_peers, converted
from gauss2svg.compare.records import finite
from gauss2svg.compare.run import in_own_process, measured_alone
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
    found = []

    def answer(request):
        found.append(request)
        count = request["settings"].get("gaussians", 100)
        if count == 13:
            return {"error": "unlucky"}
        return {
            "psnr_svg": 20 + math.log2(1 + count), "ssim_svg": 0.5, "psnr_model": None,
            "ssimulacra2_svg": 9.0 - count, "flip_svg": 0.5 / count,
            "cpu_s": 0.01 * count, "total_s": 0.01 * count, "peak_bytes": 10**8,
            "svg_bytes": 200 * count, "svgz_bytes": 20 * count, "gaussians": count,
        }  # fmt: skip

    monkeypatch.setattr(table, "measured_alone", answer)
    return found


def request_of(tool, picture, **settings):
    """A request for a run of a tool."""
    request = {"tool": tool, "settings": settings, "source": str(picture), "peer_timeout": 60}
    return request | {"options": {"seed": 0, "threads": 1}}


def counts(rows):
    return [row["settings"]["gaussians"] for row in rows]


@pytest.fixture(scope="module")
def measured(photo, tmp_path_factory):
    """One real benchmark: a run, one that fails, and the JPEGs."""
    folder = tmp_path_factory.mktemp("bench")
    save(photo[:48, :64], folder / "photo.png")
    arguments = ["bench", str(folder / "photo.png"), "-o", str(folder / "out"), "--threads", "1"]
    arguments += ["--axis", "gaussians=10", "--axis", "iterations=3"]
    # No program is on this path, which is known only once the run has begun.
    arguments += ["--axis", "renderer=resvg,inkscape"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", str(folder))
        status = main([*arguments, "--peers", "jpeg", "--quiet"])
    return status, folder / "out", json.loads((folder / "out" / "bench.json").read_text())


def test_real_run_has_all_that_was_promised_and_a_failing_one_is_an_error_row(measured):
    status, folder, document = measured
    good, bad, *jpegs = document["rows"]
    assert status == 1
    assert good.keys() >= PROMISED
    assert (good["gaussians"], good["used"]["init"], good["threads"]) == (10, "selective", 1)
    assert good["cpu_s"] >= good["fit_cpu_s"] > 0
    assert good["svg_bytes"] > good["svgz_bytes"] > 0
    assert "inkscape" in bad["error"]
    assert "\n" not in bad["error"]
    assert "psnr_svg" not in bad
    assert bad["error"] in (folder / "summary.md").read_text()
    assert len(jpegs) == 4
    assert all(row["psnr_model"] is None for row in jpegs)


def test_jpeg_bytes_and_fidelity_fall_with_quality(measured):
    jpegs = [row for row in measured[2]["rows"] if row["tool"] == "jpeg"]
    jpegs.sort(key=lambda row: row["settings"]["quality"])
    for name in ("svg_bytes", "psnr_svg", "ssim_svg", "flip_svg"):
        values = [-row[name] if name == "flip_svg" else row[name] for row in jpegs]
        assert values == sorted(set(values)), name


def test_avif_is_written_read_back_and_scored(picture, tmp_path):
    installed, absent = check_peers(["avif"])
    if absent:
        pytest.skip("Pillow is built without AVIF")
    rows = run_bench([picture], tmp_path / "out", axes={"gaussians": [5]}, peers=installed)
    found = sorted((row for row in rows if row["tool"] == "avif"), key=lambda row: row["svg_bytes"])
    assert [row["settings"]["quality"] for row in found] == [10, 30, 60, 90]
    assert 20 < found[0]["psnr_svg"] < found[-1]["psnr_svg"] < 60


def test_memory_of_a_run_is_its_own(picture, tmp_path):
    ours = np.ones(40_000_000)  # 320 MB, which the child must not be charged with
    row = in_own_process(converted, "jpeg", {"quality": 30}, picture, tmp_path / "output.jpg")
    assert ours.nbytes / 2 > row["peak_bytes"] > 5e6


def test_csv_and_json_agree(measured):
    _, folder, document = measured
    assert cells_of(folder / "bench.csv") == cells_expected(document["rows"])


def test_resuming_runs_only_what_is_missing(picture, tmp_path, requests, capsys):
    out = tmp_path / "out"
    first = run_bench([picture], out, axes={"gaussians": [5, 13]})
    seen = []
    rows = run_bench([picture], out, axes={"gaussians": [5, 13, 7]}, progress=seen.append)
    assert counts([{"settings": request["settings"]} for request in requests]) == [5, 13, 13, 7]
    assert counts(rows) == [5, 13, 7]
    assert rows[0] == first[0]
    assert (seen[0].kept, seen[-1].done, seen[-1].total) == (1, 3, 3)
    assert main(["bench", str(picture), "-o", str(out), "--axis", "gaussians=5,7"]) == 0
    assert len(requests) == 4
    assert "2 runs, 2 of them kept" in capsys.readouterr().err


def test_interrupted_benchmark_keeps_what_is_finished(picture, tmp_path, requests, monkeypatch):
    answer = table.measured_alone

    def interrupt(request):
        if request["settings"]["gaussians"] == 7:
            raise KeyboardInterrupt
        return answer(request)

    monkeypatch.setattr(table, "measured_alone", interrupt)
    assert main(["bench", str(picture), "-o", str(tmp_path), "--axis", "gaussians=5,7,9"]) == 130
    assert counts(json.loads((tmp_path / "bench.json").read_text())["rows"]) == [5]
    monkeypatch.setattr(table, "measured_alone", answer)
    requests.clear()
    run_bench([picture], tmp_path, axes={"gaussians": [5, 7, 9]})
    assert len(requests) == 2


def test_changed_picture_is_run_again_and_a_moved_one_is_not(photo, picture, tmp_path, requests):
    run_bench([picture], tmp_path, axes={"gaussians": [5]})
    moved = picture.rename(tmp_path / "moved.png")
    rows = run_bench([moved], tmp_path, axes={"gaussians": [5]})
    assert len(requests) == 1
    assert rows[0]["image"] == "moved.png"
    save(photo[:40, :64], moved)
    run_bench([moved], tmp_path, axes={"gaussians": [5]})
    assert len(requests) == 2


def test_absent_peer_is_named_and_left_out(picture, tmp_path, requests, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    arguments = ["-o", str(tmp_path / "out"), "--axis", "gaussians=5", "--peers", "primitive,webp"]
    assert main(["bench", str(picture), *arguments]) == 0
    assert "skipped, not installed: primitive\n" in capsys.readouterr().err
    document = json.loads((tmp_path / "out" / "bench.json").read_text())
    assert document["peers_absent"] == ["primitive"]
    assert {row["tool"] for row in document["rows"]} == {"gauss2svg", "webp"}


def test_peer_writes_an_svg_that_is_scored_or_fails_or_times_out(picture, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path), os.pathsep)

    def record(seconds=60):
        return measured_alone(
            request_of("primitive", picture, shapes=3) | {"peer_timeout": seconds}
        )

    program(tmp_path / "primitive", f"echo '{BLANK}' > \"$4\"")
    row = record()
    with Image.open(picture) as white:
        error = np.mean((1 - np.asarray(white, np.float64) / 255) ** 2)
    assert row["psnr_svg"] == pytest.approx(-10 * math.log10(error), abs=1e-4)
    assert row["svg_bytes"] == len(BLANK) + 1

    program(tmp_path / "primitive", "echo no luck >&2; exit 3")
    assert "status 3: no luck" in record()["error"]
    program(tmp_path / "primitive", "exit 0")
    assert record() == {"error": "primitive wrote no file. Try running it by hand"}

    program(tmp_path / "primitive", f"echo $$ > {tmp_path}/pid; exec sleep 600")
    for seconds in (2, 8, 32):  # more where the machine is too busy for it to begin
        assert f"timed out after {seconds} s" in record(seconds)["error"]
        if (tmp_path / "pid").exists():
            break
    assert has_ended(int((tmp_path / "pid").read_text()))


def test_image_of_a_peer_that_is_exact_has_no_finite_psnr(tmp_path):
    picture = save(np.full((16, 16, 3), 128 / 255), tmp_path / "gray.png")
    row = measured_alone(request_of("jpeg", picture, quality=90))
    assert (row["psnr_svg"], row["ssim_svg"]) == (None, 1.0)
    assert json.loads(json.dumps(row, allow_nan=False)) == row


def test_output_of_a_peer_is_not_part_of_its_row(picture, tmp_path, monkeypatch):
    module = (
        "def convert_image_to_svg_py(png, drawn):\n"
        "    print('chatter')\n"
        f"    open(drawn, 'w').write({BLANK!r})\n"
    )
    (tmp_path / "vtracer.py").write_text(module)
    monkeypatch.syspath_prepend(tmp_path)
    assert measured_alone(request_of("vtracer", picture, style="default"))["svg_bytes"] == len(
        BLANK
    )


def test_summary_means_over_pictures_and_leaves_out_the_unfinished(photo, tmp_path, requests):
    paths = [tmp_path / "a.png", tmp_path / "b.png"]
    for size, path in enumerate(paths):
        save(photo[: 20 + size, :20], path)
    rows = run_bench(paths, tmp_path, axes={"gaussians": [5, 7, 13]})
    for row, seconds in zip(rows, (1.0, 3.0, 4.0, 6.0, 0, 0), strict=True):
        if "error" not in row:
            row["cpu_s"] = seconds
    five, seven = summarise(rows, 2)
    assert (five["images"], five["cpu_s"], seven["cpu_s"]) == (2, 2.0, 5.0)
    assert five["below_both_dB"] == seven["below_both_dB"] == 0
    seven["cpu_s"] = 1.0
    rows[2]["cpu_s"] = rows[3]["cpu_s"] = 0.5
    five, seven = summarise(rows, 2)
    assert five["below_seconds_dB"] == pytest.approx(math.log2(8 / 6))
    assert five["below_both_dB"] == 0  # for it is smaller
    assert [row["settings"] for row in summarise(rows[:3], 2)] == [{"gaussians": 5}]


def test_exact_results_have_no_finite_psnr_and_the_rest_continues(picture, tmp_path, requests):
    rows = run_bench([picture], tmp_path, axes={"gaussians": [5, 7]})
    rows[1]["psnr_svg"] = None
    summary = summarise(rows, 1)
    assert [row["below_seconds_dB"] for row in summary] == [0, None]
    json.dumps(finite([math.inf, {"a": (math.nan, 1.0)}]), allow_nan=False)
    assert plots_of(summary).keys() <= set(NAMES)
    assert plots_of([]) == {}


def test_plots_have_a_point_a_tooltip_and_a_mark_for_each_setting(picture, tmp_path, requests):
    axes = {"gaussians": [5, 7, 9], "quality": ["draft"]}
    run_bench([picture], tmp_path, axes=axes, peers=["jpeg"])
    run_bench([picture], tmp_path, axes={"quality": ["draft", "fast"]}, peers=["jpeg"])
    summary = json.loads((tmp_path / "bench.json").read_text())["summary"]
    assert len(summary) == 6
    for axis, name in zip(np.repeat(SCORES, 2), NAMES, strict=True):
        root = ElementTree.fromstring((tmp_path / name).read_text())
        points = root.findall(f".//{SVG}g[@class]/{SVG}title/..")
        titles = [point.findtext(f"{SVG}title") for point in points]
        for row, title in zip(summary, titles, strict=True):
            assert title.startswith(f"{row['label']}: {axis.text(row[axis.key])}, ")
        series = [(p.get("class"), p.find(f"{SVG}g")[1].tag) for p in points]
        assert len(set(series)) == 3  # each preset, and all of a peer
        assert series[2:] == series[2:3] * 4
        texts = [text.text for text in root.iter(f"{SVG}text")]
        assert {"draft", "fast", "jpeg"} <= set(texts)
        assert "other settings" not in texts
    assert plots_of(summary) == {name: (tmp_path / name).read_text() for name in NAMES}


def test_other_settings_have_names_and_colours_of_their_own_while_there_are_as_many(
    picture, tmp_path, requests
):
    for count, is_named in ((8, True), (9, False)):
        axes = {"gaussians": [5], "iterations": list(range(1, count + 1))}
        run_bench([picture], tmp_path, axes=axes, peers=["jpeg"])
        summary = json.loads((tmp_path / "bench.json").read_text())["summary"]
        own = [row["label"] for row in summary if row["preset"] is None and row["tool"] != "jpeg"]
        assert len(own) == count
        root = ElementTree.fromstring((tmp_path / "psnr_bytes.svg").read_text())
        texts = {text.text for text in root.iter(f"{SVG}text")}
        assert (set(own) <= texts, "other settings" in texts) == (is_named, not is_named)
        points = root.findall(f".//{SVG}g[@class]/{SVG}title/..")[:count]
        assert len({point.get("class") for point in points}) == (count if is_named else 1)


def test_score_that_was_not_measured_has_no_plot_and_no_plot_of_it_stays(
    picture, tmp_path, requests
):
    run_bench([picture], tmp_path, axes={"gaussians": [5]})
    summary = json.loads((tmp_path / "bench.json").read_text())["summary"]
    assert plots_of(summary).keys() == set(NAMES)
    unmeasured = [row | {"flip_svg": None} for row in summary]
    left = {name for name in NAMES if not name.startswith("flip")}
    assert plots_of(unmeasured).keys() == left
    rows = (tmp_path / "rows.jsonl").read_text()
    (tmp_path / "rows.jsonl").write_text(rows.replace('"flip_svg": 0.1', '"flip_svg": null'))
    run_bench([picture], tmp_path, axes={"gaussians": [5]})
    assert {path.name for path in tmp_path.glob("*_*.svg")} == left


def test_sources_of_the_photos_are_compared_with_enlarged(picture, tmp_path, requests):
    with pytest.raises(InputError, match="references must have an SVG for each photo; got no"):
        run_bench([picture], tmp_path / "out", axes={"gaussians": [5]}, references=tmp_path)
    source = tmp_path / f"{picture.stem}.svg"
    source.write_text("<svg/>")
    for text in ("<svg/>", "<svg/>", "<svg></svg>"):  # another source is another run
        source.write_text(text)
        run_bench([picture], tmp_path / "out", axes={"gaussians": [5]}, references=tmp_path)
    given = [(request["reference"], request["reference_scale"]) for request in requests]
    assert given == [(str(source), 4.0)] * 2


def test_score_of_an_enlargement_is_a_column_where_it_was_measured(photo, picture, tmp_path):
    source = tmp_path / "source.svg"
    source.write_text('<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 3"/>')
    request = request_of("gauss2svg", picture, gaussians=2, iterations=1)
    row = measured_alone(request | {"reference": str(source), "reference_scale": 2.0})
    assert row["psnr_svg_enlarged"] > 0
    assert measured_alone(request)["psnr_svg_enlarged"] is None
