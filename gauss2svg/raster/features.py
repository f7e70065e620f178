"""Features of SVG that some renderers draw wrongly; each renderer states its own as CANNOT_DRAW."""

from enum import StrEnum


class Feature(StrEnum):
    """A feature, as an error names it.

    A blurred element counts as skewed where it is rotated or skewed and not uniformly scaled, so
    that circles become ellipses, and as rotated where it is turned other than by right angles.
    Animation is that which also runs under prefers-reduced-motion; without it a file is drawn as it
    is written.
    """

    SKEWED_BLUR = "a blur of rotated or skewed shapes"
    ROTATED_BLUR = "a blur of rotated shapes"
    BLUR = "a blur"
    LIGHTER = "mix-blend-mode: plus-lighter"
    BLEND = "mix-blend-mode"
    FILTER = "a filter"
    PLAIN_HREF = "href without xlink:"
    MASK = "a mask"
    MOVING = "animation, drawn at some moment of it"
