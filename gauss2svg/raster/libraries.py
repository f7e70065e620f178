"""Renderers that are Python packages: resvg, and CairoSVG, which needs the system library cairo."""

import numpy as np
import resvg_py
from numpy.typing import NDArray

from gauss2svg.errors import RendererError
from gauss2svg.raster import from_png


def resvg_version() -> str:
    """Return the name and version of resvg."""
    return f"resvg {resvg_py.__resvg_version__}"


def resvg(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG as resvg draws it."""
    try:
        # If dpi is not given, resvg_py draws lengths in mm and the like as 0.
        png = resvg_py.svg_to_bytes(
            svg_string=svg,
            width=width,
            height=height,
            skip_system_fonts=True,
            dpi=96,
            languages=["en"],
        )
    except BaseException as error:
        # If resvg panics, pyo3 raises its PanicException, which is not an Exception but only a
        # BaseException.
        if isinstance(error, ValueError) or type(error).__name__ == "PanicException":
            raise RendererError(f"resvg cannot draw the SVG: {error}") from error
        raise
    return from_png(png)


def cairo_version() -> str:
    """Return the name and version of CairoSVG."""
    return f"CairoSVG {_cairosvg().__version__}"


def cairo(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG as CairoSVG draws it."""
    cairosvg, size = _cairosvg(), {"output_width": width, "output_height": height}
    try:
        return from_png(cairosvg.svg2png(svg.encode(), unsafe=False, **size) or b"")
    except Exception as error:  # the parser of CairoSVG may raise an exception of any class
        raise RendererError(f"CairoSVG cannot draw the SVG: {error!r}") from error


def _cairosvg():
    try:
        import cairosvg
    except OSError as error:  # raised if cairocffi has not found the shared library cairo
        raise RendererError(
            "renderer cairo needs the cairo system library. Try to install it (apt-get install "
            "libcairo2, brew install cairo), or --renderer resvg"
        ) from error
    return cairosvg
