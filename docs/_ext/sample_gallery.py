"""The sample gallery, two photos that scikit-image ships, beside the pages: sample/index.html."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).parents[2]
FOLDER = "sample"


def build(app: Any, error: Exception | None) -> None:
    """Make it where the site is built; a site that has it already keeps it."""
    if error is not None or app.builder.name != "html":
        return
    script = str(_ROOT / "benchmarks" / "gallery.py")
    path = os.pathsep.join([str(_ROOT), os.environ.get("PYTHONPATH", "")])
    run = subprocess.run(
        [sys.executable, script, FOLDER, "--sample"],  # which the pages show, without our folders
        cwd=app.outdir,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    if run.returncode:
        raise RuntimeError(f"the sample gallery: {run.stderr[-2000:]}")


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("build-finished", build)
    return {"parallel_read_safe": True}
