"""The directive `{rooms}`: rooms of the package and their imports, drawn from the code."""

from __future__ import annotations

import tomllib
from collections import Counter
from html import escape
from pathlib import Path
from typing import Any

import grimp
from docutils import nodes
from sphinx.util.docutils import SphinxDirective

_PROJECT = Path(__file__).parents[2] / "pyproject.toml"
_STEP, _BOX, _LEFT = 46, 30, 8  # px: between rows, of a box's height, of the margin
_PLAIN = ("errors", "version", "files", "options", "__main__")  # files, most of which all import


def layers() -> list[list[str]]:
    """The rooms, highest layer first, as the import contract has them."""
    contracts = tomllib.loads(_PROJECT.read_text())["tool"]["importlinter"]["contracts"]
    (rows,) = (one["layers"] for one in contracts if one["type"] == "layers")
    named = ([name.strip() for name in row.split("|")] for row in rows)
    return [kept for row in named if (kept := [name for name in row if name not in _PLAIN])]


def imports(rooms: set[str]) -> Counter[tuple[str, str]]:
    """Numbers of imports from one room's modules to another's."""
    graph = grimp.build_graph("gauss2svg")
    found: Counter[tuple[str, str]] = Counter()
    for module in graph.modules:
        for other in graph.find_modules_directly_imported_by(module):
            pair = tuple(name.split(".")[1] if "." in name else "" for name in (module, other))
            if pair[0] != pair[1] and set(pair) <= rooms:
                found[pair[0], pair[1]] += 1
    return found


def drawing() -> str:
    """The SVG: a box for each room, and an arc from each to those that it imports."""
    rows = layers()
    at = {}
    for y, row in enumerate(rows):
        for x, name in enumerate(row):
            width = (200 - 8 * (len(row) - 1)) / len(row)
            at[name] = (_LEFT + x * (width + 8), 8 + y * _STEP, width)
    height = 8 + len(rows) * _STEP
    parts = [
        f'<svg class="rooms" viewBox="0 0 560 {height}" role="img" aria-labelledby="rooms-title">'
        '<title id="rooms-title">Rooms of the package, from top to bottom, and arcs to the rooms '
        "that each imports</title>"
    ]
    for (source, target), count in sorted(imports(set(at)).items()):
        y0, y1 = (at[name][1] + _BOX / 2 for name in (source, target))
        reach = 40 + 0.85 * (y1 - y0)
        parts.append(
            f'<path d="M212 {y0 + 4:g}C{212 + reach:g} {y0 + 4:g} {212 + reach:g} {y1 - 4:g} '
            f'214 {y1 - 4:g}" stroke-width="{min(0.6 + count / 8, 4):.2g}"><title>{source} imports '
            f"{target}, {count} times</title></path>"
            f'<path class="head" d="M213 {y1 - 4:g}l7 -3v6z"/>'
        )
    for name, (x, y, width) in at.items():
        parts.append(
            f'<rect x="{x:g}" y="{y}" width="{width:g}" height="{_BOX}" rx="4"/>'
            f'<text x="{x + width / 2:g}" y="{y + 20}">{escape(name)}</text>'
        )
    return "".join([*parts, "</svg>"])


class Rooms(SphinxDirective):
    """The drawing."""

    def run(self) -> list[nodes.Node]:
        """The node."""
        return [nodes.raw("", drawing(), format="html")]


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_directive("rooms", Rooms)
    return {"parallel_read_safe": True}
