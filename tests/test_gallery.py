"""The gallery as a whole: what is made, kept, shown and told; real builds are few and slow."""

import csv
import dataclasses
import json
import os
import shutil
import signal
import statistics
import subprocess
import sys
import time
from html.parser import HTMLParser

import numpy as np
import psutil
import pytest
from PIL import Image, PngImagePlugin

import gauss2svg
from gauss2svg.bench.rows import flat
from gauss2svg.cli import main
from gauss2svg.errors import Gauss2SvgError, on_one_line
from gauss2svg.gallery import build, numbers, plan
from gauss2svg.gallery.build import build_gallery
from gauss2svg.gallery.pages import write_pages
from gauss2svg.gallery.photos import slug_of
from gauss2svg.gallery.records import NUMBERS
from gauss2svg.gallery.work import (
    ERRORS,
    OUTLINES,
    PICTURE,
    REPORT,
    SCENE,
    THUMBNAIL,
    _finish,
)
from gauss2svg.gallery.worker import answer_to
from gauss2svg.image import load_image
from gauss2svg.outputs import as_json

NASTY = "<script>alert(1)<img src=x onerror=alert(2)>&amp;\"'{{7*7}}{%if%}\u202e.png"
UNDECODABLE = "\udcff.png"
SECRET = "Ada of Nowhere"
BLANK = '<svg xmlns="http://www.w3.org/2000/svg" width="48" height="40"/>'


def save(pixels, path, **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.round(pixels * 255).astype(np.uint8)).save(path, **options)
    return path


def with_metadata():
    """EXIF with a place, texts and XMP, as options of a PNG."""
    exif = Image.Exif()
    exif[0x010E] = exif[0x013B] = SECRET  # ImageDescription, Artist
    exif.get_ifd(0x8825)[1] = SECRET  # GPSLatitudeRef
    texts = PngImagePlugin.PngInfo()
    texts.add_text("Comment", SECRET)
    texts.add_itxt("XML:com.adobe.xmp", f"<x>{SECRET}</x>")
    return {"exif": exif, "pnginfo": texts}


class Page(HTMLParser):
    """The elements of a page with their attributes, and its texts, in their order."""

    def __init__(self, path):
        super().__init__()
        self.parts = []
        self.texts = []
        self.feed(path.read_text())
        self.close()

    def handle_starttag(self, tag, attrs):
        self.parts.append((tag, attrs))

    def handle_data(self, data):
        if data.strip():
            self.texts.append(" ".join(data.split()))


class Table(HTMLParser):
    """Cells of the table of a class on a page, row by row."""

    def __init__(self, path):
        super().__init__()
        self.rows = []
        self._open = False
        self.feed(path.read_text())

    def handle_starttag(self, tag, attrs):
        if tag == "tr":
            self.rows.append([])
        self._open = tag in ("th", "td") or (self._open and tag not in ("tr", "caption"))
        if tag in ("th", "td"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        self._open = self._open and tag not in ("th", "td")

    def handle_data(self, data):
        if self._open:
            self.rows[-1][-1] += data


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
        "folder.png": "is a folder",
        "broken.png": "broken",
        "large.png": "pixels",
    }
    (root / "photos" / "folder.png").mkdir()
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


class Asked(list):
    """The works that a gallery asked for, as (kind, photo's folder, settings)."""

    def take(self):
        found = sorted(self, key=str)
        self.clear()
        return found


CROP = {"x": 0, "y": 0, "width": 5, "height": 5, "psnr": None}


def canned(work):
    """What make_variant leaves, at once and of no content."""
    count = work["settings"].get("gaussians", 100)
    if count == 13:
        return {"error": "un\nlucky \udcff"}
    report = {
        "gaussians": count, "svg_bytes": 100 * count, "svgz_bytes": 10 * count, "fit_s": 0.1,
        "total_s": 0.1 * count, "psnr_svg": None if count == 7 else 20.0 + work["seed"],
        "ssim_svg": 0.5, "renderer": "resvg 1", "seed": work["seed"],
    }  # fmt: skip
    files = dict.fromkeys((PICTURE, SCENE, OUTLINES, THUMBNAIL, ERRORS), b"<svg/>")
    extra = {"worst": CROP, "typical": CROP, "rounds": [[1, count]], "cpu_s": 0.1}
    return {"record": _finish(work, files | {REPORT: as_json(report)}, extra)}


@pytest.fixture
def asked(monkeypatch):
    """Works that were asked for, done here: photos in truth, SVGs as above."""
    found = Asked()

    class Here:
        def __init__(self, jobs):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def run(self, works):
            for index, work in enumerate(works):
                yield index, None
                folder = work["folder"].rpartition("/photos/")[2]
                found.append((work["kind"], folder))
                yield index, canned(work) if work["kind"] == "variant" else answer_to(work)

    monkeypatch.setattr(build, "Crew", Here)
    return found


@pytest.fixture
def two(photo, tmp_path):
    """Paths of two photos."""
    return [
        save(photo[:9, i : 9 + i], tmp_path / f"{name}.png") for i, name in ((1, "a"), (2, "b"))
    ]


def all_works(photos, variants):
    works = [("photo", photo) for photo in photos]
    return sorted(works + [("variant", f"{p}/{v}") for p in photos for v in variants])


# What was made.


def test_bad_photos_are_told_and_the_rest_is_made(site):
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
    assert f"Not made: {len(site.bad)}" in page


def test_numbers_of_data_table_and_reports_agree(site):
    document = site.document
    with (site.out / "gallery.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    for row, cells in zip(document["rows"], table, strict=True):
        expected = {name: "" if v is None else str(v) for name, v in flat(row).items()}
        assert cells == {name: expected.get(name, "") for name in cells}
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
                assert value == statistics.median(known)
            if kind == "total":
                assert value == sum(known)


def test_numbers_of_the_pages_are_those_of_the_data(site):
    def told(row, prefix=""):
        return [
            numbers.decibels(row[prefix + "psnr_svg"]), numbers.ratio(row[prefix + "ssim_svg"]),
        ]  # fmt: skip

    head, *rows = Table(site.out / "index.html").rows
    assert len(head) == 10
    for row, summary in zip(rows, site.document["summary"], strict=True):
        assert row == [
            summary["variant"], "4", numbers.whole(summary["median_gaussians"]),
            numbers.size(summary["median_svg_bytes"]), numbers.size(summary["median_svgz_bytes"]),
            numbers.seconds(summary["median_total_s"]), *told(summary, "median_"),
            numbers.size(summary["total_svg_bytes"]), numbers.seconds(summary["total_total_s"]),
        ]  # fmt: skip
    _, *rows = Table(site.out / "trade-off.html").rows
    for cells, row in zip(rows, site.document["rows"], strict=True):
        assert cells == [
            row["photo"], row["variant"], *told(row), numbers.whole(row["gaussians"]),
            numbers.size(row["svg_bytes"]), numbers.size(row["svgz_bytes"]),
            numbers.seconds(row["total_s"]),
        ]  # fmt: skip
    for at, row in enumerate(site.document["rows"]):
        cells = Table(site.out / row["page"]).rows[1 + at % 2]
        assert cells[:8] == [
            row["variant"], numbers.whole(row["gaussians"]), *told(row),
            numbers.size(row["svg_bytes"]), numbers.size(row["svgz_bytes"]),
            numbers.seconds(row["total_s"]), numbers.seconds(row["cpu_s"]),
        ]  # fmt: skip


def test_every_page_names_the_renderer_and_links_to_what_is_there(site):
    pages = list(site.out.rglob("*.html"))
    assert len(pages) == 3 + len(site.good)
    (renderer,) = {row["renderer"] for row in site.document["rows"]}
    for path in pages:
        assert renderer in path.read_text()
        for _, attributes in Page(path).parts:
            for name, value in attributes:
                if name in ("href", "src") and not value.startswith(("#", "data:")):
                    assert (path.parent / value.partition("#")[0]).is_file(), value


@pytest.mark.parametrize("name", ["nasty", "clear"])
def test_svg_and_report_are_those_of_the_command_line(name, site, tmp_path):
    path = site.good[name]
    row = site.rows(on_one_line(path.name))[0]
    made = {what: site.out / file for what, file in row["files"].items()}
    arguments = [str(path), "-o", str(tmp_path / "x.svg"), "--gaussians", "20", "--fragments"]
    arguments += ["--seed", "3", "--report", str(tmp_path / "x.json"), "--quiet"]
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
        "compile_s", "fit_s", "fit_cpu_s", "total_s", "threads",
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


def test_shrunk_photo_is_shown_as_it_is_fitted(photo, tmp_path, asked):
    alpha = np.linspace(0, 1, 128 * 128).reshape(128, 128, 1)
    paths = [save(photo, tmp_path / "a.png"), save(np.dstack([photo, alpha]), tmp_path / "b.png")]
    build_gallery(paths, tmp_path / "out", counts=[5], photo_size=32)
    for path in paths:
        with Image.open(tmp_path / "out" / "photos" / path.stem / "photo.webp") as shown:
            pixels = np.asarray(shown)
        with Image.open(path) as picture:
            whole = np.asarray(picture, np.float64)
        weight = whole[:, :, 3:] if whole.shape[2] == 4 else np.ones((128, 128, 1))
        colors, weights = (
            values.reshape(32, 4, 32, 4, -1).mean(axis=(1, 3))
            for values in (whole[:, :, :3] * weight, weight)
        )
        wanted = np.divide(colors, weights, out=np.zeros_like(colors), where=weights > 0)
        assert pixels.shape == (32, 32, whole.shape[2])
        assert np.abs(pixels[:, :, :3] - wanted).max() <= 0.51
        if whole.shape[2] == 4:
            assert np.abs(pixels[:, :, 3:] - weights).max() <= 0.51


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


def test_flat_picture_is_equal_and_told_so(site):
    for row in site.rows("flat.png"):
        assert row["psnr_svg"] is None
    texts = Page(site.out / site.rows("flat.png")[0]["page"]).texts
    assert "equal" in texts
    assert "equal" in (site.out / "trade-off.html").read_text()


class Crew:
    """Asked for nothing."""

    def __init__(self, jobs):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def run(self, works):
        # A bad photo is looked at again.
        assert [work["kind"] for work in works] in ([], ["photo"] * 2)
        for index, work in enumerate(works):
            yield index, None
            yield index, answer_to(work)


def test_second_build_makes_nothing_and_says_the_same(site, monkeypatch, capsys):
    monkeypatch.setattr(build, "Crew", Crew)
    assert main(site.arguments) == 1
    assert "8 SVGs, 8 of them kept from before; 4 failed" in capsys.readouterr().err
    again = json.loads((site.out / "gallery.json").read_text())
    for name in ("rows", "summary", "failures"):
        assert again[name] == site.document[name]


# Nothing of a name is HTML: pages of such names are those of plain ones, but for the texts.

TEXTS = [
    "<script>alert(1)</script>&\"'{{7*7}}",
    "</title></style></textarea><img src=x onerror=alert(1)>",
    "--><!-- ]]> {% raw %}{# #} &lt;b&gt; \u2028 &#60;",
    "' onmouseover='alert(1)' x=\" onfocus=\"alert(1)\" `",
    "javascript:alert(1)",
]


@pytest.mark.parametrize("text", TEXTS)
def test_nothing_of_a_name_is_rendered_as_html(text, two, tmp_path, asked, monkeypatch):
    told = []
    monkeypatch.setattr(build, "write_pages", lambda *arguments: told.extend(arguments))
    build_gallery([*two, "none.png"], tmp_path / "out", counts=[5, 7, 13])
    root, story, variants, shown, failures = told

    def pages(word):
        def photo_of(one):
            return dataclasses.replace(one.photo, name=word)

        write_pages(
            root,
            dataclasses.replace(story, title=word, command=word, absent=(word,)),
            variants,
            [dataclasses.replace(one, photo=photo_of(one), notes=(word,)) for one in shown],
            [dataclasses.replace(one, photo=photo_of(one), error=word) for one in failures],
        )
        return {path: Page(path) for path in sorted(root.rglob("*.html"))}

    plain, odd = pages("plainword"), pages(text)
    flat_text = " ".join(text.split())
    assert len(plain) == 5
    for path, page in odd.items():
        assert [
            (tag, [(name, value and value.replace(text, "plainword")) for name, value in attrs])
            for tag, attrs in page.parts
        ] == plain[path].parts
        shown_texts = [part.replace(flat_text, "plainword") for part in page.texts]
        assert shown_texts == plain[path].texts
        assert any("plainword" in part for part in shown_texts)


# What is kept.


def test_finished_work_is_kept_until_what_it_depends_on_changes(
    two, photo, tmp_path, asked, monkeypatch
):
    out = tmp_path / "out"

    def made(**changes):
        options = {"counts": [5, 7], "variants": ["draft"]} | changes
        gallery = build_gallery(options.pop("photos", two), out, **options)
        assert not gallery.failures
        return asked.take(), gallery

    slugs = ["draft", "gaussians-5", "gaussians-7"]
    everything = all_works("ab", slugs)
    works, first = made()
    assert (works, first.kept) == (everything, 0)
    works, second = made(threads=1, jobs=3, peer_timeout=5, title="other", max_pixels=10**6)
    assert (works, second.kept, second.rows) == ([], 6, first.rows)
    assert made(photos=two[::-1])[0] == []
    works, third = made(counts=[7, 9, 5])
    assert works == [("variant", "a/gaussians-9"), ("variant", "b/gaussians-9")]
    assert [row for row in third.rows if row["variant"] != "9 Gaussians"] != []
    assert {str(row) for row in first.rows} < {str(row) for row in third.rows}
    added = save(photo[:5, :5], tmp_path / "c.png")
    assert made(photos=[added, *two])[0] == all_works("c", slugs)

    seeded = [work for work in everything if work[0] == "variant"]
    assert made(seed=1)[0] == seeded
    assert made(seed=0)[0] == seeded
    assert made(photo_size=7)[0] == everything
    assert made(photo_size=6)[0] == everything
    assert made()[0] == everything
    save(photo[:8, :8], two[0])
    assert made()[0] == all_works("a", slugs)
    monkeypatch.setattr(plan, "code_digest", lambda: "other code")
    assert made()[0] == everything


def test_svg_of_which_a_file_is_gone_or_cut_short_is_made_again(two, tmp_path, asked):
    first = build_gallery(two, tmp_path / "out", counts=[5, 7])
    folder = tmp_path / "out" / "photos" / "a" / "gaussians-5"
    for name, cut in ((PICTURE, None), (OUTLINES, 3), (REPORT, 9), ("record.json", 50)):
        asked.clear()
        if cut is None:
            (folder / name).unlink()
        else:
            os.truncate(folder / name, cut)
        again = build_gallery(two, tmp_path / "out", counts=[5, 7])
        assert asked == [("variant", "a/gaussians-5")], name
        assert again.rows == first.rows


def test_photo_of_the_same_name_that_comes_or_goes_moves_no_other(two, photo, tmp_path, asked):
    out = tmp_path / "out"
    others = [save(photo[:5, :size], tmp_path / str(size) / "a.png") for size in (5, 6, 7)]
    copy = tmp_path / "copy" / "a.png"
    copy.parent.mkdir()
    shutil.copyfile(two[0], copy)
    first = build_gallery(two, out, counts=[5])
    asked.clear()
    for paths, made in (
        ([*others[:2], *two], 2), (two[::-1], 0), (others, 1), ([two[0], *others], 0),
        ([others[1]], 0), ([copy, *two, *others], 1), (two, 0),
    ):  # fmt: skip
        gallery = build_gallery(paths, out, counts=[5])
        assert len({row["page"] for row in gallery.rows}) == len(paths) == len(gallery.rows)
        assert len(asked.take()) == 2 * made
    assert gallery.rows == first.rows


def test_lost_photo_is_shown_again_and_its_svgs_are_kept(two, tmp_path, asked):
    build_gallery(two, tmp_path / "out", counts=[5])
    for name in ("photo.webp", THUMBNAIL, "record.json"):
        (tmp_path / "out" / "photos" / "a" / name).unlink()
        asked.clear()
        assert build_gallery(two, tmp_path / "out", counts=[5]).kept == 2
        assert asked == [("photo", "a")]
    shutil.rmtree(tmp_path / "out" / "assets")
    asked.clear()
    build_gallery(two, tmp_path / "out", counts=[5])
    assert asked == []
    assert (tmp_path / "out" / "assets" / "gallery.css").is_file()


def test_failed_svg_is_tried_again_and_the_others_are_kept(two, tmp_path, asked, capsys):
    arguments = ["gallery", *map(str, two), "-o", str(tmp_path / "out"), "--counts", "13,5"]
    assert main(arguments) == 1
    err = capsys.readouterr().err.splitlines()
    assert err[:2] == [f"gauss2svg: failed: {n}.png, 13 Gaussians: un lucky \\udcff" for n in "ab"]
    assert err[2].startswith("gauss2svg: 2 SVGs; 2 failed; open ")
    assert len(err) == 3
    asked.clear()
    assert main([*arguments, "--quiet"]) == 1
    assert asked == [("variant", "a/gaussians-13"), ("variant", "b/gaussians-13")]
    assert len(capsys.readouterr().err.splitlines()) == 2  # bad news is told all the same


def test_progress_tells_what_is_done_of_all_and_what_is_made_now(two, tmp_path, asked):
    seen = []
    paths = [*two, tmp_path / "none.png"]
    build_gallery(paths, tmp_path / "out", counts=[5, 13], progress=seen.append)
    assert {one.total for one in seen} == {9}
    done = [one.done for one in seen]
    assert done == sorted(done)
    assert (seen[0].done, seen[-1].done, seen[-1].now) == (3, 9, ())
    assert ("a.png",) in [one.now for one in seen]
    assert ("b.png, 5 Gaussians",) in [one.now for one in seen]
    again = []
    build_gallery(paths, tmp_path / "out", counts=[5, 13], progress=again.append)
    assert (again[0].done, again[0].kept, again[-1].done) == (7, 2, 9)


def test_numpy_numbers_are_numbers(two, tmp_path, asked):
    first = build_gallery(two, tmp_path / "out", counts=[5], seed=2, photo_size=8)
    asked.clear()
    options = {"seed": np.int64(2), "photo_size": np.int32(8), "jobs": np.int8(1)}
    options |= {"counts": np.array([5]), "peer_timeout": np.float32(4), "max_pixels": np.int64(999)}
    assert build_gallery(two, tmp_path / "out", **options).rows == first.rows
    assert asked == []


# Interruptions.


def interrupted_at(count):
    calls = []

    def progress(_):
        calls.append(0)
        if len(calls) == count:
            raise KeyboardInterrupt

    return progress


@pytest.mark.parametrize("count", [1, 2, 6, 7, 12])
def test_interrupted_gallery_shows_what_is_finished_and_goes_on(count, two, tmp_path, asked):
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        build_gallery(two, out, counts=[5, 7], progress=interrupted_at(count))
    done = asked.take()
    document = json.loads((out / "gallery.json").read_text())
    assert len(document["rows"]) == sum(kind == "variant" for kind, _ in done)
    for row in document["rows"]:
        assert (out / row["page"]).is_file()
        assert row["page"] in (out / "index.html").read_text()
    gallery = build_gallery(two, out, counts=[5, 7])
    assert len(gallery.rows) == 4
    assert sorted(asked + done) == all_works("ab", ["gaussians-5", "gaussians-7"])


def test_gallery_interrupted_at_a_new_photo_still_shows_the_old_ones(
    two, photo, tmp_path, asked, monkeypatch, capsys
):
    out = tmp_path / "out"
    first = build_gallery(two, out, counts=[5, 7])
    added = save(photo[:5, :5], tmp_path / "c.png")
    with pytest.raises(KeyboardInterrupt):
        build_gallery([added, *two], out, counts=[5, 7], progress=interrupted_at(2))
    assert json.loads((out / "gallery.json").read_text())["rows"] == first.rows


def test_ctrl_c_ends_the_command_and_its_workers_and_the_next_one_goes_on(photo, tmp_path, asked):
    picture, out = save(photo, tmp_path / "a.png"), tmp_path / "out"
    arguments = ["gallery", str(picture), "-o", str(out), "--counts", "20,60000"]
    command = [sys.executable, "-m", "gauss2svg", *arguments, "--jobs", "2"]
    record = out / "photos" / "a" / "gaussians-20" / "record.json"
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        for _ in range(6000):
            if record.exists() or process.poll() is not None:
                break
            time.sleep(0.01)
        workers = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(signal.SIGINT)
        err = process.stderr.read()
        status = process.wait(60)
    assert (status, len(workers)) == (130, 2)
    assert err == "gauss2svg: interrupted; every file is whole or untouched\n"
    assert not [worker for worker in workers if worker.is_running()]
    (row,) = json.loads((out / "gallery.json").read_text())["rows"]
    assert (row["variant"], row["photo"]) == ("20 Gaussians", "a.png")
    assert {path.name for path in (out / "photos" / "a").iterdir()} - {"gaussians-60000"} == {
        "index.html", "photo.webp", "thumbnail.png", "record.json", "gaussians-20",
    }  # fmt: skip
    assert main([*arguments, "--quiet"]) == 0
    assert asked == [("variant", "a/gaussians-60000")]
    assert row in json.loads((out / "gallery.json").read_text())["rows"]


# Other tools.


def test_peer_is_measured_or_fails_or_is_stopped_on_one_line(
    photo, tmp_path, monkeypatch, capsys, asked
):
    monkeypatch.setattr(f"{__name__}.canned", answer_to)
    script = tmp_path / "bin" / "primitive"
    script.parent.mkdir()
    script.write_text(
        "#!/bin/sh\n"
        'case "$2$6" in\n'
        f"*slow*) exec sleep 600;; *100) echo '{BLANK}' > \"$4\";;\n"
        "*) echo no luck >&2; exit 3;; esac\n"
    )
    script.chmod(0o755)
    monkeypatch.setenv("PATH", f"{script.parent}{os.pathsep}{os.environ['PATH']}")
    good, slow = (save(photo[:40, :48], tmp_path / f"{name}.png") for name in ("good", "slow"))
    out = tmp_path / "out"
    options = ["-o", str(out), "--variants", "", "--peer-timeout"]
    peers = ["--peers", "primitive,primitive:500"]
    assert main(["gallery", str(good), *options, "60", *peers]) == 1
    err = capsys.readouterr().err.splitlines()
    assert len(err) == 2
    assert err[0].startswith("gauss2svg: failed: good.png, primitive 500: ")
    assert "status 3: no luck" in err[0]
    (row,) = json.loads((out / "gallery.json").read_text())["rows"]
    error = np.mean((1 - load_image(good).pixels.astype(np.float64)) ** 2)
    assert row["psnr_svg"] == pytest.approx(-10 * np.log10(error), abs=1e-4)
    assert (row["tool"], row["svg_bytes"]) == ("primitive", len(BLANK) + 1)
    assert row["renderer"].startswith("resvg")
    assert set(row["files"]) == {"SVG", "report"}
    for folder in ("primitive-100", "primitive-500"):
        left = {path.name for path in (out / "photos" / "good" / folder).iterdir()}
        assert not left & {"input.png", "drawn.svg"}
    text = (out / "photos" / "good" / "primitive-100" / "report.json").read_text()
    assert str(tmp_path) not in text

    asked.clear()
    arguments = ["gallery", str(good), str(slow), *options, "0.5", "--peers", "primitive"]
    assert main([*arguments, "--quiet"]) == 1
    assert asked == [("photo", "slow"), ("variant", "slow/primitive-100")]
    err = capsys.readouterr().err
    assert err == (
        "gauss2svg: failed: slow.png, primitive 100: timed out after 0.5 s; give a longer "
        "--peer-timeout\n"
    )
    page = (out / "photos" / "slow" / "index.html").read_text()
    assert "Nothing could be made of this photo" in page


def test_absent_peer_is_named_on_the_page_and_in_the_summary(
    two, tmp_path, asked, monkeypatch, capsys
):
    monkeypatch.setenv("PATH", str(tmp_path))
    out = tmp_path / "out"
    arguments = ["gallery", *map(str, two), "-o", str(out), "--counts", "5"]
    assert main([*arguments, "--peers", "primitive"]) == 0
    assert "not installed, left out: primitive\n" in capsys.readouterr().err
    assert "not installed: primitive" in (out / "how.html").read_text()


# Mistakes.


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--variants", "", "--counts", ""], "got no variant"),
        (["--variants", "quick"], "variant is 'quick'; needed is one of draft, fast"),
        (["--counts", "many"], "count is 'many'; needed are whole numbers by commas"),
        (["--counts", "2.5"], "count is '2.5'"),
        (["--counts=-5"], "count is '-5'"),
        (["--counts", "1" * 5000], "count is '111"),
        (["--counts", "999999999999"], "count is 999999999999; needed is a whole number in 0"),
        (["--peers", "jpeg"], "peer is 'jpeg'; needed is one of vtracer"),
        (["--peers", "vtracer:best"], "peer is 'vtracer:best'"),
        (["--jobs", "0"], "jobs is 0; needed is a whole number in 1..256"),
        (["--jobs", "many"], "jobs"),
        (["--threads", "0"], "threads is 0"),
        (["--seed", "-1"], "seed"),
        (["--photo-size", "0"], "photo_size is 0"),
        (["--max-pixels", "0"], "max_pixels is 0"),
        (["--peer-timeout", "0"], "peer_timeout is 0"),
        (["--peer-timeout", "nan"], "peer_timeout is nan"),
        (["--title", " "], "title is ' '; needed is text"),
        (["-o", "PHOTO"], "cannot make"),
        (["-o", "PHOTO/x"], "cannot make"),
        (["-o", "/proc/x/y"], "cannot make"),
    ],
)
def test_mistake_is_one_line_and_status_two_before_any_work(
    arguments, message, two, tmp_path, asked, capsys
):
    given = [word.replace("PHOTO", str(two[0])) for word in arguments]
    target = [] if "-o" in given else ["-o", str(tmp_path / "out")]
    before = sorted(tmp_path.rglob("*"))
    assert main(["gallery", str(two[1]), *given, *target]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n"), asked) == ("", 1, [])
    assert message in err
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("name", ["index.html", "how.html", "gallery.json", "gallery.csv"])
@pytest.mark.parametrize("content", ["mine", '{"rows": []}'])
def test_file_of_no_gallery_is_kept_untouched(name, content, two, tmp_path, asked, capsys):
    path = tmp_path / "out" / name
    path.parent.mkdir()
    path.write_text(content)
    assert main(["gallery", str(two[0]), "-o", str(path.parent)]) == 2
    assert capsys.readouterr().err.endswith("choose another folder, so that it is kept\n")
    assert path.read_text() == content
    assert (asked, list(path.parent.iterdir())) == ([], [path])


def test_what_cannot_be_written_is_told_before_any_work(two, tmp_path, asked, capsys):
    out = tmp_path / "out"
    build_gallery(two, out, counts=[5])
    arguments = ["gallery", str(two[0]), "-o", str(out), "--counts", "6"]
    before = (out / "gallery.json").read_bytes()
    asked.clear()
    for name in ("how.html", "photos", "assets"):
        path = out / name
        moved = path.rename(tmp_path / "moved")
        path.mkdir() if name == "how.html" else path.write_text("mine")
        assert main(arguments) == 2
        assert (asked, capsys.readouterr().err.count("\n")) == ([], 1)
        path.rmdir() if name == "how.html" else path.unlink()
        moved.rename(path)
    assert (out / "gallery.json").read_bytes() == before


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser can write to a read-only folder")
def test_read_only_folder_is_told_before_any_work(two, tmp_path, asked, capsys):
    (tmp_path / "out").mkdir(mode=0o500)
    assert main(["gallery", str(two[0]), "-o", str(tmp_path / "out")]) == 2
    assert (asked, capsys.readouterr().err.count("\n")) == ([], 1)


def test_photo_among_the_pictures_of_the_gallery_is_refused(two, tmp_path, asked, capsys):
    out = tmp_path / "out"
    build_gallery(two, out, counts=[5])
    asked.clear()
    link = tmp_path / "link.png"
    link.symlink_to(out / "photos" / "a" / "thumbnail.png")
    for path in (out / "photos" / "a" / "thumbnail.png", link):
        assert main(["gallery", str(path), "-o", str(out), "--counts", "5"]) == 2
        assert "lies where the gallery keeps its own pictures" in capsys.readouterr().err
    assert asked == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"photos": "a.png"}, {"photos": []}, {"photos": [None]}, {"variants": "draft"},
        {"counts": 5}, {"counts": "5"}, {"peers": "vtracer"}, {"jobs": True}, {"jobs": 1.5},
        {"title": None}, {"peer_timeout": "5"}, {"photo_size": 2.5}, {"directory": "a\0b"},
    ],
)  # fmt: skip
def test_wrong_arguments_are_refused_on_one_line(wrong, two, tmp_path, asked):
    arguments = {"photos": two, "directory": tmp_path / "out"} | wrong
    with pytest.raises(Gauss2SvgError) as told:
        build_gallery(arguments.pop("photos"), arguments.pop("directory"), **arguments)
    assert "\n" not in str(told.value)
    assert not (tmp_path / "out").exists()


def test_gallery_of_bad_photos_alone_has_an_index_that_says_so(tmp_path, asked, capsys):
    bad = tmp_path / "bad.png"
    bad.write_text("no picture")
    out = tmp_path / "out"
    paths = [bad, tmp_path / "none.png", "a\0b"]
    gallery = build_gallery(paths, out, counts=[5])
    assert [failure.photo.name for failure in gallery.failures] == [
        "bad.png",
        "none.png",
        "a\\x00b",
    ]
    assert gallery.rows == []
    assert "Not made: 3" in gallery.index.read_text()
    assert main(["gallery", str(bad), "-o", str(out), "--counts", "5"]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("gauss2svg: failed: bad.png: ")
    assert lines[1:] == [f"gauss2svg: 0 SVGs; 1 failed; open {out}/index.html"]


def test_pages_of_photos_that_are_left_out_stay_where_they_were(two, tmp_path, asked):
    out = tmp_path / "out"
    build_gallery(two, out, counts=[5])
    asked.clear()
    assert build_gallery(two[:1], out, counts=[5]).kept == 1
    assert "photos/b" not in (out / "index.html").read_text()
    assert build_gallery(two, out, counts=[5]).kept == 2
    assert asked == []


def test_equal_pictures_are_charted_and_told(two, tmp_path, asked):
    out = tmp_path / "out"
    gallery = build_gallery(two, out, counts=[7])
    assert [row["psnr_svg"] for row in gallery.rows] == [None, None]
    assert Table(out / "index.html").rows[1][6] == "equal"
    assert Page(out / "trade-off.html").texts.count("equal") >= 3


def test_main_command_loads_no_gallery_and_a_worker_no_pages():
    code = (
        "import sys; from gauss2svg.cli import main; main(['no.png', '-o', 'x.svg']);"
        "bad = [n for n in sys.modules if n == 'jinja2' or n.startswith('gauss2svg.gallery')];"
        "import gauss2svg.gallery.worker;"
        "bad += [n for n in ('jinja2', 'gauss2svg.gallery.pages') if n in sys.modules];"
        "sys.exit(len(bad))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert done.returncode == 0
    assert gauss2svg.build_gallery is build_gallery
