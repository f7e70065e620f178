"""A real gallery: its files and pages, and that all its numbers are those of the reports."""

import json
import re
import statistics
from itertools import product
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest
from flat import build_gallery
from galleries import BLANK, Page, cells_expected, cells_of, save
from gallery_site import BAD, COUNTS, HOSTILE, SECRET, hastily
from pictures import antialiased_badge
from PIL import Image
from rewritten import rewritten

from gauss2svg.cli.main import main
from gauss2svg.compare import chart
from gauss2svg.compare.pages import NUMBERS
from gauss2svg.compare.records import COUNTS as COUNTS_OF_PARTS
from gauss2svg.errors import on_one_line
from gauss2svg.measure import NONE, SCORES
from gauss2svg.measure.heatmap import colors_of, errors
from gauss2svg.photo.load import load_image
from gauss2svg.photo.pixels import over
from gauss2svg.raster import rasterize

pytestmark = pytest.mark.process
NAMES = ["cat 9.png", "astronaut.png", "Cat 10.png", HOSTILE]


def source_of(gallery, name):
    return gallery.directory.parent / "photos" / name


def test_bad_photos_are_failures_and_the_rest_is_made(gallery):
    variants = [f"gaussians {count}" for count in COUNTS]
    assert [(r["photo"], r["variant"]) for r in gallery.rows] == [*product(NAMES, variants)]
    page = (gallery.directory / "index.html").read_text()
    for failure, (name, reason) in zip(gallery.failures, BAD.items(), strict=True):
        assert (failure["photo"], failure["variant"]) == (on_one_line(name), None)
        assert reason in failure["error"]
        assert "\n" not in failure["error"]
        assert f"<strong>{on_one_line(name)}</strong>" in page


def test_numbers_of_data_table_and_reports_agree(gallery):
    site = gallery.directory
    assert json.loads((site / "gallery.json").read_text())["rows"] == gallery.rows
    assert cells_of(site / "gallery.csv") == cells_expected(gallery.rows)
    for row in gallery.rows:
        report = json.loads((site / row["files"]["report"]).read_text())
        assert {name: row[name] for name in NUMBERS} == {n: report.get(n) for n in NUMBERS}
        assert row["svg_bytes"] == (site / row["files"]["SVG"]).stat().st_size
        assert row["gaussians"] <= int(row["variant"].split()[1])
        assert row["cpu_s"] > 0
    for summary in gallery.summary:
        own = [row for row in gallery.rows if row["variant"] == summary["variant"]]
        assert summary["photos"] == len(own) == 4
        for name, value in summary.items():
            kind, _, number = name.partition("_")
            known = [row[number] for row in own if row.get(number) is not None]
            if kind in ("median", "total"):
                of_all = statistics.median if kind == "median" else sum
                assert value == (of_all(known) if known else None)


def test_numbers_of_the_pages_are_those_of_the_data(gallery):
    def texts(row, count):
        shown = [axis for axis in SCORES if axis.slug != "ssimulacra2"]  # they are too small
        sizes = [chart.size(row[key]) for key in ("svg_bytes", "svgz_bytes")]
        scores = [axis.text(row[axis.key]) for axis in shown]
        return [row["variant"], count, *scores, *sizes, chart.seconds(row["total_s"])]

    _, *cells = Page(gallery.directory / "trade-off.html").rows
    for at, (row, told) in enumerate(zip(gallery.rows, cells, strict=True)):
        wanted = texts(row, chart.whole(row["gaussians"]))
        assert sorted(told) == sorted([row["photo"], *wanted])
        assert Page(gallery.directory / row["page"]).rows[1 + at % 2][:8] == wanted
    _, *cells = Page(gallery.directory / "index.html").rows
    for told, summary in zip(cells, gallery.summary, strict=True):
        median = {key.removeprefix("median_"): value for key, value in summary.items()}
        assert set(texts(median, "4")) <= set(told)


def test_pages_count_what_a_drawing_is_made_of_and_its_outlines_have_all_nodes(tmp_path):
    """An axis shows what areas bring; the variant with the default value is shown first.

    Files of another method have no areas.
    """
    drawing, site = save(antialiased_badge(64), tmp_path / "badge.png"), tmp_path / "site"
    (tmp_path / "files").mkdir()
    (tmp_path / "files" / "badge.svg").write_text(BLANK)
    peers = [f"blank={tmp_path / 'files'}"]
    with hastily():
        found = build_gallery([drawing], site, axes={"areas": ["never", "auto"]}, peers=peers)
    shapes_alone, row, _ = found.rows
    assert row["psnr_svg"] > shapes_alone["psnr_svg"] + 3
    assert shapes_alone["area_count"] == shapes_alone["node_count"] == 0
    svg = (site / row["files"]["SVG"]).read_text()
    assert rewritten(svg, fragments=True) == svg
    outlines = (site / row["files"]["outlines"]).read_text()
    assert outlines.count('id="area-') == row["area_count"] + row["line_count"] > 0
    dots = re.search('id="nodes" d="(.*?)"', outlines)[1]
    assert dots.count("M") == row["node_count"] > 0
    counts = [chart.whole(row[key]) for key in COUNTS_OF_PARTS if row[key]]
    page = Page(site / row["page"])
    assert page.rows[2][: 1 + len(counts)] == ["areas auto", *counts]
    assert page.rows[3][: 1 + len(counts)] == ["blank", *[NONE] * len(counts)]
    assert ("value", "areas-auto") in next(a for t, a in page.parts if ("checked", None) in a)
    for name in ("index.html", "trade-off.html"):
        assert set(counts) <= set(Page(site / name).rows[2]), name


def test_every_page_names_the_renderer_and_links_to_what_is_there(gallery):
    pages = list(gallery.directory.rglob("*.html"))
    assert len(pages) == 3 + len(NAMES)
    (renderer,) = {row["renderer"] for row in gallery.rows}
    for path in pages:
        page = Page(path)
        assert renderer in path.read_text()
        assert HOSTILE in " ".join(page.texts)  # the title: names are text and no elements
        parts = [pair for _, attributes in page.parts for pair in attributes]
        assert not [name for name, _ in parts if name.startswith("on")]
        addresses = [urlsplit(value) for name, value in parts if name in ("href", "src")]
        assert len(addresses) > 5
        for address in (address for address in addresses if address.scheme != "data"):
            assert not address.scheme + address.netloc + address.query
            target = (path.parent / unquote(address.path)).resolve() if address.path else path
            assert target.is_file(), address
            assert target.is_relative_to(gallery.directory.resolve())


def test_svg_and_report_are_those_of_the_command_line(gallery, tmp_path):
    row = next(row for row in gallery.rows if row["photo"] == "Cat 10.png")
    made = {what: gallery.directory / file for what, file in row["files"].items()}
    words = [str(source_of(gallery, row["photo"])), "-o", str(tmp_path / "x.svg"), "--quiet"]
    words += ["--gaussians", str(COUNTS[0]), "--fragments", "--scores"]
    words += ["--report", str(tmp_path / "x.json"), "--outline", str(tmp_path / "o.svg")]
    with hastily():
        assert main(words) == 0
    assert (tmp_path / "x.svg").read_bytes() == made["SVG"].read_bytes()
    outlines = (tmp_path / "o.svg").read_text().removesuffix("</svg>\n")
    assert made["outlines"].read_text().startswith(outlines)
    one, other = (json.loads(p.read_text()) for p in (tmp_path / "x.json", made["report"]))
    assert one.keys() == other.keys()
    assert {key for key in one if one[key] != other[key]} <= {
        "fit_s", "fit_cpu_s", "total_s", "threads", "max_memory", "max_pixels",
        "full_size", "options_sha256",  # of a gallery always
    }  # fmt: skip


def test_photos_are_shown_without_loss_beside_their_errors_and_nothing_else_of_them(gallery):
    site = gallery.directory
    for row in gallery.rows:
        wanted, page = load_image(source_of(gallery, row["photo"])).pixels, site / row["page"]
        with Image.open(page.with_name("photo.webp")) as shown:
            assert np.array_equal(np.asarray(shown), np.round(wanted * 255))
        svg = site / row["files"]["SVG"]
        drawn = over(rasterize(svg.read_text(), row["width"], row["height"]))
        with Image.open(svg.with_name("errors.png")) as shown:
            expected = colors_of(np.round(errors(drawn, over(wanted))))
            np.testing.assert_array_equal(shown.convert("RGB"), expected)
    assert SECRET.encode() in source_of(gallery, HOSTILE).read_bytes()
    for path in (path for path in site.rglob("*") if path.is_file()):
        data = path.read_bytes()
        assert not [code for code in ("utf-8", "utf-16-le") if SECRET.encode(code) in data]
        assert not path.is_relative_to(site / "photos") or str(site.parent).encode() not in data
