"""Headless Chromium, driven by Playwright: what the SVG looks like on the web.

Chromium rounds to 8 bits after every layer and dithers gradients by a fixed pattern of 8 x 8 px.
The image is therefore drawn at _OFFSETS, four places on the page that lie differently in the
pattern, and their mean is taken: this gains up to 12 dB against the model, where drawing at twice
the size and averaging loses (docs/decisions/renderers.md).
"""

from __future__ import annotations

import atexit
import io
import os
import queue
import re
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.errors import RendererError, quoted
from gauss2svg.photo.alpha import straight
from gauss2svg.raster.features import Feature
from gauss2svg.raster.program import CLEAR, DRAWING, TIMEOUT_S, WHITE, find, html, version_line

# Found by Chromium 156.
CANNOT_DRAW = {Feature.MOVING: "it shows some moment of it"}
PROGRAM_VARIABLE = "GAUSS2SVG_CHROMIUM"
# Without the profile colours depend on the machine's screen. Reduced motion shows animated files
# in their final state; as an option of the page it would not reach the image in it.
_FLAGS = ("--force-color-profile=srgb", "--hide-scrollbars", "--force-prefers-reduced-motion")
_OFFSETS = ((0, 0), (1, 0), (0, 1), (1, 1))
_SITE, _HTML, _SVG = "http://gauss2svg.invalid/", "text/html", "image/svg+xml"
_PLACE = "([x, y]) => document.images[0].style = `position: absolute; left: ${x}px; top: ${y}px`"
_SIZE = "() => [document.images[0].naturalWidth, document.images[0].naturalHeight]"


def version() -> str:
    """Return the name and version as the program prints them; no browser is started."""
    playwright_api()
    program = _program()
    if sys.platform == "win32":
        return f"Chromium {_version_beside(program)}"
    # Google Chrome 140.0.1 / Chromium 156.0.8078.79 built on Debian GNU/Linux
    return version_line(program).split(" built on ")[0]


def _version_beside(program: str) -> str:
    """Return the version of a Chromium on Windows, where --version would open a window.

    An installer puts its files in a folder of that name beside the program. Playwright's own
    Chromium has no such folder.
    """
    folders = [path.name for path in Path(program).parent.glob("[0-9]*.*.*.*")]
    numbers = [[int(part) for part in re.findall("[0-9]+", name)] for name in folders]
    return ".".join(map(str, max(numbers))) if numbers else "of unknown version"


def draw(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG over white; a mean, so finer than 8 bits."""
    return _worker(os.getpid()).call(lambda new: _mean(new, svg, width, height, WHITE))


def draw_clear(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG on a page without a background."""
    return _worker(os.getpid()).call(lambda new: _mean(new, svg, width, height, CLEAR))


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
        names = "chromium", "chromium-browser", "google-chrome", "google-chrome-stable"
        return find("chromium", names, "apt-get install chromium")
    if os.access(named, os.X_OK) and os.path.isfile(named):
        return named
    raise RendererError(
        f"{PROGRAM_VARIABLE} must be the path of a Chromium; got {quoted(named)}. Try to correct "
        "it, or to unset it for the one on PATH"
    )


def launch(playwright: Any, flags: Sequence[str] = _FLAGS) -> Any:
    """Return a started browser, or raise RendererError with its last message."""
    program = _program()
    # As root Chromium does not start with its sandbox; everybody else keeps the sandbox.
    is_root = hasattr(os, "geteuid") and os.geteuid() == 0
    try:
        return playwright.chromium.launch(
            executable_path=program, args=flags, chromium_sandbox=not is_root
        )
    except playwright_api().Error as error:
        said = str(error)
        complaint = re.findall(r"\[err\] (.*\S)", said) or re.findall(r"<(process did .*)>", said)
        why = complaint[-1] if complaint else _first_line(error)
        raise RendererError(
            f"Chromium did not start: {why}. Try to reinstall {program}, or --renderer resvg"
        ) from error


class _Worker:
    """One browser for the process, in a thread of its own, which Playwright's objects belong to.

    In another thread Playwright refuses to work beside a running asyncio loop, as of a notebook.
    """

    def __init__(self) -> None:
        self._jobs: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._playwright: Any = None
        self._browser: Any = None
        self._thread = threading.Thread(target=self._work, name="gauss2svg-chromium", daemon=True)
        self._thread.start()
        atexit.register(self.close)

    def call(self, job: Callable[[Callable[..., Any]], Any]) -> Any:
        """Return what a job in the thread returns for `Browser.new_context`, or raise its error."""
        done: Future[Any] = Future()
        self._jobs.put((done, job))
        return done.result()

    def close(self) -> None:
        """End the browser, within ten seconds."""
        self._jobs.put(None)
        self._thread.join(10)

    def _work(self) -> None:
        for done, job in iter(self._jobs.get, None):
            try:
                done.set_result(job(self._context))
            except BaseException as error:  # passed on to the caller
                done.set_exception(error)
        if self._playwright is not None:
            self._playwright.stop()  # and with it the browser

    def _context(self, **options: Any) -> Any:
        api = playwright_api()
        if self._browser is not None:
            # A browser that has died since the last image is noticed at the first call only.
            with suppress(api.Error):
                return self._browser.new_context(**options)
        self._playwright = self._playwright or api.sync_playwright().start()
        self._browser = launch(self._playwright)
        return self._browser.new_context(**options)


# A forked process has its own, since the browser and its thread are its parent's.
@cache
def _worker(process_id: int) -> _Worker:
    return _Worker()


def _mean(
    new_context: Callable[..., Any], svg: str, width: int, height: int, color: str
) -> NDArray[np.float32]:
    view, is_clear = {"width": width + 1, "height": height + 1}, color == CLEAR
    total = np.zeros((height, width, 4), np.float32)
    try:
        # Offline: nothing but the two routes has an answer.
        with new_context(viewport=view, offline=True, service_workers="block") as context:
            context.set_default_timeout(TIMEOUT_S * 1000)
            page = context.new_page()
            page.route(_SITE, lambda route: route.fulfill(body=html(color), content_type=_HTML))
            page.route(_SITE + DRAWING, lambda route: route.fulfill(body=svg, content_type=_SVG))
            page.goto(_SITE)
            # Not evaluate(), which would wait forever for a page that hangs.
            found = page.wait_for_function(_SIZE).json_value()
            if found == [0, 0]:
                raise RendererError("Chromium cannot draw the SVG: not a supported image")
            if found != [width, height]:
                return np.zeros((found[1], found[0], 4), np.float32)  # which is refused
            for x, y in _OFFSETS:
                page.wait_for_function(_PLACE, arg=[x, y])
                with Image.open(io.BytesIO(page.screenshot(omit_background=is_clear))) as picture:
                    levels = np.asarray(picture.convert("RGBA"), np.float32)
                levels = levels[y : y + height, x : x + width].copy()
                levels[:, :, :3] *= levels[:, :, 3:] / 255  # transparent places have no colour
                total += levels
    except playwright_api().Error as error:
        raise RendererError(
            f"Chromium cannot draw the SVG at {width}x{height} px: {_first_line(error)}"
        ) from error
    total /= np.float32(255 * len(_OFFSETS))
    return straight(total[:, :, :3], total[:, :, 3]) if is_clear else total


def _first_line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0] or type(error).__name__
