"""What a batch reads and how outputs are named; what it refuses, in one line, before it runs."""

import io
import os
import sys

import pytest
from batches import TINY_COMMAND, save_photo, save_photos

from gauss2svg.batch import many
from gauss2svg.batch.inputs import passed_over, photos_of
from gauss2svg.cli.main import main
from gauss2svg.errors import InputError
from gauss2svg.pipeline.options import Options

TEXTS = {
    "bad.toml": b"quality = draft",
    "table.toml": b'[goal]\nquality = "draft"',
    "latin.txt": b"in/a.png\n# \xe4\n/\xe4.png",
    "wide.txt": "in/a.png".encode("utf-16-be"),
}


def names(*sources):
    return sorted(name for _, name in photos_of(map(str, sources)))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a.jpg", "b/c.PNG", "b/d/e.jpeg", ".hidden.png", ".d/f.png", "note.md", "g.svg"):
        path = tmp_path / "in" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"12345")
    return tmp_path / "in"


def test_folders_and_patterns_give_their_pictures_but_no_hidden_ones(folder):
    assert names("in") == names("in/") == names(folder) == ["a", "b/c", "b/d/e"]
    assert passed_over(["in", "in/*"]) == "1 file passed over: .md"
    (folder / "README").touch()
    assert passed_over(["in"]) == "2 files passed over: .md, none"
    # Names are relative to the part without wildcards.
    assert names("in/*.jpg", "in/b/*") == ["a", "c"]
    assert names("in/**/*.jp*g") == ["a", "b/d/e"]
    (folder / "none").mkdir()
    for source in ("in/none", "memory://nothing/*"):  # also beside others
        with pytest.raises(InputError, match="must be one or more; got none in "):
            names("in", source)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_list_keeps_whole_names_without_root_and_steps_upwards(folder, monkeypatch, encoding):
    lines = (
        "in/a.jpg\n# not/this.png\r\n\n/x y/b.png\n../up/./c.png\ns3://bucket/d/e.png\r\n"
        'no.picture\n"copied ö/as path.png"\r\n  blanks/around.png \n'
    ).encode(encoding)
    expected = ["blanks/around", "bucket/d/e", "copied ö/as path", "in/a", "no", "up/c", "x y/b"]
    (folder / "list.txt").write_bytes(lines)
    assert names("in/list.txt") == expected
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(lines)))
    assert names("-") == expected


@pytest.mark.posix
def test_photo_counts_once_and_links_are_photos_but_no_folders(folder, tmp_path):
    os.symlink("gone", folder / "b/z.png")
    assert names("in") == ["a", "b/c", "b/d/e", "b/z"]
    assert names("in/b/*.png", "in/b/z.png") == ["z", "z"]
    job = many.Batch(["in", "in/a.jpg", "in/**/*.jpg"], tmp_path / "out", Options())
    assert job.summary.count == 4
    os.symlink(folder, folder / "b/circle")
    assert names("in") == ["a", "b/c", "b/d/e", "b/z"]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("empty -o out", "photos must be one or more; got none in empty. Try"),
        ("gone.txt -o out", "cannot read gone.txt: No such file or directory. Try"),
        ("in in2 -o out", "in2/a.png, which would both write a.svg. Try renaming one, or a run"),
        pytest.param(
            "in/*/../../x.png -o out", "output must be in the output folder and outside ",
            marks=pytest.mark.posix,  # Windows reads this as the name of a file
        ),
        ("state -o out", "output must be in the output folder and outside of its gauss2"),
        ("in -o in/a.png", "cannot create "),
        ("what://x/in -o out", "cannot read what://x/in: Protocol not known: what. Try"),
        ("in -o out --workers 0", "workers must be a whole number in 1.."),
        ("in -o out --options gone.toml", "cannot read gone.toml: No such file"),
        ("in -o out --options bad.toml", "cannot take the options of bad.toml: Invalid value"),
        ("in -o out --options table.toml", "options of table.toml: option must be one of quality,"),
        ("in/a.png upper/A.png -o out", "upper/A.png, which would both write A.svg. Try"),
        ("in in2 upper/A.png -o out", "got in/a.png and in2/a.png, which would both write a.svg, "
         "and 1 other pair. Try renaming one"),
        ("latin.txt -o out", "latin.txt must be a text in UTF-8; got another encoding at byte 12"),
        ("wide.txt -o out", "wide.txt must be a text in UTF-8; got null characters. Try saving it"),
    ],
)  # fmt: skip
def test_what_cannot_work_is_refused_in_one_line(words, line, tmp_path, monkeypatch, refusal):
    monkeypatch.chdir(tmp_path)
    save_photos(tmp_path / "in", ["a.png", "b/c.png"])
    monkeypatch.setattr(many, "Pool", None)  # before any worker is started
    (tmp_path / "empty").mkdir()
    for name in ("in2/a.png", "upper/A.png", "x.png", "state/gauss2svg-batch/parts/x.png"):
        save_photo(tmp_path / name, 3)
    for name, text in TEXTS.items():
        (tmp_path / name).write_bytes(text)
    assert line in refusal("batch", *words.split()).replace(f"{tmp_path}/", "")
    assert not (tmp_path / "out").exists()


def test_options_of_a_file_count_unless_they_are_given(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_photos(tmp_path / "in", ["a.png"])
    text = 'quality = "draft"\r\nmax-bytes = "60k"\ngzip = true\nstops = 8\nrelocate = false\n'
    (tmp_path / "o.toml").write_bytes(text.encode("utf-16"))
    seen = []
    monkeypatch.setattr(many, "Batch", lambda *given: seen.append(given[2].flat()) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        main(["batch", "in", "-o", "out", "--options", "o.toml", "--stops", "6"])
    wanted = {"quality": "draft", "max_bytes": 60_000, "gzip": True, "relocate": False, "stops": 6}
    assert wanted.items() <= seen[0].items()


def test_extra_that_is_missing_is_named_in_a_line(tmp_path, monkeypatch, refusal, pool_here):
    monkeypatch.chdir(tmp_path)
    save_photos(tmp_path / "in", ["a.png"])
    for name in ("fsspec.core", "fastapi", "shapely"):
        monkeypatch.setitem(sys.modules, name, None)
    for words, extra in (
        ("batch in -o s3://bucket/out", "s3"),
        ("studio", "studio"),
        ("in/a.png -o out.svg --inks 2 --separations p.svg --cut", "cut"),
    ):
        assert f'Try pip install "gauss2svg[{extra}]"' in refusal(*words.split())
    assert main(["batch", "in", "-o", "out", *TINY_COMMAND]) == 0
