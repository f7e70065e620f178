"""Laws of files and streams: what is there afterwards is whole, whatever the target is."""

import errno
import os
import shlex
import subprocess
import sys

import numpy as np
import pytest
from conftest import random_scene
from PIL import Image

from gauss2svg import files
from gauss2svg.cli.main import main
from gauss2svg.errors import OutputError
from gauss2svg.files import write_all_atomically, write_atomically
from gauss2svg.scene import Scene

# These tests are of files; only commands in a shell rasterise in a process of their own.
pytestmark = pytest.mark.usefixtures("drawn_here")

TINY = ["--gaussians", "3", "--iterations", "2", "--quiet"]
SCENE = random_scene(5)


@pytest.fixture
def picture(photo, tmp_path):
    path = tmp_path / "photo.png"
    Image.fromarray(np.round(photo[40:56, 40:56] * 255).astype(np.uint8)).save(path)
    return path


@pytest.fixture
def svg(tmp_path):
    path = tmp_path / "drawing.svg"
    path.write_text('<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 8 8"/>')
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


WRITERS = ["write_atomically", "Scene.save", "vectorize", "check"]


def write(how, target, picture, svg):
    """Write to the target in one of four ways; an OutputError where the status is 2."""
    if how == "write_atomically":
        return write_atomically(target, b"new")
    if how == "Scene.save":
        return SCENE.save(target)
    command = [picture, "-o", target, *TINY]
    if how == "check":
        command = ["check", picture, svg, "--report", target, "--quiet"]
    if main([str(word) for word in command]) != 0:
        raise OutputError("status 2")
    return None


@pytest.fixture
def full(monkeypatch):
    """A disk that takes ten bytes of each file and then is full."""
    written = {}

    def write_some(descriptor, data):
        left = 10 - written.get(descriptor, 0)
        if left <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written[descriptor] = written.get(descriptor, 0) + min(left, len(data))
        return real(descriptor, data[:left])

    real = os.write
    monkeypatch.setattr(files.os, "write", write_some)


@pytest.mark.parametrize("how", WRITERS[1:])
def test_full_disk_leaves_the_old_file_and_no_other(how, picture, svg, tmp_path, full):
    target = tmp_path / "target"
    target.write_bytes(b"old")
    before = content(tmp_path)
    with pytest.raises(OutputError):
        write(how, target, picture, svg)
    assert content(tmp_path) == before


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


@pytest.mark.parametrize("how", WRITERS)
def test_folder_missing_folder_and_read_only_file_are_refused(
    how, picture, svg, tmp_path, monkeypatch
):
    locked = tmp_path / "locked"
    locked.write_text("old")
    access = os.access
    # Its owner may be the superuser here, who can write to anything.
    monkeypatch.setattr(
        os, "access", lambda path, mode: os.fspath(path) != str(locked) and access(path, mode)
    )
    before = content(tmp_path)
    for target in (tmp_path, tmp_path / "none" / "x", locked, "/proc/x", "/dev/full"):
        with pytest.raises(OutputError):
            write(how, target, picture, svg)
    assert content(tmp_path) == before


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser can write to a read-only folder")
def test_read_only_folder_is_refused(tmp_path):
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o500)
    with pytest.raises(OutputError, match="Permission denied"):
        write_atomically(folder / "x", b"new")


@pytest.mark.parametrize("how", WRITERS)
def test_existing_target_is_replaced_and_keeps_its_permissions(how, picture, svg, tmp_path):
    for mode in (0o600, 0o640, 0o755):
        target = tmp_path / f"target{mode:o}"
        target.write_bytes(b"old")
        target.chmod(mode)
        held = target.open("rb")
        write(how, target, picture, svg)
        with held:
            assert held.read() == b"old"  # whoever has it open reads on in the old one
        assert target.read_bytes() not in (b"", b"old")
        assert target.stat().st_mode & 0o777 == mode


@pytest.mark.parametrize("umask", [0o022, 0o077, 0o027])
def test_new_target_has_the_usual_permissions(umask, tmp_path):
    before = os.umask(umask)
    try:
        write_atomically(tmp_path / "new", b"new")
    finally:
        os.umask(before)
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o666 & ~umask


def test_hard_link_keeps_the_old_file(tmp_path):
    one, other = tmp_path / "one", tmp_path / "other"
    one.write_bytes(b"old")
    other.hardlink_to(one)
    write_atomically(one, b"new")
    assert content(tmp_path) == {"one": b"new", "other": b"old"}


def test_none_is_renamed_before_all_are_written(tmp_path, monkeypatch):
    pipe, full = tmp_path / "pipe", tmp_path / "full"
    os.mkfifo(pipe)
    full.symlink_to("/dev/full")
    (tmp_path / "b").write_bytes(b"old")
    with subprocess.Popen(["cat", pipe], stdout=subprocess.PIPE) as reader:
        with pytest.raises(OutputError, match="full: No space left"):
            write_all_atomically(
                {tmp_path / "a": b"new", tmp_path / "b": b"new", pipe: b"new", full: b"new"}
            )
        assert reader.communicate(timeout=60)[0] == b"new"
    assert content(tmp_path) == {"b": b"old"}


def test_full_report_leaves_every_output_as_it_was(picture, svg, tmp_path, refusal):
    before = content(tmp_path)
    names = [tmp_path / name for name in ("o.svg", "p.png", "s.npz", "l.svg")]
    options = zip(("-o", "--preview", "--save-scene", "--outline"), names, strict=True)
    command = [
        picture,
        *TINY,
        "--report",
        "/dev/full",
        *(word for pair in options for word in pair),
    ]
    assert "cannot write /dev/full: No space left" in refusal(*command)
    command = ["check", picture, svg, "--heatmap", names[1], "--report", "/dev/full"]
    assert "cannot write /dev/full: No space left" in refusal(*command)
    assert content(tmp_path) == before


NAMES = [
    "a b", "it's", 'say "hi"', "größe-中文-🎨", "-dash", "--report", "new\nline", "%41&<>;$HOME*",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_any_name_is_read_and_written(name, picture, tmp_path, monkeypatch, refusal):
    monkeypatch.chdir(tmp_path)
    photo, out = f"./{name}.png", f"./{name}.svg"
    picture.rename(photo)
    assert main([photo, "-o", out, *TINY, f"--report=./{name}.json"]) == 0
    assert main(["check", photo, out, "--quiet", f"--heatmap=./{name}.map"]) == 0
    assert {path.suffix for path in tmp_path.iterdir()} == {".png", ".svg", ".json", ".map"}
    assert {path.stem for path in tmp_path.iterdir()} == {name}
    if name.startswith("-"):
        assert f"./{name}.png for a file" in refusal(f"{name}.png", "-o", out, *TINY)
        assert f"./{name}.svg" in refusal("check", photo, f"{name}.svg")


@pytest.mark.parametrize(
    ("option", "link"),
    [
        *(
            (option, "hard")
            for option in ("-o", "--report", "--preview", "--save-scene", "--outline")
        ),
        *(("--report", link) for link in ("symbolic", "spelling", "folder")),
    ],
)
def test_output_that_is_the_photo_or_another_output_is_refused(
    option, link, picture, svg, tmp_path, refusal
):
    def other_name(path):
        other = tmp_path / f"other-{path.name}"
        if link == "hard":
            other.hardlink_to(path)
        elif link == "symbolic":
            other.symlink_to(path)
        elif link == "folder":
            (tmp_path / "there").symlink_to(tmp_path)
            return tmp_path / "there" / path.name
        else:
            return f"{tmp_path}/./no/..//{path.name}"
        return other

    if link == "spelling":
        (tmp_path / "no").mkdir()
    before = content(tmp_path)
    out = [] if option == "-o" else ["-o", tmp_path / "o.svg"]
    same = other_name(picture)
    err = refusal(picture, *out, option, same, *TINY)
    assert "which is also the photo. Try another name" in err
    if option in ("--report", "--preview"):
        err = refusal("check", picture, svg, option, same)
        assert "which is also the photo. Try another name" in err
    if option != "-o":
        target = tmp_path / "target"
        target.write_bytes(b"old")
        err = refusal(picture, "-o", target, option, target, *TINY)
        assert "which is also another output. Try another name" in err
        target.unlink()
    for path in (tmp_path / f"other-{picture.name}", tmp_path / "there"):
        path.unlink(missing_ok=True)
    assert content(tmp_path) == before


@pytest.mark.parametrize("link", [False, True])
def test_output_that_standard_input_reads_is_refused(link, picture, svg, tmp_path, refusal):
    read, other = tmp_path / "read", tmp_path / "other"
    given = {"the photo": picture, "the SVG": svg}
    commands = [("the photo", ["-", "-o", "NAME"])]
    further = ("--preview", "--report", "--outline", "--save-scene")
    commands += [("the photo", ["-", "-o", tmp_path / "o.svg", one, "NAME"]) for one in further]
    for one in ("--preview", "--report", "--heatmap"):
        commands.append(("the photo", ["check", "-", svg, one, "NAME"]))
        commands.append(("the SVG", ["check", picture, "-", one, "NAME"]))
    for what, command in commands:
        read.write_bytes(given[what].read_bytes())
        if link:
            other.hardlink_to(read)
        name = other if link else read
        before = content(tmp_path)
        with read.open() as stdin, pytest.MonkeyPatch.context() as patch:
            patch.setattr("sys.stdin", stdin)
            err = refusal(*(name if word == "NAME" else word for word in command))
        assert f"{name}, which is also {what}. Try another name" in err
        assert content(tmp_path) == before
        other.unlink(missing_ok=True)


def test_another_file_than_standard_input_reads_is_written(picture, tmp_path, monkeypatch):
    with picture.open() as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        assert main(["-", "-o", str(tmp_path / "o.svg"), *TINY]) == 0


def test_links_in_a_circle_are_refused_before_the_photo_is_read(tmp_path, refusal):
    (tmp_path / "a.svg").symlink_to("b.svg")
    (tmp_path / "b.svg").symlink_to("a.svg")
    err = refusal(tmp_path / "missing.png", "-o", tmp_path / "a.svg")
    assert "a.svg: Too many levels of symbolic links" in err


@pytest.mark.parametrize("name", ["null\0.png", "a.svg", "\ud800.png", "x" * 5000])
def test_the_name_of_no_file_clashes_with_no_output(name, tmp_path):
    (tmp_path / "a.svg").symlink_to("a.svg")
    files.check_outputs({str(tmp_path / name): "the photo"}, [tmp_path / "o.svg"])


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


@pytest.mark.process
def test_svg_may_come_through_a_pipe_and_a_photo_says_how_to(picture, svg, tmp_path, refusal):
    photo = shlex.quote(str(picture))
    done = shell(
        f"GAUSS2SVG - -o - {' '.join(TINY)} < {photo} | "
        f"GAUSS2SVG check {photo} <(cat) --quiet --report >(cat)"
    )
    assert done.returncode == 0, done.stderr
    assert b'"psnr_svg"' in done.stdout
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)  # without a writer: whoever opens it waits for ever
    for command in (["check", pipe, svg], [pipe, "-o", tmp_path / "o.svg"]):
        assert refusal(*command)


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


def test_saved_scene_is_whole_and_the_same(tmp_path):
    path = tmp_path / "s"  # without an ending, and none is added
    path.write_bytes(b"old")
    SCENE.save(path)
    assert [one.name for one in tmp_path.iterdir()] == ["s"]
    np.testing.assert_array_equal(Scene.load(path).mean, SCENE.mean)
