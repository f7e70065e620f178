"""Writing scenes as SVG, and reading them back."""

from gauss2svg.svg.blur import FORMS, GRADIENT
from gauss2svg.svg.options import SvgOptions
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.settle import settled
from gauss2svg.svg.write import write_svg

__all__ = ["FORMS", "GRADIENT", "SvgOptions", "read_svg", "settled", "write_svg"]
