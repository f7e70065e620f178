"""The benchmark as a whole: its runs, tables and plots; few runs are real, for they are slow."""

import json
import math
import os
from xml.etree import ElementTree

import numpy as np
import pytest
from batches import PoolHere
from galleries import BLANK, cells_expected, cells_of, program, save
from PIL import Image

from gauss2svg.cli.main import main
from gauss2svg.compare import table
from gauss2svg.compare.peers import PEERS
from gauss2svg.compare.run import in_own_process, measure_alone
from gauss2svg.compare.table import NAMES, plots_of, run_bench, summarise
from gauss2svg.errors import InputError
from gauss2svg.measure import SCORES

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


def test_another_source_of_an_enlargement_is_another_run(picture, tmp_path, requests):
    def counted(**options):
        requests.clear()
        run_bench([picture], tmp_path / "out", axes={"gaussians": [5]}, **options)
        return len(requests)

    assert counted() == 1
    for text in ("<svg/>", "<svg></svg>"):
        (tmp_path / "photo.svg").write_text(text)
        assert counted(references=tmp_path) == 1
        assert counted(references=tmp_path) == 0
    assert counted(references=tmp_path, reference_scale=2) == 1
    assert [request["reference"][1] for request in requests] == [2]
    (tmp_path / "photo.svg").unlink()
    with pytest.raises(InputError, match="references must be a folder with an SVG for each photo"):
        counted(references=tmp_path)


@pytest.mark.posix
def test_peer_that_fails_is_an_error_with_its_complaint(picture, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path), os.pathsep)
    for body, seconds, line in (
        ("echo no luck >&2; exit 3", 60, "status 3: no luck"),
        ("exit 0", 60, "primitive wrote no file. Try running it by hand"),
        ("exec sleep 600", 0.5, "timed out after 0.5 s"),
    ):
        program(tmp_path / "primitive", body)
        request = request_of("primitive", picture, shapes=3) | {"peer_timeout": seconds}
        assert line in in_own_process(measure_alone, request)["error"]


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
