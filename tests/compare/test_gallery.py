"""A real gallery: its files and pages, and that all its numbers are those of the reports."""

import dataclasses
import json
import statistics
import sys
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest
from batches import PoolHere
from flat import build_gallery
from galleries import Page, Table, cells_expected, cells_of, save
from names import possible
from PIL import Image, PngImagePlugin

from gauss2svg.cli.main import main
from gauss2svg.compare import chart, run
from gauss2svg.compare.pages import build
from gauss2svg.compare.pages.build import NUMBERS
from gauss2svg.errors import on_one_line
from gauss2svg.measure.scores import SCORES
from gauss2svg.photo.alpha import pixels_of
from gauss2svg.photo.load import load_image
from gauss2svg.pipeline.listing import slug_of

pytestmark = pytest.mark.process

NASTY = possible("<script>alert(1)<img src=x onerror=alert(2)>&amp;\"'{{7*7}}{%if%}\u202e.png")
UNDECODABLE = "\udcff.png"
SECRET = "Ada of Nowhere"


def with_metadata():
    """EXIF with a place, texts and XMP, as options of a PNG."""
    exif = Image.Exif()
    exif[0x010E] = exif[0x013B] = SECRET  # ImageDescription, Artist
    exif.get_ifd(0x8825)[1] = SECRET  # GPSLatitudeRef
    texts = PngImagePlugin.PngInfo()
    texts.add_text("Comment", SECRET)
    texts.add_itxt("XML:com.adobe.xmp", f"<x>{SECRET}</x>")
    return {"exif": exif, "pnginfo": texts}


@pytest.fixture(scope="module")
def site(photo, tmp_path_factory):
    """One real gallery, by two workers: good photos, odd ones and bad ones."""
    root = tmp_path_factory.mktemp("gallery")
    part = photo[:40, :48]
    rng = np.random.default_rng(0)
    alpha = rng.random((40, 48, 1)) * (rng.random((40, 48, 1)) < 0.7)
    good = {
        "nasty": save(part, root / "photos" / NASTY, **with_metadata()),
        "clear": save(np.dstack([part, alpha]), root / "photos" / "clear.png"),
        "flat": save(np.full((9, 100, 3), 0.4), root / "photos" / "flat.png"),
        "odd": save(photo[:10, :10], root / "photos" / UNDECODABLE),
    }
    bad = {
        "none.png": "No such file",
        "broken.png": "broken",
        "large.png": "pixels",
    }
    data = good["clear"].read_bytes()
    (root / "photos" / "broken.png").write_bytes(data[: len(data) // 2])
    save(photo, root / "photos" / "large.png")
    paths = [*map(str, good.values()), *(f"{root}/photos/{name}" for name in bad)]
    out = root / "out"
    arguments = ["gallery", *paths, "-o", str(out), "--counts", "20,40", "--jobs", "2"]
    arguments += ["--seed", "3", "--max-pixels", "4000", "--title", "<b>{{7*7}}</b>"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["gauss2svg", *arguments])
        status = main(arguments)
    document = json.loads((out / "gallery.json").read_text())
    return Site(status, out, document, good, bad, paths, arguments)


@dataclasses.dataclass
class Site:
    status: int
    out: object
    document: dict
    good: dict
    bad: dict
    paths: list
    arguments: list

    def rows(self, name):
        return [row for row in self.document["rows"] if row["photo"] == name]


def test_bad_photos_are_failures_and_the_rest_is_made(site):
    assert site.status == 1
    assert [row["variant"] for row in site.document["rows"]] == ["20 Gaussians", "40 Gaussians"] * 4
    names = [on_one_line(path.name) for path in site.good.values()]
    assert list(dict.fromkeys(row["photo"] for row in site.document["rows"])) == names
    failures = site.document["failures"]
    assert [failure["photo"] for failure in failures] == list(site.bad)
    page = (site.out / "index.html").read_text()
    for failure, reason in zip(failures, site.bad.values(), strict=True):
        assert failure["variant"] is None
        assert reason in failure["error"]
        assert "\n" not in failure["error"]
        assert f"<strong>{failure['photo']}</strong>" in page
    assert f"Failed: {len(site.bad)}" in page


def test_numbers_of_data_table_and_reports_agree(site):
    document = site.document
    assert cells_of(site.out / "gallery.csv") == cells_expected(document["rows"])
    for row in document["rows"]:
        report = json.loads((site.out / row["files"]["report"]).read_text())
        assert {name: row[name] for name in NUMBERS} == {n: report.get(n) for n in NUMBERS}
        assert (row["renderer"], row["seed"]) == (report["renderer"], 3)
        assert row["svg_bytes"] == (site.out / row["files"]["SVG"]).stat().st_size
        assert row["gaussians"] <= int(row["variant"].split()[0])
        assert row["cpu_s"] > 0
    for summary in document["summary"]:
        own = [row for row in document["rows"] if row["variant"] == summary["variant"]]
        assert summary["photos"] == len(own) == 4
        for name, value in summary.items():
            kind, _, number = name.partition("_")
            known = [row[number] for row in own if row.get(number) is not None]
            if kind == "median":
                assert value == (statistics.median(known) if known else None)
            if kind == "total":
                assert value == sum(known)


def test_numbers_of_the_pages_are_those_of_the_data(site):
    def quality(row, prefix=""):
        shown = [axis for axis in SCORES if axis.slug != "ssimulacra2"]  # they are too small
        return [axis.text(row[prefix + axis.key]) for axis in shown]

    head, *rows = Table(site.out / "index.html").rows
    assert len(head) == 11
    for row, summary in zip(rows, site.document["summary"], strict=True):
        assert row == [
            summary["variant"], "4", chart.whole(summary["median_gaussians"]),
            chart.size(summary["median_svg_bytes"]), chart.size(summary["median_svgz_bytes"]),
            chart.seconds(summary["median_total_s"]), *quality(summary, "median_"),
            chart.size(summary["total_svg_bytes"]), chart.seconds(summary["total_total_s"]),
        ]  # fmt: skip
    _, *rows = Table(site.out / "trade-off.html").rows
    for cells, row in zip(rows, site.document["rows"], strict=True):
        assert cells == [
            row["photo"], row["variant"], *quality(row), chart.whole(row["gaussians"]),
            chart.size(row["svg_bytes"]), chart.size(row["svgz_bytes"]),
            chart.seconds(row["total_s"]),
        ]  # fmt: skip
    for at, row in enumerate(site.document["rows"]):
        cells = Table(site.out / row["page"]).rows[1 + at % 2]
        assert cells[:9] == [
            row["variant"], chart.whole(row["gaussians"]), *quality(row),
            chart.size(row["svg_bytes"]), chart.size(row["svgz_bytes"]),
            chart.seconds(row["total_s"]), chart.seconds(row["cpu_s"]),
        ]  # fmt: skip


def test_every_page_names_the_renderer_and_links_to_what_is_there(site):
    pages = list(site.out.rglob("*.html"))
    assert len(pages) == 3 + len(site.good)
    (renderer,) = {row["renderer"] for row in site.document["rows"]}
    for path in pages:
        assert renderer in path.read_text()
        parts = [pair for _, attributes in Page(path).parts for pair in attributes]
        addresses = [urlsplit(value) for name, value in parts if name in ("href", "src")]
        assert len(addresses) > 5
        for address in addresses:
            if address.scheme == "data":
                continue
            assert not address.scheme + address.netloc + address.query
            if address.path:
                target = (path.parent / unquote(address.path)).resolve()
                assert target.is_file(), address
                assert target.is_relative_to(site.out.resolve())


@pytest.mark.parametrize("name", ["nasty", "clear"])
def test_svg_and_report_are_those_of_the_command_line(name, site, tmp_path):
    path = site.good[name]
    row = site.rows(on_one_line(path.name))[0]
    made = {what: site.out / file for what, file in row["files"].items()}
    arguments = [str(path), "-o", str(tmp_path / "x.svg"), "--gaussians", "20", "--fragments"]
    arguments += ["--seed", "3", "--scores", "--report", str(tmp_path / "x.json"), "--quiet"]
    arguments += ["--outline", str(tmp_path / "o.svg"), "--save-scene", str(tmp_path / "x.npz")]
    assert main(arguments) == 0
    assert (tmp_path / "x.svg").read_bytes() == made["SVG"].read_bytes()
    assert (tmp_path / "o.svg").read_bytes() == made["outlines"].read_bytes()
    with np.load(tmp_path / "x.npz") as one, np.load(made["scene"]) as other:
        assert one.files == other.files
        assert all(np.array_equal(one[key], other[key]) for key in one.files)
    one, other = (json.loads(p.read_text()) for p in (tmp_path / "x.json", made["report"]))
    assert one.keys() == other.keys()
    assert {key for key in one if one[key] != other[key]} <= {
        "compile_s", "fit_s", "fit_cpu_s", "total_s", "threads", "max_memory", "max_pixels",
        "full_size",  # of a gallery always
    }  # fmt: skip


def test_photos_are_shown_without_loss(site):
    for path in site.good.values():
        page = site.out / site.rows(on_one_line(path.name))[0]["page"]
        wanted = load_image(path)
        with Image.open(page.parent / "photo.webp") as shown:
            pixels = np.asarray(shown)
        assert np.array_equal(pixels[:, :, :3], np.round(wanted.pixels * 255))
        assert (pixels.shape[2] == 4) == (wanted.alpha is not None)
        if wanted.alpha is not None:
            assert np.array_equal(pixels[:, :, 3], np.round(wanted.alpha * 255))


def test_resized_photo_is_shown_as_it_is_fitted(photo, tmp_path, asked):
    alpha = np.linspace(0, 1, 128 * 128).reshape(128, 128, 1)
    paths = [save(photo, tmp_path / "a.png"), save(np.dstack([photo, alpha]), tmp_path / "b.png")]
    build_gallery(paths, tmp_path / "out", counts=[5], photo_size=32)
    for path in paths:
        with Image.open(tmp_path / "out" / "photos" / path.stem / "photo.webp") as shown:
            pixels = np.asarray(shown)
        wanted = load_image(path, needed=32)
        channels = pixels_of(wanted)
        assert pixels.shape == channels.shape == (32, 32, 3 + (wanted.alpha is not None))
        assert np.abs(pixels - 255 * channels)[channels[:, :, -1] > 0].max() <= 0.51


def test_nothing_of_the_metadata_is_on_the_site_and_no_path_of_the_machine(site):
    assert SECRET.encode() in site.good["nasty"].read_bytes()
    for path in (path for path in site.out.rglob("*") if path.is_file()):
        data = path.read_bytes()
        assert SECRET.encode() not in data
        assert SECRET.encode("utf-16-le") not in data
        if path.is_relative_to(site.out / "photos"):
            assert str(site.out.parent).encode() not in data, path
        if path.suffix in (".webp", ".png"):
            with Image.open(path) as picture:
                assert not picture.getexif()
                assert not set(picture.info) & {"exif", "xmp", "Comment", "icc_profile"}


def test_names_are_shown_as_text_and_folders_are_safe(site):
    for path in site.good.values():
        row = site.rows(on_one_line(path.name))[0]
        page = site.out / row["page"]
        assert page.parent.name == slug_of(path.stem)
        assert Page(page).texts.count(on_one_line(path.name)) >= 1
    text = (site.out / "index.html").read_text()
    assert "<b>" not in text
    assert "{{7*7}}" in text


def test_flat_photo_is_shown_as_equal(site):
    for row in site.rows("flat.png"):
        assert row["psnr_svg"] is None
    texts = Page(site.out / site.rows("flat.png")[0]["page"]).texts
    assert "equal" in texts
    assert "equal" in (site.out / "trade-off.html").read_text()


def test_second_build_makes_nothing_and_says_the_same(site, monkeypatch, capsys):
    asked, make_photo = [], run.make_photo

    def answer(request):
        asked.append(request["source"])
        return make_photo(request)

    monkeypatch.setattr(build, "Pool", PoolHere)
    monkeypatch.setattr(run, "make_photo", answer)
    monkeypatch.setattr(run, "make_svg", None)
    assert main(site.arguments) == 1
    assert asked == site.paths[4:]  # bad photos are read again
    assert "8 SVGs, 8 of them kept from before; 3 failed" in capsys.readouterr().err
    again = json.loads((site.out / "gallery.json").read_text())
    for name in ("rows", "summary", "failures"):
        assert again[name] == site.document[name]
