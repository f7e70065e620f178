"""Writing scenes as SVG."""

from gauss2svg.svg.options import SvgOptions
from gauss2svg.svg.settle import settled
from gauss2svg.svg.write import write_svg

__all__ = ["SvgOptions", "settled", "write_svg"]
