"""Tracers in environments of their own: programs on PATH, and a Python that a variable names."""

import os

import pytest

from gauss2svg.compare.peers import PEERS, VTRACER1
from gauss2svg.errors import PeerError

pytestmark = [pytest.mark.process, pytest.mark.posix]  # stand-ins are shell scripts
# Each tool as a script, which writes the words that it was given in place of an SVG.
SCRIPTS = {
    "swag": """[ "$1" = --version ] && echo "swag 9.1" && exit
echo "$@" > "$3/$(basename "$1" .png).svg" """,
    "vtracer1": """case "$3" in *version*) echo 9.2;; *) echo "$@" > "$5";; esac""",
}


@pytest.fixture
def tool(tmp_path, monkeypatch):
    """Install a stand-in; return what its conversion of a picture writes."""

    def install(name: str, script: str) -> str:
        path = tmp_path / name
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)
        monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
        monkeypatch.setenv(VTRACER1, str(path))
        picture, output = tmp_path / "in.png", tmp_path / "result.svg"
        picture.write_bytes(b"")
        PEERS[name].prepare(picture, output, **PEERS[name].settings[0])()
        return output.read_text()

    return install


@pytest.mark.parametrize(("name", "version"), [("swag", "9.1"), ("vtracer1", "9.2")])
def test_a_tool_gets_the_picture_and_its_settings_and_says_its_version(name, version, tool):
    written = tool(name, SCRIPTS[name])
    assert "in.png" in written
    assert {"swag": "--quality fast", "vtracer1": "{}"}[name] in written
    assert PEERS[name].version() == version


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_tool_that_fails_is_one_line_with_its_complaint(name, tool):
    with pytest.raises(PeerError, match=r"ended with status 3: no such colour$"):
        tool(name, "echo no such colour >&2; exit 3")


def test_a_tool_that_cannot_start_or_draws_nothing_is_one_line(tool, tmp_path, monkeypatch):
    with pytest.raises(FileNotFoundError, match=r"result\.svg"):  # which a run calls "no file"
        tool("swag", "exit 0")
    (tmp_path / "swag").write_text("#!/no/such/interpreter\n")
    with pytest.raises(PeerError, match="cannot run swag: No such file"):
        PEERS["swag"].version()
    monkeypatch.setenv(VTRACER1, "/bin/false")
    with pytest.raises(PeerError, match=f"{VTRACER1} must be .* status 1.* Try to install vtracer"):
        PEERS["vtracer1"].version()
    monkeypatch.setenv("PATH", str(tmp_path / "none"))
    monkeypatch.delenv(VTRACER1)
    assert PEERS["swag"].version() is PEERS["vtracer1"].version() is None
