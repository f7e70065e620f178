"""References of an SVG: only those within the file and to embedded images are allowed.

resvg reads local files that an href names, absolute or relative to the current folder, and a
browser would load more than any renderer here does, so that the score would be of another image.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from typing import Any
from urllib.request import DataHandler, Request

from PIL import Image

from gauss2svg.errors import InputError, brief, quoted
from gauss2svg.raster.css import component_values

_PICTURES = ("image", "feImage", "img")
_FORMATS = ("PNG", "JPEG", "GIF", "WEBP")
MOST_EMBEDDED_PIXELS = 100_000_000  # of all embedded pictures together
_SPACE = " \t\r\n\f"
# Functions of CSS whose strings are addresses, and what may spell one; after a vendor's prefix.
_LOADING = ("url", "src", "image", "image-set", "cross-fade")
_SUBSTITUTED = ("var", "env", "attr", "if")
_VENDOR = re.compile(r"-[a-z]+-")
_SUSPECT = re.compile(r"\\|@import|(src|image|image-set|cross-fade)\(")


def check_css(text: str) -> int:
    """Number of characters that had to be tokenised to see where CSS refers to.

    text  a style sheet, a style or the value of a property
    Raises InputError if it refers to anything outside the file.
    """
    lowered = text.lower()
    # Without escapes a reference can be spelled in one way only; most are of this kind.
    if not _SUSPECT.search(lowered) and all(map(_begins_within, lowered.split("url(")[1:])):
        return 0
    for target in _targets(text):
        if not target.startswith("#") and not _is_data(target):
            raise _outside(target)
    return len(text)


def _begins_within(target: str) -> bool:
    target = target.lstrip(_SPACE)
    return (target[1:].lstrip(_SPACE) if target[:1] in ("'", '"') else target).startswith("#")


def _targets(text: str) -> Iterator[str]:
    """What CSS refers to, also within strings: CairoSVG looks for addresses there as well."""
    lists = [component_values(text)]
    while lists:
        is_namespace = False  # whose address comes next, and is never loaded
        for token in lists.pop():
            if token.type in ("whitespace", "ident"):
                continue
            skipped, is_namespace = is_namespace, False
            if token.type == "at-keyword":
                is_namespace = token.lower_value == "namespace"
                if token.lower_value == "import":
                    yield "@import of a style sheet"
            elif token.type == "url" and not skipped:
                yield token.value.strip()
            elif token.type == "error" and token.kind == "bad-url":
                yield "a broken url()"
            elif token.type == "string" and "url(" in token.value.lower():
                lists.append(component_values(token.value))
            elif token.type == "function":
                lists.append(token.arguments)
                if _VENDOR.sub("", token.lower_name, count=1) in _LOADING and not skipped:
                    yield from _addresses(token)
            elif token.type.endswith(" block"):
                lists.append(token.content)


def _addresses(function: Any) -> Iterator[str]:
    for token in function.arguments:
        if token.type == "string":
            yield token.value.strip()
        elif token.type == "function" and token.lower_name in _SUBSTITUTED:
            yield f"{function.name}({token.name}())"


def check_link(tag: str, target: str) -> int:
    """Pixels of the picture that a link embeds, 0 for a link within the file.

    tag     local name of the element whose href it is
    target  its value
    Raises InputError for any other link, and for data: that is not a PNG, JPEG, GIF or WebP.
    """
    target = target.strip()
    if not target or target.startswith("#"):
        return 0
    if _is_data(target) and tag in _PICTURES:
        return _pixels(target)
    raise _outside(target)


def check_unread(target: str) -> None:
    """Raise InputError for what browsers may load by an attribute that is not taken apart here."""
    if target.strip():
        raise _outside(target)


def _is_data(target: str) -> bool:
    return target[:5].lower() == "data:"


def _outside(target: str) -> InputError:
    return InputError(
        "a reference in the SVG must be within the file or embedded as data:; got "
        f"{quoted(target)}. Try to embed the image, or to remove the reference"
    )


def _pixels(uri: str) -> int:
    try:
        with (
            warnings.catch_warnings(action="ignore"),  # its size is counted by the caller
            DataHandler().data_open(Request(uri)) as data,
            # Only the header is read. SVG is excluded: a nested one would be drawn unchecked.
            Image.open(data, formats=_FORMATS) as picture,
        ):
            return picture.width * picture.height
    except Image.DecompressionBombError as error:
        raise InputError(
            f"an image in the SVG must be smaller; got {brief(error)}. Try to shrink it before "
            "embedding it"
        ) from error
    except (OSError, ValueError, SyntaxError) as error:
        raise InputError(
            f"data: in the SVG must be an image, one of {', '.join(_FORMATS)}; got {uri[:40]}.."
        ) from error
