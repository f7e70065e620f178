"""A tracer of your own beside gauss2svg: python examples/tracer.py PHOTOS."""

import sys
from pathlib import Path

from PIL import Image

from gauss2svg import build_gallery
from gauss2svg.compare.table import run_bench

PIXEL = '<path fill="#{:02x}{:02x}{:02x}" d="M{} {}h1v1h-1"/>'


def trace(photo: str) -> str:
    """Return an SVG of 8 x 8 squares in the colours of a photo; put your tracer here."""
    with Image.open(photo) as image:
        size, small = image.size, image.convert("RGB").resize((8, 8)).tobytes()
    root = '<svg xmlns="http://www.w3.org/2000/svg" width="{}" height="{}" viewBox="0 0 8 8" {}>'
    squares = (PIXEL.format(*small[3 * k : 3 * k + 3], k % 8, k // 8) for k in range(64))
    return root.format(*size, 'preserveAspectRatio="none"') + "".join(squares) + "</svg>"


def main(*photos: str) -> None:
    Path("mine").mkdir(exist_ok=True)
    for photo in photos:
        Path("mine", Path(photo).stem + ".svg").write_text(trace(photo), encoding="utf-8")
    run_bench(photos, "bench", axes={"quality": ["draft"]}, peers=["mine=mine"])
    build_gallery(photos, "site", variants=["draft"], peers=["mine=mine"])


if __name__ == "__main__":
    main(*sys.argv[1:])
