"""Survey an untrusted SVG, and refuse it if it would load anything from outside the file.

resvg reads local files that an href names, absolute or relative to the current folder. CairoSVG
draws an SVG that is embedded as an image. Escapes in CSS could hide an address from a search.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from urllib.request import DataHandler, Request

from PIL import Image

from gauss2svg.errors import InputError, quoted, refusal
from gauss2svg.svg.file import INKSCAPE, SVG, parse

MOST_ELEMENTS = 1_000_000  # resvg's limit of elements
MOST_IMAGE_PIXELS = 100_000_000  # limit of pixels in all embedded images, which renderers decode
# Local names of attributes whose address a renderer, an editor or a browser loads.
_LINKS = {"href", "absref", "base", "src", "srcset", "imagesrcset", "srcdoc", "poster"}
_LINKS |= {"data", "background", "archive", "code", "codebase", "classid"}
_FORMATS = ("PNG", "JPEG", "GIF", "WEBP")
_FONT = r"data:(?:font/|application/(?:x-)?font)"
_URL = re.compile(rf"url\((?!\s*+(?:[\"']\s*+)?+(?:#|{_FONT}))\s*+([^)]*)", re.IGNORECASE)
_LOADING = re.compile(
    r"@import|(?<![\w-])(?:-\w+-)?(?:src|image|image-set|cross-fade)\(", re.IGNORECASE
)


class Survey:
    """Counts of an SVG's elements and layers, and its root.

    elements   number of elements
    tags       number of elements by name, commonest first. Names outside of SVG's namespace are
               written {namespace}name
    layers     number of groups that Inkscape shows as layers
    root       attributes of the root
    qualified  whether the root is in SVG's namespace, which browsers require

    Raise InputError if the SVG has more than most_elements elements, or refers to anything outside
    the file.
    """

    def __init__(self, text: str, most_elements: int = MOST_ELEMENTS) -> None:
        self.tags: dict[str, int] = Counter()
        self.elements, self.layers, self.root, self.qualified = 0, 0, dict[str, str](), False
        self._most = most_elements
        self._in_sheet, self._sheet, self._pixels = False, list[str](), 0
        parse(text, self)
        self.tags = dict(Counter(self.tags).most_common())

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Count an element, and check its references. Keep the attributes of the root."""
        name, local = tag.removeprefix(SVG), tag.rpartition("}")[2]
        if not self.tags:
            if name != "svg":
                raise refusal("root element", "<svg>", f"<{name[:80]}>")
            self.root, self.qualified = attributes, tag != name
        self.elements += 1
        if self.elements > self._most:
            advice = "to raise --max-elements if you trust it"
            raise refusal("the SVG", f"of at most {self._most} elements", "more", advice)
        if self._in_sheet:  # renderers disagree on the CSS of a <style> that has elements
            got = f"<{local[:80]}> in it"
            raise refusal("a style sheet", "of text alone", got, "to save it as plain SVG")
        self._in_sheet = local == "style"
        self.tags[name] += 1
        self.layers += attributes.get(INKSCAPE + "groupmode") == "layer"
        for key, value in attributes.items():
            link = key.rpartition("}")[2]
            if link in _LINKS:
                if (local, link) != ("a", "href"):  # browsers load a link only on a click
                    self._pixels += _pixels_of(value.strip())
                    if self._pixels > MOST_IMAGE_PIXELS:
                        needed, advice = f"at most {MOST_IMAGE_PIXELS} px", "smaller images"
                        raise refusal("images in the SVG", needed, f"{self._pixels} px", advice)
            elif key == "style" or ("(" in value and "}" not in key):
                _check_css(value)

    def end(self, _tag: str) -> None:
        """Check a style sheet at its end."""
        if self._in_sheet:
            _check_css("".join(self._sheet))
            self._sheet.clear()
            self._in_sheet = False

    def data(self, text: str) -> None:
        """Keep the text of a style sheet."""
        if self._in_sheet:
            self._sheet.append(text)

    def pi(self, target: str, _text: str) -> None:
        """Raise InputError for a processing instruction, at any place, that loads a style sheet."""
        if target == "xml-stylesheet":
            raise _outside("xml-stylesheet")


def _check_css(text: str) -> None:
    """Raise InputError for CSS that loads anything, or has escapes, which could hide an address."""
    if "\\" in text:
        raise refusal("CSS", "without escapes", quoted(text), "to save it as plain SVG")
    if match := _URL.search(text) or _LOADING.search(text):
        raise _outside(match[match.lastindex or 0])


def _pixels_of(target: str) -> int:
    """Return the number of pixels of an embedded image, or 0 for a reference within the file.

    Raise InputError for any other address.
    """
    if not target or target.startswith("#"):
        return 0
    if target[:5].lower() != "data:":
        raise _outside(target)
    try:
        with (
            warnings.catch_warnings(action="ignore"),
            DataHandler().data_open(Request(target)) as data,
            # Only the header is read.
            Image.open(data, formats=_FORMATS) as picture,
        ):
            return picture.width * picture.height
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        needed = f"an image, one of {', '.join(_FORMATS)}"
        raise refusal("data: in the SVG", needed, quoted(target[:40])) from error


def _outside(target: str) -> InputError:
    advice = "to embed the image, or to remove the reference"
    needed = "within the file or embedded as data:"
    return refusal("a reference in the SVG", needed, quoted(target.strip()), advice)
