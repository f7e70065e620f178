"""Installed renderer programs: found on PATH, run in a process group, with a time limit."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from gauss2svg.errors import RendererError, must_be, shown

# Inkscape takes up to a minute for a large file of blurs; a program that takes longer hangs.
TIMEOUT_S = 300
_VERSION_TIMEOUT_S = 30
_DRAWING = "draw the SVG"


def find(renderer: str, names: Sequence[str], install: str) -> str:
    """Path of the first of the programs on PATH; raises RendererError where there is none."""
    for name in names:
        path = shutil.which(name)
        if path:
            return path
    raise RendererError(
        f"renderer {renderer} needs the program {names[0]}; got none on PATH. Try to install it "
        f"({install}), or --renderer resvg"
    )


def wrong_size(what: str, got: Sequence[int], needed: Sequence[int]) -> RendererError:
    """The error of a raster of got instead of needed (width, height) px."""
    width, height = needed
    shape = shown(f"{got[0]}x{got[1]} px")
    return RendererError(must_be(what, f"{width}x{height} px", shape, "an SVG with a viewBox"))


@cache
def version_line(path: str) -> str:
    """First line that the program prints for --version; asked once."""
    try:
        printed = run([path, "--version"], timeout_s=_VERSION_TIMEOUT_S, task="say its version")
    except RendererError as error:
        raise RendererError(f"{error}. Try to reinstall it, or --renderer resvg") from error
    lines = printed.decode(errors="replace").strip().splitlines()
    if not lines:
        raise RendererError(f"{path} --version printed nothing. Try to reinstall it")
    return lines[0].strip()


def run(
    command: Sequence[str],
    *,
    stdin: bytes | None = None,
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
    timeout_s: float = TIMEOUT_S,
    task: str = _DRAWING,
) -> bytes:
    """Standard output of a command.

    Raises RendererError with the last line of its standard error if it fails, and where it takes
    longer than timeout_s; task is what the program then could not do.
    """
    name = Path(command[0]).name
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL if stdin is None else subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=folder,
            env={**os.environ, **(environment or {})},
            start_new_session=True,  # a process group, so that its children end with it
        )
    except OSError as error:
        raise RendererError(f"{command[0]} cannot be started: {error.strerror}") from error
    with process:
        try:
            written, complaint = process.communicate(stdin, timeout_s)
        except subprocess.TimeoutExpired as error:
            advice = ". Try to draw it smaller, or another --renderer" if task == _DRAWING else ""
            raise RendererError(f"{name} cannot {task} in {timeout_s:g} s{advice}") from error
        finally:  # also at an interrupt, which another process group does not receive
            _end(process)
    if process.returncode:
        lines = complaint.decode(errors="replace").strip().splitlines() or ["no reason given"]
        raise RendererError(f"{name} cannot {task}: {lines[-1]} (exit status {process.returncode})")
    return written


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.returncode is not None:
        return
    if os.name == "posix":
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
