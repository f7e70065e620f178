"""Renderers that are programs (librsvg, Inkscape, Firefox), and functions to find and run programs.

librsvg is the renderer of GNOME and of many web services. Its program is rsvg-convert. Inkscape
draws an SVG as an editor shows it. Firefox has an option to take a screenshot without a window.
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

# The time limit of a program, in seconds. Inkscape takes up to a minute for a file with many blurs.
TIMEOUT_S = 300
DRAWING = "drawing.svg"
# The folders into which installers put programs. These programs may not be on PATH.
if sys.platform == "win32":
    _VARIABLES = "ProgramFiles", "ProgramW6432", "ProgramFiles(x86)", "LOCALAPPDATA"
    _FOLDERS = [os.environ[name] for name in _VARIABLES if os.environ.get(name)]
else:
    _FOLDERS = ["/Applications", os.path.expanduser("~/Applications")]  # used on macOS


def find(renderer: str, names: Sequence[str], install: str) -> str:
    """Return the path of the first program in `names` that is installed.

    Raise RendererError if none of them is installed.

    names    names of the programs, which are looked for on PATH. A name with / is a path relative
             to the folders into which installers put programs
    install  commands that install the program, for the error message
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
    """Return the first line that a program prints when it is called with --version."""
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

    task    what the command does, such as "draw the SVG". The error message says that the program
            cannot do this
    folder  working folder of the program, which is also its home folder
    """
    # The program gets a home folder of its own, because the user's settings could change the image,
    # and because two processes cannot use the same profile at once.
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
    """Run a command in a new folder that has `files`.

    Return the pixels of the file drawn.png that the command writes there. Raise RendererError if it
    writes none.
    """
    with tempfile.TemporaryDirectory(prefix="gauss2svg-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        for file, text in files.items():
            (folder / file).parent.mkdir(exist_ok=True)
            (folder / file).write_text(text, encoding="utf-8")
        run(command(folder), folder=folder)
        png = folder / "drawn.png"
        if not png.exists():  # a program that fails may still have the exit status 0
            raise RendererError(f"{renderer} cannot draw the SVG: it wrote no file")
        return from_png(png.read_bytes())


def html(page: str) -> str:
    """Return the HTML of a page that shows the drawing.

    page  colour of the page: WHITE, BLACK or CLEAR

    The drawing is the file DRAWING in an <img>. There an SVG runs no scripts and loads no files.
    """
    return f"""<!doctype html><meta charset="utf-8">
<style>html, body {{ margin: 0; background: {page} }} img {{ display: block }}</style>
<img src="{DRAWING}">
"""


def librsvg_version() -> str:
    """Return the name and version of librsvg."""
    return f"librsvg {version_line(_librsvg_program()).rpartition(' ')[2]}"


def librsvg(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG as librsvg draws it."""
    # Without --unlimited, rsvg-convert refuses large files. The SVG comes from standard input, so
    # it has no folder, and rsvg-convert loads no other files for it.
    size = ["--width", str(width), "--height", str(height)]
    return from_png(
        run([_librsvg_program(), "--unlimited", *size, "--format=png"], stdin=svg.encode())
    )


def _librsvg_program() -> str:
    return find("librsvg", ["rsvg-convert"], "apt-get install librsvg2-bin, brew install librsvg")


# A surface of cairo may have at most this many px a side. If the raster is larger, Inkscape writes
# a white image.
_MAX_SIDE = 32767


def inkscape_version() -> str:
    """Return the name and version of Inkscape."""
    return " ".join(version_line(_inkscape_program()).split()[:2])


def inkscape(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG as Inkscape draws it."""
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
    # The program inkscape.com writes to the terminal. inkscape.exe would open a window.
    windows = "Inkscape/bin/inkscape.com", "Inkscape/bin/inkscape.exe"
    install = "apt-get install inkscape, brew install inkscape"
    return find("inkscape", ["inkscape", mac, *windows], install)


# Settings of Firefox. They make the colours independent of the screen's profile and of the graphics
# card. Animated files are shown in their final state. The network is set to a proxy that does not
# exist, so Firefox cannot use it.
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
# On Windows the program starts another process for the browser. Without this option the program
# would end before that process.
_WAIT = ["--wait-for-browser"] if sys.platform == "win32" else []
# Firefox does not report an image that it cannot draw, but it gives such an image a wrong size. So
# this script removes an image of a wrong size from the page. The image has a border, which is a
# white row of pixels below the image. If the script removes the image, the row is missing too.
# `firefox` checks whether the row is there.
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
    """Return the pixels (height, width, 4) of the SVG on a page of the colour `page`.

    Firefox has no transparent page. So if `page` is CLEAR, the alpha is computed from two
    drawings, over white and over black.
    """
    if page == CLEAR:
        return from_views(
            *(firefox(svg, width, height, color)[:, :, :3] for color in (WHITE, BLACK))
        )
    page_end = _SIZE_CHECK.format(width=width, height=height, color=page)
    files = {DRAWING: svg, "page.html": html(BLACK) + page_end, "profile/user.js": _PREFERENCES}

    def command(folder: Path) -> list[str]:
        # Without --no-remote, a Firefox that the user has already started would open the page.
        options = ["--headless", "--no-remote", *_WAIT, f"--window-size={width},{height + 1}"]
        screenshot = "--screenshot", str(folder / "drawn.png"), (folder / "page.html").as_uri()
        return [_firefox_program(), *options, "--profile", str(folder / "profile"), *screenshot]

    pixels = run_in_folder("Firefox", files, command)
    # The row below the image is white, because it is the border of the image. If the page has
    # removed the image, the row is black. If the screenshot is too short to have this row, this
    # check finds nothing, but the caller refuses the screenshot because of its size.
    if not pixels[height:].all():
        raise RendererError("Firefox cannot draw the SVG: not a supported image")
    return pixels[:height]


def _firefox_program() -> str:
    names = "firefox", "firefox-esr", "Firefox.app/Contents/MacOS/firefox"
    windows = "Mozilla Firefox/firefox.exe"
    return find("firefox", [*names, windows], "apt-get install firefox-esr")
