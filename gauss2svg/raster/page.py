"""The page that shows an SVG to a browser.

In an <img> an SVG runs no script and loads nothing, whatever it says.
"""

IMAGE = "drawing.svg"
HTML = f"""<!doctype html><meta charset="utf-8">
<style>html, body {{ margin: 0; background: #fff }} img {{ display: block }}</style>
<img src="{IMAGE}">
"""
