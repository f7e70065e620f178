"""Headless Firefox, by its own screenshot option."""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import RendererError
from gauss2svg.photo.alpha import from_views
from gauss2svg.raster.features import Feature
from gauss2svg.raster.program import BLACK, IMAGE, WHITE, find, from_png, html, run, version_line

# Found by Firefox 153.
CANNOT_DRAW = {Feature.MOVING: "it shows some moment of it"}
_PREFERENCES = {
    "gfx.color_management.mode": 0,  # colours are not converted to the screen's profile
    "gfx.webrender.software": True,  # the same image on every graphics card
    "layout.css.devPixelsPerPx": "1.0",
    "ui.prefersReducedMotion": 1,  # animated files are shown in their final state
    "network.proxy.type": 1,  # a proxy that is not there, so that nothing reaches the network
    "network.proxy.http": "127.0.0.1",
    "network.proxy.http_port": 9,
    "network.proxy.ssl": "127.0.0.1",
    "network.proxy.ssl_port": 9,
    "network.captive-portal-service.enabled": False,
    "network.connectivity-service.enabled": False,
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
    """Name and version of Firefox."""
    return version_line(_program()).removeprefix("Mozilla ")


def draw(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Pixels (height, width, 4) of the SVG, over white."""
    return _draw(svg, width, height, WHITE)


def draw_clear(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Pixels (height, width, 4) of the SVG with alpha, by rasters over white and over black."""
    white, black = (_draw(svg, width, height, color)[:, :, :3] for color in (WHITE, BLACK))
    return from_views(white, black)


def _draw(svg: str, width: int, height: int, color: str) -> NDArray[np.float32]:
    with tempfile.TemporaryDirectory(prefix="gauss2svg-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        (folder / IMAGE).write_text(svg, encoding="utf-8")
        page = folder / "page.html"
        verdict = _VERDICT.format(width=width, height=height, color=color)
        page.write_text(html(WHITE) + verdict, encoding="utf-8")
        profile = folder / "profile"
        profile.mkdir()
        preferences = (
            f'user_pref("{key}", {json.dumps(_PREFERENCES[key])});' for key in _PREFERENCES
        )
        (profile / "user.js").write_text("\n".join(preferences), encoding="utf-8")
        screenshot = folder / "drawn.png"
        command = [
            _program(),
            "--headless",
            "--no-remote",  # otherwise a Firefox that is already open would open the page
            "--profile",
            str(profile),
            f"--window-size={width},{height + 1}",
            "--screenshot",
            str(screenshot),
            page.as_uri(),
            # On Windows the program starts another, and would end before that.
            *(["--wait-for-browser"] if sys.platform == "win32" else []),
        ]
        run(command, folder=folder, environment={"HOME": name})
        if not screenshot.exists():
            raise RendererError("Firefox cannot draw the SVG: it wrote no file")
        drawn = from_png(screenshot.read_bytes())
    verdict = drawn[height:, :width, :3]
    if drawn.shape[:2] != (height + 1, width):
        raise RendererError(
            f"screenshot of Firefox must be {width}x{height + 1} px; got "
            f"{drawn.shape[1]}x{drawn.shape[0]} px. Try to draw it smaller, or another "
            "--renderer"
        )
    if not verdict.any():
        raise RendererError("Firefox cannot draw the SVG: not a supported image")
    if (verdict[:, :, 1:] == 0).any():
        raise RendererError(
            f"raster of firefox must be {width}x{height} px; got another size. Try an SVG with "
            "a viewBox"
        )
    return drawn[:height]


def _program() -> str:
    return find("firefox", ["firefox", "firefox-esr"], "apt-get install firefox-esr")
