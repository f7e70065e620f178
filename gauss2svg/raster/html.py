"""The HTML page that shows an SVG in a browser.

It does so in an <img>, in which an SVG runs no script and loads nothing.
"""

IMAGE = "drawing.svg"
WHITE, BLACK, CLEAR = "#fff", "#000", "transparent"


def html(page: str) -> str:
    """The page, of the colour WHITE, BLACK or CLEAR."""
    return f"""<!doctype html><meta charset="utf-8">
<style>html, body {{ margin: 0; background: {page} }} img {{ display: block }}</style>
<img src="{IMAGE}">
"""
