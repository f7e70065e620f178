"""Features of SVG that some renderers draw wrongly, found by their words in a file.

Each renderer states its own as CANNOT_DRAW. What our own forms use is known without a search:
gauss2svg.raster names the renderers of each.
"""

from __future__ import annotations

import html
import re
from enum import StrEnum


class Feature(StrEnum):
    """A feature, as an error names it.

    A blur counts as turned where anything in the file is rotated or skewed. Animation is that which
    also runs under prefers-reduced-motion; without it a file is drawn as it is written.
    """

    TURNED_BLUR = "a blur of rotated or skewed shapes"
    BLUR = "a blur"
    LIGHTER = "mix-blend-mode: plus-lighter"
    BLEND = "mix-blend-mode"
    FILTER = "a filter"
    PLAIN_HREF = "href without xlink:"
    MASK = "a mask"
    MOVING = "animation, drawn at some moment of it"


_GAP = r"(?:\s|/\*(?:[^*]|\*(?!/))*+\*/)*+"  # blanks and comments of CSS
# A value that has an effect.
_ON = rf"""{_GAP}[:=]{_GAP}["']?+{_GAP}(?!none|normal|inherit|initial|unset)"""
_TAG = r"<(?:[\w.-]+:)?"
_LINKING = "(?:use|image|pattern|filter|lineargradient|radialgradient)"
# Words without which a file has no such feature, and what finds it, all in lower case.
_SEARCHES = {
    Feature.BLUR: ("blur shadow", r"fegaussianblur|fedropshadow|(?<![\w-])(?:blur|drop-shadow)\("),
    Feature.LIGHTER: ("plus-", rf"mix-blend-mode{_ON}plus-"),
    Feature.BLEND: ("mix-blend-mode", rf"mix-blend-mode{_ON}"),
    Feature.FILTER: ("filter", rf"(?<![\w-])(?:-webkit-)?filter{_ON}"),
    Feature.PLAIN_HREF: ("href", rf"{_TAG}{_LINKING}(?=[^<>]*\shref\s*=)(?![^<>]*:href\s*=)"),
    Feature.MASK: ("mask", rf"{_TAG}mask\b"),
    Feature.MOVING: (
        "animat set discard starting-style",
        rf"{_TAG}(?:animate|set|discard)|@starting-style|(?<![\w-])animation(?:-name)?{_ON}",
    ),
}
# A transform of CSS, or one that does more than move and scale.
_TURNS = re.compile(
    r"""rotate|skew|[;"'{\s]transform\s*:|matrix\s*+\((?!\s*[^\s,()]{1,40}[\s,]+0[\s,]+0[\s,])"""
)
# Texts that nobody draws; a style sheet may be in CDATA, which is kept.
_TEXTS = re.compile(
    rf"(<!\[cdata\[.*?\]\]>)|<!--.*?(?:-->|\Z)|{_TAG}(?:title|desc)\b[^<>]*>[^<]*", re.DOTALL
)
# The style sheet of our animated files, which moves nothing for those who prefer so.
_FOR_MOTION = re.compile(
    r"@media[^{}<>@]{0,200}prefers-reduced-motion\s*:\s*no-preference\s*\)\s*\{"
    r"(?:[^{}<>]*+\{(?:[^{}<>]*+\{[^{}<>]*+\})*+[^{}<>]*+\})*+"
)


def uses(svg: str, feature: Feature) -> bool:
    """Return whether an SVG may use a feature: words in it may have no effect."""
    if feature is Feature.TURNED_BLUR:
        return uses(svg, Feature.BLUR) and _TURNS.search(_drawn(svg)) is not None
    words, pattern = _SEARCHES[feature]
    text = _drawn(svg)
    if not any(word in text for word in words.split()):
        return False
    return re.search(pattern, _FOR_MOTION.sub("", text)) is not None


def _drawn(svg: str) -> str:
    """Return the text of an SVG in lower case, without texts that nobody draws."""
    text = _TEXTS.sub(lambda found: found[1] or "", svg.lower())
    # References of XML could spell a word.
    return re.sub(r"&#x?[\da-f]+;", lambda found: html.unescape(found[0]), text)
