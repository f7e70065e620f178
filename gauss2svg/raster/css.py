"""CSS by tinycss2: declarations of style sheets and style attributes, and tokens of any CSS."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import tinycss2

from gauss2svg.errors import InputError

# Tokenising takes 1 to 5 microseconds a character: without a limit a hostile file takes minutes.
MOST_CSS = 4_000_000
_REDUCED_MOTION = ["prefers-reduced-motion", ":", "no-preference"]


def declarations(style: str) -> list[Any]:
    """The declarations of a style attribute, in order.

    Raises InputError as `statements` does.
    """
    parsed = _parsed(tinycss2.parse_blocks_contents, style)
    return [node for node in parsed if node.type == "declaration"]


def statements(text: str, is_sheet: bool) -> Iterator[Any]:
    """Declarations and at-rules of a style sheet or a style attribute, at any depth.

    What applies only where the viewer accepts motion is left out: renderers are started with
    reduced motion. Raises InputError for more than MOST_CSS characters and for a number of more
    digits than Python reads.
    """
    parse = tinycss2.parse_stylesheet if is_sheet else tinycss2.parse_blocks_contents
    open_nodes = _parsed(parse, text)
    while open_nodes:
        node = open_nodes.pop()
        if node.type in ("declaration", "at-rule"):
            yield node
        if getattr(node, "content", None) and not _needs_motion(node):
            open_nodes += tinycss2.parse_blocks_contents(node.content, True, True)


def component_values(text: str) -> list[Any]:
    """The tokens of any CSS text, blocks and functions as trees.

    Raises InputError as `statements` does.
    """
    return _parsed(tinycss2.parse_component_value_list, text)


def first_word(value: list[Any]) -> str:
    """The first word of a value; "" for what is not a word, "none" for an empty value."""
    for token in value:
        if token.type != "whitespace":
            return token.lower_value if token.type == "ident" else ""
    return "none"


def _parsed(parse: Callable[..., list[Any]], text: str) -> list[Any]:
    if len(text) > MOST_CSS:
        raise InputError(
            f"CSS in the SVG must be at most {MOST_CSS} characters a style sheet; got {len(text)}. "
            "Try to save it as plain SVG"
        )
    try:
        return parse(text, skip_comments=True)
    except ValueError as error:  # int() of thousands of digits
        raise InputError(f"CSS in the SVG must have shorter numbers; got {error}") from error


def _needs_motion(node: Any) -> bool:
    """Whether a node is @media (prefers-reduced-motion: no-preference) { .. }."""
    if node.type != "at-rule" or node.lower_at_keyword != "media":
        return False
    query = [token for token in node.prelude if token.type != "whitespace"]
    if len(query) != 1 or query[0].type != "() block":
        return False
    words = (getattr(w, "lower_value", getattr(w, "value", None)) for w in query[0].content)
    return [word for word in words if word != " "] == _REDUCED_MOTION
