"""CairoSVG, which draws with the cairo system library."""

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import RendererError
from gauss2svg.raster.features import Feature
from gauss2svg.raster.program import from_png

_INSTALL = (
    "renderer cairo needs the cairo system library. Try to install it (apt-get install libcairo2, "
    "brew install cairo), or --renderer resvg"
)


# Found by CairoSVG 2.9.
CANNOT_DRAW = {
    Feature.SKEWED_BLUR: "it has no filters but offset, flood and blend",
    Feature.ROTATED_BLUR: "it has no filters but offset, flood and blend",
    Feature.BLUR: "it has no filters but offset, flood and blend",
    Feature.LIGHTER: "",
    Feature.BLEND: "",
    Feature.FILTER: "it has no filters but offset, flood and blend",
    Feature.MASK: "119 levels off at a grey; black and white ones are right",
}


def version() -> str:
    """Name and version of CairoSVG."""
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
