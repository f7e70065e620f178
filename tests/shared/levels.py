"""Processes that run a script by the package's source, with variables of the environment."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import gauss2svg
from gauss2svg.core import Kernel

PACKAGE = Path(gauss2svg.__file__).parent
IS_X86 = platform.machine().lower() in ("x86_64", "amd64")
LEVELS = [f"v{k}" for k in range(2, Kernel("cpu_level", "")() + 1)] if IS_X86 else []


def printed(script: str, *arguments: object, tree: Path = PACKAGE.parent, **variables: str) -> str:
    """What a script prints for some arguments, by the package in a folder."""
    paths = os.pathsep.join([str(tree), *sys.path])
    command = [sys.executable, "-P", "-c", script, *map(str, arguments)]
    env = {**os.environ, "PYTHONPATH": paths, **variables}
    done = subprocess.run(command, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout
