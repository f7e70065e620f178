"""The command `gauss2svg studio` on small photos, and a browser that records what its page does."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gallery_site import Visit
from PIL import Image
from skimage import data

from gauss2svg.raster import chromium

HOSTILE = "<img src=x onerror=alert(1)>&\"'.png"
PLAIN, UPRIGHT = "cat.png", "cup.png"
_ENDS_S = 20
# The page ends streams and requests that it no longer needs.
_ENDED = re.compile(r"/(events|estimate|chart|frame\?n=\d+): net::ERR_ABORTED$")


def write_photos(folder: Path) -> dict[str, Path]:
    """Small photos by their names, one of them upright, one transparent and badly named."""
    cat, cup = (Image.fromarray(one) for one in (data.chelsea(), data.coffee()))
    alpha = np.broadcast_to(np.linspace(0, 400, 80).clip(0, 255).astype(np.uint8), (60, 80))
    small = np.asarray(cup.resize((80, 60)))
    made = {
        PLAIN: cat.resize((96, 64)),
        UPRIGHT: cup.rotate(90, expand=True).resize((64, 96)),
        HOSTILE: Image.fromarray(np.dstack([small, alpha])),
    }
    for name, picture in made.items():
        picture.save(folder / name, "PNG")
    return {name: folder / name for name in made}


class Server:
    """The command, until `close`."""

    def __init__(self, folder: Path) -> None:
        words = ["studio", str(folder), "--no-browser", "--port", "0", "--jobs", "1"]
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "gauss2svg", *words, "--threads", "1"],
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self._process.stderr is not None
        found, self.said = None, ""
        for line in self._process.stderr:
            self.said += line
            found = re.search(r"(http://\S+/)\?token=(\S+)", line)
            if found:
                break
        assert found, self.said
        self.address, self.root, self.token = found[0], found[1], found[2]
        self._rest = threading.Thread(target=self._process.stderr.read, daemon=True)
        self._rest.start()

    def get(self, path: str) -> bytes:
        """What the service answers, without the page."""
        headers = {"Authorization": f"Bearer {self.token}"}
        with urllib.request.urlopen(
            urllib.request.Request(self.root + path, headers=headers)
        ) as got:
            return got.read()

    def post(self, path: str, body: Any) -> Any:
        """The JSON that the service answers to JSON."""
        headers = {"Authorization": f"Bearer {self.token}", "Content-Type": "application/json"}
        request = urllib.request.Request(self.root + path, json.dumps(body).encode(), headers)
        with urllib.request.urlopen(request) as got:
            return json.load(got)

    def close(self) -> None:
        """End it as Ctrl-C does."""
        self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(_ENDS_S)
        finally:
            self._process.kill()
            self._rest.join(_ENDS_S)
            self._process.stderr.close()  # pyright: ignore[reportOptionalMemberAccess]


class StudioVisit(Visit):
    """A browser tab on the studio."""

    def __init__(self, browser: Any, server: Server, **options: Any) -> None:
        super().__init__(browser, Path("/"), **options)
        self.server = server
        self.page.set_default_timeout(40_000)  # of a fit on a busy machine
        self.expected: list[str] = []  # parts of complaints that a test asks for

    def open(self) -> Any:
        """The page, ready."""
        self.page.goto(self.server.address)
        self.page.wait_for_selector("body.ready")
        return self.page

    def strays(self) -> list[str]:
        """Requests for anything but the server itself."""
        own = (self.server.root, "data:", f"blob:{self.server.root}")
        return [url for url in self.requests if not url.startswith(own)]

    def close(self) -> None:
        """Close it; fails on a console message, an error or a request that should not be."""
        self._context.close()  # so that nothing more is heard
        self.complaints = [
            line
            for line in self.complaints
            if not _ENDED.search(line) and not any(part in line for part in self.expected)
        ]
        super().close()


class StudioBrowser:
    """The browser of the renderer chromium, for visits to a studio."""

    def __init__(self, playwright: Any, server: Server) -> None:
        self._server = server
        self._browser = chromium.launch(chromium._playwright(), playwright, chromium._program())

    def visit(self, **options: Any) -> StudioVisit:
        """A visit in a browser context with these options."""
        return StudioVisit(self._browser, self._server, **options)

    def close(self) -> None:
        """End the browser."""
        self._browser.close()


_photos: dict[str, Path] = {}
_servers: list[Server] = []


@pytest.fixture(scope="module")
def photos(tmp_path_factory) -> dict[str, Path]:
    """Photos that the server offers as samples; one folder for all modules."""
    if not _photos:
        _photos.update(write_photos(tmp_path_factory.mktemp("photos")))
    return _photos


@pytest.fixture(scope="module")
def server(photos: dict[str, Path], pytestconfig) -> Server:
    """The studio of those photos, which takes seconds to start; one for all modules."""
    if not _servers:
        _servers.append(Server(photos[PLAIN].parent))
        pytestconfig.add_cleanup(_servers[0].close)
    return _servers[0]


@pytest.fixture(scope="module")
def tabs(server: Server):
    """A browser for that studio."""
    with chromium._playwright().sync_playwright() as playwright:
        browser = StudioBrowser(playwright, server)
        yield browser
        browser.close()


@pytest.fixture
def visit(browser, tabs: StudioBrowser):
    """Opens visits, each of which must end without errors."""
    visits: list[StudioVisit] = []

    def open_one(**options):
        visits.append(tabs.visit(**options))
        return visits[-1]

    yield open_one
    for one in visits:
        one.close()


def draft(page: Any) -> None:
    """Aim at the quickest run."""
    page.locator("#preset").select_option("draft")


def aim(page: Any, kind: str, value: float) -> None:
    """Aim at a number of this kind."""
    page.locator("#goal").get_by_role("radio", name=kind, exact=True).check()
    page.locator("#exact").fill(str(value))


def pick(page: Any, name: str) -> None:
    """Run a sample."""
    page.locator("#samples").get_by_role("button", name=name, exact=True).click()


def await_run(page: Any, number: int) -> None:
    """Wait until this run is in the table."""
    page.wait_for_selector(f'#runs [data-action="show-{number}"]')


def job_of(page: Any) -> str:
    """The id of the run that is shown."""
    link = page.locator('[data-file^="picture.svg?download"]').get_attribute("href")
    return re.fullmatch(r"api/jobs/([^/]+)/.*", link)[1]


# Largest difference of any channel between an image of the page and a file of the service.
_DIFFERENCE = """async (image, address) => {
    const file = new Image();
    file.src = address;
    await Promise.all([file.decode(), image.decode()]);
    const [a, b] = [image, file].map((one) => {
        const canvas = new OffscreenCanvas(image.width, image.height);
        const context = canvas.getContext("2d");
        context.drawImage(one, 0, 0, image.width, image.height);
        return context.getImageData(0, 0, image.width, image.height).data;
    });
    return a.reduce((most, value, at) => Math.max(most, Math.abs(value - b[at])), 0);
}"""


def difference(page: Any, path: str, selector: str = "#svg") -> int:
    """Levels of 255 by which an image of the page differs from a picture of the service."""
    return page.locator(selector).evaluate(_DIFFERENCE, path)
