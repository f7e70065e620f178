"""Laws of files and streams: what is there afterwards is whole, whatever the target is."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from names import possible
from odd_options import SVG
from PIL import Image

from gauss2svg import files
from gauss2svg.cli.main import main
from gauss2svg.files import write_atomically

# These tests are of files; only commands in a shell rasterise in a process of their own.
pytestmark = pytest.mark.usefixtures("drawn_here")

TINY = ["--gaussians", "3", "--iterations", "2", "--quiet"]


@pytest.fixture
def picture(photo, tmp_path):
    path = tmp_path / "photo.png"
    Image.fromarray(np.round(photo[40:56, 40:56] * 255).astype(np.uint8)).save(path)
    return path


@pytest.fixture
def svg(tmp_path):
    path = tmp_path / "drawing.svg"
    path.write_text(SVG)
    return path


def content(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def shell(command, **options):
    """A command line with GAUSS2SVG for the command, in a shell of its own."""
    program = f"{shlex.quote(sys.executable)} -m gauss2svg"
    return subprocess.run(
        ["bash", "-c", command.replace("GAUSS2SVG", program)],
        capture_output=True, check=False, timeout=100, **options,
    )  # fmt: skip


@pytest.mark.posix
def test_limit_of_a_files_size_is_a_full_disk(tmp_path):
    code = (
        "import resource, signal, sys; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
        "resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000)); "
        "from gauss2svg.files import write_all_atomically as w; "
        "w({sys.argv[1]: b'n' * 4000, sys.argv[2]: b'n' * 6000})"
    )
    first, second = tmp_path / "first", tmp_path / "second"
    first.write_text("old")
    done = subprocess.run(
        [sys.executable, "-c", code, first, second], capture_output=True, check=False
    )
    assert b"second: File too large. Try another folder" in done.stderr
    assert content(tmp_path) == {"first": b"old"}


@pytest.mark.posix
def test_a_target_keeps_its_permissions_and_a_new_one_has_the_usual(picture, tmp_path):
    before = os.umask(0o027)
    try:
        for mode in (None, 0o600, 0o755):
            target = tmp_path / f"{mode}.svg"
            target.write_bytes(b"old")
            target.chmod(mode or 0o644)
            held = target.open("rb")
            if mode is None:
                target.unlink()
            assert main([str(picture), "-o", str(target), *TINY]) == 0
            with held:
                assert held.read() == b"old"  # whoever has it open reads on in the old one
            assert target.read_bytes().startswith(b"<?xml")
            assert target.stat().st_mode & 0o777 == (mode or 0o640)
    finally:
        os.umask(before)


@pytest.mark.posix
def test_pipe_is_written_to_and_not_replaced(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", pipe], stdout=subprocess.PIPE) as reader:
        write_atomically(pipe, b"new")
        assert pipe.is_fifo()
        assert reader.communicate(timeout=60)[0] == b"new"


def test_two_writers_of_one_file_leave_that_of_the_last_whole(tmp_path, monkeypatch):
    target, replace = tmp_path / "o.svg", files.replace

    def replace_after_another(part, path):
        monkeypatch.undo()
        write_atomically(target, b"second")
        replace(part, path)

    monkeypatch.setattr(files, "replace", replace_after_another)
    write_atomically(target, b"first")
    assert content(tmp_path) == {"o.svg": b"first"}


NAMES = ['it\'s a "b"', "größe-中文-🎨", "--report", "new\nline", "%41&<>;$HOME*[red]"]


@pytest.mark.parametrize("name", NAMES)
def test_any_name_is_read_and_written(name, picture, tmp_path, monkeypatch, refusal):
    monkeypatch.chdir(tmp_path)
    name = possible(name)
    photo, out = f"./{name}.png", f"./{name}.svg"
    picture.rename(photo)
    assert main([photo, "-o", out, *TINY, f"--report=./{name}.json"]) == 0
    assert main(["check", photo, out, "--quiet", f"--heatmap=./{name}.map"]) == 0
    assert {path.suffix for path in tmp_path.iterdir()} == {".png", ".svg", ".json", ".map"}
    assert {path.stem for path in tmp_path.iterdir()} == {name}
    if name.startswith("-"):
        assert f"./{name}.png for a file" in refusal(f"{name}.png", "-o", out, *TINY)
        assert f"./{name}.svg" in refusal("check", photo, f"{name}.svg")


ALSO_PHOTO, ALSO_OUTPUT = "which is also the photo. Try", "which is also another output. Try"
MAKE = ("photo.png", "-o", "o.svg", *TINY)
CHECK = ("check", "photo.png", "drawing.svg")
REFUSED = [
    *(((*MAKE, "--report", name), ALSO_PHOTO)
      for name in ("photo.png", "hard.png", "soft.png", "there/photo.png", "./no/../photo.png")),
    *(((*MAKE, option, "o.svg"), ALSO_OUTPUT)
      for option in ("--report", "--preview", "--save-scene", "--outline")),
    (("photo.png", "-o", "hard.png", *TINY), ALSO_PHOTO),
    ((*CHECK, "--heatmap", "soft.png"), ALSO_PHOTO),
    (("-", "-o", "hard.png", *TINY), ALSO_PHOTO),
    (("check", "-", "drawing.svg", "--preview", "hard.png"), ALSO_PHOTO),
    (("check", "drawing.svg", "-", "--heatmap", "soft.png"), "which is also the SVG. Try"),
    (("none.png", "-o", "circle.svg"), "circle.svg: Too many levels of symbolic links"),
    (("photo.png", "-o", "."), "it is a folder. Try a file name"),
    (("photo.png", "-o", "none/o.svg"), "o.svg: No such file or directory. Try"),
    (("photo.png", "-o", "/proc/x"), "cannot write /proc/x"),
    (("photo.png", "-o", "locked.svg"), "locked.svg: it is read-only. Try another name"),
    ((*MAKE, "--preview", "p.png", "--save-scene", "s.npz", "--report", "/dev/full"), "No space"),
    ((*CHECK, "--heatmap", "p.png", "--report", "/dev/full"), "/dev/full: No space left"),
    ((".", "-o", "o.svg"), "one file; got .. Try gauss2svg batch PHOTOS -o FOLDER"),
    (("pipe", "-o", "o.svg"), "pipe: it is a pipe or a device, not a regular file"),
]  # fmt: skip


def needs_posix(words):
    """Whether a command names a link, a pipe or a device."""
    return any(word.startswith(("soft", "there", "circle", "pipe", "/")) for word in words)


@pytest.mark.parametrize(
    ("words", "line"),
    [pytest.param(*row, marks=[pytest.mark.posix] * needs_posix(row[0])) for row in REFUSED],
)
def test_what_cannot_be_written_is_one_line_and_changes_no_file(
    words, line, picture, svg, tmp_path, monkeypatch, refusal
):
    monkeypatch.chdir(tmp_path)
    Path("hard.png").hardlink_to(picture)
    Path("no").mkdir()
    if os.name == "posix":
        Path("soft.png").symlink_to(picture)
        Path("there").symlink_to(tmp_path)
        Path("circle.svg").symlink_to("circle.svg")
        os.mkfifo("pipe")  # without a writer: whoever opens it waits for ever
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


def test_names_that_differ_by_case_are_one_where_the_file_system_says_so(
    picture, tmp_path, monkeypatch, refusal
):
    command = [picture, "-o", tmp_path / "o.svg", "--outline", tmp_path / "O.SVG", *TINY]
    folds = files.folds_case(tmp_path)
    monkeypatch.setattr(files, "folds_case", lambda folder: True)
    assert "O.SVG, which is also another output" in refusal(*command)
    monkeypatch.undo()
    if not folds:
        assert main([str(word) for word in command]) == 0
        assert {"o.svg", "O.SVG"} <= set(content(tmp_path))


@pytest.mark.posix
@pytest.mark.process
def test_closed_and_broken_streams_are_one_line_and_status_two(picture, tmp_path):
    photo, report = shlex.quote(str(picture)), shlex.quote(str(tmp_path / "r.json"))
    tiny = " ".join(TINY)
    before = content(tmp_path)
    for command, said in {
        f"GAUSS2SVG {photo} -o - {tiny} --report {report} >&-": "standard output must be open",
        f"GAUSS2SVG check {photo} - --report {report} <&-": "standard input must be open",
        f"GAUSS2SVG {photo} -o - {tiny} --report {report} > /dev/full": "No space left on device",
        # Its reader is gone long before it writes.
        f"set -o pipefail; GAUSS2SVG {photo} -o - {tiny} --report {report} | true": "Broken pipe",
    }.items():
        done = shell(command)
        assert done.returncode == 2, command
        err = done.stderr.decode()
        assert said in err
        assert err.count("\n") == 1, err
        assert content(tmp_path) == before


@pytest.mark.posix
@pytest.mark.process
def test_closed_streams_do_not_get_into_files(picture, tmp_path):
    out, report = tmp_path / "o.svg", tmp_path / "r.json"
    limit = " --target-psnr 99"  # is reported on standard error in spite of --quiet
    names = " ".join(shlex.quote(str(path)) for path in (picture, "-o", out, "--report", report))
    done = shell(f"GAUSS2SVG {names} {' '.join(TINY)}{limit} <&- >&- 2>&-")
    assert done.returncode == 0
    assert out.read_bytes().startswith(b"<?xml")
    assert out.read_bytes().endswith(b"</svg>\n")
    piped = shell(f"GAUSS2SVG {shlex.quote(str(picture))} -o - {' '.join(TINY)}{limit} 2>&-")
    assert piped.returncode == 0
    assert piped.stdout == out.read_bytes()
