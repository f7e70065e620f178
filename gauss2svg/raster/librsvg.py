"""librsvg, by its program rsvg-convert: the renderer of GNOME and of many web services."""

import numpy as np
from numpy.typing import NDArray

from gauss2svg.raster.features import Feature
from gauss2svg.raster.program import find, from_png, run, version_line

# Observed with librsvg 2.54.
CANNOT_DRAW = {Feature.TURNED_BLUR: "39 to 45 levels off", Feature.LIGHTER: ""}


def version() -> str:
    """Return the name and version of librsvg."""
    return f"librsvg {version_line(_program()).rpartition(' ')[2]}"


def draw(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG."""
    # Without --unlimited, rsvg-convert refuses large files. It loads no other files for an SVG on
    # standard input, which has no folder.
    size = ["--width", str(width), "--height", str(height)]
    return from_png(run([_program(), "--unlimited", *size, "--format=png"], stdin=svg.encode()))


def _program() -> str:
    return find("librsvg", ["rsvg-convert"], "apt-get install librsvg2-bin, brew install librsvg")
