"""Writing scenes as SVG, and reading them back."""

from gauss2svg.svg.blur import FORMS, GRADIENT
from gauss2svg.svg.layers import arranged
from gauss2svg.svg.options import SvgOptions
from gauss2svg.svg.packing import bytes_by_part, file_bytes, is_svgz
from gauss2svg.svg.page import Page
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.settle import settled
from gauss2svg.svg.write import outline_svg, write_svg

__all__ = [
    "FORMS",
    "GRADIENT",
    "Page",
    "SvgOptions",
    "arranged",
    "bytes_by_part",
    "file_bytes",
    "is_svgz",
    "outline_svg",
    "read_svg",
    "settled",
    "write_svg",
]
