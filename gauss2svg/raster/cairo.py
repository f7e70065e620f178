"""CairoSVG, which draws with the cairo system library."""

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import RendererError
from gauss2svg.raster.png import from_png

_INSTALL = (
    "renderer cairo needs the cairo system library. Try to install it (apt-get install libcairo2, "
    "brew install cairo), or --renderer resvg"
)


def version() -> str:
    """Name and version."""
    return f"CairoSVG {_cairosvg().__version__}"


def draw(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Pixels (height, width, 4) of the SVG."""
    cairosvg = _cairosvg()
    try:
        png = cairosvg.svg2png(
            bytestring=svg.encode(), output_width=width, output_height=height, unsafe=False
        )
    except Exception as error:  # CairoSVG raises whatever its parsing trips over
        raise RendererError(f"CairoSVG cannot draw the SVG: {error!r}") from error
    if png is None:
        raise RendererError("CairoSVG drew nothing")
    return from_png(png)


def _cairosvg():
    try:
        import cairosvg
    except OSError as error:  # cairocffi found no shared library
        raise RendererError(_INSTALL) from error
    return cairosvg
