"""benchmarks/reproduce_paper.py: the page is complete, and its verdicts follow from the numbers."""

import dataclasses
import importlib
import json
import math
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image


@pytest.fixture(scope="module")
def claims():
    return importlib.import_module("paper.claims")


class Page(HTMLParser):
    """Tags with their attributes, and the tags still open at the end."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "img", "source"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def all(self, tag: str) -> list[dict]:
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture(scope="module")
def context() -> dict:
    """The context that the template of the quick page was rendered with."""
    return {}


@pytest.fixture(scope="module")
def quick(tmp_path_factory, context) -> Path:
    """The folder of the quick page, made by the command itself."""
    pytest.importorskip("matplotlib")
    folder = tmp_path_factory.mktemp("paper")
    command = importlib.import_module("reproduce_paper")
    report = importlib.import_module("paper.report")
    render = report._page
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report, "_page", lambda **given: render(**(context.update(given) or given)))
        patch.setattr(sys, "argv", ["reproduce_paper.py", str(folder), "--quick"])
        command.main()
    return folder


@pytest.fixture(scope="module")
def page(quick) -> Page:
    return Page((quick / "index.html").read_text(encoding="utf-8"))


SECTIONS = ["rounds", "iterations", "schedules", "windows", "losses", "files", "claims"]
CLAIMS = ["a", "b", "c", "c, LIVE", "d", "e", "f"]


@pytest.mark.nightly
def test_page_is_well_formed_and_has_every_section(page):
    assert page.open == []
    assert [section["id"] for section in page.all("section")] == SECTIONS
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(set(ids)) == len(ids)


@pytest.mark.nightly
def test_every_image_exists_has_its_size_and_an_alternative_text(page, quick):
    images = page.all("img")
    assert len(images) > 25
    for image in images:
        assert image["alt"].strip()
        path = quick / image["src"]
        if path.suffix == ".png":
            with Image.open(path) as opened:
                assert opened.size == (int(image["width"]), int(image["height"]))
        else:
            assert path.read_text().startswith("<?xml")
    files = {path.name for path in quick.iterdir()}
    shown = {image["src"] for image in images} | {s["srcset"] for s in page.all("source")}
    assert shown == files - {"index.html", "numbers.json"}


@pytest.mark.nightly
def test_page_needs_nothing_from_elsewhere_and_no_script(page, quick):
    assert not page.all("script")
    assert not page.all("link")
    text = (quick / "index.html").read_text(encoding="utf-8")
    assert "url(" not in text
    assert "@import" not in text
    local = {"numbers.json", *(f"#{name}" for name in SECTIONS)}
    (paper,) = {a["href"] for a in page.all("a")} - local
    assert paper.startswith("https://infoscience.epfl.ch/")
    assert all("/" not in image["src"] for image in page.all("img"))


@pytest.mark.nightly
def test_page_has_one_verdict_for_each_claim(page, quick, claims):
    shown = [item for item in page.all("li") if "data-claim" in item]
    assert [item["data-claim"] for item in shown] == CLAIMS
    verdicts = json.loads((quick / "numbers.json").read_text())["verdicts"]
    assert [verdict["key"] for verdict in verdicts] == CLAIMS
    for item, verdict in zip(shown, verdicts, strict=True):
        assert verdict["word"] in claims.WORDS
        assert item["class"] == verdict["word"].replace(" ", "-")
    assert [v["word"] for v in verdicts if v["key"] == "c, LIVE"] == [claims.UNTESTED]


@pytest.mark.nightly
def test_the_same_settings_give_the_same_bytes(quick, tmp_path):
    sections = importlib.import_module("paper.model_sections")
    book = importlib.import_module("paper.book").Book.begin(
        importlib.import_module("paper.settings").QUICK, tmp_path
    )
    sections.progressive(book)
    sections.cropped_windows(book)
    made = sorted(tmp_path.iterdir())
    assert len(made) > 15
    for path in made:
        assert path.read_bytes() == (quick / path.name).read_bytes(), path.name
    written = json.loads((quick / "numbers.json").read_text())
    assert json.loads(json.dumps(book.numbers)) == {name: written[name] for name in book.numbers}


@pytest.mark.nightly
def test_page_without_the_tracer_states_that(monkeypatch, quick, context, tmp_path):
    report = importlib.import_module("paper.report")
    sections = importlib.import_module("paper.svg_sections")
    settings = importlib.import_module("paper.settings").QUICK
    book = importlib.import_module("paper.book").Book.begin(settings, tmp_path)
    monkeypatch.setattr(sections.table, "peer_version", lambda: None)
    error, edges = sections.svg_files(book)
    assert book.page["polygons_table"] is None
    assert all(pairs == [] for pairs in [*error.values(), *edges.values()])
    assert "vtracer is not installed" in report._page(**context | book.page)
    unmatched = report._page(**context | book.page | {"tracer_is_there": True})
    assert "vtracer is not installed" not in unmatched
    assert "nothing to compare" in unmatched


def test_fewer_gaussians_both_ways(claims):
    clear = {"paper": [1.0, 1.2, 0.9], "product": [0.5, 0.6, 0.4]}
    needed = {"paper": 200.0, "product": math.inf}
    verdict = claims.fewer_gaussians(clear, needed, 127, 508)
    assert verdict.word == claims.HOLDS
    assert "needs 200 instead of 127" in verdict.numbers
    assert "more than 508" in verdict.numbers
    worse = {way: [-gain for gain in gains] for way, gains in clear.items()}
    assert claims.fewer_gaussians(worse, needed, 127, 508).word == claims.NOT
    assert "needs" not in claims.fewer_gaussians(worse, needed, 127, 508).numbers
    lost_in_spread = {"paper": clear["paper"], "product": [0.5, -0.6, 0.3]}
    assert claims.fewer_gaussians(lost_in_spread, needed, 127, 508).word == claims.IN_PART


def test_trade_off_both_ways(claims):
    rising = [(64, 20.0), (128, 22.0), (256, 25.0)]
    falling = [(count, -psnr) for count, psnr in rising]
    assert claims.trade_off({"one": rising, "two": rising}).word == claims.HOLDS
    assert claims.trade_off({"one": rising, "two": falling}).word == claims.IN_PART
    assert claims.trade_off({"one": falling}).word == claims.NOT
    assert (
        "from 64 to 256 it rises from 20.00 to 25.00 dB" in claims.trade_off({"a": rising}).numbers
    )


def test_faster_than_shapes_both_ways(claims):
    ahead, behind = [1.0, 1.1, 0.9], [-1.0, -1.1, -0.9]
    assert claims.faster_than_shapes(ahead, ahead).word == claims.HOLDS
    assert claims.faster_than_shapes(ahead, behind).word == claims.IN_PART
    assert claims.faster_than_shapes(behind, behind).word == claims.NOT
    assert claims.faster_than_shapes([1.0, -0.9, 0.2], behind).word == claims.NOT


def test_smoother_than_shapes_both_ways(claims):
    better, worse = [(1.0, 2.0), (2.0, 2.5), (1.0, 1.7)], [(2.0, 1.0)] * 3
    verdict = claims.smoother_than_shapes
    assert verdict({"x": better}, {"x": better}).word == claims.HOLDS
    assert verdict({"x": better}, {"x": worse}).word == claims.IN_PART
    assert verdict({"x": worse, "y": worse}, {"x": worse, "y": worse}).word == claims.NOT
    lost_in_spread = [(1.0, 2.0), (2.0, 1.1), (1.0, 1.1)]
    assert verdict({"x": lost_in_spread}, {"x": better}).word == claims.IN_PART
    assert verdict({"x": better, "y": []}, {"x": better, "y": []}).word == claims.HOLDS
    assert verdict({"x": []}, {"x": []}).word == claims.UNTESTED


def test_too_few_pairs_test_nothing(claims):
    assert claims.fewer_gaussians({"a": [0.5, 0.6]}, {"a": 200}, 127, 508).word == claims.UNTESTED
    assert claims.faster_than_shapes([1.0], [1.0]).word == claims.UNTESTED
    assert claims.smoother_than_shapes({"x": [(1, 2)]}, {"x": [(1, 2)]}).word == claims.UNTESTED
    assert claims.trade_off({"x": [(64, 20.0)]}).word == claims.UNTESTED


def test_crop_cured_both_ways(claims):
    assert claims.crop_cured(60.0, 0.5, 25.0, 60.0).word == claims.HOLDS
    assert claims.crop_cured(60.0, 9.0, 25.0, 45.0).word == claims.IN_PART
    assert claims.crop_cured(60.0, 70.0, 25.0, 45.0).word == claims.NOT
    assert claims.crop_cured(60.0, 9.0, 45.0, 25.0).word == claims.NOT
    assert claims.crop_cured(0.2, 0.1, 60.0, 70.0).word == claims.NOT  # there was no crop


def test_losses_differ_both_ways(claims):
    verdict = claims.losses_differ
    traded = verdict({"mse": (30.0, 0.80), "mse+ssim": (28.0, 0.85), "l1": (29.0, 0.79)})
    assert traded.word == claims.HOLDS
    assert "mse+ssim loses 2.00 dB to mse, which loses 0.0500 SSIM" in traded.numbers
    assert verdict({"mse": (30.0, 0.9), "l1": (28.0, 0.8)}).word == claims.IN_PART
    assert verdict({"mse": (30.0, 0.80), "mse+ssim": (29.97, 0.90)}).word == claims.IN_PART
    assert verdict({"mse": (30.0, 0.9), "l1": (30.0, 0.9)}).word == claims.NOT


def test_count_for_a_psnr_is_interpolated_on_the_line():
    count_for = importlib.import_module("paper.schedules").count_for
    line = [(100, 20.0), (200, 22.0), (400, 26.0)]
    assert count_for(19.0, line) == 100
    assert count_for(21.0, line) == pytest.approx(100 * math.sqrt(2))
    assert count_for(26.0, line) == pytest.approx(400)
    assert count_for(26.1, line) == math.inf


def test_smoothness_sees_false_edges_and_errors_only_where_the_photo_is_smooth():
    photos = importlib.import_module("paper.photos")
    ramp = np.repeat(np.linspace(0.2, 0.6, 60)[None, :, None], 30, axis=0).repeat(3, axis=2)
    bands = np.round(ramp * 10) / 10
    assert photos.smoothness(ramp, ramp) == photos.Smoothness(1.0, 0.0, 0.0)
    banded = photos.smoothness(bands, ramp)
    assert banded.edges == pytest.approx(2 * 4 / 60)  # both sides of four steps
    assert banded.error == pytest.approx(255 * 0.1 / math.sqrt(12), rel=0.05)
    stepped = ramp.copy()
    stepped[:, 30:] += 0.3
    away = photos.smoothness(
        np.where(np.abs(np.arange(60) - 29.5)[:, None] < 3, 0, stepped), stepped
    )
    assert away.error == 0
    assert 0 < away.area < 1
    noise = np.random.default_rng(0).random((30, 30, 3))
    assert math.isnan(photos.smoothness(noise, noise).error)


def test_photos_are_reduced_to_their_side_on_8_bits():
    photo = importlib.import_module("paper.photos").photo
    for name, size in (("astronaut", (64, 64)), ("cat", (43, 64)), ("coffee", (43, 64))):
        pixels = photo(name, 64)
        assert pixels.shape == (*size, 3)
        levels = np.round(pixels * 255).astype(np.uint8)
        np.testing.assert_array_equal(pixels, levels / np.float32(255))


@pytest.mark.nightly
def test_ellipses_as_soft_as_gaussians_are_fitted_as_these_are(monkeypatch):
    shapes = importlib.import_module("paper.shapes")
    pixels = importlib.import_module("paper.photos").photo("coffee", 48)
    kinds = (shapes.GAUSSIANS, shapes.ELLIPSES)
    crisp = [shapes.crisp_fit("coffee", pixels, kind, 10, 5, 0, 1.0) for kind in kinds]
    assert abs(crisp[0].psnr[0] - crisp[1].psnr[0]) > 0.01
    monkeypatch.setattr(shapes, "_LEAST_BETA", 1.0)
    monkeypatch.setattr(shapes, "_MOST_BETA", 1.0)
    soft = [shapes.crisp_fit("coffee", pixels, kind, 10, 5, 0, 1.0) for kind in kinds]
    assert soft[1].psnr == pytest.approx(soft[0].psnr, abs=0.01)


@pytest.mark.nightly
def test_every_fit_of_shapes_gets_better():
    shapes = importlib.import_module("paper.shapes")
    pixels = importlib.import_module("paper.photos").photo("coffee", 48)
    for kind in (shapes.GAUSSIANS, shapes.ELLIPSES):
        fits = [shapes.crisp_fit("coffee", pixels, kind, 10, 25, 0, 1.0) for _ in range(2)]
        assert fits[0].psnr == fits[1].psnr
        assert fits[0].psnr[-1] > fits[0].psnr[0] + 1
        assert fits[0].seconds == sorted(fits[0].seconds)
        assert len(fits[0].psnr) == len(fits[0].seconds) == 26
        shorter = shapes.crisp_fit("coffee", pixels, kind, 10, 12, 0, 1.0)
        assert shorter.psnr[-1] == pytest.approx(fits[0].psnr[12], abs=1e-3)  # the same moment


def shape_fit(kind: str, psnr: list[float], seconds: list[float]):
    shapes = importlib.import_module("paper.shapes")
    return shapes.ShapeFit("cat", kind, 0, 1.0, psnr, seconds, np.zeros((1, 1, 3)), None)


def test_shapes_are_compared_at_the_end_and_when_the_faster_one_is_done():
    shapes = importlib.import_module("paper.shapes")
    own = shape_fit(shapes.GAUSSIANS, [10.0, 20.0, 25.0], [0.0, 2.0, 4.0])
    other = shape_fit(shapes.ELLIPSES, [9.0, 18.0, 21.0], [0.0, 1.0, 2.0])
    assert shapes.pairs([own, other]) == [shapes.Pair("cat", 0, 4.0, -1.0)]
    assert shapes.iterations_to(own, 21.0) == 2
    assert shapes.iterations_to(other, 25.0) == math.inf


def file_row(photo: str, kind: str, svg_bytes: int, error: float = 1.0):
    return importlib.import_module("paper.table").Row(
        photo, kind, 10, 30.0, 0.9, 1.0, error, 0.1, svg_bytes, svg_bytes / 4, 0.1
    )


def test_polygons_are_compared_with_the_largest_file_of_no_more_bytes():
    table = importlib.import_module("paper.table")
    own = [file_row("cat", table.BEST.name, size) for size in (100, 200, 300)]
    own += [file_row("cat", "another", 240), file_row("dog", table.BEST.name, 220)]
    assert table.at_most_as_large(own, file_row("cat", "p", 250)) is own[1]
    assert table.at_most_as_large(own, file_row("cat", "p", 300)) is own[2]
    assert table.at_most_as_large(own, file_row("cat", "p", 99)) is None


def test_a_setting_counts_only_where_every_photo_has_a_file_beside_it():
    table = importlib.import_module("paper.table")
    own = [file_row("cat", table.BEST.name, 100, 2.0), file_row("dog", table.BEST.name, 200, 4.0)]
    peers = [file_row(photo, kind, size, error) for photo, kind, size, error in (
        ("cat", "few", 150, 5.0), ("dog", "few", 150, 5.0), ("cat", "more", 250, 6.0),
        ("dog", "more", 250, 7.0), ("cat", "most", 300, 8.0), ("dog", "most", 300, 9.0),
    )]  # fmt: skip
    found = table.matched(own, peers)
    assert [row for row, _ in found] == peers[2:]
    assert table.by_photo(found, lambda row: row.error) == [(2.0, 7.0), (4.0, 8.0)]


def test_files_are_larger_from_the_count_after_the_last_that_fits():
    larger_from = importlib.import_module("paper.table").larger_from
    rows = [dataclasses.replace(file_row("m", "k", b), count=c)
            for c, b in ((8, 90), (16, 210), (32, 180), (64, 400))]  # fmt: skip
    assert larger_from(rows, "svg_bytes", 200) == 64
    assert larger_from(rows, "svg_bytes", 50) == 8
    assert larger_from(rows, "svgz_bytes", 200) is None


def test_jumps_at_edges_are_those_within_the_canvas():
    windows = importlib.import_module("paper.kernel_window")
    scene = windows.bell(40, 10.0)  # sigma 4, at 20, 20
    value = math.exp(-((5 / 4) ** 2) / 2)
    assert windows.edges_inside(scene, np.array([5.0])) == pytest.approx([value])
    assert windows.edges_inside(scene, np.array([21.0])) == [0]
    corner = scene.replace(mean=np.array([[-3.0, 20.0]]))  # the right edge alone is inside at 2
    at_the_corner = math.exp(-(3**2 + 5**2) / 32)  # of the edges above and below
    assert windows.edges_inside(corner, np.array([5.0])) == pytest.approx(
        [max(value, at_the_corner)]
    )
    away = scene.replace(mean=np.array([[-9.0, 20.0]]))
    assert windows.edges_inside(away, np.array([5.0])) == [0]


def test_the_square_is_where_images_differ_most():
    square = importlib.import_module("paper.losses").most_different_square
    images = [np.zeros((40, 60, 3)), np.zeros((40, 60, 3))]
    images[1][22:30, 41:49] = 1
    rows, columns = square(images)
    assert (rows.stop - rows.start, columns.stop - columns.start) == (10, 10)
    assert rows.start <= 22 < 30 <= rows.stop
    assert columns.start <= 41 < 49 <= columns.stop


@pytest.mark.example
@pytest.mark.parametrize("there", ["file", "folder", "package"])
def test_foreign_files_and_missing_packages_are_refused_in_one_line(
    there, monkeypatch, capsys, tmp_path
):
    command = importlib.import_module("reproduce_paper")
    out = tmp_path / "out"
    if there == "file":
        out.write_text("mine")
    elif there == "folder":
        out.mkdir()
        (out / "photo.png").write_text("mine")
    else:
        monkeypatch.delitem(sys.modules, "paper.report", raising=False)
        monkeypatch.setitem(sys.modules, "jinja2", None)
    monkeypatch.setattr(sys, "argv", ["reproduce_paper.py", str(out), "--quick"])
    with pytest.raises(SystemExit) as ended:
        command.main()
    output = capsys.readouterr()
    assert ended.value.code == 2
    assert output.out == ""
    assert output.err.count("\n") == 1
    assert (".[dev]" if there == "package" else str(out)) in output.err
    assert [path.name for path in tmp_path.rglob("photo.png")] == ["photo.png"] * (
        there == "folder"
    )


@pytest.mark.nightly
def test_an_earlier_page_is_recognised_by_its_list_of_files(quick, tmp_path):
    report = importlib.import_module("paper.report")
    assert set(report._older_page(quick)) == {path.name for path in quick.iterdir()}
    assert report._older_page(tmp_path / "none") == []
