"""A real gallery: its files and pages, and that all its numbers are those of the reports."""

import dataclasses
import json
import statistics
import sys
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest
from galleries import Page, Table, cells_expected, cells_of, save
from names import possible
from PIL import Image, PngImagePlugin

from gauss2svg.cli.main import main
from gauss2svg.compare import chart
from gauss2svg.compare.pages.build import NUMBERS
from gauss2svg.errors import on_one_line
from gauss2svg.measure import SCORES
from gauss2svg.photo.load import load_image

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
    def texts(row, *others):
        shown = [axis for axis in SCORES if axis.slug != "ssimulacra2"]  # they are too small
        sizes = [chart.size(row[key]) for key in ("svg_bytes", "svgz_bytes")]
        seconds = chart.seconds(row["total_s"])
        return [*others, *(axis.text(row[axis.key]) for axis in shown), *sizes, seconds]

    _, *cells = Table(site.out / "trade-off.html").rows
    for at, (row, told) in enumerate(zip(site.document["rows"], cells, strict=True)):
        count = chart.whole(row["gaussians"])
        assert sorted(told) == sorted([row["photo"], *texts(row, row["variant"], count)])
        of_photo = Table(site.out / row["page"]).rows[1 + at % 2]
        assert of_photo[:9] == [*texts(row, row["variant"], count), chart.seconds(row["cpu_s"])]
    _, *cells = Table(site.out / "index.html").rows
    for told, summary in zip(cells, site.document["summary"], strict=True):
        median = {key.removeprefix("median_"): value for key, value in summary.items()}
        assert set(texts(median, median["variant"], "4")) <= set(told)


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


def test_svg_and_report_are_those_of_the_command_line(site, tmp_path):
    path = site.good["clear"]
    made = {what: site.out / file for what, file in site.rows("clear.png")[0]["files"].items()}
    arguments = [str(path), "-o", str(tmp_path / "x.svg"), "--gaussians", "20", "--fragments"]
    arguments += ["--seed", "3", "--scores", "--report", str(tmp_path / "x.json"), "--quiet"]
    assert main([*arguments, "--outline", str(tmp_path / "o.svg")]) == 0
    assert (tmp_path / "x.svg").read_bytes() == made["SVG"].read_bytes()
    assert (tmp_path / "o.svg").read_bytes() == made["outlines"].read_bytes()
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
