"""Files that are read and written again."""

from __future__ import annotations

import re
from typing import Any

from gauss2svg.scene import Scene
from gauss2svg.svg import Document, SvgFormat
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import write_svg


def rewritten(svg: str, scene: Scene | None = None, layers: Any = "rounds", **document: Any) -> str:
    """Return the text of a scene, by default the one that an SVG has, in the format of the SVG."""
    scene = read_svg(svg) if scene is None else scene
    side = re.findall(r'viewBox="0 0 ([\d.]+)', svg)[0]
    svg_format = SvgFormat(
        markup="editable" if svg.startswith("<?xml") else "minimal",
        precision=scene.width / float(side),
        layers=layers,
    )
    for title in re.findall("<title>(.*?)</title>", svg):
        document["title"] = title
    return write_svg(scene, svg_format, Document(**document))
