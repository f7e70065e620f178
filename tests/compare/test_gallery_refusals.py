"""Mistakes, bad photos, odd names and other tools: what a gallery refuses, reports and escapes."""

import dataclasses
import json
import os

import numpy as np
import pytest
from flat import build_gallery
from galleries import BLANK, Page, Table, program, save

from gauss2svg.cli.main import main
from gauss2svg.compare.pages import build
from gauss2svg.compare.pages.build import write_pages
from gauss2svg.compare.records import record_or_error
from gauss2svg.compare.run import make_photo, make_svg
from gauss2svg.errors import Gauss2SvgError, InputError, OutputError
from gauss2svg.photo.load import load_image

TEXTS = [
    "<script>alert(1)</script>&\"'{{7*7}}",
    "</title></style></textarea><img src=x onerror=alert(1)>",
    "--><!-- ]]> {% raw %}{# #} &lt;b&gt; \u2028 &#60;",
    "' onmouseover='alert(1)' x=\" onfocus=\"alert(1)\" `",
    "javascript:alert(1)",
]


@pytest.mark.process
@pytest.mark.parametrize("text", TEXTS)
def test_nothing_of_a_name_is_rendered_as_html(text, two, tmp_path, asked, monkeypatch):
    given = []
    monkeypatch.setattr(build, "write_pages", lambda *arguments: given.extend(arguments) or {
        "rows": [], "summary": [], "failures": []
    })  # fmt: skip
    build_gallery([*two, "none.png"], tmp_path / "out", counts=[5, 7, 13])
    root, made, plan, grid = given
    records = grid.records.copy()

    def pages(word):
        for task, record in records.items():
            task.photo = dataclasses.replace(task.photo, name=word)
            odd = {"error": word} if "error" in record else {"notes": [word], "image": word}
            grid.records[task] = record and record | odd
        named = made | {"title": word, "command": word, "peers_absent": [word]}
        write_pages(root, named, plan, grid)
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


@pytest.mark.posix
@pytest.mark.process
def test_peer_is_measured_or_fails_or_is_stopped_on_one_line(
    photo, tmp_path, monkeypatch, capsys, asked
):
    monkeypatch.setattr("galleries.canned", make_svg)
    program(
        tmp_path / "bin" / "primitive",
        f"[ -e {tmp_path}/slow ] && exec sleep 600\n"
        f"[ $6 = 100 ] && echo '{BLANK}' > \"$4\" && exit\n"
        "echo no luck >&2; exit 3\n",
    )
    monkeypatch.setenv("PATH", str(tmp_path / "bin"), os.pathsep)
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
    made = [path.name for path in (out / "photos" / "good").iterdir() if path.is_dir()]
    assert made == ["primitive-100"]
    text = (out / "photos" / "good" / "primitive-100" / "report.json").read_text()
    assert str(tmp_path) not in text

    asked.clear()
    (tmp_path / "slow").touch()
    arguments = ["gallery", str(good), str(slow), *options, "0.5", "--peers", "primitive"]
    assert main([*arguments, "--quiet"]) == 1
    assert asked == [("photo", "slow"), ("variant", "slow/primitive-100")]
    err = capsys.readouterr().err
    assert err == (
        "gauss2svg: failed: slow.png, primitive 100: timed out after 0.5 s. Try a longer "
        "--peer-timeout\n"
    )
    page = (out / "photos" / "slow" / "index.html").read_text()
    assert "No SVG of this photo could be made" in page


def test_absent_peer_is_named_on_the_page_and_in_the_summary(
    two, tmp_path, asked, monkeypatch, capsys
):
    monkeypatch.setenv("PATH", str(tmp_path))
    out = tmp_path / "out"
    arguments = ["gallery", *map(str, two), "-o", str(out), "--counts", "5"]
    assert main([*arguments, "--peers", "primitive"]) == 0
    assert "skipped, not installed: primitive\n" in capsys.readouterr().err
    assert "not installed: primitive" in (out / "how.html").read_text()


@pytest.mark.parametrize("name", ["index.html", "how.html", "gallery.json", "gallery.csv"])
@pytest.mark.parametrize("content", ["mine", '{"rows": []}'])
def test_file_of_no_gallery_is_kept_untouched(name, content, two, tmp_path, asked, refusal):
    path = tmp_path / "out" / name
    path.parent.mkdir()
    path.write_text(content)
    line = refusal("gallery", two[0], "-o", path.parent)
    assert line.endswith("so it is kept. Try another folder\n")
    assert path.read_text() == content
    assert (asked, list(path.parent.iterdir())) == ([], [path])


def test_what_cannot_be_written_is_an_error_before_any_work(two, tmp_path, asked, refusal):
    out = tmp_path / "out"
    build_gallery(two, out, counts=[5])
    arguments = ["gallery", str(two[0]), "-o", str(out), "--counts", "6"]
    before = (out / "gallery.json").read_bytes()
    asked.clear()
    for name in ("how.html", "photos", "assets"):
        path = out / name
        moved = path.rename(tmp_path / "moved")
        path.mkdir() if name == "how.html" else path.write_text("mine")
        assert refusal(*arguments)
        assert asked == []
        path.rmdir() if name == "how.html" else path.unlink()
        moved.rename(path)
    assert (out / "gallery.json").read_bytes() == before


def test_read_only_folder_is_an_error_before_any_work(two, tmp_path, asked, refusal):
    (tmp_path / "out").mkdir(mode=0o500)
    if os.access(tmp_path / "out", os.W_OK):
        pytest.skip("the superuser can write to a read-only folder, and so can all on Windows")
    assert refusal("gallery", two[0], "-o", tmp_path / "out")
    assert asked == []


WRONG = [
    *(({"photos": bad}, "photos must be a sequence of paths; ") for bad in ("a.png", b"a", os, 5)),
    *(({"photos": bad}, "photos must be the paths of one or more photos; ") for bad in ([], None)),
    *(({"photos": [bad]}, "photos must be a sequence of paths; ") for bad in (None, 1.5)),
    ({"variants": ["quick"]}, "variant must be one of draft, fast, balanced, high, max; got"),
    ({"variants": [["draft"]]}, "variant must be one of "),
    ({"variants": "draft"}, "variants must be a sequence; got 'draft'. Try ['draft']"),
    ({"variants": []}, "variants must be at least one preset, count or peer; got none"),
    ({"counts": []}, "variants must be at least one preset, count or peer; got none"),
    *(({"counts": bad}, "counts must be a sequence; got ") for bad in (5, "500")),
    *(({"counts": [bad]}, "count must be a whole number in 0..") for bad in (-1, 2.5, True, 10**9)),
    ({"peers": "vtracer"}, "peers must be a sequence; got 'vtracer'"),
    *(({"peers": [bad]}, "peer must be one of vtracer, vtracer:default, ")
      for bad in ("jpeg", "vtracer:", "vtracer:fine", None)),
    ({"variants": [], "peers": ["primitive"]}, "variants must be at least one preset, count or peer"
     "; got only peers that are not installed: primitive"),
    *(({"title": bad}, "title must be text") for bad in (" ", None, 5, b"x", "\udcff", "a\nb")),
    *(({"jobs": bad}, "jobs must be a whole number") for bad in (True, 1.5)),
    ({"peer_timeout": "5"}, "peer_timeout must be a number"),
    ({"photo_size": 2.5}, "photo_size must be a whole number"),
    ({"directory": "a\0b"}, "cannot create a"),
]  # fmt: skip


@pytest.mark.parametrize(("wrong", "line"), WRONG)
def test_wrong_arguments_are_refused_on_one_line(wrong, line, two, tmp_path, asked, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    arguments = {"photos": two, "directory": tmp_path / "out"} | wrong
    with pytest.raises(Gauss2SvgError) as error:
        build_gallery(arguments.pop("photos"), arguments.pop("directory"), **arguments)
    assert str(error.value).startswith(line)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


def test_gallery_of_bad_photos_alone_has_an_index_that_says_so(tmp_path, asked, capsys):
    bad = tmp_path / "bad.png"
    bad.write_text("no picture")
    out = tmp_path / "out"
    paths = [bad, tmp_path / "none.png", "a\0b"]
    gallery = build_gallery(paths, out, counts=[5])
    assert [failure["photo"] for failure in gallery.failures] == [
        "bad.png",
        "none.png",
        "a\\x00b",
    ]
    assert gallery.rows == []
    assert "Failed: 3" in gallery.index.read_text()
    assert main(["gallery", str(bad), "-o", str(out), "--counts", "5"]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("gauss2svg: failed: bad.png: ")
    assert lines[1:] == [f"gauss2svg: 0 SVGs; 1 failed; open {out / 'index.html'}"]


@pytest.mark.process
def test_pages_of_photos_that_are_left_out_stay_where_they_were(two, tmp_path, asked):
    out = tmp_path / "out"
    build_gallery(two, out, counts=[5])
    asked.clear()
    assert build_gallery(two[:1], out, counts=[5]).kept == 1
    assert "photos/b" not in (out / "index.html").read_text()
    assert build_gallery(two, out, counts=[5]).kept == 2
    assert asked == []


def test_exact_svgs_are_charted_and_shown_as_equal(two, tmp_path, asked):
    out = tmp_path / "out"
    gallery = build_gallery(two, out, counts=[7])
    assert [row["psnr_svg"] for row in gallery.rows] == [None, None]
    assert Table(out / "index.html").rows[1][6] == "equal"
    assert Page(out / "trade-off.html").texts.count("equal") >= 3


@pytest.mark.parametrize("name", ["photos/holidays/a.jpg", "photos/a.jpg", "assets/gallery.css"])
def test_folder_of_somebody_else_is_kept(name, two, tmp_path, asked, refusal):
    path = tmp_path / "out" / name
    path.parent.mkdir(parents=True)
    path.write_text("mine")
    assert refusal("gallery", two[0], "-o", tmp_path / "out", "--counts", "5")
    assert asked == []
    assert path.read_text() == "mine"
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [name.split("/")[0]]


@pytest.mark.parametrize(
    ("error", "line", "more"),
    [
        (InputError("two\nlines.  Try one"), "two lines. Try one", {}),
        (MemoryError("5 GiB"), "out of memory (5 GiB). Try smaller photos or fewer Gaussians", {}),
        (ZeroDivisionError("a\nfault"), "ZeroDivisionError: a fault", {}),
        (OutputError("the disk is full"), "the disk is full", {"fatal": True}),  # for all others
    ],
)
def test_every_error_of_a_request_is_one_line(error, line, more):
    def fail(_):
        raise error

    assert record_or_error(fail, {}) == {"error": line, **more}
    assert record_or_error(make_photo, {})["error"].startswith("KeyError: ")
