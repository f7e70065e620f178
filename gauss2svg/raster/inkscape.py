"""Inkscape's command line: what an editor shows."""

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import RendererError
from gauss2svg.raster.features import Feature
from gauss2svg.raster.program import find, from_png, run, version_line

# Beyond the size of a cairo surface Inkscape writes a white image without any message.
_MOST_PX = 32767


# Found by Inkscape 1.2.
CANNOT_DRAW = {
    Feature.LIGHTER: "",
    Feature.PLAIN_HREF: "",
}


def version() -> str:
    """Name and version of Inkscape."""
    return " ".join(version_line(_program()).split()[:2])


def draw(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Pixels (height, width, 4) of the SVG."""
    if max(width, height) > _MOST_PX:
        raise RendererError(
            f"raster of inkscape must be at most {_MOST_PX} px a side; got {width}x{height}. "
            "Try to draw it smaller, or another --renderer"
        )
    with tempfile.TemporaryDirectory(prefix="gauss2svg-") as name:
        folder = Path(name)
        (folder / "drawing.svg").write_text(svg, encoding="utf-8")
        command = [
            _program(),
            "--export-type=png",
            "--export-area-page",
            f"--export-width={width}",
            f"--export-height={height}",
            "--export-filename=drawn.png",
            "drawing.svg",
        ]
        # The user's settings could change the image, and two processes cannot share a profile.
        run(command, folder=folder, environment={"INKSCAPE_PROFILE_DIR": name, "HOME": name})
        drawn = folder / "drawn.png"
        # Inkscape exits with 0 even if it could not read the file.
        if not drawn.exists():
            raise RendererError("Inkscape cannot draw the SVG: it wrote no file")
        return from_png(drawn.read_bytes())


def _program() -> str:
    return find("inkscape", ["inkscape"], "apt-get install inkscape, brew install inkscape")
