"""Style sheets and animation that leave a file as its elements say, told from those that do not."""

from __future__ import annotations

import re
from typing import Any

from gauss2svg.errors import InputError

# Every pattern gives up at the first character that does not fit, and none begins anew within
# what another beginning has passed: the time is linear in the length, however hostile.
_KEYFRAMES = re.compile(
    r"@(?:-\w++-)?keyframes[^{}@]*+\{(?:[^{}@]*+\{[^{}]*+\})*+[^{}@]*+\}", re.IGNORECASE
)
_COMMENT = re.compile(r"/\*.*?(?:\*/|\Z)|<!--|-->", re.DOTALL)
_RULE = re.compile(r"(?:\A|(?<=[{}@]))[^{}@]*+\{([^{}]*+)\}")
# By write_svg: it hides nothing where the address has no fragment. A list of selectors that ends
# with this one would, so nothing may be before it but another rule.
_UP_TO_TARGET = re.compile(
    r"(?:\A|(?<=\}))\s*+svg\s*+>\s*+g:target\s*+~\s*+g\s*+\{\s*+display\s*+:\s*+none\s*+;?\s*+\}"
)
_MEDIA = re.compile(r"@media\b[^{}@]*+\{\s*+\}", re.IGNORECASE)
_ANIMATION = re.compile(r"(?:-webkit-)?animation(?:-[a-z-]+)?")
# After these a shape stays as the animation leaves it, or is never as it is written.
_LASTING = re.compile(r"\b(?:forwards|both|infinite|paused)\b", re.IGNORECASE)
_ADVICE = "needed are style sheets that animate only: write that into the elements"


def check_sheet(text: str) -> None:
    """Raise InputError for a style sheet with anything but animation that ends as it began.

    The rule of write_svg by which a fragment of the address hides later rounds is skipped.
    """
    text = _UP_TO_TARGET.sub("", _KEYFRAMES.sub("", _COMMENT.sub(" ", text)))
    if "\\" in text:
        raise InputError(f"it has an escape (\\); {_ADVICE}")
    for rule in _RULE.findall(text):
        for declaration in rule.split(";"):
            name, _, value = declaration.partition(":")
            if name.strip():
                check_animation(name.strip().lower(), value, _ADVICE)
    rest = _MEDIA.sub("", _RULE.sub("", text)).strip()
    if rest:
        raise InputError(f"it has {' '.join(rest.split())[:60]!r}; {_ADVICE}")


def check_animation(name: str, value: str, advice: str) -> None:
    """Raise InputError for a property that is none of animations, or one that does not end."""
    if not _ANIMATION.fullmatch(name):
        raise InputError(f"it sets {name[:60]}; {advice}")
    if lasting := _LASTING.search(value):
        raise InputError(
            f"its {name[:60]} is {lasting[0]}; needed is one that ends as it began: remove it"
        )


def check_smil(tag: str, attributes: Any) -> None:
    """Raise InputError for an element that sets or animates something for good."""
    if tag in ("set", "discard"):
        raise InputError("it changes what is drawn; write that into the elements, and delete it")
    for name in ("fill", "repeatCount", "repeatDur", "dur"):
        if attributes.get(name) in ("freeze", "indefinite"):
            raise InputError(
                f"its {name} is {attributes[name]}; needed is animation that ends as it began: "
                "delete it"
            )
