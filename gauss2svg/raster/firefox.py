"""Headless Firefox, by its own screenshot option."""

import json
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import RendererError
from gauss2svg.photo.alpha import from_views
from gauss2svg.raster.features import Feature
from gauss2svg.raster.program import BLACK, DRAWING, WHITE, drawn, find, html, version_line

# Found by Firefox 153.
CANNOT_DRAW = {Feature.MOVING: "it shows some moment of it"}
# Colours are not converted to the screen's profile, and are the same on every graphics card.
# Animated files are shown in their final state. A proxy that is not there blocks the network.
_PREFERENCES = {
    "gfx.color_management.mode": 0,
    "gfx.webrender.software": True,
    "layout.css.devPixelsPerPx": "1.0",
    "ui.prefersReducedMotion": 1,
    "network.proxy.type": 1,
    "network.proxy.http": "127.0.0.1",
    "network.proxy.http_port": 9,
    "network.proxy.ssl": "127.0.0.1",
    "network.proxy.ssl_port": 9,
}
# Firefox does not report a broken image, so the page does, by a row of pixels under it: black for
# no image, white for the right size, red for another.
_VERDICT = """<style>
html, body {{ background: #000 }}
body {{ overflow: hidden; height: {height}px; padding-bottom: 1px }}
img {{ visibility: hidden; background: {color} }}
</style>
<script>
addEventListener("load", () => {{
  const image = document.images[0];
  if (!image.naturalWidth) return;
  const right = image.naturalWidth === {width} && image.naturalHeight === {height};
  const color = right ? "#fff" : "#f00";
  document.body.style.background = document.documentElement.style.background = color;
  if (right) image.style.visibility = "visible";
}});
</script>
"""


def version() -> str:
    """Return the name and version of Firefox."""
    return version_line(_program()).removeprefix("Mozilla ")


def draw(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG over white."""
    return _draw(svg, width, height, WHITE)


def draw_clear(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) with alpha, by rasters over white and over black."""
    white, black = (_draw(svg, width, height, color)[:, :, :3] for color in (WHITE, BLACK))
    return from_views(white, black)


def _draw(svg: str, width: int, height: int, color: str) -> NDArray[np.float32]:
    page_end = _VERDICT.format(width=width, height=height, color=color)
    user_js = "\n".join(
        f'user_pref("{key}", {json.dumps(value)});' for key, value in _PREFERENCES.items()
    )
    files = {DRAWING: svg, "page.html": html(WHITE) + page_end, "profile/user.js": user_js}

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
    verdict = pixels[height:, :, :3]
    if not verdict.any():
        raise RendererError("Firefox cannot draw the SVG: not a supported image")
    if (verdict[:, :, 1:] == 0).any():
        return pixels[:0]  # which is refused
    return pixels[:height]


def _program() -> str:
    return find("firefox", ["firefox", "firefox-esr"], "apt-get install firefox-esr")
