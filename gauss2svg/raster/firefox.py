"""Headless Firefox, by its own screenshot option."""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import RendererError
from gauss2svg.photo.alpha import from_views
from gauss2svg.raster import program
from gauss2svg.raster.features import Feature
from gauss2svg.raster.program import BLACK, DRAWING, WHITE, drawn, html

# Found by Firefox 153.
CANNOT_DRAW = {Feature.MOVING: "it shows some moment of it"}
# Colours are not converted to the screen's profile, and are the same on every graphics card.
# Animated files are shown in their final state. A proxy that is not there blocks the network.
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
# Firefox does not report a broken image. So the page removes what has not the right size, and with
# it the row of white pixels that is the image's lower border.
_VERDICT = """<style>
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


def draw(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG over white."""
    return _draw(svg, width, height, WHITE)


def draw_clear(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) with alpha, by rasters over white and over black."""
    white, black = (_draw(svg, width, height, color)[:, :, :3] for color in (WHITE, BLACK))
    return from_views(white, black)


def _draw(svg: str, width: int, height: int, color: str) -> NDArray[np.float32]:
    page_end = _VERDICT.format(width=width, height=height, color=color)
    files = {DRAWING: svg, "page.html": html(BLACK) + page_end, "profile/user.js": _PREFERENCES}

    def command(folder: Path) -> list[str]:
        return [
            _program(),
            "--headless",
            "--no-remote",  # otherwise a Firefox that is already open would open the page
            "--profile",
            str(folder / "profile"),
            f"--window-size={width},{height + 1}",
            "--screenshot",
            str(folder / "drawn.png"),
            (folder / "page.html").as_uri(),
            # On Windows the program starts another, and would end before that.
            *(["--wait-for-browser"] if sys.platform == "win32" else []),
        ]

    pixels = drawn("Firefox", files, command)
    if pixels.shape[:2] != (height + 1, width):
        raise RendererError(
            f"screenshot of Firefox must be {width}x{height + 1} px; got "
            f"{pixels.shape[1]}x{pixels.shape[0]} px. Try to draw it smaller, or another --renderer"
        )
    if not pixels[height:, :, :3].all():
        raise RendererError(program.NOT_DRAWN.format("Firefox", width, height))
    return pixels[:height]


def _program() -> str:
    names = "firefox", "firefox-esr", "Firefox.app/Contents/MacOS/firefox"
    windows = "Mozilla Firefox/firefox.exe"
    return program.find("firefox", [*names, windows], "apt-get install firefox-esr")
