"""Laws of what differs between systems: each is tested here by the answers of Windows and macOS."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import galleries
import psutil
import pytest
from conftest import has_ended
from PIL import Image

from gauss2svg import files, processes
from gauss2svg.batch import worker
from gauss2svg.batch.stores import Store
from gauss2svg.cli import signals
from gauss2svg.cli.main import main
from gauss2svg.errors import InputError, OutputError, RendererError
from gauss2svg.files import expanded, is_device
from gauss2svg.measure import isolated
from gauss2svg.photo.listing import slug_of
from gauss2svg.processes import (
    command_line,
    crash_of,
    end_of,
    end_tree,
    module_path,
    own_group,
)
from gauss2svg.raster import chromium, program
from gauss2svg.studio.uploads import stem_of


@pytest.mark.parametrize(
    ("status", "system", "crash"),
    [
        (-signal.SIGSEGV, "posix", "SIGSEGV"),
        (-50, "posix", "signal 50"),
        (0, "posix", None),
        (139, "posix", None),
        (0xC00000FD, "nt", "stack overflow, 0xC00000FD"),
        (0xC0000005 - 2**32, "nt", "access violation, 0xC0000005"),
        (0xC0FFEE00, "nt", "exception, 0xC0FFEE00"),
        (0, "nt", None),
        (3, "nt", None),
        (0x80000003, "nt", None),
    ],
)
def test_a_crash_is_told_from_an_end_by_the_exit_status_of_its_system(status, system, crash):
    assert crash_of(status, system) == crash
    if crash is None:
        assert end_of(status, system) == f"ended with status {status}"
    else:
        assert end_of(status, system) == f"killed by {crash}; was there enough memory?"


def test_a_renderer_that_crashes_on_windows_is_an_error_that_says_so(monkeypatch):
    monkeypatch.setattr(isolated, "crash_of", lambda status: crash_of(0xC00000FD, "nt"))
    exits = [sys.executable, "-c", "import sys; sys.exit(9)"]
    monkeypatch.setattr(isolated, "module_command", lambda *_: exits)
    with pytest.raises(RendererError, match=r"crashed on the SVG \(stack overflow"):
        isolated.draw("<svg/>", 2, 2, "resvg", 60)


# A process that starts another and writes the ids of both.
PARENT = (
    "import os, subprocess, sys, time; "
    "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)']); "
    "print(os.getpid(), child.pid, flush=True); time.sleep(600)"
)


@pytest.mark.process
@pytest.mark.parametrize("system", ["posix", "nt"])
def test_a_process_ends_with_what_it_has_started(system):
    group = own_group("posix") if os.name == "posix" else own_group()
    with subprocess.Popen(
        [sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True, **group
    ) as process:
        both = [int(word) for word in process.stdout.readline().split()]
        end_tree(process.pid, system)
        process.wait()
    assert all(has_ended(one) for one in both)
    end_tree(process.pid, system)  # which is gone: nothing happens


def test_a_group_of_processes_is_asked_for_as_its_system_has_it():
    assert own_group("nt") == {"creationflags": 0x200}
    assert own_group("posix") == {"start_new_session": True}


# Starts a worker of the benchmark as its parent, and waits.
STARTS_WORKER = """
import subprocess, sys
worker = subprocess.Popen(
    [sys.executable, "-P", "-m", "gauss2svg.compare.worker", sys.argv[1]], stdin=subprocess.PIPE,
    start_new_session=True,
)
print(worker.pid, flush=True)
worker.wait()
"""


@pytest.mark.process
def test_a_run_of_the_benchmark_ends_with_its_parent(tmp_path):
    said = f"read line < /dev/stdin\necho $$ > {tmp_path}/pid\nsleep 600"
    galleries.program(tmp_path / "primitive", said)
    Image.new("RGB", (4, 4)).save(tmp_path / "a.png")
    request = {"tool": "primitive", "settings": {"shapes": 3}}
    request |= {"png": str(tmp_path / "a.png"), "output": str(tmp_path / "a.svg")}
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    with subprocess.Popen(
        [sys.executable, "-c", STARTS_WORKER, json.dumps(request)],
        stdout=subprocess.PIPE,
        env={**os.environ, "PATH": path, **module_path()},
    ) as parent:
        worker = int(parent.stdout.readline())
        until = time.monotonic() + 60
        while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text().strip():
            assert time.monotonic() < until
            time.sleep(0.05)
        peer = int((tmp_path / "pid").read_text())
        assert psutil.pid_exists(worker)
        parent.kill()
    assert has_ended(worker)
    assert has_ended(peer)


@pytest.mark.parametrize(
    ("words", "posix", "windows"),
    [
        (["gauss2svg", "a.png"], "gauss2svg a.png", "gauss2svg a.png"),
        (["my photo.png"], "'my photo.png'", '"my photo.png"'),
        (["a&b.png"], "'a&b.png'", '"a&b.png"'),
        (["it's"], "'it'\"'\"'s'", '"it\'s"'),
        (["C:\\a b\\"], "'C:\\a b\\'", '"C:\\a b\\\\"'),
        ([""], "''", '""'),
    ],
)
def test_a_command_is_shown_as_its_system_types_it(words, posix, windows):
    assert command_line(words, "posix") == posix
    assert command_line(words, "nt") == windows


WINDOWS_FOLDERS = {"ProgramFiles": r"C:\Program Files", "LOCALAPPDATA": r"C:\Users\me\Local"}


@pytest.mark.parametrize(
    ("renderer", "system", "environment", "place"),
    [
        ("inkscape", "darwin", {}, "/Applications/Inkscape.app/Contents/MacOS/inkscape"),
        ("firefox", "darwin", {"HOME": "/Users/me"},
         "/Users/me/Applications/Firefox.app/Contents/MacOS/firefox"),
        ("chromium", "darwin", {}, "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome"),
        ("inkscape", "win32", WINDOWS_FOLDERS, r"C:\Program Files/Inkscape/bin/inkscape.com"),
        ("firefox", "win32", WINDOWS_FOLDERS, r"C:\Program Files/Mozilla Firefox/firefox.exe"),
        ("chromium", "win32", WINDOWS_FOLDERS,
         r"C:\Users\me\Local/Google/Chrome/Application/chrome.exe"),
    ],
)  # fmt: skip
def test_programs_are_looked_for_where_installers_put_them(renderer, system, environment, place):
    found = program.places(renderer, system, environment)
    assert place in [path.replace(os.sep, "/") for path in found]


def test_on_linux_programs_are_looked_for_on_path_alone():
    assert program.places("inkscape", "linux", WINDOWS_FOLDERS) == []
    assert program.places("librsvg", "win32", WINDOWS_FOLDERS) == []


def test_a_program_off_path_is_found_and_one_on_path_comes_first(tmp_path, monkeypatch):
    app = tmp_path / "Applications" / "Inkscape.app" / "Contents" / "MacOS" / "inkscape"
    app.parent.mkdir(parents=True)
    galleries.program(app, "")
    places = program.places("inkscape", "darwin", {"HOME": str(tmp_path)})
    monkeypatch.setattr(program, "places", lambda _: places)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    assert program.find("inkscape", ["inkscape"], "it") == str(app)
    monkeypatch.setattr(program, "places", lambda _: [str(tmp_path / "none")])
    with pytest.raises(RendererError, match="got none on PATH or where it is usually installed"):
        program.find("inkscape", ["inkscape"], "it")
    own = galleries.program(tmp_path / "bin" / "inkscape", "")
    assert program.find("inkscape", ["inkscape"], "it") == str(own)


def test_the_version_of_a_chromium_on_windows_is_that_of_its_folder(tmp_path, monkeypatch):
    for name in ("99.0.1.2", "140.0.7.10", "140.0.7.9", "Dictionaries", "1.2.3"):
        (tmp_path / name).mkdir()
    assert chromium._version_beside(str(tmp_path / "chrome.exe")) == "140.0.7.10"
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(chromium, "_playwright", lambda: None)
    (tmp_path / "none").mkdir()
    for folder in ("none", "that cannot be listed"):
        monkeypatch.setattr(chromium, "_program", lambda at=folder: str(tmp_path / at / "c.exe"))
        assert chromium.version() == "Chromium of unknown version"


@pytest.fixture
def held_open(monkeypatch):
    """Tries for which another program holds each target open; pauses, which take no time."""
    held, pauses = {}, []
    real = os.replace

    def replace(made, target):
        left = held.get(os.fspath(target), 0)
        if left:
            held[os.fspath(target)] = left - 1
            raise PermissionError(errno.EACCES, "The process cannot access the file")
        real(made, target)

    monkeypatch.setattr(os, "replace", replace)
    monkeypatch.setattr(time, "sleep", pauses.append)
    return held, pauses


def test_a_file_that_is_held_open_for_moments_is_replaced_on_windows(tmp_path, held_open):
    held, pauses = held_open
    made, target = tmp_path / "made", tmp_path / "target"
    for tries in (0, 1, 5):
        made.write_text("new")
        target.write_text("old")
        held[str(target)] = tries
        files.replace(made, target, "nt")
        assert target.read_text() == "new"
        assert len(pauses) == tries
        pauses.clear()
    assert sum(files._PAUSES_S) < 2
    made.write_text("new")
    held[str(target)] = 99
    with pytest.raises(PermissionError):
        files.replace(made, target, "nt")
    with pytest.raises(PermissionError):  # elsewhere at once: it does not pass
        files.replace(made, target, "posix")
    assert len(pauses) == 5


@pytest.mark.parametrize("system", ["nt", "posix"])
@pytest.mark.parametrize("has_links", [True, False])
@pytest.mark.parametrize("failing", ["a", "b", "c"])
def test_where_one_file_cannot_be_renamed_none_is_replaced(
    failing, has_links, system, tmp_path, held_open, monkeypatch
):
    def refuse(*_):
        raise OSError(errno.ENOTSUP, "no links")

    if not has_links:
        monkeypatch.setattr(os, "link", refuse)
    for name in "abc":
        (tmp_path / f".{name}").write_text("new")
    for name in "ac":
        (tmp_path / name).write_text("old")
    before = {p.name: p.read_text() for p in tmp_path.iterdir() if not p.name.startswith(".")}
    held_open[0][str(tmp_path / failing)] = 99
    pairs = [(tmp_path / f".{name}", tmp_path / name) for name in "abc"]
    with pytest.raises(PermissionError):
        files._rename(pairs, system)
    for made, _ in pairs:  # which `write_all_atomically` removes
        made.unlink(missing_ok=True)
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == before
    held_open[0].clear()
    for name in "abc":
        (tmp_path / f".{name}").write_text("new")
    files._rename(pairs, system)
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == dict.fromkeys("abc", "new")


def test_a_folder_is_refused_as_one_where_opening_it_is_denied(tmp_path, monkeypatch):
    def denied(path, *_):
        raise PermissionError(errno.EACCES, "Permission denied", path)

    monkeypatch.setattr(os, "open", denied)  # as Windows answers for a folder
    with pytest.raises(InputError, match="it is a folder, not a regular file"):
        files.reading(tmp_path, "a photo").__enter__()
    with pytest.raises(InputError, match="Permission denied"):
        files.reading(tmp_path / "none", "a photo").__enter__()


DEVICES = ["con", "CON", "con.svg", "Aux.tar.gz", "prn ", "nul.txt", "com1", "lpt9.svg", "COM³.x",
           "conin$", "com0", "con .svg", "nul:x"]  # fmt: skip


def test_names_of_devices_are_known_and_others_are_not():
    assert [name for name in DEVICES if not is_device(name)] == []
    for name in ("cone.svg", "a.con", "com.svg", "com10", "lpt", "icon.svg", "_con.svg", "confirm"):
        assert not is_device(name)


def test_no_file_is_written_to_a_device_on_windows(tmp_path, monkeypatch):
    for name in ("con.svg", "Aux"):
        with pytest.raises(OutputError, match="Windows takes the name for that of a device"):
            files.check_writable(tmp_path / name, "nt")
        files.check_writable(tmp_path / name, "posix")
    files.check_writable(tmp_path / "nul", "nt")
    refuse = files._refuse_device
    monkeypatch.setattr(files, "_refuse_device", lambda path: refuse(path, "nt"))
    store = Store(str(tmp_path))
    with pytest.raises(OutputError, match="device") as caught:
        store.write("con.svg", b"")
    # By this a batch knows that it is the fault of one photo's name.
    assert caught.value.__cause__.errno == errno.EINVAL
    assert slug_of("Con") == "photo-con"
    assert stem_of("con.jpg") == "_con"


def test_ctrl_break_ends_a_command_as_sigterm_does(monkeypatch):
    windows = SimpleNamespace(SIGINT=2, SIGTERM=15, SIGBREAK=21)
    assert signals.handled_of(windows) == (2, 15, 21)
    assert signals.handled_of() == (signal.SIGINT, signal.SIGTERM)
    assert signals.status_of(21) == signals.status_of(signal.SIGTERM) == 143
    assert signals.status_of(signal.SIGINT) == 130
    with pytest.raises(signals.Terminated):
        signals.raise_for(21)
    ignored = []
    monkeypatch.setattr(signal, "SIGBREAK", 21, raising=False)
    monkeypatch.setattr(signal, "signal", lambda number, _: ignored.append(number))
    worker.dask_setup(None)
    assert ignored == [signal.SIGINT, 21]


@pytest.fixture
def pictures(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for at, name in enumerate(["a.jpg", "b.jpg", "c[1].jpg", "deep/d.jpg", "e.png"]):
        Path(name).parent.mkdir(exist_ok=True)
        Image.new("RGB", (12, 8), (50 * at, 9, 9)).save(name)
    return tmp_path


def test_patterns_are_expanded_in_order_and_names_are_kept(pictures):
    assert expanded(["*.jpg"]) == ["a.jpg", "b.jpg", "c[1].jpg"]
    assert expanded(["e.png", "[ab].jpg", "-"]) == ["e.png", "a.jpg", "b.jpg", "-"]
    assert expanded([os.path.join("**", "*.jpg")])[-1] == os.path.join("deep", "d.jpg")
    assert expanded(["c[1].jpg"]) == ["c[1].jpg"]  # a file of that name
    assert expanded(["none*.jpg", "nul\0*"]) == ["none*.jpg", "nul\0*"]


@pytest.mark.usefixtures("asked", "drawn_here")
def test_commands_expand_patterns_themselves(pictures, capsys, monkeypatch, refusal):
    assert main(["placeholder", "*.jpg", "--max-bytes", "300", "-o", "all.json"]) == 0
    assert "3 placeholders" in capsys.readouterr().err
    assert main(["gallery", "[ab].jpg", "-o", "site", "--counts", "3"]) == 0
    assert "2 SVGs" in capsys.readouterr().err
    taken = []

    def run_bench(images, *_, **__):
        taken.extend(images)
        return []

    monkeypatch.setattr("gauss2svg.compare.tables.bench.run_bench", run_bench)
    assert main(["bench", "*.jpg", "-o", "bench", "--quiet"]) == 0
    assert taken == ["a.jpg", "b.jpg", "c[1].jpg"]
    assert main(["*.png", "-o", "e.svg", "--gaussians", "2", "--quiet"]) == 0
    assert main(["check", "*.png", "e.s*", "--quiet"]) == 0
    line = refusal("*.jpg", "-o", "o.svg")
    assert "the photo must be one file; got a.jpg, b.jpg, c[1].jpg" in line
    line = refusal("check", "*.jpg", "e.svg")
    assert "photo and SVG must be one file each; got a.jpg, b.jpg" in line


def test_every_function_that_asks_for_a_system_asks_for_this_one_by_default():
    assert processes.own_group() == processes.own_group(os.name)
    assert program.places("inkscape") == program.places("inkscape", sys.platform)
