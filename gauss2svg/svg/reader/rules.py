"""Style sheets and animation: refused unless the SVG ends as its elements say.

The sheet of minimal markup has the opacities of stops. It is read as it is written.
"""

from __future__ import annotations

import re
from typing import Any

from gauss2svg.errors import InputError, quoted
from gauss2svg.svg.document import UP_TO_TARGET
from gauss2svg.svg.syntax.css import component_values, nodes_of, written
from gauss2svg.svg.syntax.values import NUMBER

# Characters: write_svg writes a few thousand, and tokenising hostile ones takes up to 5 us each.
_LONGEST_SHEET = 100_000
# After these a shape stays as the animation leaves it, or is never as it is written.
_LASTING = ("forwards", "both", "infinite", "paused")
_STOP_RULE = re.compile(
    rf'\[href="#([A-Za-z]+)"\] (stop(?:\+stop)*+)\{{'
    rf"(stop-color:currentColor;)?stop-opacity:({NUMBER})\}}"
)
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
    for node in nodes_of(text, True, _is_entered):
        if node.type == "declaration":
            check_animation(node.lower_name, node.value, _ADVICE)
        elif not (node.type == "qualified-rule" or _is_entered(node) or _is_keyframes(node)):
            what = f"@{node.at_keyword[:60]}" if node.type == "at-rule" else f"{text[:60]!r}"
            raise InputError(f"the style sheet must be {_NEEDED}; got {what}. Try {_ADVICE}")


def check_animation(name: str, value: str | list[Any], advice: str) -> None:
    """Raise InputError for a property other than animation, and for one that does not end."""
    if not name.removeprefix("-webkit-").startswith("animation"):
        raise InputError(f"the style must be animation only; got {name[:60]}. Try {advice}")
    tokens = component_values(value) if isinstance(value, str) else value
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


def _is_entered(node: Any) -> bool:
    if node.type == "at-rule":
        return node.content is not None and node.lower_at_keyword == "media"
    if node.type != "qualified-rule":
        return False
    rule = f"{written(node.prelude)}{{{written(node.content).rstrip(';')}}}"
    return rule != UP_TO_TARGET  # which hides nothing without a fragment in the address


def _is_keyframes(node: Any) -> bool:
    at_rule = node.type == "at-rule" and node.content is not None
    return at_rule and node.lower_at_keyword.endswith("keyframes")
