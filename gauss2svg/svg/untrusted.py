"""Survey an untrusted SVG: refuse what it would load, and count its elements.

A file is refused if it would load anything from outside of the file, because resvg reads the local
file to which an href refers. The href may be an absolute path, or a path relative to the current
folder. An embedded image must not be an SVG, because CairoSVG would draw that SVG, and its
references are not checked here. CSS is searched as it is written and with its escapes replaced,
because an escape could hide an address.

Only attributes that a renderer reads as an address or as CSS are looked at. In SVG these are href,
the xml:base of an address, the absref of Inkscape, and attributes that take url(...). Browsers draw
an SVG as an image here, which loads nothing for the HTML in it.

resvg skips elements that it does not know without a message, so a file that a browser draws exactly
may get a low score. Such elements are listed. gauss2svg.raster.isolated has the messages of resvg
on values and CSS that it cannot read.
"""

from __future__ import annotations

import base64
import io
import re
import warnings
from collections import Counter
from urllib.parse import unquote_to_bytes

from PIL import Image

from gauss2svg.errors import InputError, quoted, refusal
from gauss2svg.svg.file import INKSCAPE, SVG, parse

MOST_ELEMENTS = 1_000_000  # the limit that resvg has
# The largest number of pixels in all embedded images together. It is limited because renderers
# decode these images.
_MOST_IMAGE_PIXELS = 100_000_000
# Matches what CSS loads, apart from references within the file and embedded fonts.
_LOADING = re.compile(
    r"""@import|url\((?!\s*+["']?+\s*+(?:#|data:(?:font/|application/(?:x-)?font)))\s*+([^)]*)""",
    re.ASCII | re.IGNORECASE,
)
# Attributes whose value may have url(...), in CSS or as it is.
_WITH_URL = {"style", "fill", "stroke", "clip-path", "mask", "filter", "background"}
_WITH_URL |= {"marker", "marker-start", "marker-mid", "marker-end"}
# Elements that resvg 0.48 and Chromium 156 draw alike, or not at all, and texts.
_ELEMENTS = re.compile(
    "svg|g|defs|symbol|use|a|switch|view|path|rect|circle|ellipse|line|polyline|polygon|image"
    "|(?:linear|radial)Gradient|stop|clipPath|mask|marker|filter|title|desc|metadata|style"
    "|fe(?:GaussianBlur|Offset|Flood|Blend|Composite|Merge|MergeNode|ColorMatrix|DropShadow"
    "|ComponentTransfer|Func[RGBA])|text|tspan|tref|textPath"
)


class Survey:
    """Counts of the elements and layers of an SVG, and its root.

    elements   number of elements
    tags       number of elements of each name, the most frequent name first. A name that is not in
               the namespace of SVG is written as {namespace}name
    layers     number of groups that Inkscape shows as layers
    root       attributes of the root
    qualified  whether the root is in the namespace of SVG. If not, browsers do not show the file
    unknown    the keys are the names of elements that resvg is not known to draw as browsers do

    Raise InputError if the SVG has more than most_elements elements, or if it refers to anything
    outside of the file.
    """

    def __init__(self, text: str, most_elements: int = MOST_ELEMENTS) -> None:
        self.tags: dict[str, int] = Counter()
        self.elements, self.layers, self.root, self.qualified = 0, 0, dict[str, str](), False
        self.unknown = dict[str, None]()
        self._most, self._pixels = most_elements, 0
        self._in_sheet, self._sheet = False, list[str]()
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
        self.layers += name == "g" and attributes.get(INKSCAPE + "groupmode") == "layer"
        # No renderer draws an element of another namespace, or one that requires an extension, as
        # Illustrator writes them for itself.
        is_drawn = "}" not in name and "requiredExtensions" not in attributes
        if is_drawn and not _ELEMENTS.fullmatch(name):
            self.unknown[name[:40]] = None
        for key, value in attributes.items():
            link = key.rpartition("}")[2]
            if link in ("href", "absref") or key.endswith("}base"):
                # The href of an <a> is allowed, because it is loaded only if someone clicks on it.
                if (local, link) != ("a", "href"):
                    self._add_picture(value)
            elif link in _WITH_URL:
                _check_loading(value)

    def end(self, _tag: str) -> None:
        """Check the text of a style sheet when its element ends."""
        if self._in_sheet:
            _check_loading("".join(self._sheet))
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

    def _add_picture(self, target: str) -> None:
        """Count the pixels of the embedded image that an address contains.

        A reference within the file has none. Raise InputError for any other address. resvg opens a
        file named " #a.png", but ignores blanks before "data:" as browsers do.
        """
        if not target or target.startswith("#"):
            return
        target = target.lstrip(" \t\r\n")
        if target[:5].lower() != "data:":
            raise _outside(target)
        declared, _, content = target[5:].partition(",")
        data = unquote_to_bytes(content)
        formats = "PNG", "JPEG", "GIF", "WEBP"
        try:
            if declared.lower().rstrip().endswith("base64"):
                data = base64.b64decode(b"".join(data.split()) + b"==")
            with (
                warnings.catch_warnings(action="ignore"),
                # Image.open reads only the header.
                Image.open(io.BytesIO(data), formats=formats) as picture,
            ):
                self._pixels += picture.width * picture.height
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
            needed = f"an image, one of {', '.join(formats)}"
            raise refusal("data: in the SVG", needed, quoted(target[:40])) from error
        if self._pixels > _MOST_IMAGE_PIXELS:
            needed, advice = f"at most {_MOST_IMAGE_PIXELS} px", "smaller images"
            raise refusal("images in the SVG", needed, f"{self._pixels} px", advice)


def _check_loading(text: str) -> None:
    """Raise InputError if CSS loads anything, as it is written or with its escapes replaced."""
    if "(" not in text and "@" not in text and "\\" not in text:
        return
    unescaped = re.sub(r"\\(?:([\da-fA-F]{1,6})(?:\r\n|\s)?|\r\n|[\n\r\f])", _character, text)
    for css in {text, unescaped.replace("\\", "")}:
        if match := _LOADING.search(css):
            raise _outside(match[1] or match[0])


def _character(escape: re.Match[str]) -> str:
    """Return the character of an escape of CSS, or "" for an escaped end of a line."""
    code = int(escape[1] or "0", 16)
    return chr(code) if 0 < code < 0x110000 else ""


def _outside(target: str) -> InputError:
    advice = "to embed the image, or to remove the reference"
    needed = "within the file or embedded as data:"
    return refusal("a reference in the SVG", needed, quoted(target.strip()), advice)
