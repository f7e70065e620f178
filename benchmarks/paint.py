"""What Chromium takes to first paint a file: milliseconds by shapes, markup and displayed width.

python benchmarks/paint.py [PHOTO] [--counts 20 300 1000 5000 10000] [--widths 400 800 1600]
python benchmarks/paint.py --page PHOTO...     # a page of 40 placeholders, of parts of the photos

First paint is the browser's own "first-contentful-paint" of a page with nothing but the picture,
from the disk; medians. "Raster" is the CPU time of its raster tasks. Needs '.[browser]'.
"""

from __future__ import annotations

import argparse
import base64
import itertools
import json
import statistics
import tempfile
from pathlib import Path

import numpy as np
from common import eight_bits, encoded

from gauss2svg import FitOptions, SvgOptions, placeholder, vectorize
from gauss2svg.photo.alpha import over
from gauss2svg.photo.load import load_image
from gauss2svg.pipeline.report import drawn_pixels, paint_ms
from gauss2svg.raster.chromium import launch_options

_COFFEE = Path(__file__).with_name("coffee.jpg")
_PAINTED = """() => new Promise(done => {
    const has = () => performance.getEntriesByName("first-contentful-paint")[0];
    const look = () => has() ? done(has().startTime) : setTimeout(look, 20);
    look();
})"""
_COLUMNS, _TILE = 8, 160  # px


def painted(browser, page_file: Path, body: str, width: int, height: int) -> tuple[float, float]:
    """First paint and CPU time of raster tasks, both in ms, of a page with this body."""
    page_file.write_text(f"<!doctype html><body style=margin:0>{body}")
    page = browser.new_page(viewport={"width": width, "height": height})
    browser.start_tracing(page=page, categories=["cc", "devtools.timeline"])
    page.goto(page_file.as_uri())
    first = page.evaluate(_PAINTED)
    page.screenshot()
    events = json.loads(browser.stop_tracing())["traceEvents"]
    page.close()
    spent = sum(e.get("tdur", e.get("dur", 0)) for e in events if e["name"] == "RasterTask")
    return first, spent / 1000


def medians(browser, page_file: Path, body: str, size: tuple[int, int], repeats: int) -> str:
    """First paint and raster, ms, as the text of a table's cell."""
    runs = [painted(browser, page_file, body, *size) for _ in range(repeats)]
    return ", ".join(f"{statistics.median(values):.0f}" for values in zip(*runs, strict=True))


def by_shapes(browser, folder: Path, given: argparse.Namespace) -> None:
    """A row for a JPEG and for each count and markup, a cell for each width."""
    photo = over(load_image(given.photos[0]).pixels)
    eight_bits(photo).save(folder / "0.jpg", quality=80)
    files = [("JPEG", folder / "0.jpg")]
    for count, markup in itertools.product(given.counts, ("editable", "minimal")):
        made = vectorize(
            photo, gaussians=count, fit=FitOptions(iterations=100), svg=SvgOptions(markup=markup)
        )
        n, million = len(made.scene), drawn_pixels(made.scene) / 1e6
        path = folder / f"{len(files)}.svg"
        path.write_text(made.svg)
        name = f"{n}, {markup}, {million:.1f} Mpx drawn, rule {paint_ms(made.scene, made.svg):.0f}"
        files.append((name, path))
    print(f"| shapes, markup at {photo.shape[1]} px |", end="")
    print(" | ".join(f" {width} px: first paint, raster, ms" for width in given.widths), "|")
    for name, path in files:
        cells = []
        for width in given.widths:
            size = width, round(width * photo.shape[0] / photo.shape[1])
            body = f"<img src={path.name} width={size[0]} height={size[1]}>"
            cells.append(medians(browser, folder / "page.html", body, size, given.repeats))
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


def of_placeholders(browser, folder: Path, given: argparse.Namespace) -> None:
    """Pages of 40 colours, 40 WebP thumbnails and 40 placeholders of a kilobyte."""
    photos = itertools.cycle(over(load_image(path).pixels) for path in given.photos)
    rows = dict.fromkeys(("colours", "WebP", "placeholders, in src", "placeholders, in CSS"), "")
    box = f"width={_TILE} height={_TILE}"
    rng = np.random.default_rng(0)
    for photo in itertools.islice(photos, 40):
        side = min(photo.shape[:2]) // 2
        y, x = (rng.integers(0, extent - side) for extent in photo.shape[:2])
        part = photo[y : y + side, x : x + side]
        made = placeholder(part)
        thumbnail = encoded(eight_bits(part).resize((40, 40)), "WEBP", quality=40)
        webp = base64.b64encode(thumbnail).decode()
        tile = f"display:inline-block;width:{_TILE}px;height:{_TILE}px"
        rows["colours"] += f'<i style="{tile};background:{made.color}"></i>'
        rows["WebP"] += f'<img src="data:image/webp;base64,{webp}" {box}>'
        rows["placeholders, in src"] += f'<img src="{made.data_uri}" {box}>'
        style = f"{tile};background:{made.color} url('{made.data_uri_base64}') 0 0/100% 100%"
        rows["placeholders, in CSS"] += f'<i style="{style}"></i>'
    size = _COLUMNS * _TILE, 5 * _TILE
    print("| 40 of | kB | first paint, raster, ms |")
    for name, body in rows.items():
        body = f"<div style='width:{size[0]}px;font-size:0'>{body}</div><p>40 photos"
        cell = medians(browser, folder / "page.html", body, size, given.repeats)
        print(f"| {name} | {len(body) / 1000:.1f} | {cell} |", flush=True)
        if given.screenshots:
            page = browser.new_page(viewport={"width": size[0], "height": size[1]})
            page.goto((folder / "page.html").as_uri())
            page.screenshot(path=given.screenshots / f"{name.replace(', ', '-')}.png")
            page.close()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("photos", nargs="*", default=[_COFFEE], type=Path)
    parser.add_argument("--counts", nargs="*", type=int, default=[20, 300, 1000, 5000, 10000])
    parser.add_argument("--widths", nargs="*", type=int, default=[400, 800, 1600])
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--page", action="store_true")
    parser.add_argument("--screenshots", type=Path, help="folder for pictures of the pages")
    given = parser.parse_args()
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(**launch_options(flags=()))
        made = of_placeholders if given.page else by_shapes
        made(browser, Path(folder), given)
        browser.close()


if __name__ == "__main__":
    main()
