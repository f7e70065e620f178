"""The directive `{packages}`: the packages and their imports, drawn from the code."""

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
_STEP, _BOX = 42, 28  # px: from row to row, and of a box
# Files, most of which all import.
_PLAIN = ("errors", "version", "files", "options", "processes", "__main__")


def packages_in_order() -> list[str]:
    """Return the packages, highest layer first, in the order of the import contract."""
    contracts = tomllib.loads(_PROJECT.read_text())["tool"]["importlinter"]["contracts"]
    (rows,) = (one["layers"] for one in contracts if one["type"] == "layers")
    named = (name.strip() for row in rows for name in row.split("|"))
    return [name for name in named if name not in _PLAIN]


def imports(packages: set[str]) -> Counter[tuple[str, str]]:
    """Return the number of imports from the modules of a package to those of another."""
    graph = grimp.build_graph("gauss2svg", cache_dir=None)
    found: Counter[tuple[str, str]] = Counter()
    for module in graph.modules:
        for other in graph.find_modules_directly_imported_by(module):
            pair = tuple(name.split(".")[1] if "." in name else "" for name in (module, other))
            if pair[0] != pair[1] and set(pair) <= packages:
                found[pair[0], pair[1]] += 1
    return found


def drawing() -> str:
    """Return the SVG: a box for each package, and an arc to each package that it imports."""
    at = {name: 8 + k * _STEP for k, name in enumerate(packages_in_order())}
    height = 8 + len(at) * _STEP
    width = 212 + round(0.75 * _reach(height))  # as far as the widest arc gets
    parts = [
        f'<svg class="packages" viewBox="0 0 {width} {height}" role="img" '
        'aria-labelledby="packages-title">'
        '<title id="packages-title">Packages from top to bottom, and arcs to the packages that '
        "each imports</title>"
    ]
    for (source, target), count in sorted(imports(set(at)).items()):
        y0, y1 = (at[name] + _BOX / 2 for name in (source, target))
        reach = _reach(y1 - y0)
        parts.append(
            f'<path d="M212 {y0 + 4:g}C{212 + reach:g} {y0 + 4:g} {212 + reach:g} {y1 - 4:g} '
            f'214 {y1 - 4:g}" stroke-width="{min(0.6 + count / 8, 4):.2g}"><title>{source} imports '
            f"{target}, {count} times</title></path>"
            f'<path class="head" d="M213 {y1 - 4:g}l7 -3v6z"/>'
        )
    for name, y in at.items():
        parts.append(
            f'<rect x="8" y="{y}" width="200" height="{_BOX}" rx="4"/>'
            f'<text x="108" y="{y + 20}">{escape(name)}</text>'
        )
    return "".join([*parts, "</svg>"])


def _reach(distance: float) -> float:
    """Return how far (px) an arc reaches to the right, by the distance (px) of its ends."""
    return 40 + 0.85 * distance


class Packages(SphinxDirective):
    """The drawing."""

    def run(self) -> list[nodes.Node]:
        """Return the node."""
        return [nodes.raw("", drawing(), format="html")]


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_directive("packages", Packages)
    return {"parallel_read_safe": True}
