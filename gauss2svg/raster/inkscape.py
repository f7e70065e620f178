"""Inkscape by its command line, which shows an SVG as an editor does."""

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import RendererError
from gauss2svg.raster.features import Feature
from gauss2svg.raster.program import DRAWING, drawn, find, version_line

# Observed with Inkscape 1.2.
CANNOT_DRAW = {Feature.LIGHTER: "", Feature.PLAIN_HREF: ""}
_MAX_SIDE = 32767  # px; beyond this limit of cairo surfaces Inkscape writes a white image


def version() -> str:
    """Return the name and version of Inkscape."""
    return " ".join(version_line(_program()).split()[:2])


def draw(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG."""
    if max(width, height) > _MAX_SIDE:
        raise RendererError(
            f"raster of inkscape must be at most {_MAX_SIDE} px a side; got {width}x{height}. "
            "Try to draw it smaller, or another --renderer"
        )
    export = "--export-type=png", "--export-area-page", "--export-filename=drawn.png"
    size = f"--export-width={width}", f"--export-height={height}"
    return drawn("Inkscape", {DRAWING: svg}, lambda _: [_program(), *export, *size, DRAWING])


def _program() -> str:
    mac = "Inkscape.app/Contents/MacOS/inkscape"
    # The .com writes to the terminal, the .exe opens a window.
    windows = "Inkscape/bin/inkscape.com", "Inkscape/bin/inkscape.exe"
    install = "apt-get install inkscape, brew install inkscape"
    return find("inkscape", ["inkscape", mac, *windows], install)
