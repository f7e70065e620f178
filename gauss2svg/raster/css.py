"""Style sheets and style attributes as a renderer takes them: no comments, no escapes."""

from __future__ import annotations

import re

_COMMENT = re.compile(r"/\*.*?(?:\*/|\Z)", re.DOTALL)
_ESCAPE = re.compile(r"\\(?:([0-9a-fA-F]{1,6})\s?|(.))", re.DOTALL)


def plain_css(text: str) -> str:
    r"""CSS without comments and with its escapes resolved: f\69ll is fill."""
    if "/*" in text:
        text = _COMMENT.sub(" ", text)
    return _ESCAPE.sub(_resolved, text) if "\\" in text else text


def _resolved(escape: re.Match[str]) -> str:
    if escape[1] is None:
        return escape[2]
    code = int(escape[1], 16)
    return chr(code) if 0 < code < 0x110000 and not 0xD800 <= code < 0xE000 else "\ufffd"


def without_blocks(text: str, beginning: re.Pattern[str]) -> str:
    """CSS without the blocks that begin so, up to the brace that closes each.

    beginning matches up to and with the brace that opens the block.
    """
    kept, at = [], 0
    while found := beginning.search(text, at):
        kept.append(text[at : found.start()])
        at, depth = found.end(), 1
        while depth and at < len(text):
            depth += {"{": 1, "}": -1}.get(text[at], 0)
            at += 1
    return "".join([*kept, text[at:]])
