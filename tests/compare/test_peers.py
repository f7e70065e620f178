"""Files and numbers of other methods, and what a batch has made, as they are in reports."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest
from batches import PoolHere, rows
from galleries import BLANK, save
from PIL import Image

from gauss2svg.cli.main import main
from gauss2svg.compare import pages, run, table
from gauss2svg.errors import Gauss2SvgError
from gauss2svg.measure.metrics import psnr
from gauss2svg.photo.load import load_image
from gauss2svg.svg.file import SVG, parse


@pytest.fixture(autouse=True)
def _here(monkeypatch, drawn_here, pool_here):
    """Runs are made in this process, without scores."""
    monkeypatch.setattr(table, "Pool", PoolHere)
    monkeypatch.setattr(pages, "Pool", PoolHere)


def reported(command, *words, status=0):
    """The rows of a report, by the name of a photo and of its variant."""
    assert main([command, "-o", command, "--quiet", *words]) == status
    with open(f"{command}/{command}.json", encoding="utf-8") as file:
        rows = json.load(file)["rows"]
    names = ("image", "label") if command == "bench" else ("photo", "variant")
    return {tuple(row[name] for name in names): row for row in rows}


@pytest.fixture
def two_photos(photo, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return [
        str(save(photo[at : at + 40, :48], tmp_path / f"{name}.png"))
        for at, name in ((0, "a"), (9, "b"))
    ]


@pytest.mark.parametrize("command", ["bench", pytest.param("gallery", marks=pytest.mark.sweep)])
def test_files_of_another_method_are_measured_and_again_if_they_change(
    command, two_photos, tmp_path
):
    for label in ("svgs", "pngs"):
        (tmp_path / label).mkdir()
    reduced = {}
    for name in "ab":
        (tmp_path / "svgs" / f"{name}.svg").write_text(BLANK)
        with Image.open(f"{name}.png") as image:
            image.quantize(4).save(f"pngs/{name}.png")
        reduced[name] = psnr(
            load_image(f"pngs/{name}.png").pixels, load_image(f"{name}.png").pixels
        )
    (tmp_path / "svgs" / "table.csv").write_text("photo,total_s\na.png,2.5\n")
    none = ["--axis", "iterations=1", "--axis", "gaussians=1"]
    rows = reported(command, *two_photos, "--peers", "svgs=svgs", "--peers", "pngs=pngs", *none)
    for name in "ab":
        blank, few = rows[f"{name}.png", "svgs"], rows[f"{name}.png", "pngs"]
        error = np.mean((1 - load_image(f"{name}.png").pixels.astype(np.float64)) ** 2)
        assert blank["psnr_svg"] == pytest.approx(-10 * np.log10(error), abs=1e-4)
        assert (blank["svg_bytes"], blank["total_s"]) == (len(BLANK), 2.5 if name == "a" else None)
        assert few["psnr_svg"] == pytest.approx(reduced[name], abs=1e-4)
        if command == "gallery":  # pages show a picture in an SVG, which they enlarge
            root = parse((tmp_path / command / few["files"]["SVG"]).read_text())
            assert (root.tag, root.get("viewBox")) == (f"{SVG}svg", "0 0 48 40")
            data = (tmp_path / "pngs" / f"{name}.png").read_bytes()
            assert root[0].get("href").endswith(base64.b64encode(data).decode())
    (tmp_path / "svgs" / "b.svg").write_text(BLANK.replace("/>", ' viewBox="0 0 1 1"/>'))
    again = reported(command, *two_photos, "--peers", "svgs=svgs,pngs=pngs", *none)
    changed = {key for key, row in again.items() if row["svg_bytes"] != rows[key]["svg_bytes"]}
    assert changed == {("b.png", "svgs")}


def test_published_numbers_are_rows_of_a_benchmark(two_photos, tmp_path, refusal):
    (tmp_path / "each.csv").write_text("photo,psnr_svg,svgz_bytes\na,30,900\nphotos/b.png,20,100\n")
    (tmp_path / "some.csv").write_text("photo,psnr_svg\nb,20\n,25\n")
    (tmp_path / "means.csv").write_text("psnr_svg\n25\n")
    for text, message in (
        ("photo,psnr\na.png,30\n", "must be a CSV with columns of a report, and the column photo"),
        ("photo;psnr_svg\na;31,5\n", "if there are several rows; got photo;psnr_svg. Try photo,"),
        ("method,psnr_svg\nA,30\nB,31\n", "if there are several rows; got method, psnr_svg."),
        ('psnr_svg\n"31,5"\n', "psnr_svg in line 2 of bad.csv must be a number with a point, or "),
    ):
        (tmp_path / "bad.csv").write_text(text)
        assert message in refusal("bench", *two_photos, "-o", "bad", "--peers", "bad=bad.csv")
    (tmp_path / "table.csv").write_text('photo,total_s\na,"31,5"\n')
    message = "total_s in line 2 of . must be a number with a point, or empty; got '31,5'"
    assert message in refusal("bench", *two_photos, "-o", "bad", "--peers", "bad=.")
    peers = "each=each.csv,means=means.csv,some=some.csv"
    axis = ["--axis", "iterations=1", "--axis", "gaussians=1"]
    rows = reported("bench", *two_photos, "--peers", peers, *axis, status=1)
    assert [rows["a.png", "each"][name] for name in ("psnr_svg", "svgz_bytes")] == [30, 900]
    assert rows["a.png", "means"]["svg_bytes"] is None
    summary = json.loads((tmp_path / "bench" / "bench.json").read_text())["summary"]
    means = {row["label"]: (row["psnr_svg"], row["images"]) for row in summary}
    assert (means["each"], means["means"], means["some"]) == ((25, 2), (25, 2), (20, 1))
    text = (tmp_path / "bench" / "summary.md").read_text()
    assert "| each | 25.00 |" in text
    assert "| some (1 of 2 photos) | 20.00 |" in text
    assert "- some on a.png: some must have a file or a row for each photo; got none" in text


@pytest.mark.usefixtures("hasty")
def test_a_batch_is_shown_and_measured_without_another_fit(two_photos, tmp_path, monkeypatch):
    two_photos[0] = str(Path(two_photos[0]).rename(tmp_path / "-a.png"))
    assert main(["batch", *two_photos, "-o", "out", "--quiet", "--gaussians", "9"]) == 0
    monkeypatch.setattr(run, "vectorize_by", None)
    made = {name.removeprefix("'"): row for name, row in rows(tmp_path / "out").items()}
    for command in ("gallery", "bench"):
        found = reported(command, "--from", "out")
        assert found.keys() == {("-a.png", "batch"), ("b.png", "batch")}
        for (photo, _), row in found.items():
            of_batch = made[photo.replace("png", "svg")]
            for name in ("psnr_svg", "gaussians", "svg_bytes", "svgz_bytes", "total_s", "cpu_s"):
                assert row[name] == pytest.approx(float(of_batch[name])), name


def test_a_photo_without_a_file_and_a_tool_that_takes_too_long_are_errors(two_photos):
    request = {"tool": "jpeg", "settings": {"quality": 30}, "source": two_photos[0]}
    request |= {"options": {"max_pixels": 10**6}, "peer_timeout": 1e-3}
    with pytest.raises(
        Gauss2SvgError, match=r"timed out after 0\.001 s. Try a longer --peer-timeout"
    ):
        run.measure_run(request)
    with pytest.raises(Gauss2SvgError, match="jpeg must have a file or a row for each photo"):
        run.measure_run(request | {"file": None, "numbers": {}})
