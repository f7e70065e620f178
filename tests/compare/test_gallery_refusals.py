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
from gauss2svg.compare.run import make_svg
from gauss2svg.errors import Gauss2SvgError
from gauss2svg.photo.load import load_image

TEXTS = [
    "<script>alert(1)</script>&\"'{{7*7}}",
    "</title></style></textarea><img src=x onerror=alert(1)>",
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
def test_peer_is_measured_or_fails_on_one_line(photo, tmp_path, monkeypatch, capsys, asked):
    monkeypatch.setattr("galleries.canned", make_svg)
    drawn = f"[ $6 = 100 ] && echo '{BLANK}' > \"$4\" && exit\necho no luck >&2; exit 3\n"
    program(tmp_path / "bin" / "primitive", drawn)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"), os.pathsep)
    good, out = save(photo[:40, :48], tmp_path / "good.png"), tmp_path / "out"
    peers = ["--variants", "", "--peers", "primitive,primitive:500"]
    assert main(["gallery", str(good), "-o", str(out), *peers]) == 1
    err = capsys.readouterr().err.splitlines()
    assert len(err) == 2
    assert err[0].startswith("gauss2svg: failed: good.png, primitive 500: ")
    assert "status 3: no luck" in err[0]
    (row,) = json.loads((out / "gallery.json").read_text())["rows"]
    error = np.mean((1 - load_image(good).pixels.astype(np.float64)) ** 2)
    assert row["psnr_svg"] == pytest.approx(-10 * np.log10(error), abs=1e-4)
    assert (row["tool"], row["svg_bytes"]) == ("primitive", len(BLANK) + 1)
    assert set(row["files"]) == {"SVG", "report"}
    assert str(tmp_path) not in (out / row["files"]["report"]).read_text()


def test_absent_peer_is_named_on_the_page_and_in_the_summary(
    two, tmp_path, asked, monkeypatch, capsys
):
    monkeypatch.setenv("PATH", str(tmp_path))
    out = tmp_path / "out"
    arguments = ["gallery", *map(str, two), "-o", str(out), "--counts", "5"]
    assert main([*arguments, "--peers", "primitive"]) == 0
    assert "skipped, not installed: primitive\n" in capsys.readouterr().err
    assert "not installed: primitive" in (out / "how.html").read_text()


@pytest.mark.parametrize("content", ["mine", '{"rows": []}'])
@pytest.mark.parametrize("name", ["index.html", "gallery.json", "photos/a.jpg", "assets/a.css"])
def test_files_of_no_gallery_are_kept(name, content, two, tmp_path, asked, refusal):
    path = tmp_path / "out" / name
    path.parent.mkdir(parents=True)
    path.write_text(content)
    before = sorted((tmp_path / "out").rglob("*"))
    assert "Try another folder" in refusal("gallery", two[0], "-o", tmp_path / "out")
    assert (asked, path.read_text()) == ([], content)
    assert sorted((tmp_path / "out").rglob("*")) == before


WRONG = [
    *(({"photos": bad}, "photos must be a sequence of paths; ") for bad in ("a.png", os, [1.5])),
    *(({"photos": bad}, "photos must be the paths of one or more photos; ") for bad in ([], None)),
    *(({"variants": bad}, "variant must be one of draft, ") for bad in (["quick"], [["draft"]])),
    ({"variants": "draft"}, "variants must be a sequence; got 'draft'. Try ['draft']"),
    ({"counts": []}, "variants must be at least one preset, count or peer; got none"),
    ({"counts": "500"}, "counts must be a sequence; got "),
    *(({"counts": [bad]}, "count must be a whole number in 0..") for bad in (-1, 2.5, True)),
    *(({"peers": [bad]}, "peer must be one of vtracer, ") for bad in ("vtracer:fine", None)),
    ({"variants": [], "peers": ["primitive"]}, "variants must be at least one preset, count or peer"
     "; got only peers that are not installed: primitive"),
    *(({"title": bad}, "title must be text") for bad in (" ", b"x", "\udcff", "a\nb")),
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


def test_exact_svgs_are_charted_and_shown_as_equal(two, tmp_path, asked):
    out = tmp_path / "out"
    gallery = build_gallery(two, out, counts=[7])
    assert [row["psnr_svg"] for row in gallery.rows] == [None, None]
    assert Table(out / "index.html").rows[1][6] == "equal"
    assert Page(out / "trade-off.html").texts.count("equal") >= 3
