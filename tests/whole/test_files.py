"""Laws of files and streams: what is there afterwards is whole, whatever the target is."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from galleries import BLANK
from pictures import possible

from gauss2svg.cli.main import main
from gauss2svg.files import write_atomically

# These tests are of files; only commands in a shell rasterise in a process of their own.
pytestmark = pytest.mark.usefixtures("drawn_here")

TINY = ["--gaussians", "3", "--iterations", "2", "--quiet"]


def content(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def shell(command, folder):
    """A line of a shell in a folder, with GAUSS2SVG for a run on its photo."""
    program = f"{shlex.quote(sys.executable)} -P -m gauss2svg"
    photo = "" if "GAUSS2SVG check" in command else f"photo.png {' '.join(TINY)}"
    line = command.replace("GAUSS2SVG", f"{program} {photo}")
    return subprocess.run(["bash", "-c", line], cwd=folder, capture_output=True)


@pytest.mark.posix
def test_a_target_keeps_its_mode_its_link_and_its_readers_and_a_new_one_has_the_usual_mode(
    picture, tmp_path
):
    target, link = tmp_path / "o.svg", tmp_path / "link.svg"
    link.symlink_to("o.svg")
    before = os.umask(0o027)
    try:
        for mode in (None, 0o600, 0o755):
            if mode is not None:
                target.write_bytes(b"old")
                target.chmod(mode)
            assert main([str(picture), "-o", str(link), *TINY]) == 0
            assert (link.is_symlink(), target.stat().st_mode & 0o777) == (True, mode or 0o640)
            assert target.read_bytes().startswith(b"<?xml")
    finally:
        os.umask(before)
    with target.open("rb") as held:
        write_atomically(target, b"new")
        assert held.read().startswith(b"<?xml")


@pytest.mark.posix
def test_pipe_is_written_to_and_not_replaced(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", pipe], stdout=subprocess.PIPE) as reader:
        write_atomically(pipe, b"new")
        assert pipe.is_fifo()
        assert reader.communicate(timeout=60)[0] == b"new"


@pytest.mark.parametrize("name", ["größe-中文-🎨", "--report", "new\nline", "%41&<>;$HOME*['\"]"])
def test_any_name_is_read_and_written(name, picture, tmp_path, monkeypatch, refusal):
    monkeypatch.chdir(tmp_path)
    name = possible(name)
    photo, out = f"./{name}.png", f"./{name}.svg"
    picture.rename(photo)
    assert main([photo, "-o", out, *TINY, f"--report=./{name}.json"]) == 0
    assert main(["check", photo, out, "--quiet", f"--heatmap=./{name}.map.png"]) == 0
    found = sorted(path.name for path in tmp_path.iterdir())
    assert found == [f"{name}.{kind}" for kind in ("json", "map.png", "png", "svg")]
    if name.startswith("-"):
        for words in ([f"{name}.png", "-o", out], ["check", photo, f"{name}.svg"]):
            assert "must be an option; got an unknown one" in refusal(*words)


ALSO_PHOTO, ALSO_OUTPUT = "which is also the photo. Try", "which is also another output. Try"
MAKE = ("photo.png", "-o", "o.svg", *TINY)
CHECK = ("check", "photo.png", "drawing.svg")
REFUSED = [
    *(((*MAKE, "--report", name), ALSO_PHOTO)
      for name in ("photo.png", "hard.png", "soft.png", "there/photo.png")),
    *(((*MAKE, option, "o.svg"), ALSO_OUTPUT)
      for option in ("--report", "--outline")),
    (("photo.png", "-o", "hard.png", *TINY), ALSO_PHOTO),
    ((*CHECK, "--heatmap", "soft.png"), ALSO_PHOTO),
    (("-", "-o", "o.svg", *TINY, "--preview", "photo.png"), ALSO_PHOTO),
    (("photo.png", "-o", ""), "must be the name of a file or folder; got none. Try"),
    (("drawing.svg",), "the photo must be another image than an SVG; got drawing.svg. Try"),
    (("photo.png", "-o", "none/o.svg"), "o.svg: No such file or directory. Try"),
    (("photo.png", "-o", "locked.svg"), "locked.svg: it is read-only. Try another name"),
    ((*MAKE, "--preview", "p.png", "--save-scene", "s.npz", "--report", "/dev/full"), "No space"),
]  # fmt: skip


def needs_posix(words):
    """Whether a command names a link or a device."""
    return any(word.startswith(("soft", "there", "/")) for word in words)


@pytest.mark.parametrize(
    ("words", "line"),
    [pytest.param(*row, marks=[pytest.mark.posix] * needs_posix(row[0])) for row in REFUSED],
)
def test_what_cannot_be_written_is_one_line_and_changes_no_file(
    words, line, picture, tmp_path, monkeypatch, refusal
):
    monkeypatch.chdir(tmp_path)
    Path("drawing.svg").write_text(BLANK)
    Path("hard.png").hardlink_to(picture)
    Path("no").mkdir()
    if os.name == "posix":
        Path("soft.png").symlink_to(picture)
        Path("there").symlink_to(tmp_path)
    Path("locked.svg").write_text("old")
    access = os.access
    # Its owner may be the superuser here, who can write to anything.
    monkeypatch.setattr(
        os, "access", lambda path, mode: "locked" not in str(path) and access(path, mode)
    )
    before = content(tmp_path)
    with picture.open() as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        assert line in refusal(*words)
    assert content(tmp_path) == before


STREAMS = {
    "GAUSS2SVG -o - --report r.json >&-": "standard output must be open",
    "GAUSS2SVG check photo.png - --report r.json <&-": "standard input must be open",
    "GAUSS2SVG -o - --report r.json > /dev/full": "No space left on device",
    # The other file of the command fits in.
    "ulimit -f 1; GAUSS2SVG -o o.svgz --report r.json": "r.json: File too large. Try",
}


@pytest.mark.posix
@pytest.mark.process
def test_streams_that_fail_are_one_line_and_status_two_and_no_file(picture, tmp_path):
    before = content(tmp_path)
    for command, said in STREAMS.items():
        done = shell(command, tmp_path)
        assert (done.returncode, done.stderr.count(b"\n")) == (2, 1), (command, done.stderr)
        assert said in done.stderr.decode()
        assert content(tmp_path) == before
