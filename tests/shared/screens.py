"""What a page looks like: screenshots on a busy machine, and faults of access."""

import io
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.raster.chromium import launch_options

_REFUSED = "Unable to capture screenshot"
_TRIES, _PAUSE_MS = 5, 200
_GRAVE, SCHEMES = ("serious", "critical"), ("light", "dark")
OVERFLOW = "() => document.documentElement.scrollWidth - document.documentElement.clientWidth"
CONTROLS = "input, select, button, textarea, output, [role=slider], .handle, .badge"


def expect(what: Any) -> Any:
    """Playwright's assertions, which wait; loaded by tests that have a browser alone."""
    from playwright.sync_api import expect as waiting

    return waiting(what)


@contextmanager
def chromium(**given) -> Iterator[Any]:
    """The browser of the renderer, started as it starts it but for what is given."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(**launch_options(**given))
        yield browser
        browser.close()


def captured(page, **options) -> bytes:
    """The PNG of a page; retried if Chromium is too busy to take one."""
    for _ in range(_TRIES - 1):
        try:
            return page.screenshot(**options)
        except Exception as error:  # of Playwright, which may not be installed
            if _REFUSED not in str(error):
                raise
            page.wait_for_timeout(_PAUSE_MS)
    return page.screenshot(**options)


def drawn_in_pages(bodies: Iterable[str], width: int, height: int) -> list[NDArray[np.float64]]:
    """Pixels (h, w, 3), 0..255, of pages of these bodies, each a page without margins."""
    found = []
    with chromium(flags=()) as browser:
        for body in bodies:
            page = browser.new_page(viewport={"width": width, "height": height})
            page.set_content(f'<!doctype html><body style="margin:0">{body}</body>')
            with Image.open(io.BytesIO(page.screenshot())) as picture:
                found.append(np.asarray(picture.convert("RGB"), np.float64))
    return found


def grave_faults(page, **options) -> list[tuple[str, str]]:
    """Grave faults of accessibility that axe finds in a page, as (name, markup)."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    # Without preload: it reads style sheets once more, which files may not do to each other.
    options |= {"resultTypes": ["violations"], "preload": False}
    found = axe.run(page, options=options).response["violations"]
    return [
        (fault["id"], node["html"])
        for fault in found
        if fault["impact"] in _GRAVE
        for node in fault["nodes"]
    ]


def check_access(page: Any, *sizes: dict[str, int]) -> None:
    """Assert that a page has no grave fault at these sizes, in light, dark and forced colours.

    Light and dark take turns from size to size: they differ by colours alone.
    """
    for number, size in enumerate(sizes):
        page.set_viewport_size(size)
        for forced in ("active", "none"):
            page.emulate_media(color_scheme=SCHEMES[number % 2], forced_colors=forced)
            assert page.evaluate(OVERFLOW) == 0, (page.url, size)
        assert not grave_faults(page), (page.url, size)
