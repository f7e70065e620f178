"""What differs between systems, as the system that runs the tests has it."""

import sys
import threading
from pathlib import Path

import pytest
from PIL import Image

from gauss2svg import files
from gauss2svg.cli.main import main


@pytest.mark.skipif(sys.platform != "win32", reason="other systems replace open files")
def test_a_file_that_is_held_open_for_a_moment_is_replaced(tmp_path):
    made, target = tmp_path / "made", tmp_path / "target"
    made.write_text("new")
    with target.open("w") as held:
        threading.Timer(0.1, held.close).start()
        files.replace(made, target)
    assert target.read_text() == "new"


@pytest.fixture
def pictures(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for at, name in enumerate(["a.jpg", "b.jpg", "c[1].jpg", "deep/d.jpg", "e.png"]):
        Path(name).parent.mkdir(exist_ok=True)
        Image.new("RGB", (12, 8), (50 * at, 9, 9)).save(name)
    return tmp_path


@pytest.mark.usefixtures("asked", "drawn_here")
def test_commands_expand_patterns_themselves(pictures, capsys, refusal):
    assert main(["placeholder", "*.jpg", "--max-bytes", "300", "-o", "all.json"]) == 0
    assert "3 placeholders" in capsys.readouterr().err
    assert main(["gallery", "[ab].jpg", "-o", "site", "--counts", "3"]) == 0
    assert "2 done" in capsys.readouterr().err
    assert main(["*.png", "-o", "e.svg", "--gaussians", "2", "--quiet"]) == 0
    assert main(["check", "*.png", "e.s*", "--quiet"]) == 0
    assert "the photo must be one file; got a.jpg, b.jpg, c[1]" in refusal("*.jpg", "-o", "o.svg")
    assert "one photo and then one SVG; got a.jpg" in refusal("check", "*.jpg", "e.svg")
    assert main(["c[1].jpg", "-o", "c.svg", "--gaussians", "2", "--quiet"]) == 0  # a file's name
    for name in ("none*.jpg", "nul\0*"):
        assert "files must be one or more; got none in" in refusal(name, "-o", "o.svg")
