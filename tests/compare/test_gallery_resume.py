"""What a gallery keeps and makes again, what an interruption leaves, and what is refused."""

import json
from contextlib import nullcontext
from itertools import chain, repeat
from unittest import mock

import pytest
from flat import build_gallery
from galleries import Page, all_requests, save

from gauss2svg.cli.main import main
from gauss2svg.compare import grid

pytestmark = pytest.mark.process


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
    everything = all_requests("ab", slugs)
    found, first = made()
    assert found == everything
    found, second = made(threads=1, jobs=3, peer_timeout=5, title="other", max_pixels=10**6)
    assert (found, second.rows) == ([], first.rows)
    assert made(photos=two[::-1])[0] == []
    found, third = made(counts=[7, 9, 5])
    assert found == [("variant", "a/gaussians-9"), ("variant", "b/gaussians-9")]
    assert {str(row) for row in first.rows} < {str(row) for row in third.rows}
    assert made(photo_size=7)[0] == everything
    assert made()[0] == everything
    save(photo[:8, :8], two[0])
    assert made()[0] == all_requests("a", slugs)
    monkeypatch.setattr(grid, "code_digest", lambda: "other code")
    assert made()[0] == everything


def test_failed_svg_is_tried_again_and_the_others_are_kept(two, tmp_path, asked, capsys):
    arguments = ["gallery", *map(str, two), "-o", str(tmp_path / "out"), "--counts", "13,5"]
    for _ in range(2):
        assert main([*arguments, "--quiet"]) == 1
        assert capsys.readouterr().err.splitlines() == [
            f"gauss2svg: failed: {n}.png, gaussians 13: un lucky \\udcff" for n in "ab"
        ]
        made = asked.take()
    assert made == [("variant", "a/gaussians-13"), ("variant", "b/gaussians-13")]


def test_interrupted_gallery_shows_what_is_finished_and_continues(
    two, tmp_path, asked, monkeypatch
):
    out = tmp_path / "out"
    update = mock.Mock(side_effect=chain(repeat(None, 6), [KeyboardInterrupt], repeat(None)))
    with monkeypatch.context() as patch:
        patch.setattr(grid, "counting", lambda quiet: nullcontext(update))
        with pytest.raises(KeyboardInterrupt):
            build_gallery(two, out, counts=[5, 7])
    done = asked.take()
    document = json.loads((out / "gallery.json").read_text())
    assert len(document["rows"]) == sum(kind == "variant" for kind, _ in done)
    assert document["missing"] == 4 - len(document["rows"])
    assert ("Not finished." in Page(out / "index.html").texts) == (document["missing"] > 0)
    for row in document["rows"]:
        assert (out / row["page"]).is_file()
        assert row["page"] in (out / "index.html").read_text()
    gallery = build_gallery(two, out, counts=[5, 7])
    assert len(gallery.rows) == 4
    assert "Not finished." not in Page(out / "index.html").texts
    assert sorted(asked + done) == all_requests("ab", ["gaussians-5", "gaussians-7"])


def test_a_file_that_has_no_record_any_more_is_made_again(two, tmp_path, asked, monkeypatch):
    """An earlier record is not that of a file which was replaced before an interruption."""
    given = {"photos": two[:1], "directory": tmp_path / "out", "counts": [5]}
    build_gallery(**given)
    add_row = grid.add_row

    def interrupted(path, row):
        if "report" in row:
            raise KeyboardInterrupt
        add_row(path, row)

    with monkeypatch.context() as patch:
        patch.setattr(grid, "add_row", interrupted)
        patch.setattr(grid, "code_digest", lambda: "other code")
        with pytest.raises(KeyboardInterrupt):
            build_gallery(**given)
    asked.clear()
    build_gallery(**given)
    assert asked == [("photo", "a"), ("variant", "a/gaussians-5")]


@pytest.mark.parametrize("name", ["index.html", "gallery.json", "photos/a.jpg"])
def test_files_of_no_gallery_are_kept(name, two, tmp_path, asked, refusal):
    path = tmp_path / "out" / name
    path.parent.mkdir(parents=True)
    path.write_text('{"rows": []}')
    before = sorted((tmp_path / "out").rglob("*"))
    assert "Try another folder" in refusal("gallery", two[0], "-o", tmp_path / "out")
    assert (asked, path.read_text()) == ([], '{"rows": []}')
    assert sorted((tmp_path / "out").rglob("*")) == before
