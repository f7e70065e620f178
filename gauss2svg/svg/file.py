"""SVG files: their names, bytes, text, XML and size, and HTML that shows them.

A file that is read is not trusted. Everything before its root is dropped, so that neither the
parser nor a renderer sees a document type or a declared encoding. A file is refused if it has more
bytes than the limit, or a document type with declarations other than those of plain texts, which
Illustrator writes. References to these are replaced by the texts.
"""

from __future__ import annotations

import base64
import gzip
import html
import io
import math
import os
import re
import zlib
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from gauss2svg.errors import InputError, brief, quoted, refusal
from gauss2svg.files import UTF16_MARKS, reason_of
from gauss2svg.options import file_name
from gauss2svg.photo import PREFIX_BYTES, Format, format_of
from gauss2svg.svg import MM, NAMESPACE, signed

SvgSource = Any  # a path, a text that begins with <, bytes or a binary file
SVG = "{http://www.w3.org/2000/svg}"
INKSCAPE = "{http://www.inkscape.org/namespaces/inkscape}"
BLANKS = "\ufeff \t\r\n"  # characters that may precede the first <
# The default limit of a file's size in bytes, after gunzipping. Without a limit, a hostile file
# could become a thousand times as large when it is gunzipped.
MOST_BYTES = 256_000_000
# Matches a number. float() alone would also accept nan, inf and 1_000. Possessive quantifiers never
# give back what they have matched. So the time is linear even if the text has a long run of digits
# that is no part of a number.
NUMBER = r"[+-]?+(?:\d++\.?+\d*+|\.\d++)(?:[eE][+-]?+\d++)?+"
_LIST = re.compile(rf"(?:[\s,]*+{NUMBER})*+[\s,]*+")


def read_source(
    source: SvgSource, most_bytes: int, argument: str = "svg", limit: str = "--max-svg-bytes"
) -> tuple[bytes, str]:
    """Return the bytes of an SVG, gunzipped, and the text that they encode.

    A str that begins with < is the text itself, and any other str is a path. Raise InputError if
    the source cannot be read, or if it has more than most_bytes bytes after gunzipping.

    argument  name of the source in error messages
    limit     name of the option that sets most_bytes, in error messages
    """
    name, data = "the SVG", source
    if isinstance(source, str) and source.lstrip(BLANKS).startswith("<"):
        data = source.encode("utf-8", "surrogatepass")
    elif isinstance(source, (str, os.PathLike)):
        name = file_name(argument, source)
        try:  # `open` is used because files.reading refuses pipes
            with open(name, "rb") as file:
                data = file.read(most_bytes + 1)
        except (OSError, ValueError) as error:  # a path with a null character raises ValueError
            raise InputError(f"cannot read {name}: {reason_of(error)}. Try another path") from error
    elif hasattr(source, "read"):
        data = source.read(most_bytes + 1)
    if not isinstance(data, bytes):
        needed = "a path, text that begins with <, bytes or a binary file"
        raise refusal(argument, needed, type(source).__name__)
    if data.startswith(b"\x1f\x8b"):  # the magic number of gzip
        try:
            with gzip.GzipFile(fileobj=io.BytesIO(data)) as stream:
                data = stream.read(most_bytes + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise refusal(name, "a complete gzip file", brief(error), "to re-save it") from error
    if len(data) > most_bytes:
        advice = f"to raise {limit} if you trust it"
        raise refusal(name, f"at most {most_bytes} bytes, gunzipped", "more", advice)
    if isinstance(source, str) and name == "the SVG":
        return data, source
    return data, _decoded(data, name)


def _decoded(data: bytes, name: str) -> str:
    """Return the text of a file in UTF-16 with its mark, in UTF-8, or else in Latin-1.

    A file in another encoding is read as Latin-1. Only its texts and names are then wrong.
    """
    if isinstance(kind := format_of(data[:PREFIX_BYTES]), Format):
        raise refusal(name, "an SVG", f"a {kind.name} picture", "to save it as SVG")
    with suppress(ValueError):
        return data.decode("utf-16" if data.startswith(UTF16_MARKS) else "utf-8")
    return data.decode("latin-1")


def from_root(text: str) -> str:
    """Return the text of an SVG without all that precedes its root.

    Raise InputError if the text has a null character. Also raise InputError if the text before the
    root has a document type that declares more than texts, or a reference to a style sheet in
    another file.
    """
    # expat would read a text with null characters as UTF-16. It would then find elements that no
    # renderer finds.
    if "\0" in text:
        raise refusal("the SVG", "without null characters", "some", "to save it as UTF-8")
    # Blanks, comments, processing instructions other than xml-stylesheet, and document types that
    # declare nothing but texts without markup may precede the root.
    entity = r"""<!ENTITY\s++([\w.-]++)\s++["']([^"'<>&%]{0,200})["']\s*+>"""
    before_root = re.compile(
        r"""(?:[\s\ufeff]++|<\?(?!xml-stylesheet).*?\?>|<!--.*?-->"""
        r"""|<!DOCTYPE(?:[^\[\]<>"']|"[^"]*"|'[^']*')*+"""
        rf"""(?:\[(?:\s++|<!--.*?-->|{entity})*+\]\s*+)?+>)*+""",
        re.DOTALL,
    )
    before = before_root.match(text)
    end = before.end() if before else 0
    rest = text[end:]
    # Texts and references that are replaced are limited, because a reference may become 200
    # characters. Illustrator declares a dozen texts, and refers to each once or twice.
    if values := dict(re.findall(entity, text[:end])[:100]):
        names = re.compile(f"&({'|'.join(map(re.escape, values))});")
        rest = names.sub(lambda match: values[match[1]], rest, count=1000)
    if rest.startswith(("<!DOCTYPE", "<?xml-stylesheet")):
        needed = "without a document type of its own or a style sheet of another file"
        got, advice = quoted(rest[:60]), "to save it as plain SVG"
        raise refusal("the SVG", needed, got, advice)
    return rest


def parse(text: str, target: Any = None) -> Any:
    """Parse the text of an SVG, which must begin with its root.

    Return the tree of its elements. If `target` is given, the parser builds no tree, but calls the
    methods of `target`. The result is then that of `target.close()`, or None if `target` has no
    such method. Raise InputError if the text is not well-formed XML.
    """
    # Only few runs read an SVG, and this import takes 3 ms.
    from xml.etree import ElementTree

    try:
        parser = ElementTree.XMLParser(target=target)
        parser.feed(text)
        return parser.close()
    except (ElementTree.ParseError, UnicodeEncodeError, OverflowError) as error:
        raise refusal("the SVG", "well-formed XML", brief(error), "to re-save it") from error


def stretched(text: str, width: int, height: int, view_box: str | None = None) -> str:
    """Return the text of an SVG with its root stretched to width x height px.

    view_box  viewBox of the root, which is the visible part of the SVG. If it is None, the root
              keeps its own viewBox. A text without any viewBox is then returned unchanged

    A width in the style of the root remains, because it has no effect in any renderer.
    """
    attribute = r"""\s+([^\s=/>]+)\s*=\s*(?:"[^"]*"|'[^']*')"""
    size = {"width": width, "height": height, "preserveAspectRatio": "none"}
    if view_box is not None:
        size["viewBox"] = view_box
    tag = re.match(rf"<([^\s/>]+)((?:{attribute})*+)", text)
    own = {match[1]: match[0] for match in re.finditer(attribute, tag[2])} if tag else {}
    if tag is None or (view_box is None and "viewBox" not in own):
        return text
    written = "".join(f' {name}="{value}"' for name, value in size.items())
    kept = "".join(attribute for name, attribute in own.items() if name not in size)
    return f"<{tag[1]}{written}{kept}{text[tag.end() :]}"


class Frame(NamedTuple):
    """The size of an SVG and its visible part.

    width, height  size in px
    view_box       x, y, width and height of the visible part, in user units
    """

    width: float
    height: float
    view_box: tuple[float, ...]


@lru_cache(maxsize=4096)  # most elements of a file share texts such as "0" and "1"
def numbers(text: str, name: str, count: int = 0) -> tuple[float, ...]:
    """Return the numbers in a text. Blanks or commas must separate them.

    Raise InputError if the text has anything else, or if a number is not finite.

    count  how many numbers the text must have. 0 allows any count
    """
    values = tuple(map(float, re.findall(NUMBER, text))) if _LIST.fullmatch(text) else (math.nan,)
    if not all(map(math.isfinite, values)) or (count and len(values) != count):
        needed = "a finite number" if count == 1 else f"{count or ''} finite numbers".strip()
        raise refusal(name, needed, quoted(text))
    return values


def pixels_of(text: str) -> float | None:
    """Return an absolute length, such as 5in, in px. An inch has 96 px.

    Return None if the text is not an absolute length.
    """
    match = re.fullmatch(rf"\s*+({NUMBER})({'|'.join(MM)}|)\s*+", text)
    return float(match[1]) * (MM[match[2] or "px"] / MM["px"]) if match else None


def frame_of(root: Mapping[str, str]) -> Frame:
    """Return the frame of an SVG, which the attributes of its root determine.

    If the width or the height is missing, it follows from the viewBox. A viewBox that browsers
    ignore, because it is no list of four numbers or has a side below 0, counts as missing. Raise
    InputError if there is neither a viewBox nor a width and a height in absolute units. Also raise
    InputError if a number is too large or too small for renderers.
    """
    sides = [pixels_of(root.get(name, "")) for name in ("width", "height")]
    box = list(map(float, re.findall(NUMBER, root.get("viewBox", ""))))
    if not _LIST.fullmatch(root.get("viewBox", "")) or len(box) != 4 or min(box[2:]) < 0:
        box = None
    if box is None:
        if None in sides:
            needed = "of a known size, by a viewBox of 4 numbers or by sides in absolute units"
            advice = 'to add viewBox="0 0 WIDTH HEIGHT" to its root'
            raise refusal("the SVG", needed, "neither", advice)
        box = [0.0, 0.0, *(side or 0.0 for side in sides)]
    width, height = sides
    if width is None or height is None:
        scales = [s / b for s, b in zip(sides, box[2:], strict=True) if s is not None and b]
        width, height = (side * (scales or [1.0])[0] for side in box[2:])
    # Renderers compute with 32-bit floats, and they need a part of the range of these floats for
    # the transform to pixels.
    are_sides_held = all(1e-30 <= side <= 1e30 for side in (width, height, *box[2:]))
    if not (are_sides_held and max(abs(box[0]), abs(box[1])) <= 1e30):
        got, advice = (width, height, *box), "to scale it to the size of the photo"
        needed, shown = "above 0 and in 1e-30..1e+30", " ".join(f"{v:g}" for v in got)
        raise refusal("width, height and viewBox of the SVG", needed, shown, advice)
    return Frame(width, height, tuple(box))


def is_svgz(path: str | os.PathLike[str]) -> bool:
    """Return whether a path ends in .svgz, in small or capital letters. Such files are gzipped."""
    return os.fsdecode(path).lower().endswith(".svgz")


def is_own(path: str | os.PathLike[str]) -> bool:
    """Return whether gauss2svg has written an SVG file, and no other program has saved it since.

    Editable markup says so in its description, and minimal markup begins with the path of the
    background, which is not closed. Files that have neither are `signed`. A file that cannot be
    read counts as one of another program.
    """
    try:
        text = read_source(Path(path), MOST_BYTES)[1]
    except InputError:
        return False
    # Programs that save a file again put attributes on lines of their own, or drop the description
    # and close the path.
    own = re.match(
        r"""(?:<\?xml version="1.0" encoding="utf-8"\?>\n)?"""
        r"""<svg((?: [\w:-]+=(?:"[^"]*"|'[^']*'))+)"""
        r"""(?<=")>(?:<title>[^<]*</title>)?(?:<desc>([^<]*)</desc>)?"""
        r"""((?:<defs>.*?</defs>)?(?:<svg>)?<path(?: fill="#[0-9a-f]+")? d="M0 0h\d+v\d+H0"/>)?""",
        text,
        re.DOTALL,
    )
    root, description, background = own.groups("") if own else ("", "", "")
    return bool(background) or signed(NAMESPACE) in root or "written by gauss2svg" in description


def file_bytes(svg: str | bytes, gzipped: bool) -> bytes:
    """Return the bytes of the file of an SVG.

    gzip writes no date into it, so the same SVG always gives the same bytes.
    """
    data = svg.encode() if isinstance(svg, str) else svg
    return gzip.compress(data, compresslevel=9, mtime=0) if gzipped else data


def bytes_by_part(svg: str) -> dict[str, int]:
    """Return the number of bytes of each part of an SVG that write_svg wrote.

    The sum is the size of the file. Its parts are:

    gradients  all definitions
    geometry   the elements of areas, lines and shapes
    overhead   the rest: root, names, background, groups and style sheet
    """
    data = svg.encode()
    # The patterns always find whole elements, because texts and attributes have entities in place
    # of the characters < and >.
    rest = re.sub(rb"<defs>.*?</defs>", b"", data, flags=re.DOTALL)
    geometry = sum(map(len, re.findall(rb"<(?:circle|ellipse|path|use)\b[^>]*>", rest)))
    gradients = len(data) - len(rest)
    return {"gradients": gradients, "geometry": geometry, "overhead": len(rest) - geometry}


def image(data: bytes, media_type: str, alt: str) -> str:
    """Return HTML that contains the data of a picture and shows it no wider than the page.

    The HTML is an <img> and not an inline SVG, because gradients of two inline SVGs in one page
    could have the same id.
    """
    source = f"data:{media_type};base64,{base64.b64encode(data).decode()}"
    return f'<img alt="{html.escape(alt)}" style="max-width:100%" src="{source}"/>'
