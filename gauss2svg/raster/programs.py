"""Renderers that are programs (librsvg, Inkscape, Firefox), and functions to find and run programs.

librsvg, the renderer of GNOME and of many web services, is run as rsvg-convert. Inkscape shows an
SVG as an editor does. Firefox draws with its own screenshot option, without a window.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gauss2svg import processes
from gauss2svg.errors import RendererError
from gauss2svg.photo.pixels import from_views
from gauss2svg.raster import BLACK, CLEAR, WHITE, from_png

TIMEOUT_S = 300  # s, time limit of a program. Inkscape takes up to a minute for a file of blurs
DRAWING = "drawing.svg"
# Folders in which installers put programs that are not on PATH.
if sys.platform == "win32":
    _VARIABLES = "ProgramFiles", "ProgramW6432", "ProgramFiles(x86)", "LOCALAPPDATA"
    _FOLDERS = [os.environ[name] for name in _VARIABLES if os.environ.get(name)]
else:
    _FOLDERS = ["/Applications", os.path.expanduser("~/Applications")]  # folders of macOS


def find(renderer: str, names: Sequence[str], install: str) -> str:
    """Return the path of the first program that is installed. Raise RendererError if none is.

    names    names of programs on PATH, or paths (with /) relative to the folders of installers
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
    folder  working folder, which is also the program's home folder
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


def run_in_folder(
    renderer: str, files: Mapping[str, str], command: Callable[[Path], Sequence[str]]
) -> NDArray[np.float32]:
    """Run a command in a new folder with `files`, and return the pixels of its drawn.png."""
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


def librsvg_version() -> str:
    """Return the name and version of librsvg."""
    return f"librsvg {version_line(_librsvg_program()).rpartition(' ')[2]}"


def librsvg(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG by librsvg."""
    # Without --unlimited, rsvg-convert refuses large files. It loads no other files for an SVG on
    # standard input, which has no folder.
    size = ["--width", str(width), "--height", str(height)]
    return from_png(
        run([_librsvg_program(), "--unlimited", *size, "--format=png"], stdin=svg.encode())
    )


def _librsvg_program() -> str:
    return find("librsvg", ["rsvg-convert"], "apt-get install librsvg2-bin, brew install librsvg")


_MAX_SIDE = 32767  # px, largest side of a cairo surface. For more, Inkscape writes a white image


def inkscape_version() -> str:
    """Return the name and version of Inkscape."""
    return " ".join(version_line(_inkscape_program()).split()[:2])


def inkscape(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG by Inkscape."""
    if max(width, height) > _MAX_SIDE:
        raise RendererError(
            f"raster of inkscape must be at most {_MAX_SIDE} px a side; got {width}x{height}. "
            "Try to draw it smaller, or another --renderer"
        )
    export = "--export-type=png", "--export-area-page", "--export-filename=drawn.png"
    size = f"--export-width={width}", f"--export-height={height}"
    return run_in_folder(
        "Inkscape", {DRAWING: svg}, lambda _: [_inkscape_program(), *export, *size, DRAWING]
    )


def _inkscape_program() -> str:
    mac = "Inkscape.app/Contents/MacOS/inkscape"
    # The .com writes to the terminal, the .exe opens a window.
    windows = "Inkscape/bin/inkscape.com", "Inkscape/bin/inkscape.exe"
    install = "apt-get install inkscape, brew install inkscape"
    return find("inkscape", ["inkscape", mac, *windows], install)


# Settings of Firefox: colours are not converted to the screen's profile, and do not depend on the
# graphics card. Animated files are in their final state. The nonexistent proxy blocks the network.
_PREFERENCES = """
user_pref("gfx.color_management.mode", 0);
user_pref("gfx.webrender.software", true);
user_pref("layout.css.devPixelsPerPx", "1.0");
user_pref("ui.prefersReducedMotion", 1);
user_pref("network.proxy.type", 1);
user_pref("network.proxy.http", "127.0.0.1");
user_pref("network.proxy.http_port", 9);
user_pref("network.proxy.ssl", "127.0.0.1");
user_pref("network.proxy.ssl_port", 9);
"""
# On Windows the program starts another process, and would end before that process ends.
_WAIT = ["--wait-for-browser"] if sys.platform == "win32" else []
# Firefox does not report a broken image. So the page removes an image of the wrong size, together
# with its lower border, a row of white pixels.
_SIZE_CHECK = """<style>
body {{ overflow: hidden }} img {{ background: {color}; border-bottom: 1px solid #fff }}
</style>
<script>
addEventListener("load", () => {{
  const image = document.images[0];
  if (image.naturalWidth !== {width} || image.naturalHeight !== {height}) image.remove();
}});
</script>
"""


def firefox_version() -> str:
    """Return the name and version of Firefox."""
    return version_line(_firefox_program()).removeprefix("Mozilla ")


def firefox(svg: str, width: int, height: int, page: str = WHITE) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG on a page. Draw twice for a clear page."""
    if page == CLEAR:
        return from_views(
            *(firefox(svg, width, height, color)[:, :, :3] for color in (WHITE, BLACK))
        )
    page_end = _SIZE_CHECK.format(width=width, height=height, color=page)
    files = {DRAWING: svg, "page.html": html(BLACK) + page_end, "profile/user.js": _PREFERENCES}

    def command(folder: Path) -> list[str]:
        # Without --no-remote, a running Firefox would open the page.
        options = ["--headless", "--no-remote", *_WAIT, f"--window-size={width},{height + 1}"]
        screenshot = "--screenshot", str(folder / "drawn.png"), (folder / "page.html").as_uri()
        return [_firefox_program(), *options, "--profile", str(folder / "profile"), *screenshot]

    pixels = run_in_folder("Firefox", files, command)
    # The row below the image is its border. Without that row, the caller refuses the short raster.
    if not pixels[height:].all():
        raise RendererError("Firefox cannot draw the SVG: not a supported image")
    return pixels[:height]


def _firefox_program() -> str:
    names = "firefox", "firefox-esr", "Firefox.app/Contents/MacOS/firefox"
    windows = "Mozilla Firefox/firefox.exe"
    return find("firefox", [*names, windows], "apt-get install firefox-esr")
