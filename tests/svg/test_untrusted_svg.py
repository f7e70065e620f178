"""An SVG from anyone: what grows or loads is refused, and what may be drawn wrongly is named."""

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
from gauss2svg.measure.metrics import psnr
from gauss2svg.raster import rasterize, refuse_unsupported
from gauss2svg.raster.isolated import draw
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
    "no svg": ("<html/>", "root element must be <svg>; got <html>"),
    "any prefix": ('<image any:href="x.png"/>', "got 'x.png'"),
    "use": ('<use href="other.svg#a"/>', "got 'other.svg#a'"),
    "use of data": (f'<use href="{data_of(NESTED)}"/>', NO_IMAGE),
    "paints": ('<g fill="url(#a)" stroke="url(#b) url( \'x.svg#a\' )"/>', "x.svg#a"),
    "style sheet": ("<style>g { mask: url(x.svg) }</style>", "got 'x.svg'"),
    "escaped rule": ("<style>@i\\mport 'x.css';</style>", "got '@import'"),
    "escape at the end of a line": ("<style>g { fill: u\\\nrl(x.svg) }</style>", "got 'x.svg'"),
    "instruction": (
        f'<!-- --><?xml-stylesheet href="x.css"?>{ROOT}</svg>',
        "a style sheet of another file; got '<?xml-stylesheet href=",
    ),
    "instruction at the end": (f"{ROOT}</svg><?xml-stylesheet href='x'?>", "got 'xml-stylesheet'"),
    "null": (f"{ROOT}<desc>\0</desc></svg>", "without null characters"),
    "element in a style sheet": ('<style>@imp<g>x</g>ort "x";</style>', "of text alone; got <g>"),
    "svg of CSS": ("<style>g{mask:url(data:image/svg+xml,x)}</style>", "got 'data:image/svg"),
    "base": ('<image xml:base="/etc/x.png" href=""/>', "got '/etc/x.png'"),
    "blank of a link": ('<image href=" #p.png"/>', "got '#p.png'"),
    "blank before data": (f'<image href="\u00a0{DOT}"/>', "data:image"),
    "other format": (f'<image href="{data_of(BMP)}"/>', NO_IMAGE),
    "large picture": (f'<image href="{HUGE}"/>', NO_IMAGE),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_would_grow_or_load_is_refused_in_one_line(case):
    svg, line = REFUSED[case]
    svg = svg if svg.startswith(("<?", "<!", "<html")) else f"{ROOT}{svg}</svg>"
    with pytest.raises(InputError) as caught:
        sized_svg(read_source(svg.encode(), 10_000)[1], 8, 8, "resvg", 99)
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "inner",
    [
        '<use href="#a"/><image href=""/><a xlink:href="https://example.com"><g/></a>',
        '<g fill="url(#a)" style="mask:url(\'#b\')"/><script src="/cdn-cgi/x.js"/>',
        "<style>@font-face { src: url(data:font/woff2;base64,AAAA) } g { fill: url( #a ) }</style>",
        f'<image href="{DOT}"/><image href=" &#10;{DOT.rstrip("=").replace("png;b", "png;B")}"/>',
        '<g content="\\(b\\)" aria-label="url(https://a.org) (\\)" data="1" base="7" src="x.png"/>',
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
    bomb = gzip.compress(bytes(4 << 20))
    for source in (lambda: read_source(bomb, 1000), lambda: read_svg(bomb, max_bytes=1000)):
        with pytest.raises(InputError, match="at most 1000 bytes, gunzipped"):
            source()
        assert len(unpacked.pop()) == 1001
    with pytest.raises(InputError, match="at most 1000 bytes"):
        read_source(Endless(), 1000)
    with pytest.raises(InputError, match=r"at most 2 elements; .*max_elements"):
        read_svg(f"{ROOT}<g/><g/></svg>", max_elements=2)


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
    for encoding in ("utf-16", "windows-1252", "utf-8"):
        text = f"<?xml version='1.0' encoding='{encoding}'?>{ROOT}<title>ö</title></svg>"
        assert read_source(text.encode(encoding), 10_000)[1] == text
    assert Survey(svg, 3).tags == {"g": 2, "svg": 1}
    for broken in (packed[:-9], packed[:12] + b"\xff" * 9 + packed[21:]):
        with pytest.raises(InputError, match="complete gzip file"):
            read_source(broken, 1000)
    # expat would take null characters for UTF-16 and see elements that no renderer of the text does
    for kind in ("PNG", "JPEG"):
        with pytest.raises(InputError, match=f"got a {kind} picture"):
            read_source(encoded(Image.new("RGB", (8, 8)), kind), 10_000)
    with pytest.raises(InputError, match="without null characters"):
        sized_svg(read_source(svg.encode("utf-16-le"), 10_000)[1], 8, 8, "resvg", 99)


MANY = 20_000
CHAIN = "".join(f'<radialGradient id="c{i}" xlink:href="#c{i + 1}"/>' for i in range(2000))
CHAIN += gradient("c2000")
HOSTILE = {
    "digits": f'<svg width="{"9" * MANY}x" viewBox="0 0 8 8"',
    "calls": f'{ROOT[:-1]} filter="blur(" transform="{"matrix(" * MANY}"',
    "styles": f"{ROOT}<g style='a:{'/*' * MANY}'/><g style='{'fill:red;' * MANY}!'/>",
    "media": f"{ROOT}<style>{'@media print{a{' * MANY}animation:a</style>",
    "comments": f"{ROOT}<style><![CDATA[{'<!-- <use title ' * MANY} href]]></style>",
    "urls": f"{ROOT}<style>{'url(#' * MANY}{'image(a ' * MANY}</style>",
    "rules": f"{ROOT}<style>{'.a{fill:red}' * MANY}{'a,' * MANY}{'a{' * MANY}</style>",
    "selectors": f"{ROOT}<style>{'a.b#c >' * MANY}!{{fill:red}}</style>",
    "numbers": f'{ROOT}<path d="M0 0" stroke-dasharray="{"1 " * MANY}x" fill="{" " * MANY}x"/>',
    "transforms": f'{ROOT}<path d="M0 0h9v9z" transform="{"x" * MANY}"/>',
    "path data": f'{ROOT}<path d="M0 0h9v9{" " * MANY}x"/>',
    "prolog": f"{'<!-- -->' * MANY}{'<?a ?>' * MANY}<!DOCTYPE svg [" + '<!ENTITY a "b">' * 999,
    "chain": f"{ROOT}{CHAIN}" + "".join(f'<circle r="1" fill="url(#c{i})"/>' for i in range(2000)),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_time_grows_no_faster_than_the_text(name):
    svg = HOSTILE[name]
    svg += "/>" if svg.endswith('"') else "</svg>"
    begun = time.process_time()
    with contextlib.suppress(InputError, RendererError):
        _, text = read_source(svg, len(svg))
        frame_of(Survey(text, MANY).root)
    for renderer in ("resvg", "firefox"):
        with contextlib.suppress(RendererError):
            refuse_unsupported(svg, renderer)
    with contextlib.suppress(InputError):
        read_svg(svg)
    assert time.process_time() - begun < 2


STYLED = '<g class="a"><path class="b" d="M0 0h8"/><circle class="b c" r="3"/></g>'
RECT = 'rect y="1" height="5"'


def document(body):
    return f'<svg {SPACES} viewBox="0 0 8 8">{body}</svg>'


COLORS = (
    "red RED #f00 #F008 #ff0000 #ff000080 transparent rgb(255,0,0) rgba(255,0,0,.5) none "
    "rgb(100%,0%,50%) hsl(120,100%,50%) currentColor inherit url(#a) url('#a')_red url(#a)_none"
)
OTHER_COLORS = (
    "rebeccapurple currentcolor rgb(255_0_0_/_.5) rgba(255,0,0,50%) hsl(120deg,100%,50%) "
    "oklch(.6_.2_30) color(display-p3_1_0_0) var(--x,red) Canvas rgb(1,2) #ff URL(#a) bogus unset"
)
RIGHT = [
    *(f'<{RECT} width="6" fill="{c.replace("_", " ")}"/>' for c in COLORS.split()),
    *(f'<{RECT} width="6" style="stroke:{c.replace("_", " ")}"/>' for c in COLORS.split()),
    *(f'<{RECT} x="1" width="{side}"/>' for side in ("8px", "+8", ".8e1", "5mm", "30%")),
    *(f'<g transform="{t}"/>' for t in ("rotate(5,1 2)scale(2)", "matrix(1 0 0 1 2-3)", "")),
    '<g style="display:inline;overflow:visible;enable-background:new;-inkscape-stroke:none"/>',
    '<g style="/* a */fill:/* b */red;font-family:\'A b\',&quot;c&quot;"/>',
    '<foo fill="lab(1 2 3)" xmlns="urn:a"/>',
    f'<{RECT} width="6" stroke-dasharray="1 2,3" rx="2"/>',
    '<filter id="f" x="-50%"><feGaussianBlur stdDeviation="2 1"/></filter><g filter="url(#f)"/>',
    # as Illustrator and Figma write them
    '<switch><foreignObject requiredExtensions="x" width="1"/><g i:extraneous="self" xmlns:i="x"/>'
    "</switch>", '<linearGradient xlink:href="#a" spreadMethod="reflect"/>',
    *(f"<style>{rule}{{fill:red}}</style>{STYLED}" for rule in (
        "path", ".b", "*", ".a .b", ".a > path", "path + circle", ".b.c", '[class="c"]', ".b, .c",
        ".b:hover", "svg>g:target~g")),
    "<style>@font-face{src:url(data:font/woff,)} @media (prefers-color-scheme:dark){.b{fill:red}}"
    f".st0{{fill:none;stroke:#000;}}\n\t.b{{fill:red}}</style>{STYLED}",
]  # fmt: skip
UNREAD = {
    **{f'<{RECT} width="6" fill="{c.replace("_", " ")}"/>': "fill value" for c in (
        OTHER_COLORS.split())},
    **{f'<{RECT} width="{side}"/>': f"width value: '{side}'" for side in (
        "8PX", "20vw", "calc(...)")},
    **{f'<g style="{css}"/>': css.partition(":")[0] for css in (
        "transform:rotate(9deg)", "clip-path:circle(2px)", "mix-blend-mode:plus-lighter")},
    **{f"<style>{rule}{{fill:red}}{'}' * rule.count('{')}</style>{STYLED}": part for rule, part in {
        ".b:nth-of-type(2)": "':nth-of-type'", ":root": "':root'", ".c ~ path": "Selector",
        "[class^=b]": "Selector", "@layer x{.b": "@layer", ".\\62 ": "Selector"}.items()},
    f'<image width="8" height="8" href="{DOT[:60]}"/>': "a PNG image",
}  # fmt: skip


def unread(bodies):
    return draw(document("".join(bodies)), 32, 32, "resvg", 60)[1]


def test_what_resvg_reads_has_no_remark():
    assert unread(RIGHT) == []
    assert not Survey(document("".join(RIGHT))).unknown


def test_what_resvg_cannot_read_is_named():
    remarks = unread(UNREAD)
    assert {part for part in UNREAD.values() if not any(part in one for one in remarks)} == set()
    assert sum("fill value" in one for one in remarks) == len(OTHER_COLORS.split())


@pytest.mark.parametrize(
    "name", ["pattern", "foreignObject", "animate", "set", "feTile", "script", "mesh", "bogus"]
)
def test_an_element_that_resvg_skips_is_named(name):
    assert list(Survey(document(f"<{name}/><{name}/>")).unknown) == [name]


@pytest.mark.browser
def test_what_has_no_remark_is_drawn_alike_by_a_browser():
    side, columns = 32, 12
    svgs = [document(body) for body in RIGHT]
    cells = "".join(
        f'<image x="{i % columns * side}" y="{i // columns * side}" width="{side}" height="{side}" '
        f'href="data:image/svg+xml;base64,{base64.b64encode(svg.encode()).decode()}"/>'
        for i, svg in enumerate(svgs)
    )
    width, height = columns * side, -(-len(svgs) // columns) * side
    root = f'<svg {SPACES} viewBox="0 0 {width} {height}">'
    sheet = rasterize(f"{root}{cells}</svg>", width, height, "chromium")
    apart = {}
    for i, svg in enumerate(svgs):
        y, x = i // columns * side, i % columns * side
        apart[RIGHT[i]] = psnr(rasterize(svg, side, side), sheet[y : y + side, x : x + side])
    assert sheet.std() > 0.1
    assert {body: value for body, value in apart.items() if value < 30} == {}
