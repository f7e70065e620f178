"""Docstrings as they are in the code, as reStructuredText.

In the code they are plain text: prose, indented formulas, and aligned lists of arguments,

    image  path, bytes or array
    goal   what to reach,
           with continued lines

which become paragraphs, literal blocks and definition lists.
"""

from __future__ import annotations

import re
from typing import Any

_NAMES = r"\w+(?:, \w+)*"
_ITEM = re.compile(rf"({_NAMES}) {{2,}}(\S.*)")
_BARE_ITEM = re.compile(_NAMES)
_LITERAL = re.compile(r"(`[^`]+`)")
_SPECIAL = re.compile(r"([\\*_|<>])")


def inline(text: str) -> str:
    """Return a line with its special characters escaped, and `names` as literals."""
    parts = _LITERAL.split(text)
    return "".join(
        f"``{part[1:-1]}``" if k % 2 else _SPECIAL.sub(r"\\\1", part)
        for k, part in enumerate(parts)
    )


def as_rst(lines: list[str]) -> list[str]:
    """Return the docstring of these lines as reStructuredText."""
    out: list[str] = []
    kind = ""  # of the block that the last line belongs to
    for k, line in enumerate(lines):
        indented = line.startswith("  ")
        following = lines[k + 1] if k + 1 < len(lines) else ""
        item = _ITEM.fullmatch(line)
        bare = _BARE_ITEM.fullmatch(line) and following.startswith("    ")
        if not line.strip():
            out.append("")
            kind = kind if kind == "literal" else ""
        elif not indented and (item or bare):
            out += [] if kind == "list" else [""]
            out.append(f"``{item[1] if item else line}``")
            out += [f"   {inline(item[2])}"] if item else []
            kind = "list"
        elif indented and kind == "list":
            out.append(f"   {inline(line.strip())}")
        elif indented:
            out += [] if kind == "literal" else ["", "::", ""]
            out.append(f"   {line}")
            kind = "literal"
        else:
            out += [] if kind == "prose" else [""]
            out.append(inline(line))
            kind = "prose"
    return [*out, ""]


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""

    def process(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
        lines[:] = as_rst(lines)

    app.connect("autodoc-process-docstring", process)
    return {"parallel_read_safe": True}
