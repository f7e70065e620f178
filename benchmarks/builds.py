"""Build examples/vite with npm and look at its page in Chromium, with late photos.

python benchmarks/builds.py [--pictures FOLDER]

It prints how far anything moved (layout shift), whether the placeholders are in the first paint,
how close they are to the photos, and whether they are gone once the photos have come. It needs
node and Playwright. npm installs Vite, unless examples/vite has node_modules.
"""

from __future__ import annotations

import argparse
import io
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
from PIL import Image

from gauss2svg.raster.chromium import launch_options

EXAMPLES = Path(__file__).parents[1] / "examples"
PHOTOS = "public/photos"
LATE_S = 4.0
_SHIFT = """() => {
    window.shift = 0;
    new PerformanceObserver((list) => {
        for (const entry of list.getEntries()) window.shift += entry.value;
    }).observe({ type: "layout-shift", buffered: true });
}"""
_STATE = """() => ({
    shift: window.shift,
    paint: performance.getEntriesByName("first-contentful-paint")[0]?.startTime,
    loaded: [...document.images].filter((one) => one.complete && one.naturalWidth).length,
    shown: [...document.images].filter((one) => one.style.backgroundImage.startsWith("url")).length,
    boxes: [...document.images].map((one) => {
        const { x, y, width, height } = one.getBoundingClientRect();
        return [x, y, width, height];
    }),
})"""


class Late(SimpleHTTPRequestHandler):
    """Serves a folder; photos come after LATE_S."""

    def do_GET(self) -> None:
        """Answer, after a while where it is a photo."""
        if self.path.startswith("/photos/"):
            time.sleep(LATE_S)
        super().do_GET()

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Say nothing."""


def built(folder: Path) -> Path:
    """Build the project with two photos, one of them transparent, and return its pages."""
    root, photos = folder / "vite", folder / "vite" / PHOTOS
    shutil.copytree(EXAMPLES / "vite", root, ignore=shutil.ignore_patterns("node_modules"))
    photos.mkdir(parents=True)
    with Image.open(EXAMPLES / "coffee.jpg") as photo:
        photo.resize((1600, 1067)).save(photos / "coffee.jpg")
        clear = photo.convert("RGBA").resize((900, 600))
    x = np.abs(np.linspace(-1, 1, 900)) < 0.5
    clear.putalpha(Image.fromarray(np.tile(np.uint8(255 * x), (600, 1))))
    clear.save(photos / "clear one.png")
    if (EXAMPLES / "vite" / "node_modules").exists():
        (root / "node_modules").symlink_to((EXAMPLES / "vite" / "node_modules").resolve())
    else:
        subprocess.run(["npm", "install", "--no-audit", "--no-fund"], cwd=root, check=True)
    for _ in range(2):  # the second time nothing has changed
        begun = time.perf_counter()
        subprocess.run(["npm", "run", "build", "--silent"], cwd=root, check=True, stdout=sys.stderr)
        print(f"built in {time.perf_counter() - begun:.1f} s")
    return root / "dist"


def pixels_of(shot: bytes, box: list[float]) -> np.ndarray:
    """The pixels of an element on a screenshot, (h, w, 3) in 0..1."""
    x, y, width, height = (round(value) for value in box)
    with Image.open(io.BytesIO(shot)) as picture:
        part = picture.convert("RGB").crop((x, y, x + width, y + height))
        return np.asarray(part, np.float64) / 255


def look(pages: Path, program: object, pictures: Path | None) -> list[str]:
    """Look at the page before and after its photos have come; return what is wrong."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Late, directory=os.fspath(pages)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    page = program.new_page(viewport={"width": 800, "height": 1200})  # type: ignore[attr-defined]
    page.add_init_script(f"({_SHIFT})()")
    page.goto(f"http://127.0.0.1:{server.server_port}/", wait_until="domcontentloaded")
    page.wait_for_function("performance.getEntriesByName('first-contentful-paint').length > 0")
    first, early = page.screenshot(), page.evaluate(_STATE)
    page.wait_for_load_state("load")
    page.wait_for_timeout(300)
    last, late = page.screenshot(), page.evaluate(_STATE)
    server.shutdown()
    if pictures is not None:
        (pictures / "first.png").write_bytes(first)
        (pictures / "loaded.png").write_bytes(last)
    wrong = []
    if early["loaded"]:
        wrong.append("photos had come before the first look")
    # With two decimals: what Chromium calls a shift is larger.
    if late["shift"] > 0.001 or early["boxes"] != late["boxes"]:
        wrong.append(f"moved: layout shift {late['shift']:.3f}")
    errors = []
    for before, after in zip(early["boxes"], late["boxes"], strict=True):
        seen, photo = pixels_of(first, before), pixels_of(last, after)
        if seen.std() < 0.02:
            wrong.append("no placeholder in the first paint")
        errors.append(10 * np.log10(1 / ((seen - photo) ** 2).mean()))
        sides = photo[:, : photo.shape[1] // 5]
        is_clear = sides.shape[0] and len(errors) == 1  # "clear one.png" sorts first
        if is_clear and sides.min() < 0.999:
            wrong.append("the placeholder shines through the transparent photo")
    close = ", ".join(f"{one:.1f}" for one in errors)
    print(
        f"first paint at {early['paint']:.0f} ms with {early['loaded']} of "
        f"{len(early['boxes'])} photos; placeholders at {close} dB of what comes; layout shift "
        f"{late['shift']:.3f}; {late['loaded']} photos loaded, {late['shown']} placeholders left"
    )
    return wrong


def main() -> int:
    """Build and look; 1 where anything is wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--pictures", type=Path, help="folder for screenshots")
    given = parser.parse_args()
    if given.pictures is not None:
        given.pictures.mkdir(parents=True, exist_ok=True)
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        pages = built(Path(folder))
        program = playwright.chromium.launch(**launch_options(flags=()))
        wrong = look(pages, program, given.pictures)
        program.close()
    for line in wrong:
        print(f"wrong: {line}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
