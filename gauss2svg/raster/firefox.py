"""Headless Firefox, by its own screenshot option."""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import RendererError
from gauss2svg.photo.alpha import from_views
from gauss2svg.raster import program
from gauss2svg.raster.features import Feature
from gauss2svg.raster.program import BLACK, CLEAR, DRAWING, WHITE, drawn, html

# Observed with Firefox 153.
CANNOT_DRAW = {Feature.MOVING: "it shows some moment of it"}
# Colours are not converted to the screen's profile, and are the same on every graphics card.
# Animated files are shown in their final state. A proxy that does not exist blocks the network.
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
# On Windows the program starts another process, and would end before that does.
_WAIT = ["--wait-for-browser"] if sys.platform == "win32" else []
# Firefox does not report a broken image. So the page removes an image of the wrong size, and with
# it the row of white pixels that is its lower border.
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


def version() -> str:
    """Return the name and version of Firefox."""
    return program.version_line(_program()).removeprefix("Mozilla ")


def draw(svg: str, width: int, height: int, page: str = WHITE) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG on a page. A clear page takes two rasters."""
    if page == CLEAR:
        return from_views(*(draw(svg, width, height, color)[:, :, :3] for color in (WHITE, BLACK)))
    page_end = _SIZE_CHECK.format(width=width, height=height, color=page)
    files = {DRAWING: svg, "page.html": html(BLACK) + page_end, "profile/user.js": _PREFERENCES}

    def command(folder: Path) -> list[str]:
        # Without --no-remote a Firefox that is already open would open the page.
        options = ["--headless", "--no-remote", *_WAIT, f"--window-size={width},{height + 1}"]
        screenshot = "--screenshot", str(folder / "drawn.png"), (folder / "page.html").as_uri()
        return [_program(), *options, "--profile", str(folder / "profile"), *screenshot]

    pixels = drawn("Firefox", files, command)
    # all() of no rows is True. A window that small is refused by the caller.
    if not pixels[height:].all():
        raise RendererError("Firefox cannot draw the SVG: not a supported image")
    return pixels[:height]


def _program() -> str:
    names = "firefox", "firefox-esr", "Firefox.app/Contents/MacOS/firefox"
    windows = "Mozilla Firefox/firefox.exe"
    return program.find("firefox", [*names, windows], "apt-get install firefox-esr")
