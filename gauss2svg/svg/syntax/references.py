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
from gauss2svg.svg.syntax.css import MOST_CSS, component_values
from gauss2svg.svg.syntax.parse import SVG

_LINKS = ("href", "absref")  # the latter of sodipodi, by which Inkscape finds local files
_BASE = "{http://www.w3.org/XML/1998/namespace}base"  # CairoSVG adds links, even empty ones, to it
# By which browsers load into elements of HTML, whichever part of an SVG they are in.
_FOREIGN_LINKS = ("src", "data", "poster", "background")
_FOREIGN_LISTS = ("srcset", "imagesrcset", "srcdoc", "archive", "code", "codebase", "classid")
_FORMATS = ("PNG", "JPEG", "GIF", "WEBP")
_MOST_EMBEDDED_PIXELS = 100_000_000  # of all embedded pictures together
_SPACE = " \t\r\n\f"
# Functions of CSS whose strings are addresses, and what may spell one; after a vendor's prefix.
_LOADING = ("url", "src", "image", "image-set", "cross-fade")
_SUBSTITUTED = ("var", "env", "attr", "if")
_VENDOR = re.compile(r"-[a-z]+-")
_SUSPECT = re.compile(r"\\|@import|(src|image|image-set|cross-fade)\(")


class References:
    """Refuses a document that refers to anything outside of it, by an InputError."""

    def __init__(self) -> None:
        self._pixels = self._tokenized = 0

    def start(self, tag: str, attributes: dict[str, str], _depth: int) -> None:
        """Check the links of an element, and the CSS in its attributes."""
        local = tag.rpartition("}")[2]
        is_foreign = local != tag.removeprefix(SVG)
        for key, value in attributes.items():
            if key.rpartition("}")[2] in _LINKS or (is_foreign and key in _FOREIGN_LINKS):
                self._follow(local, value.strip())
            elif key == _BASE or (is_foreign and key in _FOREIGN_LISTS):
                if value.strip():  # a browser may load it; it is not taken apart here
                    raise _outside(value)
            elif "(" in value:
                self.sheet(value)

    def sheet(self, text: str) -> None:
        """Check where CSS refers to: a style sheet, a style or the value of a property."""
        lowered = text.lower()
        # Without escapes a reference can be spelled in one way only; most are of this kind.
        if not _SUSPECT.search(lowered) and all(map(_begins_within, lowered.split("url(")[1:])):
            return
        for target in _targets(text):
            if not target.startswith("#") and not _is_data(target):
                raise _outside(target)
        self._tokenized += len(text)
        if self._tokenized > MOST_CSS:
            raise InputError(
                f"CSS in the SVG must be at most {MOST_CSS} characters where it has escapes, "
                f"imports or addresses; got {self._tokenized}. Try to save it as plain SVG"
            )

    def _follow(self, tag: str, target: str) -> None:
        """Add the pixels of the picture that a link of an element embeds."""
        if tag == "a" or not target or target.startswith("#"):
            return  # an <a> is only loaded on a click
        if not _is_data(target) or tag not in ("image", "feImage", "img"):
            raise _outside(target)
        self._pixels += _pixels(target)
        if self._pixels > _MOST_EMBEDDED_PIXELS:
            raise InputError(
                f"images in the SVG must be of at most {_MOST_EMBEDDED_PIXELS} px together; got "
                f"{self._pixels}. Try to shrink them before embedding them"
            )


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
