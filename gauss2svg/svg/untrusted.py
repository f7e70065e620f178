"""Survey an untrusted SVG, and refuse it if it would load anything from outside of the file.

This is needed because resvg reads the local file to which an href refers. The href may be an
absolute path, or a path relative to the current folder. An embedded image must not be an SVG,
because CairoSVG would draw that SVG, and its references are not checked here. CSS must have no
escapes, because they could hide an address from the search here.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from urllib.request import DataHandler, Request

from PIL import Image

from gauss2svg.errors import InputError, quoted, refusal
from gauss2svg.svg.file import INKSCAPE, SVG, parse

MOST_ELEMENTS = 1_000_000  # the limit that resvg has
# The largest number of pixels in all embedded images together. It is limited because renderers
# decode these images.
MOST_IMAGE_PIXELS = 100_000_000
# The local names of attributes whose value is an address that a renderer, an editor or a browser
# would load.
_LINKS = {"href", "absref", "base", "src", "srcset", "imagesrcset", "srcdoc", "poster"}
_LINKS |= {"data", "background", "archive", "code", "codebase", "classid"}
_FORMATS = ("PNG", "JPEG", "GIF", "WEBP")
_FONT = r"data:(?:font/|application/(?:x-)?font)"
_URL = re.compile(rf"url\((?!\s*+(?:[\"']\s*+)?+(?:#|{_FONT}))\s*+([^)]*)", re.IGNORECASE)
_LOADING = re.compile(
    r"@import|(?<![\w-])(?:-\w+-)?(?:src|image|image-set|cross-fade)\(", re.IGNORECASE
)


class Survey:
    """Counts of the elements and layers of an SVG, and its root.

    elements   number of elements
    tags       number of elements of each name, the most frequent name first. A name that is not in
               the namespace of SVG is written as {namespace}name
    layers     number of groups that Inkscape shows as layers
    root       attributes of the root
    qualified  whether the root is in the namespace of SVG. If not, browsers do not show the file

    Raise InputError if the SVG has more than most_elements elements, or if it refers to anything
    outside of the file.
    """

    def __init__(self, text: str, most_elements: int = MOST_ELEMENTS) -> None:
        self.tags: dict[str, int] = Counter()
        self.elements, self.layers, self.root, self.qualified = 0, 0, dict[str, str](), False
        self._most = most_elements
        self._in_sheet, self._sheet, self._pixels = False, list[str](), 0
        parse(text, self)
        self.tags = dict(Counter(self.tags).most_common())

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Count an element and check its references. Store the attributes if it is the root."""
        name, local = tag.removeprefix(SVG), tag.rpartition("}")[2]
        if not self.tags:
            if name != "svg":
                raise refusal("root element", "<svg>", f"<{name[:80]}>")
            self.root, self.qualified = attributes, tag != name
        self.elements += 1
        if self.elements > self._most:
            advice = "to raise --max-elements if you trust it"
            raise refusal("the SVG", f"of at most {self._most} elements", "more", advice)
        if self._in_sheet:
            # Renderers disagree about the CSS of a <style> that contains elements, so such a file
            # is refused.
            got = f"<{local[:80]}> in it"
            raise refusal("a style sheet", "of text alone", got, "to save it as plain SVG")
        self._in_sheet = local == "style"
        self.tags[name] += 1
        self.layers += attributes.get(INKSCAPE + "groupmode") == "layer"
        for key, value in attributes.items():
            link = key.rpartition("}")[2]
            if link in _LINKS:
                # The href of an <a> is allowed, because it is loaded only if someone clicks on it.
                if (local, link) != ("a", "href"):
                    self._pixels += _pixels_of(value.strip())
                    if self._pixels > MOST_IMAGE_PIXELS:
                        needed, advice = f"at most {MOST_IMAGE_PIXELS} px", "smaller images"
                        raise refusal("images in the SVG", needed, f"{self._pixels} px", advice)
            elif key == "style" or ("(" in value and "}" not in key):
                _check_css(value)

    def end(self, _tag: str) -> None:
        """Check the text of a style sheet when its element ends."""
        if self._in_sheet:
            _check_css("".join(self._sheet))
            self._sheet.clear()
            self._in_sheet = False

    def data(self, text: str) -> None:
        """Collect the text of a style sheet."""
        if self._in_sheet:
            self._sheet.append(text)

    def pi(self, target: str, _text: str) -> None:
        """Raise InputError if a processing instruction loads a style sheet.

        The instruction may be at any place of the file.
        """
        if target == "xml-stylesheet":
            raise _outside("xml-stylesheet")


def _check_css(text: str) -> None:
    """Raise InputError if CSS loads anything, or has escapes, which could hide an address."""
    if "\\" in text:
        raise refusal("CSS", "without escapes", quoted(text), "to save it as plain SVG")
    if match := _URL.search(text) or _LOADING.search(text):
        raise _outside(match[match.lastindex or 0])


def _pixels_of(target: str) -> int:
    """Return the number of pixels of the embedded image that an address contains.

    Return 0 if the address is a reference within the file. Raise InputError for any other address.
    """
    if not target or target.startswith("#"):
        return 0
    if target[:5].lower() != "data:":
        raise _outside(target)
    try:
        with (
            warnings.catch_warnings(action="ignore"),
            DataHandler().data_open(Request(target)) as data,
            # Image.open reads only the header.
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
