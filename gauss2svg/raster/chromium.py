"""Chromium without its window, driven by Playwright: what the SVG looks like on the web.

Chromium rounds to 8 bits after every layer, and dithers the gradients before, by a fixed pattern
of 8 x 8 px. One screenshot is so off by what nobody sees in it. The picture is therefore drawn
in _OFFSETS, places on the page that lie differently in the pattern, and the mean is taken; each
is drawn at its own size, so that all sample the pixels' centres, as the model does. dB against
the model of fitted scenes, all by `gauss2svg.render.render` at the picture's size:

    scene                    1 place   2 beside   4    16     2x averaged   4x averaged
    Kodak 20, 5000           48.3      55.9      57.6         45.1          43.8
    Kodak 20, 5000, gaussian 46.8      54.9      56.6         45.1          43.8
    Kodak 04, 5000           45.5      54.9      57.1         47.9          47.3
    Kodak 04, 5000, gaussian 44.0      53.9      56.0         48.5          48.0
    astronaut, 1000, gaussian 46.8     53.4      54.6  55.4   49.2          48.4
    logo, 500                54.0      58.1      59.3         47.2          46.3

Drawn twice as large and averaged, dithering goes too, but each pixel becomes the mean over its
area: that is 54 to 60 dB from the model averaged likewise, and 45 to 51 dB from the model. The
flags --disable-gpu, --disable-software-rasterizer, --disable-lcd-text, --disable-skia-runtime-opts
and wider colour profiles change no pixel; rasterising by GPU code is up to 0.4 dB worse.
"""

from __future__ import annotations

import atexit
import importlib.metadata
import io
import os
import queue
import re
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.errors import RendererError, must_be
from gauss2svg.photo.alpha import straight
from gauss2svg.raster.html import CLEAR, IMAGE, WHITE, html
from gauss2svg.raster.program import TIMEOUT_S, find, version_line, wrong_size

PROGRAM_VARIABLE = "GAUSS2SVG_CHROMIUM"
_PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_INSTALL = (
    "renderer chromium needs Playwright and a browser. Try to install them (pip install "
    "'gauss2svg[browser]', apt-get install chromium), or --renderer resvg"
)
# Without the profile the colours depend on the machine's screen. Reduced motion shows animated
# files as they end; asked for a page alone, it does not reach the picture in it.
_FLAGS = ("--force-color-profile=srgb", "--hide-scrollbars", "--force-prefers-reduced-motion")
_OFFSETS = ((0, 0), (1, 0), (0, 1), (1, 1))
_SITE = "http://gauss2svg.invalid/"  # nothing but the page and the SVG is there, or anywhere
_PLACE = """([x, y]) => {
    Object.assign(document.images[0].style, {position: "absolute", left: `${x}px`, top: `${y}px`});
    return true;
}"""
_SIZE = "() => [document.images[0].naturalWidth, document.images[0].naturalHeight]"
_CLOSING_S = 10
_LEAST_PLAYWRIGHT = (1, 58)  # those before hang on pictures of a few pixels


def version() -> str:
    """Name and version, by asking the program: the browser is not started."""
    _playwright()
    # Google Chrome 140.0.1 / Chromium 156.0.8078.79 built on Debian GNU/Linux
    return version_line(_program()).split(" built on ")[0]


def draw(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Pixels (height, width, 4) of the SVG, over white; finer than 8 bits, as a mean is."""
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
    except importlib.metadata.PackageNotFoundError:  # a copy beside the installed packages
        return sync_api
    if tuple(int(part) for part in re.findall(r"\d+", have)[:2]) < _LEAST_PLAYWRIGHT:
        raise RendererError(
            f"Playwright must be at least {'.'.join(map(str, _LEAST_PLAYWRIGHT))}, as earlier ones "
            f"hang on small images; got {have}. Try pip install -U 'gauss2svg[browser]', or "
            "--renderer resvg"
        )
    return sync_api


def _program() -> str:
    named = os.environ.get(PROGRAM_VARIABLE)
    if named:
        if os.access(named, os.X_OK) and os.path.isfile(named):
            return named
        advice = "to correct it, or to unset it for the one on PATH"
        raise RendererError(must_be(PROGRAM_VARIABLE, "the path of a Chromium", named, advice))
    return find("chromium", _PROGRAMS, "apt-get install chromium")


def launch(api: Any, playwright: Any, program: str, flags: Sequence[str] = _FLAGS) -> Any:
    """A browser; raises RendererError with its own last complaint where it does not start."""
    # As root it does not start with its sandbox; nobody else does without.
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

    Playwright's objects belong to the thread that made them, and it refuses to work beside a
    running asyncio loop, such as a notebook's: so every picture is drawn in this thread.
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
        """Have a picture drawn on a page of that colour, and wait for it."""
        api, program = _playwright(), _program()
        return self.call(lambda: self._draw(api, program, svg, width, height, color))

    def call(self, job: Callable[[], Any]) -> Any:
        """What the job returns or raises in the browser's thread."""
        done: Future[Any] = Future()
        self._jobs.put((done, job))
        return done.result()

    def close(self) -> None:
        """End the browser."""
        self._jobs.put(None)
        self._thread.join(_CLOSING_S)

    def _work(self) -> None:
        for done, job in iter(self._jobs.get, None):
            try:
                done.set_result(job())
            except BaseException as error:  # whoever waits for the picture is to get it
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
        # The page is offline: what it asks for is answered by Playwright, or not at all.
        options = {
            "viewport": {"width": width, "height": height},
            "device_scale_factor": 1,
            "offline": True,
            "service_workers": "block",
        }
        if self._browser is not None:
            # That a browser has died since the last picture shows at the first call only.
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
    # Not evaluate(), which would wait for a page that hangs without end.
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
        levels[:, :, :3] *= levels[:, :, 3:] / 255  # transparent places count for no colour
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
    # The thread does not live on in a forked process, and the browser is its parent's.
    global _started, _lock
    if _started is not None:
        atexit.unregister(_started.close)
    _started, _lock = None, threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
