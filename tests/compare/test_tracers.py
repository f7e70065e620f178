"""Other tools: programs on PATH, a Python that a variable names, and modules."""

import json
import math
import os

import numpy as np
import pytest
from galleries import BLANK, program, save

from gauss2svg.cli.main import main
from gauss2svg.compare.peers import PEERS, VTRACER1
from gauss2svg.compare.run import in_own_process, make_svg, measure_alone
from gauss2svg.errors import PeerError
from gauss2svg.photo.load import load_image

pytestmark = [pytest.mark.process, pytest.mark.posix]  # stand-ins are shell scripts
# Each tool as a script, which writes the words that it was given in place of an SVG.
SCRIPTS = {
    "swag": """[ "$1" = --version ] && echo "swag 9.1" && exit
echo "$@" > "$3/$(basename "$1" .png).svg" """,
    "vtracer1": """case "$3" in *version*) echo 9.2;; *) echo "$@" > "$5";; esac""",
    "primitive": """echo "$@" > "$4" """,
}
WORDS = {"swag": "--quality fast", "vtracer1": "{}", "primitive": "-n 100"}
VERSIONS = {"swag": "9.1", "vtracer1": "9.2"}


@pytest.fixture
def picture(photo, tmp_path):
    return save(photo[:40, :48], tmp_path / "in.png")


@pytest.fixture
def tool(picture, tmp_path, monkeypatch):
    """Install a stand-in; return what its conversion of a picture writes."""

    def install(name: str, script: str) -> str:
        path = program(tmp_path / "bin" / name, script)
        monkeypatch.setenv("PATH", f"{path.parent}{os.pathsep}{os.environ['PATH']}")
        monkeypatch.setenv(VTRACER1, str(path))
        output = tmp_path / "result.svg"
        PEERS[name].prepare(picture, output, **PEERS[name].settings[0])()
        return output.read_text()

    return install


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_tool_gets_the_picture_and_its_settings_and_fails_with_its_complaint(name, tool):
    written = tool(name, SCRIPTS[name])
    assert "in.png" in written
    assert WORDS[name] in written
    assert name not in VERSIONS or PEERS[name].version() == VERSIONS[name]
    with pytest.raises(PeerError, match=r"ended with status 3: no such colour$"):
        tool(name, "echo no such colour >&2; exit 3")


def test_a_tool_that_cannot_start_is_one_line(tool, tmp_path, monkeypatch):
    tool("swag", SCRIPTS["swag"])
    (tmp_path / "bin/swag").write_text("#!/no/such/interpreter\n")
    with pytest.raises(PeerError, match="cannot run swag: No such file"):
        PEERS["swag"].version()
    monkeypatch.setenv(VTRACER1, "/bin/false")
    with pytest.raises(PeerError, match=f"{VTRACER1} must be .* status 1.* Try to install vtracer"):
        PEERS["vtracer1"].version()


def measured(picture, tool, peer_timeout=60, **settings):
    """The record of a benchmark's run of a tool."""
    options = {"seed": 0, "threads": 1, "max_pixels": 10**6}
    request = {"tool": tool, "settings": settings, "source": str(picture)}
    request |= {"peer_timeout": peer_timeout, "options": options}
    return in_own_process(measure_alone, request)


def psnr_of_white(picture):
    error = np.mean((1 - load_image(picture).pixels.astype(np.float64)) ** 2)
    return pytest.approx(-10 * math.log10(error), abs=1e-4)


def test_output_of_a_module_is_not_part_of_its_row(picture, tmp_path, monkeypatch):
    (tmp_path / "vtracer.py").write_text(
        "def convert_image_to_svg_py(png, drawn):\n"
        "    print('chatter')\n"
        f"    open(drawn, 'w').write({BLANK!r})\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    row = measured(picture, "vtracer", style="default")
    assert (row["psnr_svg"], row["svg_bytes"]) == (psnr_of_white(picture), len(BLANK))


def test_a_program_is_measured_or_an_error_of_a_gallery_and_of_a_benchmark(
    picture, tmp_path, monkeypatch, capsys, asked
):
    monkeypatch.setattr("galleries.canned", make_svg)
    drawn = f"[ $6 = 100 ] && echo '{BLANK}' > \"$4\" && exit\necho no luck >&2; exit 3\n"
    program(tmp_path / "bin" / "primitive", drawn)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"), os.pathsep)
    out, peers = tmp_path / "out", ["--variants", "", "--peers", "primitive,primitive:500"]
    assert main(["gallery", str(picture), "-o", str(out), *peers]) == 1
    failed = capsys.readouterr().err.splitlines()[0]
    assert failed.startswith("gauss2svg: failed: in.png, primitive 500: ")
    assert "status 3: no luck" in failed
    (row,) = json.loads((out / "gallery.json").read_text())["rows"]
    assert (row["psnr_svg"], row["svg_bytes"]) == (psnr_of_white(picture), len(BLANK) + 1)
    assert str(tmp_path) not in (out / row["files"]["report"]).read_text()
    for body, seconds, line in (
        ("exit 0", 60, "primitive wrote no file. Try running it by hand"),
        ("exec sleep 600", 0.5, "timed out after 0.5 s"),
    ):
        program(tmp_path / "bin" / "primitive", body)
        assert line in measured(picture, "primitive", seconds, shapes=3)["error"]
