"""Properties of an SVG from anyone: what would grow or load from elsewhere is refused."""

import base64
import contextlib
import gzip
import io
import time

import numpy as np
import pytest
from pictures import encoded, png
from PIL import Image
from svg_texts import SPACES, gradient

from gauss2svg.errors import InputError, RendererError
from gauss2svg.measure.check import sized_svg
from gauss2svg.raster import refuse_unsupported
from gauss2svg.svg.file import frame_of, from_root, read_source
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.untrusted import Survey

ROOT = (
    '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
    'xmlns:any="http://www.w3.org/1999/xlink" xmlns:h="http://www.w3.org/1999/xhtml" '
    'xmlns:s="http://sodipodi.sourceforge.net/DTD/sodipodi-0.dtd" viewBox="0 0 8 8">'
)
LAUGHS = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 10))


def data_of(content):
    return f"data:image/png;base64,{base64.b64encode(content).decode()}"


DOT, HUGE = (data_of(png(np.zeros((1, 1, 3)), size=size)) for size in ((1, 1), (20000, 9500)))
BMP = encoded(Image.new("RGB", (2, 2)), "BMP")
NESTED = f'{ROOT}<image href="/etc/hostname" width="8" height="8"/></svg>'.encode()
NO_IMAGE = "data: in the SVG must be an image"
REFUSED = {
    "billion laughs": (
        f'<!DOCTYPE svg [<!ENTITY l0 "ha">{LAUGHS}]>{ROOT}<desc>&l9;</desc></svg>', "plain SVG",
    ),
    "external entity": (
        f'<!DOCTYPE svg [<!ENTITY x SYSTEM "file:///etc/passwd">]>{ROOT}<desc>&x;</desc></svg>',
        "save it as plain SVG",
    ),
    "own attributes": (
        f'<!DOCTYPE svg [<!ATTLIST g fill CDATA "red">]>{ROOT}<g/></svg>', "type of its own",
    ),
    "no svg": ("<html/>", "root element must be <svg>; got <html>"),
    "any prefix": ('<image any:href="x.png"/>', "got 'x.png'"),
    "picture of an editor": (
        f'<image xlink:href="{DOT}" s:absref="/etc/x.png"/>', "got '/etc/x.png'",
    ),
    "use": ('<use href="other.svg#a"/>', "got 'other.svg#a'"),
    "use of data": (f'<use href="{data_of(NESTED)}"/>', NO_IMAGE),
    "paints": ('<g fill="url(#a)" stroke="url(#b) url( \'x.svg#a\' )"/>', "x.svg#a"),
    "style sheet": ("<style>g { mask: url(x.svg) }</style>", "got 'x.svg'"),
    "escaped paint": ("<g style='fill:\\75r\\6c(x.svg)'/>", "got 'x.svg'"),
    "escaped rule": ("<style>@i\\mport 'x.css';</style>", "got '@import'"),
    "escape at the end of a line": ("<style>g { fill: u\\\nrl(x.svg) }</style>", "got 'x.svg'"),
    "instruction": (
        f'<!-- --><?xml-stylesheet href="x.css"?>{ROOT}</svg>',
        "a style sheet of another file; got '<?xml-stylesheet href=",
    ),
    "instruction at the end": (f"{ROOT}</svg><?xml-stylesheet href='x'?>", "got 'xml-stylesheet'"),
    "null": (f"{ROOT}<desc>\0</desc></svg>", "without null characters"),
    "style sheet of a page": ('<h:style>@IMPORT "x.css";</h:style>', "got '@IMPORT'"),
    "element in a style sheet": ('<style>@imp<g>x</g>ort "x";</style>', "of text alone; got <g>"),
    "set of images": ("<g style='fill:image-set(\"x.png\" 1x)'/>", "got 'image-set('"),
    "svg of CSS": ("<style>g{mask:url(data:image/svg+xml,x)}</style>", "got 'data:image/svg"),
    "base": ('<image xml:base="/etc/x.png" href=""/>', "got '/etc/x.png'"),
    **{f"blank {blank!r} of a link": (f'<image href="{blank}#p.png"/>', "got '#p.png'")
       for blank in (" ", "\u00a0", "&#10;", "\t", "\u3000")},
    "blank of a link of CSS": ("<g style='fill:url(\u00a0#p.png)'/>", "#p.png"),
    "blank before data": (f'<image href="\u00a0{DOT}"/>', "data:image"),
    "address of no namespace": ("<style>@namespace a url(#); g{mask:url(x.svg)}</style>", "x.svg"),
    "escaped namespace": ("<g style='list-style:\\@namespace url(x.svg)'/>", "got 'x.svg'"),
    "image by a name": ("<g style='fill:image(\"x.png\")'/>", "got 'image('"),
    "other format": (f'<image href="{data_of(BMP)}"/>', NO_IMAGE),
    "large picture": (f'<image href="{HUGE}"/>', NO_IMAGE),
    **{f"{name} of {tag}": (f'<h:{tag} {name}="//a/x.png"/>', "got '//a/x.png'")
       for tag in ("img", "object", "body", "link", "any")
       for name in ("src", "srcset", "href", "data", "poster", "background", "srcdoc", "code")},
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_would_grow_or_load_is_refused_in_one_line(case):
    svg, line = REFUSED[case]
    svg = svg if svg.startswith(("<?", "<!", "<html")) else f"{ROOT}{svg}</svg>"
    for renderer in ("resvg", "chromium"):
        with pytest.raises(InputError) as caught:
            sized_svg(read_source(svg.encode(), 10_000)[1], 8, 8, renderer, 99)
        assert line in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "inner",
    [
        '<use href="#a"/><image href=""/>',
        '<a xlink:href="https://example.com"><g/></a>',
        '<g fill="url(#a)" style="mask:url(\'#b\')"/>',
        "<style>@font-face { src: url(data:font/woff2;base64,AAAA) } g { fill: url( #a ) }</style>",
        f'<h:img src="{DOT}" title="image-set"/>',
        f'<g class="image" {SPACES} inkscape:label="image(1) \\ (2)"/>',
        f'<image href="{DOT}"/><image href=" &#10;{DOT} "/>',
        "<g clip-path=\"url('#image(1)')\" style=\"mask:url('#image(1) 2')\"/>",
        "<style>@namespace svg url(http://www.w3.org/2000/svg); @namespace url('urn:a');</style>",
        f'<image href="{DOT.rstrip("=").replace("png;base", "png;BASE")}"/>',
        '<g content="\\(a+b\\)" id="image(1) 1" aria-label="url(https://a.org) (\\)" code="DE"/>',
        '<g data="1" background="white" base="7" src="x.png" poster="a" srcset="b"/>',
        '<script src="/cdn-cgi/x.js"/>',
        "<g style=\"font-family:'A\\'s'\"/>",
        "<style>.md\\:flex { fill: #000 } a::before { content: '\\201C' }</style>",
    ],
)
def test_what_stays_within_the_file_is_let_through(inner):
    assert Survey(f"{ROOT}{inner}</svg>", 10).elements > 1


class Endless(io.RawIOBase):
    """A stream that must not be read to its end."""

    def read(self, size=-1):
        assert size >= 0
        return b"<" * size


def test_what_is_too_long_is_not_unpacked_or_read_to_its_end(monkeypatch):
    unpacked, read = [], gzip.GzipFile.read
    monkeypatch.setattr(
        gzip.GzipFile, "read", lambda *given: unpacked.append(read(*given)) or unpacked[-1]
    )
    bomb = gzip.compress(bytes(50 << 20))
    for source in (lambda: read_source(bomb, 1000), lambda: read_svg(bomb, max_bytes=1000)):
        with pytest.raises(InputError, match="at most 1000 bytes, gunzipped"):
            source()
        assert len(unpacked.pop()) == 1001
    with pytest.raises(InputError, match="at most 1000 bytes"):
        read_source(Endless(), 1000)
    with pytest.raises(InputError, match=r"at most 2 elements; .*max_elements"):
        read_svg(f"{ROOT}<g/><g/></svg>", max_elements=2)


@pytest.mark.parametrize(
    ("name", "encoding"),
    [("utf-16", "utf-8"), ("UTF-16LE", "utf-8"), ("utf-32", "utf-8"), ("UCS-2", "utf-8"),
     ("nonsense", "utf-8"), ("UTF8", "utf-8"), ("x-mac-roman", "mac-roman"), ("rot13", "utf-8"),
     ("Shift_JIS", "shift_jis")],
)  # fmt: skip
@pytest.mark.parametrize("blank", ["", " "])
def test_a_declaration_that_cannot_be_is_ignored_as_by_browsers(name, encoding, blank):
    text = f'<?xml version="1.0" encoding="{name}"?>{ROOT}</svg>{blank}'
    assert read_source(text.encode(encoding), 10_000)[1] == text


@pytest.mark.parametrize(
    ("document", "body"),
    [
        ("<!DOCTYPE svg []>", "<g/>"),
        ('<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "a.dtd" [ <!-- > ] --> ]>', "<g/>"),
        ("<!DOCTYPE svg [\n\t<!ENTITY ns_a \"urn:a\">\n<!ENTITY b 'c'>\n]>", '<g a="&ns_a;&b;"/>'),
    ],
)
def test_document_type_of_plain_texts_is_replaced(document, body):
    found = from_root(f"<?xml version='1.0'?>{document}{ROOT}{body}</svg>")
    assert found == f"{ROOT}{body.replace('&ns_a;&b;', 'urn:ac')}</svg>"


def test_source_is_read_in_its_encoding_up_to_its_limits():
    svg = f"{ROOT}<g/><g/></svg>"
    packed = gzip.compress(svg.encode())
    for source in (svg.encode(), svg.encode("utf-8-sig"), packed):
        assert read_source(source, len(svg) + 3)[1].lstrip("\ufeff") == svg
    for encoding in ("utf-16", "windows-1252"):
        text = f"<?xml version='1.0' encoding='{encoding}'?>{ROOT}<title>Größe 10 €</title></svg>"
        assert read_source(text.encode(encoding), 10_000)[1] == text
    assert Survey(svg, 3).tags == {"g": 2, "svg": 1}
    with pytest.raises(InputError, match=f"at most {len(svg) - 1} bytes"):
        read_source(svg.encode(), len(svg) - 1)
    for broken in (packed[:-9], packed[:12] + b"\xff" * 9 + packed[21:]):
        with pytest.raises(InputError, match="complete gzip file"):
            read_source(broken, 1000)
    # expat would take null characters for UTF-16 and see elements that no renderer of the text does
    with pytest.raises(InputError, match="without null characters"):
        sized_svg(read_source(svg.encode("utf-16-le"), 10_000)[1], 8, 8, "resvg", 99)


MANY = 40_000
CHAIN = "".join(f'<radialGradient id="c{i}" xlink:href="#c{i + 1}"/>' for i in range(5000))
CHAIN += gradient("c5000")
HOSTILE = {
    "digits": f'<svg width="{"9" * MANY}x" viewBox="0 0 8 8"',
    "word": f'{ROOT[:-1]} filter="url(#a)" transform="{"a" * MANY}"',
    "calls": f'{ROOT[:-1]} filter="blur(" transform="{"matrix(" * MANY}"',
    "unclosed comments": f"{ROOT}<style>{'/*' * MANY}</style>",
    "unclosed comments of a style": f"{ROOT}<g style='{'/*' * 100_000}'/>",
    "comments in a string": f"{ROOT}<g style='a:\"{'/*' * 100_000}\"'/>",
    "unclosed rules": f"{ROOT}<style>{'a{' * MANY}</style>",
    "media": f"{ROOT}<style>{'@media no-preference){a{' * MANY}animation:a</style>",
    "comments": f"{ROOT}<style><![CDATA[{'<!-- <use title ' * MANY} href]]></style>",
    "sheets": f"{ROOT}{'<style>' * MANY}{'</style>' * MANY}",
    "urls": f"{ROOT}<style>{'url(#' * MANY}{'image(a ' * MANY}</style>",
    "namespaces": f"{ROOT}<style>{'@namespace a ' * MANY}</style>",
    "rules": f"{ROOT}<style>{'.a{fill:red!important}' * (MANY // 4)}</style>"
    + '<g class="a"/>' * 999,
    "nested rules": f"{ROOT}<style>{'g{' * MANY}fill:red</style><g/>",
    "functions": f"{ROOT}<g style='fill:{'f(' * MANY}'/>",
    "declarations": f"{ROOT}<g style='{'fill:red;' * MANY}\\'/>",
    "transforms": f'{ROOT}<g transform="{"scale(1)" * MANY}x"/>',
    "numbers": f'{ROOT}<path d="M0 0" stroke-dasharray="{"1 " * MANY}x" fill="{" " * MANY}x"/>',
    "entities": "<!DOCTYPE svg [" + '<!ENTITY a "b">' * 999 + f"]>{ROOT}<g a='{'&a;' * MANY}'/>",
    "prolog": f"{'<!-- -->' * MANY}{'<?a ?>' * MANY}<svg",
    "chain": f"{ROOT}{CHAIN}" + "".join(f'<circle r="1" fill="url(#c{i})"/>' for i in range(5000)),
    "one attribute": f'{ROOT[:-1]} a="{"x" * 1_000_000}"',
}


@pytest.mark.parametrize("name", HOSTILE)
def test_time_grows_no_faster_than_the_text(name):
    svg = HOSTILE[name]
    svg += "/>" if svg.endswith('"') else "</svg>"
    begun = time.process_time()
    with contextlib.suppress(InputError, RendererError):
        _, text = read_source(svg, len(svg))
        frame_of(Survey(text, MANY).root)
    for renderer in ("resvg", "inkscape", "firefox", "cairo"):
        with contextlib.suppress(RendererError):
            refuse_unsupported(svg, renderer)
    with contextlib.suppress(InputError):
        read_svg(svg)
    assert time.process_time() - begun < 4
