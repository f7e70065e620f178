"""Interrupted processes leave whole files, say one line, and end with the status of the signal."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from random import Random
from xml.etree import ElementTree

import pytest
from PIL import Image
from skimage import data

import gauss2svg
from gauss2svg.cli.terminal import _ENDING
from gauss2svg.scene import Scene

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]
OLD = "<!-- written by gauss2svg -->"
PACKAGES = os.fspath(Path(gauss2svg.__file__).parents[1])
COMMAND = ["photo.png", "-o", "out.svg", "--quiet", "--gaussians", "40", "--iterations", "150"]
OUTPUTS = (
    ["--renderer", "cairo"],
    ["--save-scene", "scene.npz", "--animate", "2"],
    ["--preview", "preview.png", "--report", "report.json", "--outline", "outline.svg"],
)

# A signal that comes while text is executed, as numba does where it compiles.
LOST_IN_EXEC = """
import signal
from gauss2svg.cli import main
from gauss2svg.cli.terminal import status_of
def interrupted():
    try:
        exec("raise KeyboardInterrupt")
    except KeyboardInterrupt:
        return status_of(signal.SIGINT)
main.main = interrupted
main.run()
"""


def test_the_status_is_that_of_the_command_wherever_a_signal_is_raised(tmp_path):
    (tmp_path / "command.py").write_text(LOST_IN_EXEC)
    path = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
    command = [sys.executable, "-m", "command"]
    assert subprocess.run(command, env={**os.environ, "PYTHONPATH": path}).returncode == 130


def started(folder, options, **environment):
    """Start a command in a folder with an old output, and return it once it handles signals."""
    (folder / "temporary").mkdir(parents=True)
    Image.fromarray(data.coffee()[::8, ::8]).save(folder / "photo.png")
    (folder / "out.svg").write_text(OLD)
    environment |= {"PYTHONPATH": PACKAGES, "TMPDIR": str(folder / "temporary")}
    process = subprocess.Popen(
        [sys.executable, "-m", "gauss2svg", *COMMAND, *options],
        cwd=folder, env=os.environ | environment, stderr=subprocess.PIPE,
    )  # fmt: skip
    while process.poll() is None:
        caught = Path(f"/proc/{process.pid}/status").read_text().partition("SigCgt:")[2].split()
        if caught and int(caught[0], 16) >> (signal.SIGTERM - 1) & 1:
            break
        time.sleep(0.001)
    return process


def check_whole(path):
    """Read a new file as a whole."""
    if path.suffix == ".svg":
        ElementTree.parse(path)
    elif path.suffix == ".png":
        Image.open(path).load()
    elif path.suffix == ".npz":
        Scene.load(path)


@pytest.fixture(scope="module")
def usual_s(tmp_path_factory):
    """Return the seconds of a command that is not interrupted, once its kernels are compiled."""
    for number in range(2):
        begun = time.monotonic()
        process = started(tmp_path_factory.mktemp("run") / str(number), OUTPUTS[0])
        assert process.communicate() == (None, b"")
    return time.monotonic() - begun


@pytest.mark.parametrize("number", range(2))
@pytest.mark.parametrize("is_cold", [False, True])
def test_an_interrupted_process_leaves_whole_files_and_says_one_line(
    number, is_cold, usual_s, tmp_path
):
    rng = Random(number)
    which, options = rng.choice([signal.SIGINT, signal.SIGTERM]), rng.choice(OUTPUTS)
    cold = {"NUMBA_CACHE_DIR": str(tmp_path / "cold")} if is_cold else {}
    process = started(tmp_path / "run", options, **cold)
    time.sleep(rng.random() * usual_s)
    process.send_signal(which)
    was_old = (tmp_path / "run/out.svg").read_text() == OLD
    lines = process.communicate()[1].replace(_ENDING, b"").decode().splitlines()
    status = process.returncode
    assert status == 128 + which or (status, was_old) == (0, False), lines
    assert len(lines) == (status != 0), lines
    names = {"out.svg", *(name for name in options if "." in name)}
    left = {path.name for path in (tmp_path / "run").iterdir()}
    assert left <= names | {"photo.png", "temporary"}
    assert not list((tmp_path / "run/temporary").iterdir())
    paths = [tmp_path / "run" / name for name in names & left]
    new = [path for path in paths if path.suffix != ".svg" or path.read_text() != OLD]
    for path in new:
        check_whole(path)
    if status == 0 or "The best picture so far is in" in lines[0]:
        assert len(new) == len(names)
    else:
        assert "every file is whole or untouched" in lines[0]
