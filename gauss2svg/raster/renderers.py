"""Renderers that are libraries (resvg, CairoSVG) or programs (librsvg, Inkscape, Firefox).

librsvg is the renderer of GNOME and of many web services. Its program is rsvg-convert. Inkscape
draws an SVG as an editor shows it. Firefox has an option to take a screenshot without a window.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import resvg_py
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


# For each renderer: the commands that install its program, for error messages, and the names of the
# program, which are looked for on PATH. A name with / is a path relative to _FOLDERS.
_PROGRAMS = {
    "librsvg": ("apt-get install librsvg2-bin, brew install librsvg", "rsvg-convert"),
    # The program inkscape.com writes to the terminal. inkscape.exe would open a window.
    "inkscape": (
        "apt-get install inkscape, brew install inkscape", "inkscape",
        "Inkscape.app/Contents/MacOS/inkscape", "Inkscape/bin/inkscape.com",
        "Inkscape/bin/inkscape.exe",
    ),
    "firefox": (
        "apt-get install firefox-esr", "firefox", "firefox-esr",
        "Firefox.app/Contents/MacOS/firefox", "Mozilla Firefox/firefox.exe",
    ),
    "chromium": (
        "apt-get install chromium", "chromium", "chromium-browser", "google-chrome",
        "google-chrome-stable", "Google Chrome.app/Contents/MacOS/Google Chrome",
        "Chromium.app/Contents/MacOS/Chromium", "Google/Chrome/Application/chrome.exe",
        "Chromium/Application/chrome.exe",
    ),
}  # fmt: skip


def find(renderer: str) -> str:
    """Return the path of a renderer's program. Raise RendererError if none is installed."""
    install, *names = _PROGRAMS[renderer]
    for name in names:
        folders = _FOLDERS if "/" in name else [""]
        for path in (os.path.normpath(os.path.join(folder, name)) for folder in folders):
            if program := shutil.which(path):
                return program
    raise RendererError(
        f"renderer {renderer} needs the program {names[0]}; got none on PATH or where it is "
        f"usually installed. Try to install it ({install}), or --renderer resvg"
    )


def version(renderer: str) -> str:
    """Return the name and version of a renderer. Raise RendererError if it is not installed."""
    if renderer == "resvg":
        return f"resvg {resvg_py.__resvg_version__}"
    if renderer == "cairo":
        return f"CairoSVG {cairosvg_module().__version__}"
    if renderer == "chromium":
        playwright_api()
    path = find(renderer)
    if renderer == "chromium" and sys.platform == "win32":  # --version would open a window there
        return "Chromium of unknown version"
    # Programs print a line such as "Mozilla Firefox 153.0", "Inkscape 1.2.2 (b0a8486541)" or
    # "Chromium 156.0.8078.79 built on Debian GNU/Linux".
    line = _version_line(path).removeprefix("Mozilla ").replace("rsvg-convert version", "librsvg")
    return re.split(r" \(| built on ", line)[0]


@cache
def _version_line(path: str) -> str:
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


# Whether resvg prints messages to standard output. Only gauss2svg.raster.isolated changes it.
resvg_prints = False


def resvg(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG as resvg draws it."""
    try:
        # If dpi is not given, resvg_py draws lengths in mm and the like as 0.
        png = resvg_py.svg_to_bytes(
            svg_string=svg, width=width, height=height, skip_system_fonts=True, dpi=96,
            languages=["en"], log_information=resvg_prints,
        )  # fmt: skip
    except BaseException as error:
        # If resvg panics, pyo3 raises its PanicException, which is not an Exception but only a
        # BaseException.
        if isinstance(error, ValueError) or type(error).__name__ == "PanicException":
            raise RendererError(f"resvg cannot draw the SVG: {error}") from error
        raise
    return from_png(png)


def cairo(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG as CairoSVG draws it."""
    cairosvg, size = cairosvg_module(), {"output_width": width, "output_height": height}
    try:
        return from_png(cairosvg.svg2png(svg.encode(), unsafe=False, **size) or b"")
    except Exception as error:  # the parser of CairoSVG may raise an exception of any class
        raise RendererError(f"CairoSVG cannot draw the SVG: {error!r}") from error


def cairosvg_module() -> Any:
    """Return the package cairosvg. Raise RendererError if its system library is not installed."""
    try:
        import cairosvg
    except OSError as error:  # raised if cairocffi has not found the shared library cairo
        raise RendererError(
            "renderer cairo needs the cairo system library. Try to install it (apt-get install "
            "libcairo2, brew install cairo), or --renderer resvg"
        ) from error
    return cairosvg


def playwright_api() -> Any:
    """Return Playwright's API. Raise RendererError if it is not installed."""
    try:
        from playwright import sync_api
    except ImportError as error:
        raise RendererError(
            "renderer chromium needs Playwright and a browser. Try to install them (pip install "
            '"gauss2svg[browser]", apt-get install chromium), or --renderer resvg'
        ) from error
    return sync_api


def librsvg(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG as librsvg draws it."""
    # Without --unlimited, rsvg-convert refuses large files. The SVG comes from standard input, so
    # it has no folder, and rsvg-convert loads no other files for it.
    size = ["--width", str(width), "--height", str(height)]
    command = [find("librsvg"), "--unlimited", *size, "--format=png"]
    return from_png(run(command, stdin=svg.encode()))


def inkscape(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG as Inkscape draws it."""
    export = "--export-type=png", "--export-area-page", "--export-filename=drawn.png"
    size = f"--export-width={width}", f"--export-height={height}"
    return run_in_folder(
        "Inkscape", {DRAWING: svg}, lambda _: [find("inkscape"), *export, *size, DRAWING]
    )


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


def firefox(svg: str, width: int, height: int, page: str = WHITE) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG on a page of the colour `page`.

    Firefox has no transparent page. So if `page` is CLEAR, the alpha is computed from two
    drawings, over white and over black.
    """
    if page == CLEAR:
        return from_views(
            *(firefox(svg, width, height, color)[:, :, :3] for color in (WHITE, BLACK))
        )
    files = {DRAWING: svg, "page.html": html(page), "profile/user.js": _PREFERENCES}

    def command(folder: Path) -> list[str]:
        # Without --no-remote, a Firefox that the user has already started would open the page.
        options = ["--headless", "--no-remote", f"--window-size={width},{height}"]
        if sys.platform == "win32":
            # The program starts another process for the browser. Without this option the program
            # would end before that process.
            options.append("--wait-for-browser")
        screenshot = "--screenshot", str(folder / "drawn.png"), (folder / "page.html").as_uri()
        return [find("firefox"), *options, "--profile", str(folder / "profile"), *screenshot]

    return run_in_folder("Firefox", files, command)
