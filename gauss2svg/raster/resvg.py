"""resvg, embedded by the wheel resvg_py."""

import numpy as np
import resvg_py
from numpy.typing import NDArray

from gauss2svg.errors import RendererError
from gauss2svg.raster.features import Feature
from gauss2svg.raster.program import from_png

# Observed with resvg 0.48.
CANNOT_DRAW = {
    Feature.TURNED_BLUR: "20 to 43 levels off",
    Feature.LIGHTER: "",
}


def version() -> str:
    """Return the name and version of resvg."""
    return f"resvg {resvg_py.__resvg_version__}"


def draw(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG."""
    try:
        png = resvg_py.svg_to_bytes(
            svg_string=svg, width=width, height=height, skip_system_fonts=True
        )
    except BaseException as error:
        # A panic inside resvg is raised as pyo3's PanicException, a BaseException.
        if isinstance(error, ValueError) or type(error).__name__ == "PanicException":
            raise RendererError(f"resvg cannot draw the SVG: {error}") from error
        raise
    return from_png(png)
