"""Headless Chromium, driven by Playwright: what the SVG looks like on the web.

Chromium rounds to 8 bits after every layer and dithers gradients by a fixed pattern of 8 x 8 px.
The image is therefore drawn at _OFFSETS, four places on the page that lie differently in the
pattern, and their mean is taken: this gains up to 12 dB against the model, where drawing at twice
the size and averaging loses (docs/decisions/renderers.md).
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import RendererError, quoted
from gauss2svg.photo.alpha import straight
from gauss2svg.raster import program
from gauss2svg.raster.features import Feature
from gauss2svg.raster.program import CLEAR, DRAWING, WHITE, from_png, html

# Found by Chromium 156.
CANNOT_DRAW = {Feature.MOVING: "it shows some moment of it"}
PROGRAM_VARIABLE = "GAUSS2SVG_CHROMIUM"
# Without the profile colours depend on the machine's screen. Reduced motion shows animated files
# in their final state; as an option of the page it would not reach the image in it.
_FLAGS = ("--force-color-profile=srgb", "--hide-scrollbars", "--force-prefers-reduced-motion")
_PROGRAMS = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable",
    "Google Chrome.app/Contents/MacOS/Google Chrome", "Chromium.app/Contents/MacOS/Chromium",
    "Google/Chrome/Application/chrome.exe", "Chromium/Application/chrome.exe",
)  # fmt: skip
_own = threading.local()  # Playwright and the browser of the one thread that uses them
_OFFSETS = ((0, 0), (1, 0), (0, 1), (1, 1))
_SITE, _HTML, _SVG = "http://gauss2svg.invalid/", "text/html", "image/svg+xml"
_PLACE = "([x, y]) => document.images[0].style = `position: absolute; left: ${x}px; top: ${y}px`"
_SIZE = "() => [document.images[0].naturalWidth, document.images[0].naturalHeight]"


def version() -> str:
    """Return the name and version as the program prints them."""
    playwright_api()
    if sys.platform == "win32":  # where --version opens a window
        return f"Chromium {_in_thread(lambda: _context().browser.version)}"
    # Google Chrome 140.0.1 / Chromium 156.0.8078.79 built on Debian GNU/Linux
    return program.version_line(_program()).split(" built on ")[0]


def draw(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG over white; a mean, so finer than 8 bits."""
    return _in_thread(_mean, svg, width, height, WHITE)


def draw_clear(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG on a page without a background."""
    return _in_thread(_mean, svg, width, height, CLEAR)


def playwright_api() -> Any:
    """Return Playwright's module; raise RendererError where it is not installed."""
    try:
        from playwright import sync_api
    except ImportError as error:
        raise RendererError(
            "renderer chromium needs Playwright and a browser. Try to install them (pip install "
            '"gauss2svg[browser]", apt-get install chromium), or --renderer resvg'
        ) from error
    return sync_api


def _program() -> str:
    named = os.environ.get(PROGRAM_VARIABLE)
    if not named:
        return program.find("chromium", _PROGRAMS, "apt-get install chromium")
    if path := shutil.which(named):
        return path
    raise RendererError(
        f"{PROGRAM_VARIABLE} must be the path of a Chromium; got {quoted(named)}. Try to correct "
        "it, or to unset it for the one on PATH"
    )


def launch(playwright: Any, flags: Sequence[str] = _FLAGS) -> Any:
    """Return a started browser, or raise RendererError with its last message."""
    path = _program()
    # As root Chromium does not start with its sandbox; everybody else keeps the sandbox.
    is_root = hasattr(os, "geteuid") and os.geteuid() == 0
    try:
        return playwright.chromium.launch(
            executable_path=path, args=flags, chromium_sandbox=not is_root
        )
    except playwright_api().Error as error:
        said = str(error)
        complaint = re.findall(r"\[err\] (.*\S)", said) or re.findall(r"<(process did .*)>", said)
        why = complaint[-1] if complaint else _first_line(error)
        raise RendererError(
            f"Chromium did not start: {why}. Try to reinstall {path}, or --renderer resvg"
        ) from error


def _in_thread(job: Callable[..., Any], *arguments: Any) -> Any:
    """Return what a job returns in the thread that Playwright's objects of this process belong to.

    In another thread Playwright refuses to work beside a running asyncio loop, as of a notebook.
    """
    return _thread(os.getpid()).submit(job, *arguments).result()


# A forked process has its own, since the browser and its thread are its parent's.
@cache
def _thread(process_id: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "gauss2svg-chromium")


def _context(**options: Any) -> Any:
    """Return a new context of the browser of this thread, which ends with the process."""
    if not hasattr(_own, "playwright"):
        _own.playwright = playwright_api().sync_playwright().start()
    # There is none at first; one that has died since the last image is noticed here only.
    with suppress(playwright_api().Error, AttributeError):
        return _own.browser.new_context(**options)
    _own.browser = launch(_own.playwright)
    return _own.browser.new_context(**options)


def _mean(svg: str, width: int, height: int, color: str) -> NDArray[np.float32]:
    size, is_clear = {"width": width + 1, "height": height + 1}, color == CLEAR
    total = np.zeros((height, width, 4), np.float32)
    try:
        # Offline: nothing but the two routes has an answer.
        with _context(viewport=size, offline=True, service_workers="block") as context:
            context.set_default_timeout(program.TIMEOUT_S * 1000)
            page = context.new_page()
            page.route(_SITE, lambda route: route.fulfill(body=html(color), content_type=_HTML))
            page.route(_SITE + DRAWING, lambda route: route.fulfill(body=svg, content_type=_SVG))
            page.goto(_SITE)
            # Not evaluate(), which would wait forever for a page that hangs.
            if page.wait_for_function(_SIZE).json_value() != [width, height]:
                raise RendererError(program.NOT_DRAWN.format("Chromium", width, height))
            for x, y in _OFFSETS:
                page.wait_for_function(_PLACE, arg=[x, y])
                view = from_png(page.screenshot(omit_background=is_clear))
                view = view[y : y + height, x : x + width]
                view[:, :, :3] *= view[:, :, 3:]  # transparent places have no colour
                total += view
    except playwright_api().Error as error:
        raise RendererError(
            f"Chromium cannot draw the SVG at {width}x{height} px: {_first_line(error)}"
        ) from error
    total /= np.float32(len(_OFFSETS))
    return straight(total[:, :, :3], total[:, :, 3]) if is_clear else total


def _first_line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0] or type(error).__name__
