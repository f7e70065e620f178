"""A small gallery, and a browser that records what its pages do."""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from batches import PoolHere
from flat import build_gallery
from numpy.typing import NDArray
from pictures import possible
from PIL import Image, PngImagePlugin
from screens import captured
from skimage import data

from gauss2svg.measure import perceptual
from gauss2svg.pipeline.plan import DEFAULT_PRESET, PRESETS

HOSTILE = possible("<img src=x onerror=alert(1)>&\"'.png")
COUNTS = (30, 120)
WIDE, PHONE = {"width": 1280, "height": 900}, {"width": 390, "height": 844}
BAD = {"broken.png": "broken.png must be a supported image", "none\udcff.png": "No such file"}
SECRET = "Ada of Nowhere"
Box = dict[str, float]  # x, y, width, height, and the four sides


def with_metadata() -> dict[str, Any]:
    """Options of a PNG: EXIF with a place, texts and XMP."""
    exif, texts = Image.Exif(), PngImagePlugin.PngInfo()
    exif[0x010E] = exif[0x013B] = SECRET  # ImageDescription, Artist
    exif.get_ifd(0x8825)[1] = SECRET  # GPSLatitudeRef
    texts.add_text("Comment", SECRET)
    texts.add_itxt("XML:com.adobe.xmp", f"<x>{SECRET}</x>")
    return {"exif": exif, "pnginfo": texts}


@contextmanager
def hastily() -> Iterator[None]:
    """Short runs in this process, where FLIP has no process of its own and is a mean error."""
    preset = PRESETS[DEFAULT_PRESET]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gauss2svg.compare.pages.Pool", PoolHere)
        patch.setattr(perceptual, "flip", lambda one, other: float(np.abs(one - other).mean()))
        patch.setitem(PRESETS, DEFAULT_PRESET, dataclasses.replace(preset, iterations=40))
        yield


def build(folder: Path) -> Any:
    """Four photos, one of them upright, one transparent, one badly named, and two that are none."""
    photos = folder / "photos"
    photos.mkdir()
    coffee = _resized(data.coffee(), 120, 80)
    alpha = np.broadcast_to(np.linspace(0, 400, 120).clip(0, 255).astype(np.uint8), (80, 120))
    made = {
        "cat 9.png": _resized(data.chelsea(), 120, 90),
        "astronaut.png": _resized(data.astronaut()[:, 100:420], 72, 110),
        "Cat 10.png": np.dstack([coffee, alpha]),
        HOSTILE: _resized(data.rocket(), 112, 84),
    }
    for name, pixels in made.items():
        Image.fromarray(pixels).save(photos / name, "PNG", **with_metadata())
    (photos / "broken.png").write_bytes(b"no photo")
    paths = [photos / name for name in (*made, *BAD)]
    given = {"counts": COUNTS, "jobs": 2, "threads": 1, "title": HOSTILE}
    with hastily():
        return build_gallery(paths, folder / "site", **given)


def _resized(pixels: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    return np.asarray(Image.fromarray(pixels).resize((width, height)))


def pages_of(site: Path) -> list[str]:
    """All pages relative to the site, those of photos last."""
    found = [path.relative_to(site).as_posix() for path in site.rglob("*.html")]
    return sorted(found, key=lambda name: (name.count("/"), name))


class Visit:
    """A browser tab on the site, and everything that goes wrong in it."""

    def __init__(self, browser: Any, site: Path, **options: Any) -> None:
        self.site = site
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self._context = browser.new_context(**({"viewport": WIDE} | options))
        self.page = self._context.new_page()
        self.page.set_default_timeout(30_000)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("requestfailed", self._miss)
        self.page.on("console", self._hear)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("dialog", self._refuse)

    def go(self, name: str) -> Any:
        """The loaded page; name: relative to the site, with its fragment."""
        self.page.goto(f"{self.site.as_uri()}/{name}")
        return self.page

    def strays(self) -> list[str]:
        """Requests for anything but the site's own files."""
        root = self.site.as_uri() + "/"
        return [url for url in self.requests if not url.startswith((root, "data:"))]

    def close(self) -> None:
        """Close it; fails on a console message, an error or a request that should not be."""
        self._context.close()
        assert not self.complaints, self.complaints
        assert not self.strays(), self.strays()

    def _hear(self, message: Any) -> None:
        if message.type in ("error", "warning"):
            self.complaints.append(message.text)

    def _miss(self, request: Any) -> None:
        self.complaints.append(f"{request.url}: {request.failure}")

    def _refuse(self, dialog: Any) -> None:
        self.complaints.append(dialog.message)
        dialog.dismiss()


@contextmanager
def closed_after(make: Callable[..., Visit]) -> Iterator[Callable[..., Visit]]:
    """Makes visits, each of which must end without errors."""
    visits: list[Visit] = []

    def open_one(**options: Any) -> Visit:
        visits.append(make(**options))
        return visits[-1]

    yield open_one
    for one in visits:
        one.close()


def box(page: Any, selector: str) -> Box:
    """Place of an element on the screen, in px."""
    return page.locator(selector).first.evaluate("(e) => e.getBoundingClientRect().toJSON()")


def zoomed(page: Any, width: float) -> float:
    """Pixels of the screen for one of a photo of that width; both sides must lie in step."""
    place = box(page, "#photo")
    assert box(page, "#svg") == pytest.approx(place, abs=0.01)
    return place["width"] / width


def shot(page: Any, part: Box) -> NDArray[np.float64]:
    """Pixels (h, w, 3), 0..255, of a part of the screen, rounded to whole pixels."""
    left, top = round(part["x"]), round(part["y"])
    right, bottom = round(part["x"] + part["width"]), round(part["y"] + part["height"])
    screen = page.viewport_size
    assert 0 <= left < right <= screen["width"]
    assert 0 <= top < bottom <= screen["height"]
    clip = {"x": left, "y": top, "width": right - left, "height": bottom - top}
    with Image.open(io.BytesIO(captured(page, clip=clip, animations="disabled"))) as picture:
        return np.asarray(picture.convert("RGB"), np.float64)
