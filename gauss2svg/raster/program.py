"""Tools for renderers: find and run a program, make a page for a browser, read a PNG."""

from __future__ import annotations

import io
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL.PngImagePlugin import PngImageFile

from gauss2svg import processes
from gauss2svg.errors import RendererError

TIMEOUT_S = 300  # s; Inkscape takes up to a minute for a large file of blurs
DRAWING = "drawing.svg"
WHITE, BLACK, CLEAR = "#fff", "#000", "transparent"  # colours of a browser's page
# Folders in which installers put programs that are not on PATH.
if sys.platform == "win32":
    _VARIABLES = "ProgramFiles", "ProgramW6432", "ProgramFiles(x86)", "LOCALAPPDATA"
    _FOLDERS = [os.environ[name] for name in _VARIABLES if os.environ.get(name)]
else:
    _FOLDERS = ["/Applications", os.path.expanduser("~/Applications")]  # folders of macOS


def find(renderer: str, names: Sequence[str], install: str) -> str:
    """Return the path of the first program that is installed. Raise RendererError if none is.

    names    names of programs on PATH, or paths with / in the folders of installers
    install  commands that install the program, for the error
    """
    for name in names:
        folders = _FOLDERS if "/" in name else [""]
        for path in (os.path.normpath(os.path.join(folder, name)) for folder in folders):
            if program := shutil.which(path):
                return program
    raise RendererError(
        f"renderer {renderer} needs the program {names[0]}; got none on PATH or where it is "
        f"usually installed. Try to install it ({install}), or --renderer resvg"
    )


@cache
def version_line(path: str) -> str:
    """Return the first line that a program prints for --version."""
    printed = run([path, "--version"], 30, "say its version").decode(errors="replace").strip()
    return printed.partition("\n")[0].strip()


def run(
    command: Sequence[str],
    timeout_s: float = TIMEOUT_S,
    task: str = "draw the SVG",
    stdin: bytes | None = None,
    folder: Path | None = None,
) -> bytes:
    """Run a command and return its standard output. Raise RendererError if it fails.

    task    phrase for the error: "cannot TASK"
    folder  working folder, which also becomes the home of the program
    """
    # The user's settings could change the image, and two processes cannot share a profile.
    home = {"INKSCAPE_PROFILE_DIR": str(folder), "HOME": str(folder)} if folder else {}
    try:
        ended = processes.run(command, stdin, timeout_s=timeout_s, folder=folder, environment=home)
        if not ended.status:
            return ended.output
        reason = f"{ended.complaint or 'no reason given'} (exit status {ended.status})"
    except OSError as error:
        reason = error.strerror or str(error)
    name = Path(command[0]).name
    raise RendererError(
        f"{name} cannot {task}: {reason}. Try to reinstall it, or another --renderer"
    )


def drawn(
    renderer: str, files: Mapping[str, str], command: Callable[[Path], Sequence[str]]
) -> NDArray[np.float32]:
    """Return the pixels of drawn.png, which a command writes to a new folder that has `files`."""
    with tempfile.TemporaryDirectory(prefix="gauss2svg-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        for file, text in files.items():
            (folder / file).parent.mkdir(exist_ok=True)
            (folder / file).write_text(text, encoding="utf-8")
        run(command(folder), folder=folder)
        png = folder / "drawn.png"
        if not png.exists():  # programs may fail with exit status 0
            raise RendererError(f"{renderer} cannot draw the SVG: it wrote no file")
        return from_png(png.read_bytes())


def html(page: str) -> str:
    """Return the HTML of a page of colour `page` (WHITE, BLACK or CLEAR) that shows the drawing.

    The SVG is in an <img>, where it runs no script and loads nothing.
    """
    return f"""<!doctype html><meta charset="utf-8">
<style>html, body {{ margin: 0; background: {page} }} img {{ display: block }}</style>
<img src="{DRAWING}">
"""


def from_png(png: bytes) -> NDArray[np.float32]:
    """Return the straight RGBA (h, w, 4) float32 in 0..1 of a PNG that a renderer wrote."""
    # Image.open would limit the size, as of an untrusted image, but this size was requested.
    with PngImageFile(io.BytesIO(png)) as picture:
        return np.array(picture.convert("RGBA"), np.float32) / np.float32(255)
