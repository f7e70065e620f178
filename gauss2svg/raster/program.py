"""What the renderers share: programs found and run in limited time, browsers' pages, PNGs read."""

from __future__ import annotations

import io
import os
import shutil
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL.PngImagePlugin import PngImageFile

from gauss2svg import processes
from gauss2svg.errors import RendererError

# Inkscape takes up to a minute for a large file of blurs; a program that takes longer hangs.
TIMEOUT_S = 300
_DRAWING = "draw the SVG"
IMAGE = "drawing.svg"
WHITE, BLACK, CLEAR = "#fff", "#000", "transparent"  # pages of browsers
# Where installers put programs that are not on PATH, relative to the folders of `places`.
_MACOS = {
    "chromium": (
        "Google Chrome.app/Contents/MacOS/Google Chrome",
        "Chromium.app/Contents/MacOS/Chromium",
    ),
    "firefox": ("Firefox.app/Contents/MacOS/firefox",),
    "inkscape": ("Inkscape.app/Contents/MacOS/inkscape",),
}
_WINDOWS = {
    "chromium": ("Google/Chrome/Application/chrome.exe", "Chromium/Application/chrome.exe"),
    "firefox": ("Mozilla Firefox/firefox.exe",),
    # The .com writes to the terminal, the .exe opens a window.
    "inkscape": ("Inkscape/bin/inkscape.com", "Inkscape/bin/inkscape.exe"),
}
_PROGRAM_FILES = ("ProgramFiles", "ProgramW6432", "ProgramFiles(x86)", "LOCALAPPDATA")


def places(renderer: str) -> list[str]:
    """Return where installers put a renderer's program that is not on PATH."""
    if sys.platform == "darwin":
        folders = ["/Applications", os.path.join(os.environ.get("HOME", "/"), "Applications")]
        names = _MACOS.get(renderer, ())
    elif sys.platform == "win32":
        folders = [os.environ[name] for name in _PROGRAM_FILES if os.environ.get(name)]
        names = _WINDOWS.get(renderer, ())
    else:
        return []
    return [os.path.join(folder, *name.split("/")) for name in names for folder in folders]


def find(renderer: str, names: Sequence[str], install: str) -> str:
    """Path of the first of the programs that is there; raises RendererError where there is none."""
    elsewhere = places(renderer)
    found = (path for path in (*map(shutil.which, names), *map(shutil.which, elsewhere)) if path)
    if path := next(found, None):
        return path
    where = "on PATH or where it is usually installed" if elsewhere else "on PATH"
    raise RendererError(
        f"renderer {renderer} needs the program {names[0]}; got none {where}. Try to install it "
        f"({install}), or --renderer resvg"
    )


def wrong_size(what: str, got: Sequence[int], needed: Sequence[int]) -> RendererError:
    """The error of a raster of got instead of needed (width, height) px."""
    width, height = needed
    return RendererError(
        f"{what} must be {width}x{height} px; got {got[0]}x{got[1]} px. Try an SVG with a viewBox"
    )


@cache
def version_line(path: str) -> str:
    """First line that the program prints for --version; asked once."""
    try:
        printed = run([path, "--version"], timeout_s=30, task="say its version")
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
        ended = processes.run(
            command, stdin, timeout_s=timeout_s, folder=folder, environment=environment
        )
    except TimeoutError as error:
        advice = ". Try to draw it smaller, or another --renderer" if task == _DRAWING else ""
        raise RendererError(f"{name} cannot {task} in {timeout_s:g} s{advice}") from error
    except OSError as error:
        raise RendererError(f"{command[0]} cannot be started: {error.strerror}") from error
    if ended.status:
        why = ended.complaint or "no reason given"
        raise RendererError(f"{name} cannot {task}: {why} (exit status {ended.status})")
    return ended.output


def html(page: str) -> str:
    """The page that shows an SVG in a browser, of the colour WHITE, BLACK or CLEAR.

    It does so in an <img>, in which an SVG runs no script and loads nothing.
    """
    return f"""<!doctype html><meta charset="utf-8">
<style>html, body {{ margin: 0; background: {page} }} img {{ display: block }}</style>
<img src="{IMAGE}">
"""


def from_png(png: bytes) -> NDArray[np.float32]:
    """Unpremultiplied RGBA (h, w, 4) float32 in 0..1 of a PNG that a renderer wrote."""
    # Not by Image.open, whose size limits are for untrusted images: this size was requested.
    with PngImageFile(io.BytesIO(png)) as picture:
        pixels = np.array(picture.convert("RGBA"), np.float32)
    pixels /= 255
    return pixels
