"""Additive scenes as SVG: differences on a canvas that holds a limited range of values."""
