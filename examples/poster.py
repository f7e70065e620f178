"""An SVG of gauss2svg becomes a page for a printer: python poster.py print.svg poster.pdf 0.5 0.5.

A3 at 300 dpi, with 3 mm of bleed around the trim box and an embedded sRGB profile. The picture
covers the page. Of what is beyond it these shares are cut off at the left and at the top: 0 keeps
that side, 1 the other, and each that is not given is 0.5. It needs pikepdf.
"""

import sys
import zlib
from collections.abc import Iterator

import numpy as np
import pikepdf
from pikepdf import Array, Dictionary, Name
from PIL import ImageCms

from gauss2svg import Scene, read_svg
from gauss2svg.render import render
from gauss2svg.scene.falloff import cut_radius

DPI, TRIM_MM, BLEED_MM = 300, (297, 420), 3
STRIP = 256  # rows, which bound the memory


def strips(
    scene: Scene, width: int, height: int, cut: tuple[float, float] = (0.5, 0.5)
) -> Iterator[np.ndarray]:
    """Return the page in px from the top, as levels (rows, width, 3)."""
    scene = scene.scaled(max(width / scene.width, height / scene.height))
    beyond = (scene.width - width) * cut[0], (scene.height - height) * cut[1]
    scene = scene.replace(mean=scene.mean - beyond)
    reach = cut_radius(scene.beta) * scene.sigma[:, 1]
    for top in range(0, height, STRIP):
        rows = min(STRIP, height - top)
        away = np.abs(scene.mean[:, 1] - top - rows / 2)
        part = scene.select(away < rows / 2 + reach)
        part = part.replace(width=width, height=rows, mean=part.mean - [0, top])
        yield (np.clip(render(part), 0, 1) * 255 + 0.5).astype(np.uint8)


def packed(levels: Iterator[np.ndarray], width: int) -> bytes:
    """Rows as the differences to those above, deflated: PNG's filter "up", which PDF knows."""
    deflate, above, made = zlib.compressobj(6), np.zeros((1, width, 3), np.uint8), []
    for strip in levels:
        change = np.diff(np.concatenate([above, strip]), axis=0).reshape(len(strip), -1)
        made.append(deflate.compress(np.insert(change, 0, 2, axis=1).tobytes()))
        above = strip[-1:]
    return b"".join([*made, deflate.flush()])


def write_poster(scene: Scene, path: str, left: float = 0.5, top: float = 0.5) -> None:
    trim = TRIM_MM if scene.height >= scene.width else TRIM_MM[::-1]
    width, height = (round((side + 2 * BLEED_MM) / 25.4 * DPI) for side in trim)
    pdf = pikepdf.new()
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    picture = pdf.make_stream(
        packed(strips(scene, width, height, (left, top)), width),
        Type=Name.XObject, Subtype=Name.Image, Width=width, Height=height, BitsPerComponent=8,
        ColorSpace=Array([Name.ICCBased, pdf.make_stream(profile, N=3)]), Filter=Name.FlateDecode,
        DecodeParms=Dictionary(Predictor=15, Colors=3, Columns=width),
    )  # fmt: skip
    w, h, bleed = width * 72 / DPI, height * 72 / DPI, BLEED_MM * 72 / 25.4
    page = pdf.add_blank_page(page_size=(w, h))
    page.BleedBox, page.TrimBox = Array([0, 0, w, h]), Array([bleed, bleed, w - bleed, h - bleed])
    page.Resources = Dictionary(XObject=Dictionary(Picture=picture))
    page.Contents = pdf.make_stream(f"{w} 0 0 {h} 0 0 cm /Picture Do".encode())
    pdf.save(path)


if __name__ == "__main__":
    write_poster(read_svg(sys.argv[1]), sys.argv[2], *map(float, sys.argv[3:]))
