"""CSS of a file as browsers read it, by tinycss2, and as resvg reads it.

resvg stops to read a list of declarations at the first one that its simple grammar does not have,
such as a custom property, a slash or nested brackets.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import tinycss2

_COMMENT = r"/\*(?:[^*]|\*(?!/))*+"
# A search for comments alone would take quadratic time if many are not closed.
_TO_REMOVE = re.compile(rf"{_COMMENT}(?:\*/|\Z)")
_LINE_END = re.compile(r"\r\n?|\f")
_GAP = rf"(?:\s|{_COMMENT}\*/)*+"
_NAME = r"-?[a-zA-Z_][\w-]*+"
_TERM = (
    rf"""(?:#[\w-]*+|[+\-.\d][\d.]*+(?:%|{_NAME})?|"(?:[^"\\]|\\.)*+"|'(?:[^'\\]|\\.)*+'|,"""
    rf"""|{_NAME}(?:\([^)\\]*+\))?)"""
)
# One declaration as resvg reads it: a name, terms and the word !important. resvg skips a star
# before the name, but browsers skip the whole declaration.
_DECLARATION = re.compile(
    rf"{_GAP}(\*?)(-?[a-z_][\w-]*+){_GAP}:{_GAP}((?:{_TERM}{_GAP})++)(?:(!){_GAP}important{_GAP})?"
    rf"(?:(?:;{_GAP})++|(?=\}})|\Z)",
    re.ASCII | re.DOTALL,
)
_AT_RULES = "font-face charset page property namespace counter-style keyframes -webkit-keyframes"
_AT_RULES_WITHOUT_EFFECT = set((_AT_RULES + " -moz-keyframes -o-keyframes").split())
# Queries of media that a still picture on a white page does not meet.
_UNMET = re.compile(
    r"print|speech|\(\s*prefers-color-scheme\s*:\s*dark\s*\)"
    r"|\(\s*prefers-reduced-motion\s*:\s*no-preference\s*\)"
)


class Declaration(NamedTuple):
    """A declaration of CSS, with its value as text."""

    name: str
    value: str
    is_important: bool


class Css(NamedTuple):
    """A list of declarations.

    by_resvg     those that resvg reads
    by_browsers  those that browsers read
    is_same      whether both are known to be the same
    """

    by_resvg: list[Declaration]
    by_browsers: list[Declaration]
    is_same: bool


@lru_cache(maxsize=4096)
def css_of(style: str) -> Css:
    """Return the declarations of the attribute style."""
    style = _LINE_END.sub("\n", style)
    read, end = _by_resvg(style, 0)
    if re.compile(_GAP).fullmatch(style, end):
        return Css(read, read, True)
    return Css(read, _by_browsers(tinycss2.parse_blocks_contents(style, True, True)), False)


def rules_of(sheet: str) -> Iterator[tuple[str, list[Any], Css]]:
    """Yield each selector of a style sheet, as tokens, with its declarations.

    The first item of a tuple is what resvg does not apply: an at-rule around the selector, nested
    rules, or escapes. It is "" if there is none. Rules that no still picture meets are left out.
    """
    sheet = _LINE_END.sub("\n", sheet)  # tinycss2 does it too, and then counts the lines
    lines = [0, *(match.end() for match in re.finditer("\n", sheet))]

    def offset(node: Any) -> int:
        return lines[node.source_line - 1] + node.source_column - 1

    waiting = [("", node) for node in reversed(tinycss2.parse_stylesheet(sheet, True, True))]
    while waiting:
        reason, node = waiting.pop()
        inner: list[tuple[str, Any]] = []
        if node.type == "qualified-rule" and node.content:
            begin = offset(node.content[0])
            if "\\" in sheet[offset(node) : begin]:
                reason = reason or "escapes in a selector"
            read, end = _by_resvg(sheet, begin)
            content = tinycss2.parse_blocks_contents(node.content, True, True)
            css = Css(read, _by_browsers(content), sheet[end : end + 1] in ("}", ""))
            for selector in _selectors(node.prelude):
                yield reason, selector, css
            inner = [(reason or "nested rules", each) for each in content]
        elif node.type == "at-rule" and node.content is not None:
            name, query = node.lower_at_keyword, text_of(node.prelude)
            is_unmet = name == "media" and _UNMET.fullmatch(query)
            if name not in _AT_RULES_WITHOUT_EFFECT and not is_unmet:
                rule = f"@{name} {query}".strip()[:60]
                inner = [
                    (rule, each) for each in tinycss2.parse_rule_list(node.content, True, True)
                ]
        waiting += reversed(inner)


def text_of(nodes: list[Any]) -> str:
    """Return the text of nodes of tinycss2, or a bracket if they are nested too deeply for it."""
    try:
        return tinycss2.serialize(nodes).strip()
    except RecursionError:
        return "("


def _by_resvg(text: str, begin: int) -> tuple[list[Declaration], int]:
    """Return the declarations that resvg reads from a position on, and where the others begin."""
    read: list[Declaration] = []
    while match := _DECLARATION.match(text, begin):
        read.append(Declaration(match[2], _TO_REMOVE.sub("", match[3]).strip(), bool(match[4])))
        if match[1]:
            break
        begin = match.end()
    return read, begin


def _by_browsers(nodes: list[Any]) -> list[Declaration]:
    return [
        Declaration(node.lower_name, text_of(node.value), node.important)
        for node in nodes
        if node.type == "declaration"
    ]


def _selectors(prelude: list[Any]) -> Iterator[list[Any]]:
    """Yield the tokens of each selector of a list, without comments."""
    part: list[Any] = []
    for token in prelude:
        if token == ",":
            yield part
            part = []
        elif token.type != "comment" and (part or token.type != "whitespace"):
            part.append(token)
    yield part
