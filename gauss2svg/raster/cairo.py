"""CairoSVG, which draws with the cairo system library."""

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import RendererError
from gauss2svg.raster.features import Feature
from gauss2svg.raster.program import from_png

# Observed with CairoSVG 2.9.
_BLURS = Feature.TURNED_BLUR, Feature.BLUR
CANNOT_DRAW = {
    **dict.fromkeys((*_BLURS, Feature.FILTER), "it has no filters but offset, flood and blend"),
    Feature.LIGHTER: "",
    Feature.BLEND: "",
    Feature.MASK: "119 levels off at a grey; black and white ones are right",
}


def version() -> str:
    """Return the name and version of CairoSVG."""
    return f"CairoSVG {_cairosvg().__version__}"


def draw(svg: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG."""
    cairosvg, size = _cairosvg(), {"output_width": width, "output_height": height}
    try:
        return from_png(cairosvg.svg2png(svg.encode(), unsafe=False, **size) or b"")
    except Exception as error:  # CairoSVG's parser raises exceptions of any class
        raise RendererError(f"CairoSVG cannot draw the SVG: {error!r}") from error


def _cairosvg():
    try:
        import cairosvg
    except OSError as error:  # cairocffi found no shared library
        raise RendererError(
            "renderer cairo needs the cairo system library. Try to install it (apt-get install "
            "libcairo2, brew install cairo), or --renderer resvg"
        ) from error
    return cairosvg
