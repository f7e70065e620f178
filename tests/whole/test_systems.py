"""What differs between systems, as the system that runs the tests has it."""

import errno
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import galleries
import psutil
import pytest
from conftest import has_ended
from PIL import Image

from gauss2svg import files
from gauss2svg.batch.inputs import expanded
from gauss2svg.batch.stores import prepare, write
from gauss2svg.cli import signals
from gauss2svg.cli.main import main
from gauss2svg.errors import InputError, OutputError, RendererError
from gauss2svg.files import is_device
from gauss2svg.pipeline.listing import slug_of
from gauss2svg.processes import (
    NEW_GROUP,
    command_line,
    end_of,
    end_tree,
    module_path,
)
from gauss2svg.raster import chromium, program
from gauss2svg.studio.uploads import stem_of


@pytest.mark.parametrize(
    ("status", "end"),
    [
        (0, "ended with status 0"), (139, "ended with status 139"),
        (-signal.SIGTERM, "killed by SIGTERM; was there enough memory?"),
        (-50, "killed by status -0x32; was there enough memory?"),
        (0xC00000FD, "killed by status 0xc00000fd; was there enough memory?"),
    ],
)  # fmt: skip
def test_a_crash_is_told_from_an_end_by_the_exit_status(status, end):
    assert end_of(status) == end


# A process that starts another and writes the ids of both.
PARENT = (
    "import os, subprocess, sys, time; "
    "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)']); "
    "print(os.getpid(), child.pid, flush=True); time.sleep(600)"
)


@pytest.mark.process
def test_a_process_ends_with_what_it_has_started():
    with subprocess.Popen(
        [sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True,
        start_new_session=True, creationflags=NEW_GROUP,
    ) as process:  # fmt: skip
        both = [int(word) for word in process.stdout.readline().split()]
        end_tree(process.pid)
        process.wait()
    assert all(has_ended(one) for one in both)
    end_tree(process.pid)  # which is gone: nothing happens


# Runs a peer in a process of its own, as the benchmark does.
RUNS_PEER = """
import sys
from gauss2svg.compare.run import measure_run
measure_run({"tool": "primitive", "settings": {"shapes": 3}, "source": sys.argv[1],
             "options": {"max_pixels": 10**6}, "peer_timeout": 600})
"""


@pytest.mark.posix
@pytest.mark.process
def test_a_run_of_the_benchmark_ends_with_its_parent(tmp_path):
    galleries.program(tmp_path / "primitive", f"echo $$ > {tmp_path}/pid\nsleep 600")
    Image.new("RGB", (4, 4)).save(tmp_path / "a.png")
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    with subprocess.Popen(
        [sys.executable, "-c", RUNS_PEER, str(tmp_path / "a.png")],
        env={**os.environ, "PATH": path, **module_path()},
    ) as parent:
        until = time.monotonic() + 60
        while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text().strip():
            assert time.monotonic() < until
            time.sleep(0.05)
        (worker,) = psutil.Process(parent.pid).children()
        parent.kill()
    assert has_ended(worker.pid)
    assert has_ended(int((tmp_path / "pid").read_text()))


@pytest.mark.parametrize(
    ("words", "posix", "windows"),
    [
        (["gauss2svg", "a.png"], "gauss2svg a.png", "gauss2svg a.png"),
        (["my photo.png"], "'my photo.png'", '"my photo.png"'),
        (["a&b.png"], "'a&b.png'", '"a&b.png"'),
        (["it's"], "'it'\"'\"'s'", '"it\'s"'),
        (["C:\\a b"], "'C:\\a b'", '"C:\\a b"'),
        ([""], "''", '""'),
    ],
)
def test_a_command_is_shown_as_one_types_it(words, posix, windows):
    assert command_line(words) == (windows if sys.platform == "win32" else posix)


@pytest.mark.posix
def test_a_program_off_path_is_found_and_one_on_path_comes_first(tmp_path, monkeypatch):
    installed = galleries.program(tmp_path / "Inkscape" / "inkscape", "")
    names = "inkscape", "Inkscape/inkscape"
    monkeypatch.setattr(program, "_FOLDERS", [str(tmp_path / "none"), str(tmp_path)])
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    assert program.find("inkscape", names, "it") == str(installed)
    with pytest.raises(RendererError, match="got none on PATH or where it is usually installed"):
        program.find("inkscape", names[:1], "it")
    own = galleries.program(tmp_path / "bin" / "inkscape", "")
    assert program.find("inkscape", names, "it") == str(own)


def test_the_version_of_a_chromium_is_the_largest_of_the_folders_beside_it(tmp_path):
    assert chromium._version_beside(str(tmp_path / "chrome.exe")) == "of unknown version"
    for name in ("99.0.1.2", "140.0.7.10", "140.0.7.9", "Dictionaries", "1.2.3"):
        (tmp_path / name).mkdir()
    assert chromium._version_beside(str(tmp_path / "chrome.exe")) == "140.0.7.10"


def test_a_file_that_is_held_open_for_a_moment_is_replaced(tmp_path):
    made, target = tmp_path / "made", tmp_path / "target"
    made.write_text("new")
    target.write_text("old")
    with target.open() as held:
        closing = threading.Timer(0.1, held.close)
        closing.start()
        files.replace(made, target)
        closing.join()
    assert target.read_text() == "new"
    assert not made.exists()


@pytest.mark.skipif(sys.platform != "win32", reason="open files are replaced")
def test_a_file_that_stays_open_is_refused_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "_PAUSES_S", (0.01,))
    target = tmp_path / "target"
    target.write_text("old")
    files.check_writable(target)
    with target.open(), pytest.raises(OutputError, match=r"cannot write .*target: "):
        files.check_writable(target)
    assert target.read_text() == "old"


def test_a_folder_is_refused_as_one_and_a_missing_file_is_not(tmp_path):
    with pytest.raises(InputError, match="it is a folder, not a regular file"):
        files.reading(tmp_path, "a photo").__enter__()
    with pytest.raises(InputError, match="No such file or directory"):
        files.reading(tmp_path / "none", "a photo").__enter__()


DEVICES = ["con", "CON", "con.svg", "Aux.tar.gz", "prn ", "nul.txt", "com1", "lpt9.svg", "COM³.x",
           "conin$", "com0", "con .svg", "nul:x"]  # fmt: skip


def test_names_of_devices_are_known_and_others_are_not():
    assert [name for name in DEVICES if not is_device(name)] == []
    for name in ("cone.svg", "a.con", "com.svg", "com10", "lpt", "icon.svg", "_con.svg", "confirm"):
        assert not is_device(name)


def test_names_that_we_choose_are_those_of_no_device():
    assert slug_of("Con") == "photo-con"
    assert stem_of("con.jpg") == "_con"


@pytest.mark.skipif(sys.platform != "win32", reason="devices have other names")
def test_no_file_is_written_to_a_device_of_windows(tmp_path):
    for name in ("con.svg", "Aux"):
        with pytest.raises(OutputError, match="Windows takes the name for that of a device"):
            files.check_writable(tmp_path / name)
    files.check_writable(tmp_path / "nul")
    with pytest.raises(OutputError, match="device") as caught:
        prepare(str(tmp_path)) or write(str(tmp_path), "con.svg", b"")
    # By this a batch knows that it is the fault of one photo's name.
    assert caught.value.__cause__.errno == errno.EINVAL


@pytest.mark.parametrize("number", signals.SIGNALS)
def test_a_signal_ends_a_command_with_the_status_of_shells(number):
    is_ctrl_c = number == signal.SIGINT
    assert signals.status_of(number) == (130 if is_ctrl_c else 143)
    with pytest.raises(KeyboardInterrupt if is_ctrl_c else signals.Terminated), signals.handling():
        signal.raise_signal(number)


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
    for name in ("none*.jpg", "nul\0*"):
        with pytest.raises(InputError, match="files must be one or more; got none in"):
            expanded(["a.jpg", name])


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

    monkeypatch.setattr("gauss2svg.compare.table.run_bench", run_bench)
    assert main(["bench", "*.jpg", "-o", "bench", "--quiet"]) == 0
    assert taken == ["a.jpg", "b.jpg", "c[1].jpg"]
    assert main(["*.png", "-o", "e.svg", "--gaussians", "2", "--quiet"]) == 0
    assert main(["check", "*.png", "e.s*", "--quiet"]) == 0
    line = refusal("*.jpg", "-o", "o.svg")
    assert "the photo must be one file; got a.jpg, b.jpg, c[1].jpg" in line
    line = refusal("check", "*.jpg", "e.svg")
    assert "photo and SVG must be one file each; got a.jpg, b.jpg" in line
