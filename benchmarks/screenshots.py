"""A picture of the studio in Chromium, for the guide."""

from __future__ import annotations

import io
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from common import eight_bits
from panels import coffee
from PIL import Image

_SCREEN: Any = {"width": 1200, "height": 960}  # px
_PATIENCE_MS = 900_000  # of a fit on a busy machine


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
