"""Laws of lists of placeholders: what is kept, what is refused, and what one bad photo costs."""

import json
from pathlib import Path

import numpy as np
import pytest

from gauss2svg.batch import placeholders as lists
from gauss2svg.cli.main import main
from gauss2svg.cli.terminal import Terminated
from gauss2svg.errors import InputError
from gauss2svg.files import as_png
from gauss2svg.pipeline.placeholder import Placeholder

pytestmark = pytest.mark.usefixtures("hasty")
EMPTY = {
    "json": "[]", "object": "{}", "html": '<img src="a.png">\n',
    "picture": '<picture><img src="a.png"></picture>\n',
    "svg": '<svg viewBox="0 0 1 1"><desc>written by gauss2svg</desc></svg>',
}  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder, which has two photos, and a file that is none."""
    monkeypatch.chdir(tmp_path)
    y, x = np.mgrid[:24, :36] / 24
    for name, turn in (("one", 0.0), ("two words", 1.0)):
        Path(f"{name}.png").write_bytes(as_png(np.stack([x / 1.5, y, 0 * x + turn], axis=-1)))
    Path("bad.png").write_bytes(b"no picture")
    return tmp_path


@pytest.fixture
def counted(monkeypatch):
    """The photos of which placeholders are made, which are all one."""
    asked = []

    def made(path, *_, **__):
        if Path(path).read_bytes().startswith(b"no picture"):
            raise InputError("photo must be a supported image")
        asked.append(Path(path).name)
        return Placeholder("<svg/>", 36, 24, "#888888", 1)

    monkeypatch.setattr(lists, "placeholder", made)
    return asked


def make(words, *names) -> int:
    """The status of the command, of words between spaces and of names."""
    return main(["placeholder", *words.split(), *names])


@pytest.mark.parametrize(
    ("form", "data"),
    [
        *(("json", data) for data in (b"no JSON", b"[1]", b"{}", b"[" * 100_000)),
        *(("object", data) for data in (b"[]", b'{"a": 1}')),
        ("html", b'<img src="a.png">\n<p>mine</p>'),
    ],
)
def test_another_file_is_kept_and_refused_before_any_work(form, data, folder, refusal, monkeypatch):
    monkeypatch.setattr(lists, "placeholder", pytest.fail)
    Path("mine").write_bytes(data)
    line = refusal("placeholder", "one.png", "--format", form, "-o", "mine")
    assert f"--output must be a file of placeholders in {form}, or none yet" in line
    assert Path("mine").read_bytes() == data


@pytest.mark.parametrize("form", EMPTY)
def test_where_every_photo_fails_nothing_is_written(form, folder, capfdbinary):
    Path("svgs").mkdir()
    output, file = ("svgs", Path("svgs/bad.svg")) if form == "svg" else ("o", Path("o"))
    file.write_text(EMPTY[form])
    assert make(f"bad.png --format {form} -o {output}") == 1
    assert file.read_text() == EMPTY[form]
    assert make(f"one.png --format {form} --max-bytes 20") == 1
    out, err = capfdbinary.readouterr()
    assert (out, err.count(b"0 placeholders")) == (b"", 2)
    assert b"--max-bytes must be at least" in err


@pytest.mark.parametrize("output", ["o.json", "o.html"])
def test_a_photo_that_fails_keeps_its_entry_and_one_that_is_not_given_loses_it(
    output, folder, capsys, counted
):
    command = f"bad.png -o {output}"
    make(command, "two words.png", "one.png")
    before = Path(output).read_text()
    Path("one.png").write_bytes(b"no picture any more")
    assert make(command, "two words.png", "one.png") == 1
    assert Path(output).read_text() == before
    assert "2 failed" in capsys.readouterr().err
    assert make(command, "two words.png") == 1
    assert "one.png" not in Path(output).read_text()


@pytest.mark.parametrize("form", ["json", "object"])
def test_what_has_not_changed_is_kept_and_found_by_its_path(
    form, folder, capsys, counted, monkeypatch
):
    Path("bad.png").unlink()
    output = Path("made/list")

    def made(more="") -> int:
        counted.clear()
        assert make(f". --format {form} -o {output}{more}") == 0
        return len(counted)

    def paths() -> list[str]:
        records = json.loads(output.read_text())
        listed = records.values() if form == "object" else records
        return [one["metadata"]["path"] for one in listed]

    assert (made(), paths()) == (2, ["../one.png", "../two words.png"])
    written = output.stat()
    assert made() == 0
    assert output.stat().st_ino == written.st_ino  # not even written anew
    output.write_bytes(output.read_text().encode("utf-16"))  # as PowerShell saves it
    assert made() == 0
    assert paths() == ["../one.png", "../two words.png"]
    Path("one.png").write_bytes(Path("two words.png").read_bytes())
    assert (made(), made(" --max-bytes 500"), made()) == (1, 2, 2)
    monkeypatch.setattr(lists, "__version__", "0")
    assert (made(), made(" --root ."), paths()) == (2, 2, ["one.png", "two words.png"])


@pytest.mark.parametrize(("error", "status"), [(KeyboardInterrupt, 130), (Terminated, 143)])
def test_what_was_made_before_an_interrupt_is_written_and_kept(
    error, status, folder, capsys, counted, monkeypatch
):
    made, both = lists.placeholder, ("one.png", "two words.png")

    def interrupted(path, *given, **named):
        if Path(path).name != "one.png":
            raise error
        return made(path, *given, **named)

    with monkeypatch.context() as patch:
        patch.setattr(lists, "placeholder", interrupted)
        assert make("-o o.json", *both) == status
        [entry] = json.loads(Path("o.json").read_text())
        assert entry["metadata"]["path"] == "one.png"
        # Standard output is written whole or not at all.
        assert make("", *both) == status
        assert capsys.readouterr().out == ""
    counted.clear()
    assert make("-o o.json", *both) == 0
    assert counted == ["two words.png"]


def test_a_picture_offers_the_better_files_of_its_name_by_escaped_addresses(folder, counted):
    for name in ("one.webp", "one.avif", "alone.avif"):
        Path(name).write_bytes(Path("one.png").read_bytes() + name.encode())
    assert make("alone.avif one.png --format picture -o page.html") == 0
    alone, one = Path("page.html").read_text().splitlines()
    assert alone.startswith('<picture><img src="alone.avif"')
    avif, webp = (f'<source srcset="one.{kind}" type="image/{kind}">' for kind in ("avif", "webp"))
    assert one.startswith(f'<picture>{avif}{webp}<img src="one.png"')
    assert one.endswith("></picture>")
    assert make("--format html -o pages/page.html", "two words.png") == 0
    assert 'src="../two%20words.png"' in Path("pages/page.html").read_text()


@pytest.mark.parametrize(
    ("output", "file", "begins"),
    [
        ("o.svg", "o.svg", "<svg"), ("o.html", "o.html", "<img"), ("o.json", "o.json", "["),
        ("o", "o", "["), ("svgs/", "svgs/one.svg", "<svg"),
    ],
)  # fmt: skip
def test_the_name_of_the_output_says_the_format(output, file, begins, folder, counted):
    assert make(f"one.png -o {output}") == 0
    assert Path(file).read_text().startswith(begins)


def test_an_svg_of_another_program_is_not_replaced_in_a_folder(folder, counted, refusal):
    Path("one.svg").write_text("<svg>mine</svg>")
    assert "without SVGs of others" in refusal("placeholder", "one.png", "-o", ".")
    assert Path("one.svg").read_text() == "<svg>mine</svg>"
