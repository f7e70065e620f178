"""Pictures of the studio and of a page of a gallery in Chromium, for the guide."""

from __future__ import annotations

import io
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from common import ROOT, coffee, eight_bits
from PIL import Image

_PATIENCE_MS = 900_000  # of a fit on a busy machine


@contextmanager
def opened(address: str, width: int, height: int) -> Iterator[Any]:
    """Yield a page of Chromium at an address."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        # Without the sandbox, which root in a container cannot use: the page is ours.
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": width, "height": height})
        page.set_default_timeout(_PATIENCE_MS)
        page.goto(address)
        page.wait_for_load_state("load")
        yield page
        browser.close()


def studio() -> Image.Image:
    """Return the studio after three runs on the example photo."""
    with tempfile.TemporaryDirectory() as folder:
        eight_bits(coffee(480)).save(Path(folder) / "coffee.png")
        words = ["studio", folder, "--no-browser", "--port", "0", "--jobs", "1", "--threads", "1"]
        command = [sys.executable, "-m", "gauss2svg", *words]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as server:
            assert server.stderr is not None
            found = (re.search(r"http://\S+/\?token=\S+", line) for line in server.stderr)
            address = next(match[0] for match in found if match)
            try:
                with opened(address, 1200, 960) as page:
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
            finally:
                server.send_signal(signal.SIGINT)
    return Image.open(io.BytesIO(shot)).convert("RGB")


def gallery(_: Path) -> None:
    """Write examples/gallery.jpg, the first photo's page of the sample gallery."""
    with tempfile.TemporaryDirectory() as folder:
        script = str(ROOT / "benchmarks/gallery.py")
        subprocess.run([sys.executable, script, folder, "--sample"], check=True)
        page_file = next(path for path in Path(folder).rglob("*coffee*/index.html"))
        with opened(page_file.as_uri(), 1000, 900) as page:
            target = ROOT / "examples/gallery.jpg"
            page.screenshot(path=target, type="jpeg", quality=85, animations="disabled")
