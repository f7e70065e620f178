"""Rules of the source tree: data flows one way, long files say why, every test is in a lane."""

import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCES = sorted((ROOT / "gauss2svg").rglob("*.py"))


def test_imports_follow_the_layers():
    # the contract is in pyproject.toml; it also forbids every cycle between the layers
    run = subprocess.run(
        [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c()"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr


def test_a_file_of_over_500_lines_says_why_at_its_top():
    for path in [*SOURCES, *(ROOT / "tests").rglob("*.py")]:
        lines = path.read_text().splitlines()
        assert len(lines) <= 500 or "is long because" in "\n".join(lines[:40]), path


def test_every_test_is_in_a_lane():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pytest"]
    options = settings.get("ini_options", settings)
    markers = [marker.partition(":")[0] for marker in options["markers"]]
    *names, nightly = (name for name in markers if name != "posix")  # which is of a system
    markers = " or ".join(names)
    assert f"not ({markers} or {nightly})" in options["addopts"]
    for text in (ROOT / ".ci" / "run", ROOT / "docs" / "development.md"):
        assert f'-m "{markers}"' in text.read_text()
