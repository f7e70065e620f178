"""Minimal markup: SVG with nothing that does not draw, in whole numbers."""
