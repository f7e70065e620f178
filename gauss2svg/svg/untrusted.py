"""Survey an untrusted SVG, and refuse it if it would load anything from outside of the file.

This is needed because resvg reads the local file to which an href refers. The href may be an
absolute path, or a path relative to the current folder. An embedded image must not be an SVG,
because CairoSVG would draw that SVG, and its references are not checked here. CSS is searched as it
is written and with its escapes replaced, because an escape could hide an address.

Only attributes that a renderer reads as an address or as CSS are looked at. In SVG these are href,
the xml:base of an address, the absref of Inkscape, and attributes that take url(...).

The survey also remarks what resvg is not known to draw as browsers do. resvg ignores what it does
not know, so a file that a browser draws exactly may get a low score.
"""

from __future__ import annotations

import base64
import io
import re
import warnings
from collections import Counter
from contextlib import suppress
from functools import lru_cache
from itertools import chain
from typing import Any
from urllib.parse import unquote_to_bytes

from PIL import Image
from PIL.ExifTags import Base

from gauss2svg.errors import InputError, quoted, refusal
from gauss2svg.svg.drawable import (
    FONT_SIZE,
    IDENT,
    KINDS,
    MARKERS,
    NUMBER,
    ROOT,
    TEXTS,
    XLINK,
    Css,
    Declaration,
    css_of,
    has_effect,
    matcher,
    rules_of,
    text_of,
)
from gauss2svg.svg.file import INKSCAPE, SVG, parse

MOST_ELEMENTS = 1_000_000  # the limit that resvg has
# The largest number of pixels in all embedded images together. It is limited because renderers
# decode these images.
MOST_IMAGE_PIXELS = 100_000_000
# The local names of attributes with an address that a renderer or an editor loads.
_LINKS = {"href", "absref"}
_XML_BASE = "{http://www.w3.org/XML/1998/namespace}base"
# Such attributes of elements of web pages, which browsers draw in a <foreignObject>.
_PAGE_LINKS = {"src", "srcset", "imagesrcset", "srcdoc", "poster", "base"} | _LINKS
_PAGE_LINKS |= {"data", "background", "archive", "code", "codebase", "classid"}
# The attributes that may contain url(...), those of animations included.
_WITH_URLS = {"style", "fill", "stroke", "filter", "mask", "clip-path", "cursor", "color-profile"}
_WITH_URLS |= {"marker", "marker-start", "marker-mid", "marker-end", "to", "from", "by", "values"}
_FORMATS = ("PNG", "JPEG", "GIF", "WEBP")
_FONT = r"data:(?:font/|application/(?:x-)?font)"
_URL = re.compile(rf"url\((?!\s*+(?:[\"']\s*+)?+(?:#|{_FONT}))\s*+([^)]*)", re.A | re.I)
_ESCAPE = re.compile(r"\\(?:([\da-fA-F]{1,6})(?:\r\n|\s)?|(\r\n|[\n\r\f])|(.))", re.DOTALL)
# Functions of plain words load nothing, such as image(1) in the id of a clip path.
_LOADING = re.compile(
    r"@import|(?<![\w-])(?:-\w+-)?(?:src|image|image-set|cross-fade)\((?![\w\s.-]*+\))",
    re.IGNORECASE,
)
# The address of a namespace is not loaded.
_NAMESPACE = re.compile(
    r"""(?<![\w\\-])@namespace\s++(?:[\w-]++\s++)?url\(["']?[^\s"'()*;{}\\]*+["']?\)""", re.ASCII
)
# Elements that resvg draws otherwise than Chromium, or not at all.
_OTHERWISE = {"feMorphology", "feDisplacementMap", "feDiffuseLighting", "feSpecularLighting"}
_OTHERWISE |= {"feConvolveMatrix", "feImage", "feTile"}
_ATTRIBUTE = rf"""\[[\w-]++(?:[~|]?=(?:"[^"\\]*+"|'[^'\\]*+'|{IDENT}))?\]"""
_COMPOUND = rf"(?:\*|{IDENT})?+(?:[.#]{IDENT}|:first-child|{_ATTRIBUTE})*+"
# Selectors that resvg applies as browsers do.
_SELECTOR = re.compile(rf"{_COMPOUND}(?:(?:\s*+[>+]\s*+|\s++){_COMPOUND})*+", re.ASCII)
# Selectors that match nothing in a still picture.
_UNMET = re.compile(
    r"::|:(?:hover|active|focus(?:-visible|-within)?|visited|target)\b"
    r"|(?<![\w.#-])use(?:\s*>|\s+(?![>+~]))"  # <use> has no children
)
_TURNS = re.compile(r"rotate|skew|matrix\s*\((?!\s*[^\s,()]{1,40}[\s,]+0[\s,]+0[\s,])")
_ID = re.compile(r"""url\(\s*(?:#([^"'()]*)|"#([^"]*)"|'#([^']*)')""")
# The elements to which a property or a link refers. resvg takes others for missing, or the last
# of several elements of one id.
_PAINTS = frozenset(["linearGradient", "radialGradient", "pattern"])
_REFERENCES = {
    **dict.fromkeys(["fill", "stroke"], _PAINTS),
    "clip-path": frozenset(["clipPath"]),
    "mask": frozenset(["mask"]),
    "filter": frozenset(["filter"]),
}
# Elements with a note of their own, whose attributes have other meanings.
_ANIMATIONS = {"animate", "animateTransform", "animateMotion", "animateColor", "set"}


class Survey:
    """Counts of the elements and layers of an SVG, and its root.

    elements   number of elements
    tags       number of elements of each name, the most frequent name first. A name that is not in
               the namespace of SVG is written as {namespace}name
    layers     number of groups that Inkscape shows as layers
    root       attributes of the root
    qualified  whether the root is in the namespace of SVG. If not, browsers do not show the file
    is_animated  whether CSS animates elements
    remarks    what resvg is not known to draw as browsers do, such as "fill: oklch(...) on <rect>"

    Raise InputError if the SVG has more than most_elements elements, or if it refers to anything
    outside of the file.
    """

    def __init__(self, text: str, most_elements: int = MOST_ELEMENTS) -> None:
        self.tags: dict[str, int] = Counter()
        self.elements, self.layers, self.root, self.qualified = 0, 0, dict[str, str](), False
        self._most = most_elements
        self._in_sheet, self._sheet, self._pixels = False, list[str](), 0
        self._sheet_attributes: dict[str, str] = {}
        self._drawable = Drawable(text)
        parse(text, self)
        self.remarks = self._drawable.remarks()
        self.is_animated = self._drawable.is_animated
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
        self._drawable.start(tag, attributes)
        if self._in_sheet:
            self._sheet_attributes = attributes
        links = _PAGE_LINKS if "}" in name else _LINKS
        for key, value in attributes.items():
            link = key.rpartition("}")[2]
            if link in links or key == _XML_BASE:
                # The href of an <a> is allowed, because it is loaded only if someone clicks on it.
                if (local, link) != ("a", "href"):
                    self._add_picture(value)
            elif link in _WITH_URLS and ("(" in value or "\\" in value or link == "style"):
                _check_loading(value)

    def end(self, _tag: str) -> None:
        """Check the text of a style sheet when its element ends."""
        if self._in_sheet:
            sheet = "".join(self._sheet)
            _check_loading(sheet)
            self._drawable.sheet(sheet, self._sheet_attributes)
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
        try:
            if declared.lower().rstrip().endswith("base64"):
                data = base64.b64decode(b"".join(data.split()) + b"==")
            with (
                warnings.catch_warnings(action="ignore"),
                # Image.open reads only the header.
                Image.open(io.BytesIO(data), formats=_FORMATS) as picture,
            ):
                self._pixels += picture.width * picture.height
                remark = picture_remark(picture, data, declared)
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
            needed = f"an image, one of {', '.join(_FORMATS)}"
            raise refusal("data: in the SVG", needed, quoted(target[:40])) from error
        if remark:
            self._drawable.add(remark)
        if self._pixels > MOST_IMAGE_PIXELS:
            needed, advice = f"at most {MOST_IMAGE_PIXELS} px", "smaller images"
            raise refusal("images in the SVG", needed, f"{self._pixels} px", advice)


def _check_loading(text: str) -> None:
    """Raise InputError if CSS loads anything, as it is written or with its escapes replaced."""
    for css in {text, _ESCAPE.sub(_character, text) if "\\" in text else text}:
        kept = _NAMESPACE.sub("", css)
        if match := _URL.search(kept) or _LOADING.search(kept):
            raise _outside(match[match.lastindex or 0])


def _character(match: re.Match[str]) -> str:
    """Return the character that an escape of CSS stands for."""
    code = int(match[1] or "0", 16)
    return chr(code) if 0 < code < 0x110000 else match[3] or ""


def _outside(target: str) -> InputError:
    advice = "to embed the image, or to remove the reference"
    needed = "within the file or embedded as data:"
    return refusal("a reference in the SVG", needed, quoted(target.strip()), advice)


class Drawable:
    """Remarks on what resvg is not known to draw as browsers do.

    A parser of the text calls `start` for each element and `sheet` for each style sheet. After the
    end of the file, `remarks` returns the remarks.
    """

    def __init__(self, text: str) -> None:
        self._found: dict[str, None] = {}
        # The names of elements are kept only if they may be needed.
        self._has_sheets = "<style" in text or ":style" in text
        self._has_important = "important" in text
        self._is_first, self._is_qualified = True, True
        # For each name of an element, .class and #id: the kinds of element that have it.
        self._kinds: dict[str, frozenset[str]] = {}
        self._all, self._sheets = frozenset[str](), list[str]()
        # The names of each element with what is important in its style, and for each important
        # declaration of a sheet, the names that an element must have.
        self._named = set[tuple[frozenset[str], frozenset[Declaration]]]()
        self._important = set[tuple[frozenset[str], Declaration]]()
        # The kind of element of each id, or "" if several elements have it. References are pairs of
        # a property and an id.
        self._ids, self._references = dict[str, str](), set[tuple[str, str]]()
        # For the id of each filter: remarks on it, and the primitive in it that may be misplaced.
        self._filter, self._in_filters = "", dict[str, dict[str, None]]()
        self._has_own_units = False  # whether the filter has the units of its shape
        self._placed = dict[str, str]()
        self._is_turned, self._has_use = False, False
        # Remarks on sizes of fonts, which have an effect if a length is in em.
        self._fonts, self._has_em = dict[str, None](), False
        self.is_animated = False  # whether CSS animates an element
        self._before, self._has_auto_marker, self._has_closed = "", False, False

    def add(self, remark: str) -> None:
        """Add a remark, if there are not too many yet."""
        _keep(self._found, remark)

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Look at an element and its attributes. The first element is the root."""
        name = element = tag.removeprefix(SVG)
        if self._is_first:
            self._is_first, self._is_qualified, element = False, tag != name, ROOT
        # resvg chooses such elements in a <switch> if they come first. Browsers skip them.
        skipped = {"title", "desc", "metadata", "style", "defs"}
        if self._before == "switch" and ("}" in name or name in skipped):
            self.add(f"<{name.rpartition('}')[2][:40]}> in <switch>")
        self._before = name
        if key := attributes.get("id"):
            self._ids[key] = "" if key in self._ids else name
        if "}" in name:
            return  # no renderer draws an element of another namespace
        if self._is_qualified and tag == name:
            self.add(f"<{name[:40]}> without a namespace")
        if self._has_sheets or self._has_important:
            classes = [f".{each}" for each in attributes.get("class", "").split()]
            names = (name, f"#{attributes.get('id', '')}", *classes)
            kind = element if element in KINDS else "*"
            self._all = _with(self._all, kind)
            for each in names:
                self._kinds[each] = _with(self._kinds.get(each, frozenset()), kind)
            if self._has_important:
                styles = [d for d in css_of(attributes.get("style", "")).by_resvg if d.is_important]
                self._named.add((frozenset(names), frozenset(styles)))
        if name in TEXTS or name in _ANIMATIONS:
            return
        if name == "filter":
            self._filter = attributes.get("id", "")
            self._has_own_units = attributes.get("primitiveUnits") == "objectBoundingBox"
        # Remarks on a filter count if it is used.
        is_in_filter = name.startswith("fe")
        remarks = self._in_filters.setdefault(self._filter, {}) if is_in_filter else self._found
        if name in _OTHERWISE:
            _keep(remarks, f"<{name}>")
        for key, value in attributes.items():
            if key == "style":
                css = css_of(value)
                self._check_others(css, f" on <{name}>")
                self._check_css(element, css, f" on <{name}>")
            elif (matches := matcher(element, key)) and not matches(value):
                _keep(remarks, f'{key.rpartition("}")[2]}="{_brief(value)}" on <{name[:40]}>')
            elif key == "font-size":
                self._check_font(key, value, f" on <{name}>")
            elif matches:
                self._note_use(key, value)
            if key in ("href", f"{XLINK}href") and name in _PAINTS:
                self._references.add(("gradient", value[1:]))
        self._check_combinations(name, attributes, remarks)

    def _note_use(self, name: str, value: str) -> None:
        """Keep the references of a value, and whether it has a length in em."""
        self._has_em |= "em" in value and re.search(r"\dem\b", value) is not None
        if "#" in value and "url" in value:
            for match in _ID.finditer(value):
                self._references.add((name, match[match.lastindex or 0].strip()))

    def _check_font(self, name: str, value: str, place: str) -> None:
        """Keep a remark on a size of a font that resvg does not read as browsers do."""
        if not re.fullmatch(FONT_SIZE, value) or name != "font-size":
            _keep(self._fonts, f"{name}: {_brief(value)}{place}")

    def _check_combinations(
        self, name: str, attributes: dict[str, str], remarks: dict[str, None]
    ) -> None:
        """Add remarks on what is drawn right only beside certain other attributes."""
        if not self._is_turned and "transform" in attributes:
            self._is_turned = _TURNS.search(attributes["transform"]) is not None
        if name == "use":
            self._has_use = True
        elif name == "marker":
            self._has_auto_marker |= attributes.get("orient", "").startswith("auto")
        elif name == "pattern":
            # resvg draws a tile in whole px, so tiles are blurred and moved if there are several.
            if {attributes.get("width"), attributes.get("height")} - {"1", "100%"}:
                self.add("<pattern>")
        elif name == "feColorMatrix" and attributes.get("type") == "saturate":
            # Chromium clips what is more saturated than the source otherwise than resvg does.
            if not re.fullmatch(r"\s*(?:0?\.\d+|[01](?:\.0*)?)\s*", attributes.get("values", "1")):
                _keep(remarks, "a saturation above 1 by <feColorMatrix>")
        elif name.startswith("fe"):
            # resvg places such primitives wrongly in what is rotated or skewed.
            if name in ("feOffset", "feFlood", "feDropShadow", "feTurbulence"):
                self._placed[self._filter] = name
            sides = {"x", "y", "width", "height"} & attributes.keys()
            if sides and self._has_own_units:
                _keep(remarks, f"<{name[:40]}> with a size in primitiveUnits")
            elif 0 < len(sides) < 4:
                _keep(remarks, f"<{name[:40]}> with a part of x, y, width and height")
        elif not MARKERS.keys().isdisjoint(attributes):
            # Markers turn otherwise at the end of a closed path. In arcs their number is another.
            path = attributes.get("d", "")
            self._has_closed |= name == "polygon" or re.search("[zZ]", path) is not None
            if "marker-mid" in attributes and re.search("[aA]", path):
                self.add("a marker in an arc")
        if name in _PAINTS:
            moved = attributes.get("gradientTransform") or attributes.get("patternTransform") or ""
            for call, arguments in re.findall(r"(scale|matrix)\s*\(([^)]*)", moved):
                numbers = [float(each) for each in re.findall(NUMBER, arguments)]
                a, b, c, d, *_ = (*numbers, 0, 0, 0, 0)
                if (call == "scale" and 0 in numbers) or (call == "matrix" and a * d == b * c):
                    self.add(f"a scale of 0 on <{name}>")

    def sheet(self, text: str, attributes: dict[str, str]) -> None:
        """Keep the text of a style sheet, whose element has these attributes."""
        kind, media = attributes.get("type", "text/css"), attributes.get("media", "").strip()
        if kind != "text/css":
            if kind.strip().lower() not in ("", "text/css"):
                return  # no renderer applies the sheet
            self.add(f'type="{_brief(kind)}" on <style>')
        if media not in ("", "all", "screen"):
            self.add(f'media="{_brief(media)}" on <style>')
        self._sheets.append(text)

    def remarks(self) -> tuple[str, ...]:
        """Return remarks such as "fill: oklch(...) on <rect>", at most 20."""
        if sum(map(len, self._sheets)) > 1_000_000:  # tinycss2 would take over 3 s
            self.add("style sheets of more than 1000 kB")
        else:
            if any("<!--" in text for text in self._sheets):
                self.add("<!-- in a style sheet")
            for rule in chain.from_iterable(map(rules_of, self._sheets)):
                self._check_rule(*rule)
        if self._has_important and self._has_conflict():
            self.add("!important more than once")
        for name, key in sorted(self._references):
            kind = self._ids.get(key)
            if kind is None:
                if name == "filter":
                    self.add("a missing filter")
            elif not kind:
                self.add(f"the id {_brief(key)} of several elements")
            elif name in _REFERENCES and kind not in _REFERENCES[name]:
                self.add(f"{name} of <{kind[:40]}>")
        used = [key for name, key in sorted(self._references) if name == "filter"]
        for remark in (each for key in used for each in self._in_filters.get(key, ())):
            self.add(remark)
        for remark in self._fonts if self._has_em else ():
            self.add(remark)
        if self._has_auto_marker and self._has_closed:
            self.add("markers on a closed path")
        for key in used if self._is_turned else ():
            if key in self._placed:
                self.add(f"<{self._placed[key]}> beside a rotation or a skew")
        return tuple(self._found)

    def _check_rule(self, at_rule: str, tokens: list[Any], css: Css) -> None:
        """Check the declarations of a rule for each kind of element that its selector may match."""
        selector = text_of(tokens)
        if not re.search(r"[(\"']", selector) and _UNMET.search(selector):
            return
        kinds = self._matched(tokens) - TEXTS
        is_applied = not at_rule and _SELECTOR.fullmatch(selector) is not None
        if kinds:
            self._check_others(css, "", is_applied)
        kinds = {kind for kind in kinds if any(has_effect(kind, d.name) for d in css.by_browsers)}
        if not kinds:
            return
        if at_rule:
            self.add(at_rule)
        elif not selector or not is_applied:
            self.add(f"the selector {selector[:40]}")
        elif self._has_use and re.search(r"[\s>+]", selector):
            # In the shadow tree of <use>, browsers do not find the ancestors.
            self.add(f"the selector {selector[:40]} beside <use>")
        else:
            for kind in kinds:
                self._check_css(kind, css, "")
            last = re.sub(r"\[.*?\]|:first-child", "", re.split(r"[\s>+]", selector)[-1])
            names = frozenset(re.findall(r"[.#]?[\w-]+", last))
            self._important.update((names, d) for d in css.by_resvg if d.is_important)

    def _has_conflict(self) -> bool:
        """Return whether an element may have two important values of one property.

        resvg takes the first of them, and browsers take the last.
        """
        if len(self._named) * len(self._important) > 10_000_000:
            return True  # the search would take seconds
        for names, styles in self._named:
            found = {*styles, *(d for needed, d in self._important if needed <= names)}
            if len(found) > len({d.name for d in found}):
                return True
        return False

    def _matched(self, selector: list[Any]) -> frozenset[str]:
        """Return the kinds of element that a selector may match, by the names in it alone."""
        kinds, before = self._all, ""
        for token in selector:
            if token.type == "whitespace" or token in (">", "+", "~"):
                kinds, before = (self._all if kinds else kinds), ""
                continue
            if token.type == "hash":
                kinds &= self._kinds.get(f"#{token.value}", frozenset())
            elif token.type == "ident" and before in ("", "."):
                kinds &= self._kinds.get(before + token.value, frozenset())
            before = token.value if token.type == "literal" else token.type
            if not kinds:
                break
        return kinds

    def _check_css(self, element: str, css: Css, place: str) -> None:
        """Check the declarations that apply to an element."""
        read = [d for d in css.by_resvg if has_effect(element, d.name)]
        if not css.is_same:
            seen = [d for d in css.by_browsers if has_effect(element, d.name)]
            if [d.name for d in seen] != [d.name for d in read]:
                lost = [d for d in seen if d not in read] or read
                self.add(f"{lost[0].name}: {_brief(lost[0].value)}{place}")
        # The last declaration of a property counts.
        for name, value in {(d.name, d.is_important): (d.name, d.value) for d in read}.values():
            matches = matcher(element, name, is_css=True)
            if matches and not matches(value):
                self.add(f"{name}: {_brief(value)}{place}")
            elif matches:
                self._note_use(name, value)

    def _check_others(self, css: Css, place: str, is_applied: bool = True) -> None:
        """Look at declarations of animations, and of fonts, whose size is the unit em."""
        for name, value, _ in css.by_browsers:
            if name in ("font", "font-size"):
                self._check_font(name, value if is_applied and css.is_same else "(", place)
            elif name in ("animation", "animation-name"):
                self.is_animated |= value not in ("none", "initial", "unset")


def _keep(remarks: dict[str, None], remark: str) -> None:
    """Add a remark, if there are not 20 yet. A note has the first few."""
    if len(remarks) < 20:
        remarks[remark] = None


def picture_remark(picture: Image.Image, data: bytes, declared: str) -> str | None:
    """Return a remark on an embedded image that resvg draws otherwise than Chromium.

    data      bytes of the file of the image
    declared  media type that its address declares
    """
    kind, info = picture.format or "", picture.info
    media_type = declared.partition(";")[0].strip().lower()
    types = [f"image/{kind.lower()}", *["image/jpg"] * (kind == "JPEG")]
    if media_type not in ("", "text/plain", *types):
        return f"a {kind} declared as {media_type[:40]}"
    if kind != "WEBP" and _is_turned(info.get("exif") or b""):
        return f"a {kind} with an orientation"
    if picture.mode == "CMYK" or (kind == "JPEG" and info.get("adobe_transform") == 0):
        return f"a {kind} in CMYK or without luminance"
    if getattr(picture, "is_animated", False):
        return f"an animated {kind}"
    # A file without these bytes near its end is decoded to see if it is broken.
    ends = {"PNG": b"IEND", "JPEG": b"\xff\xd9", "GIF": b";"}
    if ends.get(kind, b"") not in data[-32:] and _is_broken(picture):
        return f"a broken {kind}"
    profile = info.get("icc_profile") or b"sRGB"
    has_gamma = "srgb" not in info and abs(info.get("gamma", 0.45455) - 0.45455) > 0.001
    if b"sRGB" not in profile.replace(b"\0", b"") or has_gamma or b"cICP" in data[:1000]:
        return f"a {kind} with colours other than sRGB"
    return None


def _is_broken(picture: Image.Image) -> bool:
    try:
        picture.load()
    except (OSError, ValueError, SyntaxError):
        return True
    return False


def _is_turned(content: bytes) -> bool:
    exif = Image.Exif()
    with suppress(Exception):  # broken data may raise any exception, and browsers ignore them
        exif.load(content)
    return exif.get(Base.Orientation, 1) in range(2, 9)


@lru_cache(maxsize=1024)
def _with(kinds: frozenset[str], kind: str) -> frozenset[str]:
    """Return the union of a set and a kind. Equal sets are one object, which saves memory."""
    return kinds | {kind}


def _brief(value: str) -> str:
    """Return a value for a remark: on one line, and without the arguments of functions.

    An argument that is NaN or infinite stays, because it is the fault.
    """
    value = value[:200]
    fault = re.search(r"\b(?:nan|inf|infinity)\b", value, re.IGNORECASE)
    arguments = f"({fault[0]} ...)" if fault else "(...)"
    return " ".join(re.sub(r"\(.*", arguments, value, flags=re.DOTALL).split())[:40]
