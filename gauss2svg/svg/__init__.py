"""Writing scenes as SVG."""

from gauss2svg.svg.encode import SvgOptions, recolored
from gauss2svg.svg.write import write_svg

__all__ = ["SvgOptions", "recolored", "write_svg"]
