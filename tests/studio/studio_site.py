"""The command `gauss2svg studio` on small photos, and a browser that records what its page does."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gallery_site import HOSTILE, Visit, closed_after
from PIL import Image
from skimage import data
from studio_server import Server, running

PLAIN, UPRIGHT = "cat.png", "cup.png"
# The page ends streams and requests that it no longer needs.
_ENDED = re.compile(r"/(events|chart|frame\?n=\d+): net::ERR_ABORTED$")


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
        own = (f"{self.server.home}/", "data:", f"blob:{self.server.home}/")
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


@pytest.fixture(scope="module")
def photos(tmp_path_factory) -> dict[str, Path]:
    """Small photos by their names, one of them upright, one transparent and badly named."""
    folder = tmp_path_factory.mktemp("photos")
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


@pytest.fixture(scope="module")
def server(photos: dict[str, Path]) -> Iterator[Server]:
    """The studio of those photos."""
    with running(str(photos[PLAIN].parent), "--jobs", "1", "--threads", "1") as found:
        yield found


@pytest.fixture
def visit(tabs: Any, server: Server):
    """Opens visits, each of which must end without errors."""
    with closed_after(partial(StudioVisit, tabs, server)) as open_one:
        yield open_one


def draft(page: Any) -> None:
    """Aim at the quickest run, by an option that may be folded away."""
    page.locator("#preset").select_option("draft")
    page.locator("#option-iterations").evaluate("(control) => { control.value = 20; }")


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
