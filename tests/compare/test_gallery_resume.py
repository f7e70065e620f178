"""What a gallery keeps and makes again, what an interruption leaves, and what is refused."""

import json
import shutil

import pytest
from flat import build_gallery
from galleries import Page, all_requests, save

from gauss2svg.cli.main import main
from gauss2svg.compare import grid, run
from gauss2svg.errors import Gauss2SvgError, OutputError

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
    assert (found, first.kept) == (everything, 0)
    found, second = made(threads=1, jobs=3, peer_timeout=5, title="other", max_pixels=10**6)
    assert (found, second.kept, second.rows) == ([], 6, first.rows)
    assert made(photos=two[::-1])[0] == []
    found, third = made(counts=[7, 9, 5])
    assert found == [("variant", "a/gaussians-9"), ("variant", "b/gaussians-9")]
    assert {str(row) for row in first.rows} < {str(row) for row in third.rows}
    added = save(photo[:5, :5], tmp_path / "c.png")
    assert made(photos=[added, *two])[0] == all_requests("c", slugs)

    seeded = [request for request in everything if request[0] == "variant"]
    assert made(seed=1)[0] == seeded
    assert made(seed=0)[0] == seeded
    assert made(photo_size=7)[0] == everything
    assert made(photo_size=6)[0] == everything
    assert made()[0] == everything
    save(photo[:8, :8], two[0])
    assert made()[0] == all_requests("a", slugs)
    monkeypatch.setattr(grid, "code_digest", lambda: "other code")
    assert made()[0] == everything


def test_lost_file_is_made_again_and_the_others_are_kept(two, tmp_path, asked):
    build_gallery(two, tmp_path / "out", counts=[5])
    for name, made in (("photo.webp", "a"), ("gaussians-5/picture.svg", "a/gaussians-5")):
        (tmp_path / "out" / "photos" / "a" / name).unlink()
        asked.clear()
        assert len(build_gallery(two, tmp_path / "out", counts=[5]).rows) == 2
        assert [folder for _, folder in asked] == [made]
    shutil.rmtree(tmp_path / "out" / "assets")
    asked.clear()
    build_gallery(two, tmp_path / "out", counts=[5])
    assert asked == []
    assert (tmp_path / "out" / "assets" / "gallery.css").is_file()


def test_failed_svg_is_tried_again_and_the_others_are_kept(two, tmp_path, asked, capsys):
    arguments = ["gallery", *map(str, two), "-o", str(tmp_path / "out"), "--counts", "13,5"]
    for _ in range(2):
        assert main([*arguments, "--quiet"]) == 1
        assert capsys.readouterr().err.splitlines() == [
            f"gauss2svg: failed: {n}.png, 13 Gaussians: un lucky \\udcff" for n in "ab"
        ]
        made = asked.take()
    assert made == [("variant", "a/gaussians-13"), ("variant", "b/gaussians-13")]


def interrupted_at(count):
    calls = []

    def progress(_):
        calls.append(0)
        if len(calls) == count:
            raise KeyboardInterrupt

    return progress


@pytest.mark.parametrize("count", [2, 7])
def test_interrupted_gallery_shows_what_is_finished_and_continues(count, two, tmp_path, asked):
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        build_gallery(two, out, counts=[5, 7], progress=interrupted_at(count))
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


def test_svg_that_an_interrupted_gallery_overwrote_is_made_again(two, tmp_path, asked, monkeypatch):
    first, make_svg = build_gallery(two, tmp_path / "out", counts=[5]), run.make_svg

    def interrupted(request):
        make_svg(request)
        raise KeyboardInterrupt

    monkeypatch.setattr(run, "make_svg", interrupted)
    with pytest.raises(KeyboardInterrupt):
        build_gallery(two, tmp_path / "out", counts=[5], seed=1)
    monkeypatch.setattr(run, "make_svg", make_svg)
    asked.clear()
    assert build_gallery(two, tmp_path / "out", counts=[5]).rows == first.rows
    assert asked == [("variant", "a/gaussians-5")]


def test_full_disk_ends_all_at_once(two, tmp_path, asked, monkeypatch, refusal):
    def fill(request):
        asked.append(request["source"])
        raise OutputError("cannot write x: No space left on device")

    monkeypatch.setattr(run, "make_photo", fill)
    assert "No space left" in refusal("gallery", *two, "-o", tmp_path / "out", "--counts", "5")
    assert asked == [str(two[0])]


def test_absent_peer_is_named_on_the_page_and_in_the_summary(
    two, tmp_path, asked, monkeypatch, capsys
):
    monkeypatch.setenv("PATH", str(tmp_path))
    out = tmp_path / "out"
    arguments = ["gallery", *map(str, two), "-o", str(out), "--counts", "5"]
    assert main([*arguments, "--peers", "primitive"]) == 0
    assert "skipped, not installed: primitive\n" in capsys.readouterr().err
    assert "not installed: primitive" in (out / "how.html").read_text()


@pytest.mark.parametrize("name", ["index.html", "gallery.json", "photos/a.jpg", "assets/a.css"])
def test_files_of_no_gallery_are_kept(name, two, tmp_path, asked, refusal):
    path = tmp_path / "out" / name
    path.parent.mkdir(parents=True)
    path.write_text('{"rows": []}')
    before = sorted((tmp_path / "out").rglob("*"))
    assert "Try another folder" in refusal("gallery", two[0], "-o", tmp_path / "out")
    assert (asked, path.read_text()) == ([], '{"rows": []}')
    assert sorted((tmp_path / "out").rglob("*")) == before


WRONG = [
    ({"photos": "a.png"}, "photos must be a sequence of paths; "),
    ({"photos": []}, "photos must be the paths of one or more photos; "),
    ({"variants": ["quick"]}, "variant must be one of draft, "),
    ({"variants": "draft"}, "variants must be a sequence; got 'draft'. Try ['draft']"),
    ({"counts": []}, "variants must be at least one preset, count or peer; got none"),
    ({"counts": [2.5]}, "count must be a whole number in 0.."),
    ({"peers": ["vtracer:fine"]}, "peer must be one of vtracer, "),
    ({"variants": [], "peers": ["primitive"]}, "variants must be at least one preset, count or peer"
     "; got only peers that are not installed: primitive"),
    ({"title": "a\nb"}, "title must be text"),
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
    assert Page(out / "index.html").rows[1][6] == "equal"
    assert Page(out / "trade-off.html").texts.count("equal") >= 3
