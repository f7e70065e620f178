"""Pictures of the studio in Chromium and of a file in Inkscape, for the guide."""

from __future__ import annotations

import ctypes
import io
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from common import eight_bits
from panels import coffee
from PIL import Image

from gauss2svg import vectorize

_SCREEN: Any = {"width": 1200, "height": 960}  # px
_PATIENCE_MS = 900_000  # of a fit on a busy machine
_DISPLAY = ":97"
# Buttons of the toolbar of Inkscape 1.2 on a screen of this size, and a place without a tooltip.
_INKSCAPE_SCREEN = (1400, 880)
_LAYERS_BUTTON, _PAGE_BUTTON = (934, 46), (558, 46)
_CANVAS = (700, 300)


def studio() -> Image.Image:
    """The studio after three runs on the example photo."""
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder:
        eight_bits(coffee(480)).save(Path(folder) / "coffee.png")
        words = ["studio", folder, "--no-browser", "--port", "0", "--jobs", "1", "--threads", "1"]
        server = subprocess.Popen(
            [sys.executable, "-m", "gauss2svg", *words], stderr=subprocess.PIPE, text=True
        )
        try:
            assert server.stderr is not None
            found = (re.search(r"http://\S+/\?token=\S+", line) for line in server.stderr)
            address = next(match[0] for match in found if match)
            with sync_playwright() as playwright:
                # Without the sandbox, which root in a container cannot use: the page is ours.
                browser = playwright.chromium.launch(
                    executable_path=shutil.which("chromium"), args=["--no-sandbox"]
                )
                page = browser.new_page(viewport=_SCREEN)
                page.set_default_timeout(_PATIENCE_MS)
                page.goto(address)
                page.wait_for_selector("body.ready")
                page.locator("#preset").select_option("draft")
                page.locator("#samples").get_by_role("button", name="coffee.png").click()
                page.wait_for_selector('#runs [data-action="show-1"]')
                for run, preset in ((2, "fast"), (3, "balanced")):
                    page.locator("#preset").select_option(preset)
                    page.locator("#run").click()
                    page.wait_for_selector(f'#runs [data-action="show-{run}"]')
                page.evaluate("scrollTo(0, 0)")
                shot = page.screenshot(animations="disabled")
                browser.close()
            with Image.open(io.BytesIO(shot)) as image:
                return image.convert("RGB")
        finally:
            server.send_signal(signal.SIGINT)
            server.wait()


class _Pointer:
    """The mouse of a display of X11 without a window manager, by its libraries."""

    def __init__(self, display: str) -> None:
        self.x, self.test = ctypes.CDLL("libX11.so.6"), ctypes.CDLL("libXtst.so.6")
        self.x.XOpenDisplay.restype = ctypes.c_void_p
        self.display = ctypes.c_void_p(self.x.XOpenDisplay(display.encode()))

    def fill_screen(self, width: int, height: int) -> None:
        """Give every large window the whole screen."""
        self.x.XDefaultRootWindow.restype = ctypes.c_ulong
        root = ctypes.c_ulong(self.x.XDefaultRootWindow(self.display))
        above, count = ctypes.c_ulong(), ctypes.c_uint()
        windows = ctypes.POINTER(ctypes.c_ulong)()
        self.x.XQueryTree(
            self.display, root, ctypes.byref(above), ctypes.byref(above),
            ctypes.byref(windows), ctypes.byref(count),
        )  # fmt: skip
        for window in windows[: count.value]:
            numbers = [ctypes.c_uint() for _ in range(6)]  # x, y, width, height, border, depth
            places = [ctypes.byref(number) for number in (above, *numbers)]
            self.x.XGetGeometry(self.display, ctypes.c_ulong(window), *places)
            if numbers[2].value > width // 2:
                self.x.XResizeWindow(self.display, ctypes.c_ulong(window), width, height)
        self._settle(2)

    def click(self, place: tuple[int, int]) -> None:
        self.move(place)
        for pressed in (1, 0):
            self.test.XTestFakeButtonEvent(self.display, 1, pressed, 0)
        self._settle(2)

    def move(self, place: tuple[int, int]) -> None:
        self.test.XTestFakeMotionEvent(self.display, -1, *place, 0)
        self._settle(0.5)

    def _settle(self, seconds: float) -> None:
        self.x.XFlush(self.display)
        time.sleep(seconds)


def inkscape() -> Image.Image:
    """A file in Inkscape, with its layers, of which the upper two are hidden."""
    svg = vectorize(coffee(600), gaussians=600).svg
    layers = re.findall(r'<g id="round-\d+"', svg)
    for layer in layers[-2:]:
        svg = svg.replace(layer, f'{layer} style="display:none"')
    width, height = _INKSCAPE_SCREEN
    screen = subprocess.Popen(["Xvfb", _DISPLAY, "-screen", "0", f"{width}x{height}x24"])
    with tempfile.TemporaryDirectory() as folder:
        file, shot = Path(folder) / "coffee.svg", Path(folder) / "shot.png"
        file.write_text(svg, encoding="utf-8")
        time.sleep(2)
        words = os.environ | {"DISPLAY": _DISPLAY, "HOME": folder}
        program = subprocess.Popen(["inkscape", str(file)], env=words)
        try:
            time.sleep(30)
            pointer = _Pointer(_DISPLAY)
            pointer.fill_screen(width, height)
            pointer.click(_LAYERS_BUTTON)
            pointer.click(_PAGE_BUTTON)
            pointer.move(_CANVAS)
            time.sleep(5)
            subprocess.run(["import", "-window", "root", str(shot)], env=words, check=True)
            with Image.open(shot) as image:
                return image.convert("RGB")
        finally:
            for process in (program, screen):
                process.terminate()
                process.wait()
