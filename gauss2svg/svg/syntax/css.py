"""CSS by tinycss2: nodes of style sheets and style attributes, and tokens of any CSS."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

import tinycss2

from gauss2svg.errors import InputError, quoted

# Tokenising takes 1 to 5 microseconds a character: without a limit a hostile file takes minutes.
MOST_CSS = 4_000_000
_COMMENT = re.compile(r"/\*.*?(?:\*/|\Z)", re.DOTALL)


def nodes_of(text: str, is_sheet: bool, is_entered: Callable[[Any], bool]) -> Iterator[Any]:
    """Nodes of a style sheet or a style attribute, and those in the blocks that are entered.

    Raises InputError for more than MOST_CSS characters and for a number of more digits than Python
    reads.
    """
    parse = tinycss2.parse_stylesheet if is_sheet else tinycss2.parse_blocks_contents
    open_nodes = _parsed(parse, text, skip_whitespace=True)
    while open_nodes:
        node = open_nodes.pop()
        yield node
        if getattr(node, "content", None) and is_entered(node):
            open_nodes += tinycss2.parse_blocks_contents(node.content, True, True)


def declarations(style: str) -> list[Any]:
    """The declarations of a style attribute, in order; raises InputError as nodes_of."""
    parsed = _parsed(tinycss2.parse_blocks_contents, style)
    return [node for node in parsed if node.type == "declaration"]


def properties(style: str) -> dict[str, str]:
    """Properties of a style attribute by their names in lower case; a later one wins.

    They are split by hand: tinycss2 would take 0.1 s for 1000 shapes that an editor styled.

    Raises InputError for escapes in names and for what is !important.
    """
    if "/*" in style:
        style = _COMMENT.sub(" ", style)
    found: dict[str, str] = {}
    for name, colon, value in (part.partition(":") for part in style.split(";")):
        if "\\" in name or "!" in value:
            raise InputError(
                "its style must be without escapes and !important; got "
                f"{quoted((name + colon + value).strip())}"
            )
        if colon:
            found[name.strip().lower()] = value.strip()
    return found


def component_values(text: str) -> list[Any]:
    """The tokens of any CSS, blocks and functions as trees; raises InputError as nodes_of."""
    return _parsed(tinycss2.parse_component_value_list, text)


def words(tokens: list[Any]) -> list[Any]:
    """Tokens without white space."""
    return [token for token in tokens if token.type != "whitespace"]


def written(tokens: list[Any]) -> str:
    """Tokens as text, without white space; () for blocks in blocks, as tinycss2 would recurse."""
    return "".join(
        "()" if any(map(_inside, _inside(token))) else token.serialize() for token in words(tokens)
    )


def _inside(token: Any) -> list[Any]:
    return getattr(token, "content", None) or getattr(token, "arguments", None) or []


def _parsed(parse: Callable[..., Any], text: str, **options: bool) -> Any:
    if len(text) > MOST_CSS:
        raise InputError(
            f"CSS in the SVG must be at most {MOST_CSS} characters a style sheet; got {len(text)}. "
            "Try to save it as plain SVG"
        )
    try:
        return parse(text, skip_comments=True, **options)
    except ValueError as error:  # int() of thousands of digits
        raise InputError(f"CSS in the SVG must have shorter numbers; got {error}") from error
