"""Style sheets and animation: refused unless the SVG ends as its elements say.

Two sheets of gauss2svg say more than its elements: that of minimal markup has the opacities of
stops, and that of an additive file draws a group as differences. They are read as they are written.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import tinycss2

from gauss2svg.errors import InputError, quoted
from gauss2svg.svg.additive.differences import ADDITIVE, difference_sheet
from gauss2svg.svg.reader.values import NUMBER

# Characters: write_svg writes a few thousand, and tokenising hostile ones takes up to 5 us each.
_LONGEST_SHEET = 100_000
# By write_svg: without a fragment in the address it hides nothing.
_UP_TO_TARGET = "svg>g:target~g"
# After these a shape stays as the animation leaves it, or is never as it is written.
_LASTING = ("forwards", "both", "infinite", "paused")
_STOP_RULE = re.compile(
    rf'\[href="#([A-Za-z]+)"\] (stop(?:\+stop)*+)\{{'
    rf"(stop-color:currentColor;)?stop-opacity:({NUMBER})\}}"
)
_DIFFERENCES = re.compile(rf"#({ADDITIVE}-[0-9a-f]{{8}}) ")
_NEEDED = "animation only, without escapes"
_ADVICE = "to write what it sets into the elements"


def stop_opacities(text: str) -> dict[str, list[str]]:
    """Opacities of stops by the id of what their gradient refers to; none for any other sheet.

    The k-th rule of an id is for the k-th stop and, if it is the last one, for all that follow.
    """
    found: dict[str, list[str]] = {}
    at = 0
    while rule := _STOP_RULE.match(text, at):
        stops = found.setdefault(rule[1], [])
        if rule[2].count("stop") != len(stops) + 1 or bool(rule[3]) == bool(stops):
            return {}
        stops.append(rule[4])
        at = rule.end()
    return found if at == len(text) else {}


def difference_group(text: str) -> str | None:
    """Id of the group that an additive file's sheet draws as differences; None for any other."""
    match = _DIFFERENCES.match(text)
    return match[1] if match and difference_sheet(match[1]) == text else None


def check_sheet(text: str) -> None:
    """Raise InputError for a style sheet with anything but animation that ends as it began.

    The rule of write_svg by which a fragment of the address hides later rounds is skipped.
    """
    if len(text) > _LONGEST_SHEET:
        raise InputError(
            f"the style sheet must be of at most {_LONGEST_SHEET} characters; got {len(text)}. "
            f"Try {_ADVICE}"
        )
    if "\\" in text:
        raise InputError(f"the style sheet must be {_NEEDED}; got an escape. Try {_ADVICE}")
    nodes = _parsed(tinycss2.parse_stylesheet, text)
    while nodes:
        node = nodes.pop()
        if node.type == "at-rule" and node.content is not None:
            keyword = node.lower_at_keyword
            if keyword.endswith("keyframes"):
                continue
            if keyword == "media":
                nodes += tinycss2.parse_blocks_contents(node.content, True, True)
                continue
        if node.type == "declaration":
            check_animation(node.lower_name, node.value, _ADVICE)
        elif node.type == "qualified-rule":
            inside = tinycss2.parse_blocks_contents(node.content or [], True, True)
            if not _is_up_to_target(node.prelude, inside):
                nodes += inside
        else:
            what = f"@{node.at_keyword[:60]}" if node.type == "at-rule" else f"{text[:60]!r}"
            raise InputError(f"the style sheet must be {_NEEDED}; got {what}. Try {_ADVICE}")


def check_animation(name: str, value: str | list[Any], advice: str) -> None:
    """Raise InputError for a property other than animation, and for one that does not end."""
    if not name.removeprefix("-webkit-").startswith("animation"):
        raise InputError(f"the style must be animation only; got {name[:60]}. Try {advice}")
    tokens = (
        _parsed(tinycss2.parse_component_value_list, value) if isinstance(value, str) else value
    )
    for token in tokens:
        if token.type == "ident" and token.lower_value in _LASTING:
            raise InputError(
                f"{name[:60]} must be one that ends as it began; got {quoted(token.value)}. Try "
                "to remove it"
            )


def check_smil(tag: str, attributes: Any) -> None:
    """Raise InputError for an element that sets or animates something for good."""
    if tag in ("set", "discard"):
        raise InputError(
            "animation must end as it began; got an element that changes what is drawn. Try to "
            "write that into the elements, and to delete it"
        )
    for name in ("fill", "repeatCount", "repeatDur", "dur"):
        if attributes.get(name) in ("freeze", "indefinite"):
            raise InputError(
                f"{name} must be such that animation ends as it began; got "
                f"{quoted(attributes[name])}. Try to delete the element"
            )


def _parsed(parse: Callable[..., list[Any]], text: str) -> list[Any]:
    try:
        tokens = parse(text, skip_comments=True)
    except ValueError:  # int() of thousands of digits
        raise InputError(
            f"the style must be of shorter numbers; got thousands of digits. Try {_ADVICE}"
        ) from None
    return [token for token in tokens if token.type != "whitespace"]


def _is_up_to_target(prelude: list[Any], inside: list[Any]) -> bool:
    selector = "".join(str(getattr(t, "value", "")) for t in prelude if t.type != "whitespace")
    if selector != _UP_TO_TARGET or len(inside) != 1 or inside[0].type != "declaration":
        return False
    words = [token for token in inside[0].value if token.type != "whitespace"]
    return inside[0].lower_name == "display" and [
        getattr(word, "lower_value", "") for word in words
    ] == ["none"]
