"""Features of SVG that some renderers draw wrongly, found in a file by their words.

Each renderer lists those that it draws wrongly in CANNOT_DRAW. The features of the project's own
files are known without a search, and gauss2svg.raster lists the renderers that draw them.
"""

from __future__ import annotations

import html
import re
from enum import StrEnum


class Feature(StrEnum):
    """A feature, with its name in errors.

    A blur counts as turned if anything in the file is rotated or skewed. Animation counts if it
    runs under prefers-reduced-motion too. Otherwise a renderer draws the file as it is written.
    """

    TURNED_BLUR = "a blur of rotated or skewed shapes"
    BLUR = "a blur"
    LIGHTER = "mix-blend-mode: plus-lighter"
    BLEND = "mix-blend-mode"
    FILTER = "a filter"
    PLAIN_HREF = "href without xlink:"
    MASK = "a mask"
    MOVING = "animation, drawn at some moment of it"


_GAP = r"(?:\s|/\*(?:[^*]|\*(?!/))*+\*/)*+"  # white space and comments of CSS
# The start of a value that switches a feature on.
_ON = rf"""{_GAP}[:=]{_GAP}["']?+{_GAP}(?!none|normal|inherit|initial|unset)"""
_TAG = r"<(?:[\w.-]+:)?"
_LINKING = "(?:use|image|pattern|filter|lineargradient|radialgradient)"
# Words of which a file with the feature has at least one, and a pattern for it, in lower case.
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
# A transform of CSS, or a transform that does more than move and scale.
_TURNS = re.compile(
    r"""rotate|skew|[;"'{\s]transform\s*:|matrix\s*+\((?!\s*[^\s,()]{1,40}[\s,]+0[\s,]+0[\s,])"""
)
# Comments, titles and descriptions, which are not drawn. Group 1 is CDATA, which is kept because it
# may be a style sheet.
_TEXTS = re.compile(
    rf"(<!\[cdata\[.*?\]\]>)|<!--.*?(?:-->|\Z)|{_TAG}(?:title|desc)\b[^<>]*>[^<]*", re.DOTALL
)
# The style sheet of the project's animated files, which does nothing under prefers-reduced-motion.
_FOR_MOTION = re.compile(
    r"@media[^{}<>@]{0,200}prefers-reduced-motion\s*:\s*no-preference\s*\)\s*\{"
    r"(?:[^{}<>]*+\{(?:[^{}<>]*+\{[^{}<>]*+\})*+[^{}<>]*+\})*+"
)


def uses(svg: str, feature: Feature) -> bool:
    """Return whether an SVG may use a feature. The words that are found may have no effect."""
    if feature is Feature.TURNED_BLUR:
        return uses(svg, Feature.BLUR) and _TURNS.search(_drawn(svg)) is not None
    words, pattern = _SEARCHES[feature]
    text = _drawn(svg)
    if not any(word in text for word in words.split()):
        return False
    return re.search(pattern, _FOR_MOTION.sub("", text)) is not None


def _drawn(svg: str) -> str:
    """Return the text of an SVG in lower case, without comments, titles and descriptions."""
    text = _TEXTS.sub(lambda match: match[1] or "", svg.lower())
    # A word could be spelt by character references of XML.
    return re.sub(r"&#x?[\da-f]+;", lambda match: html.unescape(match[0]), text)
