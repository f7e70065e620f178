"""The start tag of an SVG's root, found past all that may stand before it, and rewritten."""

from __future__ import annotations

import re

_QUOTED = r"""(?:"[^"]*"|'[^']*')"""
_COMMENT = r"<!--.*?-->"
# Of well-formed XML; a document type may have rules of its own, such as entities, in brackets.
_DOCTYPE = rf"<!DOCTYPE(?:{_QUOTED}|\[(?:{_COMMENT}|{_QUOTED}|[^\]\"'])*+\]|[^>\"'\[])*+>"
_BEFORE = re.compile(rf"\s++|<\?.*?\?>|{_COMMENT}|({_DOCTYPE})", re.DOTALL)
_START_TAG = re.compile(rf"<([^\s/>]+)((?:{_QUOTED}|[^>\"'/])*+)(/?)>")
_ATTRIBUTE = re.compile(rf"([^\s=]+)\s*=\s*({_QUOTED})")
_REPLACED = ("width", "height", "viewBox", "preserveAspectRatio")


def stretched(text: str, width: int, height: int, view_box: str | None = None) -> str | None:
    """The SVG with a root that fills width x height px; text is well-formed.

    view_box is what of it is shown, the root's own where it is None. The result is None for a
    root that has none either, and for one that cannot be found. What is before the root is left
    out, but for rules of its own: no renderer needs it, and text has no encoding. A width in the
    root's style changes nothing in any of them.
    """
    at, rules = 1 if text.startswith("\ufeff") else 0, ""
    while before := _BEFORE.match(text, at):
        at = before.end()
        rules += before[1] if before[1] and "[" in before[1] else ""
    tag = _START_TAG.match(text, at)
    if tag is None:
        return None
    attributes: dict[str, str] = dict(_ATTRIBUTE.findall(tag[2]))
    box = attributes.get("viewBox") if view_box is None else f'"{view_box}"'
    if box is None:
        return None
    kept = "".join(f" {n}={quoted}" for n, quoted in attributes.items() if n not in _REPLACED)
    return (
        f'{rules}<{tag[1]} width="{width}" height="{height}" preserveAspectRatio="none" '
        f"viewBox={box}{kept}{tag[3]}>{text[tag.end() :]}"
    )
