"""Headless Chromium, driven by Playwright: what the SVG looks like on the web.

Chromium rounds to 8 bits after every layer and dithers gradients by a fixed pattern of 8 x 8 px.
The image is therefore drawn at _OFFSETS, four places on the page that lie differently in the
pattern, and their mean is taken: this gains up to 12 dB against the model, where drawing at twice
the size and averaging loses (docs/decisions/renderers.md).
"""

from __future__ import annotations

import atexit
import importlib.metadata
import io
import os
import queue
import re
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.errors import RendererError, quoted
from gauss2svg.photo.alpha import straight
from gauss2svg.raster.features import Feature
from gauss2svg.raster.program import (
    CLEAR,
    IMAGE,
    TIMEOUT_S,
    WHITE,
    find,
    html,
    version_line,
    wrong_size,
)

# Found by Chromium 156.
CANNOT_DRAW = {Feature.MOVING: "it shows some moment of it"}
PROGRAM_VARIABLE = "GAUSS2SVG_CHROMIUM"
_INSTALL = (
    "renderer chromium needs Playwright and a browser. Try to install them (pip install "
    '"gauss2svg[browser]", apt-get install chromium), or --renderer resvg'
)
# Without the profile colours depend on the machine's screen. Reduced motion shows animated files
# in their final state; as an option of the page it would not reach the image in it.
_FLAGS = ("--force-color-profile=srgb", "--hide-scrollbars", "--force-prefers-reduced-motion")
_OFFSETS = ((0, 0), (1, 0), (0, 1), (1, 1))
# Only the page and the SVG exist there; everything else is blocked.
_SITE = "http://gauss2svg.invalid/"
_PLACE = """([x, y]) => {
    Object.assign(document.images[0].style, {position: "absolute", left: `${x}px`, top: `${y}px`});
    return true;
}"""
_SIZE = "() => [document.images[0].naturalWidth, document.images[0].naturalHeight]"
_LEAST_PLAYWRIGHT = (1, 58)  # earlier versions hang on images of a few pixels


def version() -> str:
    """Name and version as the program prints them; no browser is started."""
    _playwright()
    program = _program()
    if sys.platform == "win32":
        return f"Chromium {_version_beside(program)}"
    # Google Chrome 140.0.1 / Chromium 156.0.8078.79 built on Debian GNU/Linux
    return version_line(program).split(" built on ")[0]


def _version_beside(program: str) -> str:
    """The version of a Chromium on Windows, where --version would open a window.

    An installer puts its files in a folder of that name beside the program.
    """
    names: list[str] = []
    with suppress(OSError):  # a folder whose files may be run and not be listed
        names = [path.name for path in Path(program).parent.iterdir()]
    versions = [name for name in names if re.fullmatch(r"\d+(\.\d+){3}", name)]
    # A Chromium without an installer, as Playwright's own, has no such folder, and draws as well.
    return max(
        versions,
        key=lambda name: [int(part) for part in name.split(".")],
        default="of unknown version",
    )


def draw(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Pixels (height, width, 4) of the SVG over white; a mean, so finer than 8 bits."""
    return _worker().draw(svg, width, height, WHITE)


def draw_clear(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Pixels (height, width, 4) of the SVG on a page without a background."""
    return _worker().draw(svg, width, height, CLEAR)


def _playwright() -> Any:
    try:
        from playwright import sync_api
    except ImportError as error:
        raise RendererError(_INSTALL) from error
    try:
        have = importlib.metadata.version("playwright")
    except importlib.metadata.PackageNotFoundError:  # a copy outside of the installed packages
        return sync_api
    if tuple(int(part) for part in re.findall(r"\d+", have)[:2]) < _LEAST_PLAYWRIGHT:
        raise RendererError(
            f"Playwright must be at least {'.'.join(map(str, _LEAST_PLAYWRIGHT))}, as earlier ones "
            f"hang on small images; got {have}. Try pip install -U "
            '"gauss2svg[browser]", or --renderer resvg'
        )
    return sync_api


def _program() -> str:
    named = os.environ.get(PROGRAM_VARIABLE)
    if named:
        if os.access(named, os.X_OK) and os.path.isfile(named):
            return named
        raise RendererError(
            f"{PROGRAM_VARIABLE} must be the path of a Chromium; got {quoted(named)}. Try to "
            "correct it, or to unset it for the one on PATH"
        )
    names = "chromium", "chromium-browser", "google-chrome", "google-chrome-stable"
    return find("chromium", names, "apt-get install chromium")


def launch(api: Any, playwright: Any, program: str, flags: Sequence[str] = _FLAGS) -> Any:
    """A started browser; raises RendererError with its last message where it does not start."""
    # As root Chromium does not start with its sandbox; everybody else keeps the sandbox.
    is_root = hasattr(os, "geteuid") and os.geteuid() == 0
    try:
        return playwright.chromium.launch(
            executable_path=program, args=flags, chromium_sandbox=not is_root
        )
    except api.Error as error:
        said = str(error)
        complaint = re.findall(r"\[err\] (.*\S)", said) or re.findall(r"<(process did .*)>", said)
        raise RendererError(
            f"Chromium did not start: {complaint[-1] if complaint else _reason(error)}. Try to "
            f"reinstall {program}, or --renderer resvg"
        ) from error


class _Worker:
    """One browser for the process, in a thread of its own.

    Playwright's objects belong to the thread that made them, and Playwright refuses to work beside
    a running asyncio loop, such as a notebook's. So every image is drawn in this thread.
    """

    def __init__(self) -> None:
        self._jobs: queue.SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None] = (
            queue.SimpleQueue()
        )
        self._playwright: Any = None
        self._browser: Any = None
        self._thread = threading.Thread(target=self._work, name="gauss2svg-chromium", daemon=True)
        self._thread.start()

    def draw(self, svg: str, width: int, height: int, color: str) -> NDArray[np.float32]:
        """Pixels of the SVG on a page of a colour, drawn in the browser's thread."""
        api, program = _playwright(), _program()
        return self.call(lambda: self._draw(api, program, svg, width, height, color))

    def call(self, job: Callable[[], Any]) -> Any:
        """Run a job in the browser's thread; returns or raises what it does."""
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
                done.set_result(job())
            except BaseException as error:  # passed on to the caller
                done.set_exception(error)
        if self._browser is not None:
            self._browser.close()
        if self._playwright is not None:
            self._playwright.stop()

    def _draw(
        self, api: Any, program: str, svg: str, width: int, height: int, color: str
    ) -> NDArray[np.float32]:
        try:
            context = self._context(api, program, width + 1, height + 1)
            try:
                return _mean(context, svg, width, height, color)
            finally:
                if self._browser.is_connected():
                    context.close()
        except api.Error as error:
            raise RendererError(
                f"Chromium cannot draw the SVG at {width}x{height} px: {_reason(error)}"
            ) from error

    def _context(self, api: Any, program: str, width: int, height: int) -> Any:
        # The page is offline: Playwright answers its requests, or nobody does.
        options = {
            "viewport": {"width": width, "height": height},
            "device_scale_factor": 1,
            "offline": True,
            "service_workers": "block",
        }
        if self._browser is not None:
            # A browser that has died since the last image is noticed at the first call only.
            with suppress(api.Error):
                return self._browser.new_context(**options)
        if self._playwright is None:
            self._playwright = api.sync_playwright().start()
        self._browser = launch(api, self._playwright, program)
        return self._browser.new_context(**options)


def _mean(context: Any, svg: str, width: int, height: int, color: str) -> NDArray[np.float32]:
    context.set_default_timeout(TIMEOUT_S * 1000)
    page = context.new_page()
    page.route("**/*", lambda route: _answer(route, svg, html(color)))
    page.goto(_SITE)
    # Not evaluate(), which would wait forever for a page that hangs.
    found = page.wait_for_function(_SIZE).json_value()
    if found == [0, 0]:
        raise RendererError("Chromium cannot draw the SVG: not a supported image")
    if found != [width, height]:
        raise wrong_size("raster of chromium", found, (width, height))
    clear = color == CLEAR
    total = np.zeros((height, width, 4), np.float32)
    for x, y in _OFFSETS:
        page.wait_for_function(_PLACE, arg=[x, y])
        with Image.open(io.BytesIO(page.screenshot(omit_background=clear))) as picture:
            levels = np.asarray(picture.convert("RGBA"), np.float32)[y : y + height, x : x + width]
        levels[:, :, :3] *= levels[:, :, 3:] / 255  # transparent places have no colour
        total += levels
    total /= np.float32(255 * len(_OFFSETS))
    return straight(total[:, :, :3], total[:, :, 3]) if clear else total


def _answer(route: Any, svg: str, page: str) -> None:
    if route.request.url == _SITE:
        route.fulfill(body=page, content_type="text/html")
    elif route.request.url == _SITE + IMAGE:
        route.fulfill(body=svg, content_type="image/svg+xml")
    else:
        route.abort()


def _reason(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return (lines or [type(error).__name__])[0]


_lock = threading.Lock()
_started: _Worker | None = None


def _worker() -> _Worker:
    global _started
    with _lock:
        if _started is None:
            _started = _Worker()
            atexit.register(_started.close)
        return _started


def _forget() -> None:
    # A forked process has no such thread, and the browser belongs to its parent.
    global _started, _lock
    if _started is not None:
        atexit.unregister(_started.close)
    _started, _lock = None, threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
