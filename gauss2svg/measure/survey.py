"""What an untrusted SVG has, by one pass that checks that it is safe to draw, and its size.

References are allowed only within the file and to embedded images. resvg reads local files that an
href names, absolute or relative to the current folder, and a browser would load more than any
renderer here does, so that the score would be of another image.
"""

from __future__ import annotations

import math
import re
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.request import DataHandler, Request

from PIL import Image

from gauss2svg.errors import InputError, brief, quoted
from gauss2svg.svg.syntax.parse import (
    INKSCAPE,
    SVG,
    DoctypeError,
    Observer,
    ParseError,
    Root,
    parse,
)
from gauss2svg.svg.syntax.values import (
    MOST_CSS,
    component_values,
    declarations,
    pixels_of,
    view_box,
    words,
    written,
)

MOST_ELEMENTS = 1_000_000  # resvg's limit
# Renderers hold numbers in 32 bits, of which the transform to pixels needs some of the range.
_LEAST, _MOST = 1e-30, 1e30
_SCALE = "to scale it to the size of the photo"


@dataclass(frozen=True)
class Survey:
    """Contents of an SVG.

    tags      number of elements by name, the commonest first; SVG's own by their local name,
              others as {namespace}name
    layers    groups that Inkscape shows as layers
    root      attributes of the root element
    qualified whether the root is in SVG's namespace, which browsers require
    """

    tags: dict[str, int]
    layers: int
    root: dict[str, str]
    qualified: bool

    @property
    def elements(self) -> int:
        """Number of elements."""
        return sum(self.tags.values())


def survey(text: str, most_elements: int, *observers: Observer) -> tuple[Survey, Root]:
    """Contents and root of an untrusted SVG, by one pass over it of which observers are told too.

    Raises InputError for XML that is malformed or defines entities, for links to anything
    outside of the file, for more than most_elements elements, and where the root is not svg.
    """
    census = _Census(most_elements)
    try:
        root = parse(text, census, References(), *observers, doctype="bare")
    except DoctypeError as error:
        raise InputError(
            "SVG must be a document that cannot expand; got a document type of its own. Try to "
            "re-save it as plain SVG"
        ) from error
    except (ParseError, UnicodeEncodeError) as error:
        raise InputError(
            f"SVG must be well-formed XML; got {brief(error)}. Try to re-save it"
        ) from error
    tags = dict(census.tags.most_common())
    return Survey(tags, census.layers, census.root, census.is_qualified), root


class _Census:
    """Counts elements, and refuses those that are too many or not of an SVG."""

    def __init__(self, most: int) -> None:
        self.tags: Counter[str] = Counter()
        self.layers = 0
        self.root: dict[str, str] = {}
        self.is_qualified = False
        self._most = self._left = most
        self._sheet = math.inf  # depth of the element before, if it is a style sheet

    def start(self, tag: str, attributes: dict[str, str], depth: int) -> None:
        name = tag.removeprefix(SVG)
        local = name.rpartition("}")[2]
        if not depth:
            if name != "svg":
                raise InputError(f"root element must be <svg>; got <{name[:80]}>")
            self.root, self.is_qualified = attributes, tag != name
        self._left -= 1
        if self._left < 0:
            raise InputError(
                f"SVG must be of at most {self._most} elements; got more. Try to raise "
                "--max-elements if you trust the file"
            )
        self.tags[name] += 1
        self.layers += attributes.get(INKSCAPE + "groupmode") == "layer"
        if depth > self._sheet:
            # Renderers disagree on which of its texts are the sheet.
            raise InputError(
                f"a style sheet in the SVG must be of text alone; got <{local[:80]}> in it. Try to "
                "save it as plain SVG"
            )
        self._sheet = depth if local == "style" else math.inf

    def sheet(self, text: str) -> None:
        pass


@dataclass(frozen=True)
class Frame:
    """Size and coordinates of an SVG.

    width, height  px, > 0
    view_box       x, y, width and height of the visible part in user units
    """

    width: float
    height: float
    view_box: tuple[float, float, float, float]


def frame_of(root: Mapping[str, str]) -> Frame:
    """The frame of a root's attributes; a missing size follows from the rest.

    Raises InputError where there is neither a viewBox nor a width and a height in absolute
    units, and for numbers that renderers do not hold: see _LEAST and _MOST.
    """
    styled = {
        one.lower_name: written(one.value)
        for one in declarations(root.get("style", ""))
        if [token.type for token in words(one.value)] in (["number"], ["dimension"])
    }
    width, height = (
        _length(name, styled.get(name) or root.get(name, "")) for name in ("width", "height")
    )
    box = view_box(root["viewBox"]) if root.get("viewBox", "").strip() else None
    if box is None:
        if width is None or height is None:
            raise InputError(
                "SVG must be of a known size, by a viewBox or by a width and a height in "
                'absolute units; got neither. Try to add viewBox="0 0 WIDTH HEIGHT" to its '
                "root"
            )
        return Frame(width, height, (0.0, 0.0, width, height))
    if max(map(abs, box)) > _MOST or min(box[2:]) < _LEAST:
        raise InputError(
            f"viewBox must be of numbers up to {_MOST:g}, and a width and a height of at least "
            f"{_LEAST:g}; got {quoted(root['viewBox'])}. Try {_SCALE}"
        )
    if width is None:
        width = box[2] if height is None else _side("width", height * box[2] / box[3])
        height = box[3] if height is None else height
    elif height is None:
        height = _side("height", width * box[3] / box[2])
    return Frame(width, height, box)


def _length(name: str, text: str) -> float | None:
    """Pixels; None for a relative length."""
    pixels = pixels_of(text)
    return None if pixels is None else _side(name, pixels, text)


def _side(name: str, pixels: float, text: str = "") -> float:
    if not _LEAST <= pixels <= _MOST:
        raise InputError(
            f"{name} of the SVG must be above 0 and in {_LEAST:g}..{_MOST:g} px; got "
            f"{quoted(text) if text else f'{pixels:g}'}. Try {_SCALE}"
        )
    return pixels


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
