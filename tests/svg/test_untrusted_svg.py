"""An SVG from anyone: what grows or loads is refused, and what may be drawn wrongly is named."""

import base64
import contextlib
import gzip
import io
import itertools
import re
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


SPACES = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
IMAGE = Image.new("RGB", (3, 2), "#c40")
NOISE = Image.fromarray(np.random.default_rng(0).integers(0, 255, (32, 32, 3), dtype=np.uint8))


def remarks(body, root=""):
    return Survey(f'<svg {SPACES} viewBox="0 0 8 8" {root}>{body}</svg>').remarks


def data(kind, declared, **options):
    content = base64.b64encode(encoded(IMAGE, kind, **options)).decode()
    return f'<image width="8" height="8" href="data:{declared};base64,{content}"/>'


def orientation(value):
    exif = Image.Exif()
    exif[274] = value
    return exif


def closed(body):
    closing = "}" * (body.count("{") - body.count("}"))
    return body.replace("</style>", f"{closing}</style>")


COLORS = (
    "red RED #f00 #F008 #ff0000 #ff000080 transparent rgb(255,0,0) rgb(255_0_0) rgba(255,0,0,.5) "
    "rgb(100%,0%,50%) hsl(120,100%,50%) HSL(120_100%_50%) hsla(120,100%,50%,.5) none currentColor "
    "inherit url(#a) url('#a')_red url(#a)_none context-stroke"
)
OTHER_COLORS = (
    "rebeccapurple currentcolor rgb(255_0_0_/_.5) rgba(255,0,0,50%) hsl(120deg,100%,50%) "
    "hwb(120_0%_0%) lab(50%_40_20) oklch(.6_.2_30) color(display-p3_1_0_0) var(--x) var(--x,red) "
    "light-dark(red,blue) color-mix(in_srgb,red,blue) Canvas rgb(1,2) #ff URL(#a) bogus unset"
)
SIDES = "8 8px +8 .8e1 5mm .2in 15pt 1.2pc 1em 30%"
STYLED = '<g class="a"><path class="b" d="M0 0h8"/><circle class="b c" r="3"/></g>'
RIGHT = [
    *(f'<rect fill="{c.replace("_", " ")}"/>' for c in COLORS.split()),
    *(f'<rect style="stroke:{c.replace("_", " ")}"/>' for c in COLORS.split()),
    *(f'<rect x="1" width="{side}"/>' for side in SIDES.split()),
    *(f'<g opacity="{share}"/>' for share in (".5", "50%", "1.5", "-1")),
    *(f'<g transform="{t}"/>' for t in ("rotate(5,1 2)scale(2)", "matrix(1 0 0 1 2-3)", "")),
    '<g style="transform:matrix(1,.1,.2,1,3,4)"/>', '<g style="transform:scale(.5, 2)"/>',
    '<g transform-origin="4 4" transform="rotate(5)"/>',
    '<g style="transform-origin:4px 4px" transform="rotate(5)"/>',
    '<g style="filter:blur(2px) saturate(30%);mix-blend-mode:multiply;isolation:isolate"/>',
    '<g style="display:inline;overflow:visible;enable-background:new;-inkscape-stroke:none"/>',
    '<g style="font:12px x;text-anchor:middle;cursor:pointer;--a:1"/>', '<rect style=""/>',
    '<g style="fill:red;;stroke:#000 !important; "/>', '<g style="/* a */fill:/* b */red"/>',
    '<g style="font-family:\'A\\\'s\';fill:red"/>', '<rect style="fill:var(--x);fill:red"/>',
    '<g data-x="f(" aria-label="(\\)" background="red" content="\\(" rotate="9deg" zoom="2"/>',
    '<text style="fill:var(--x)" x="1vw">a</text>', '<foo fill="lab(1 2 3)" xmlns="urn:a"/>',
    '<path d="M0 0junk" marker-end="url(#a)"/>', '<rect stroke-dasharray="1 2,3" rx="2"/>',
    '<use href="#a"/>', '<symbol viewBox="0 0 8 8"/>', '<switch><g systemLanguage="en"/></switch>',
    '<filter id="a" x="-50%"><feGaussianBlur stdDeviation="2 1"/></filter><g filter="url(#a)"/>',
    '<mask style="mask-type:luminance"/>', '<linearGradient href="#a" spreadMethod="reflect"/>',
    '<pattern width="1" height="1" patternContentUnits="objectBoundingBox"/>',
    '<filter id="f"><feImage href="#a"/><feSpecularLighting/></filter><feTile/>',
    '<filter id="a" primitiveUnits="objectBoundingBox"><feOffset dx=".1"/></filter>',
    '<filter id="a"/><g style="filter:url(#a) url(#a)"/>',
    '<clipPath id="image(1)"/><g clip-path="url(\'#image(1)\')"/><g mask="url(#none)"/>',
    '<g id="b"/><g id="b"/><use href="#b"/><mask id="m"/><g mask="url(#m )"/>',
    '<animate fill="freeze"/><set fill="remove" to="x"/><rect fill="url(#none) red"/>',
    '<svg viewBox="0,0,1e1-2" preserveAspectRatio=" xMinYMax  slice"/><g font-size="2rem"/>',
    '<g font-size="2em" style="font-size:20px"><rect width="2em"/></g>',
    '<rect id="r"/><linearGradient href="#r"/><radialGradient xlink:href="#none"/>',
    '<linearGradient gradientTransform="matrix(0 1 -1 0 0 0)scale(1 .01)"/>',
    f"<style>@namespace svg url(http://www.w3.org/2000/svg);.b{{fill:red}}</style>{STYLED}",
    f"<style>use path, use > .b{{fill:red}}</style>{STYLED}<use/>",
    "<style>text{font:12px/1 x} .none{animation:k 1s}</style><text/><rect width='2em'/>",
    data("PNG", "image/png"), data("JPEG", "image/jpg"), data("WEBP", "image/webp"),
    data("PNG", ""), data("GIF", "IMAGE/GIF"), data("JPEG", "image/jpeg", exif=orientation(1)),
    data("JPEG", "image/jpeg", exif=b"Exif\0\0broken"),
    data("WEBP", "image/webp", exif=orientation(6)), data("PNG", "image/png;charset=utf-8"),
    *(f"<style>{rule}{{fill:red}}</style>{STYLED}" for rule in (
        "path", ".b", "*", ".a .b", ".a > path", "path + circle", ".b.c", "[class]",
        '[class~="c"]', "path:first-child", ".b, .c", ".b:hover", ".b::before", ":root .none",
        ".none:nth-child(2) i", "text:nth-child(2)", ".md\\:b", "@media print{.b",
        "@media (prefers-color-scheme:dark){.b")),
    f"<style>@font-face{{src:url(data:font/woff,)}} @keyframes k{{to{{fill:red}}}}</style>{STYLED}",
    f"<style>:root{{--x:red}} .b{{fill:blue}} text{{fill:var(--x)}}</style>{STYLED}<text/>",
    f"<style>.b{{fill:red!important}} .none{{fill:blue!important}}</style>{STYLED}",
    f"<style><![CDATA[/* a */.b{{fill:red}}]]></style>{STYLED}",
    f'<style type="text/less">.b{{fill:var(--x)}}</style>{STYLED}',
]  # fmt: skip
OTHERWISE = {
    **{f'<rect fill="{c.replace("_", " ")}"/>': "fill" for c in OTHER_COLORS.split()},
    **{f'<rect style="fill:{c.replace("_", " ")}"/>': "fill: " for c in OTHER_COLORS.split()},
    **{f'<rect width="{side}"/>': f'width="{side}" on <rect>' for side in (
        "8.", "8PX", "5Q", "1rem", "20vw", "2ex", "calc(...)", "12345678")},
    **{f'<g style="{css}"/>': css.partition(":")[0] for css in (
        "transform:rotate(9deg)", "transform:translate(1px,2px)", "transform:matrix(1 0 0 1 2 3)",
        "rotate:9deg", "scale:2", "translate:1px", "offset-path:path('M0 0')", "all:unset",
        "transform-box:fill-box", "clip-path:circle(2px)", "mix-blend-mode:plus-lighter",
        "vector-effect:non-scaling-stroke", "image-rendering:pixelated", "display:contents",
        "-webkit-filter:blur(2px)", "outline:2px solid red", "color-interpolation:linearRGB",
        "bogus:x")},
    **{f'<g id="a"/><g {name}="url(#a)"/>': f"{name} of <g>"
       for name in ("fill", "stroke", "mask", "clip-path", "filter")},
    **{f'<mask id="a"/>{twice}<g mask="url(\'#a\')"/>': "the id a of several" for twice in (
        '<mask id="a"/>', '<text id="a"/>', '<x:g xmlns:x="urn:x" id="a"/>')},
    '<stop id="a"/><linearGradient id="a"/><linearGradient href="#a"/>': "the id a of several",
    '<g style="mask:url(#a)"/><g id="a"/>': "mask of <g>",
    '<g fill="url(#a%20b)"/>': "fill=", '<g filter="url(#a) invert(1)"/>': "filter=",
    "<style>g{fill:url('#a')}</style><g id='a'/>": "fill of <g>",
    **{f'<g {size}><rect width="2em"/></g>': "font" for size in (
        'font-size="x-large"', 'font-size="2rem"', 'font-size="-1"', 'style="font-size:calc(2px)"',
        'style="font:20pt/2 x"', 'style="--a:1;font-size:2px"')},
    "<style>:root{font-size:20px}</style><rect x='1em'/>": "font-size",
    '<svg viewBox="0 0 0 9"/>': "viewBox", '<symbol viewBox="0 0 9 .0"/>': "viewBox",
    '<svg preserveAspectRatio="defer none"/>': "preserveAspectRatio",
    '<linearGradient gradientTransform="rotate(9) scale(0)"/>': "a scale of 0 on <linear",
    '<pattern width="1" height="1" patternTransform="matrix(0 0 0 1 2 3)"/>': "a scale of 0",
    '<filter id="a"><feGaussianBlur edgeMode="wrap"/></filter><g filter="url(#a)"/>': "edgeMode",
    '<filter id="a" primitiveUnits="objectBoundingBox"><feFlood x="0" y="0" width="1" height="1"/>'
    '</filter><g filter="url(#a)"/>': "<feFlood> with a size in primitiveUnits",
    '<g style="content-visibility:hidden"/>': "content-visibility",
    **{f'<image href="data:;base64,{base64.b64encode(encoded(NOISE, kind)[:-n]).decode()}"/>':
       f"a broken {kind}" for kind, n in (("PNG", 200), ("JPEG", 2), ("JPEG", 99), ("GIF", 99))},
    **{f'<rect style="{css}"/>': css.partition(":")[0] for css in ("width:8px", "x:1px", "rx:2px")},
    '<path style="d:path(\'M0 0\')"/>': "d: path(...) on <path>",
    '<g transform="matrix(1 0 0 nan 0 0)"/>': 'transform="matrix(nan ...)" on <g>',
    '<circle style="r:2px"/>': "r: 2px on <circle>",
    '<g style="--x:1;fill:red"/>': "fill: red", '<g style="FILL:red"/>': "fill: red",
    '<g style="font:12px/1 x;fill:red"/>': "fill: red", '<g style="f\\69ll:red"/>': "fill: red",
    '<g style="fill:red stroke:#000"/>': "fill", '<g transform="translate(1,)"/>': "transform",
    '<rect xmlns="" width="8"/>': "<rect> without a namespace",
    '<filter id="a"><feTile/></filter><g filter="url(#a)"/>': "<feTile>",
    '<symbol width="8"/>': "width", '<path pathLength="9"/>': "pathLength",
    '<rect marker-end="url(#a)"/>': "marker-end", '<use href="#a%20b"/>': "href",
    '<marker orient="auto"/><path d="M0 0h8z" marker-end="url(#a)"/>': "markers on a closed path",
    '<pattern width="2" height="2"/>': "<pattern>", '<rect xlink:fill="red"/>': "fill",
    '<g filter="url(#none)"/>': "a missing filter", '<switch><title/><g/></switch>': "<title> in",
    '<filter id="a"><feColorMatrix type="saturate" values="3"/></filter><g filter="url(#a)"/>':
    "a saturation above 1",
    '<filter id="a"><feOffset/></filter><g filter="url(#a)" transform="rotate(9)"/>':
    "<feOffset> beside a rotation",
    data("PNG", "image/jpeg"): "a PNG declared as image/jpeg", data("GIF", "img/gif"): "a GIF decl",
    data("JPEG", "image/jpeg", exif=orientation(6)): "a JPEG with an orientation",
    data("PNG", "image/png", exif=orientation(3)): "a PNG with an orientation",
    **{f"<style>{rule}{{fill:red}}{'}' * rule.count('{')}</style>{STYLED}": part for rule, part in {
        ".b:nth-of-type(2)": "the selector", ".b:not(.c)": "the selector", ":root": "the selector",
        ".b:is(.c)": "the selector", ".c ~ path": "the selector", "[class^=b]": "the selector",
        ".b:last-child": "the selector", "@media screen{.b": "@media screen",
        "@layer x{.b": "@layer x", "@supports (fill:red){.b": "@supports (fill:red)",
        ".a{.b": "nested rules", ".\\62 ": "escapes in a selector"}.items()},
    f"<style>.b{{fill:var(--x)}}</style>{STYLED}": "fill: var(...)",
    f"<style>circle{{r:2px}}</style>{STYLED}": "r: 2px",
    f"<style>.b{{fill:red!important}} .c{{fill:blue!important}}</style>{STYLED}": "!important more",
    f"<style>.a .b{{fill:red}}</style>{STYLED}<use/>": "the selector .a .b beside <use>",
    f'<style media="print">.b{{fill:red}}</style>{STYLED}': 'media="print" on <style>',
    f'<style type="text/CSS">.b{{fill:red}}</style>{STYLED}': 'type="text/CSS" on <style>',
    f"<style>.b{{fill:{'f(' * 9000}</style>{STYLED}": "fill: (",
    f"<g style=\"fill:{'f(' * 9000}\"/>": "fill: (", '<rect width="8 "/>': 'width="8"',
    f"<style>{' ' * 1_000_001}</style>": "style sheets of more than 1000 kB",
}  # fmt: skip


@pytest.mark.parametrize("body", RIGHT)
def test_what_resvg_draws_as_browsers_do_has_no_remark(body):
    assert remarks(closed(body)) == ()


@pytest.mark.browser
def test_what_has_no_remark_is_drawn_alike_by_a_browser():
    bodies, side, columns = [body for body in map(closed, RIGHT) if "<text" not in body], 32, 12
    # Rectangles of no size would be drawn alike whatever their paint is.
    sized = '<rect y="1" height="5" width="6"'
    bodies = [re.sub("<rect(?![^>]* width=)", sized, body) for body in bodies]
    svgs = [f'<svg {SPACES} viewBox="0 0 8 8">{body}</svg>' for body in bodies]
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
        drawn = rasterize(svg, side, side)
        apart[bodies[i]] = psnr(drawn, sheet[y : y + side, x : x + side])
    assert sheet.std() > 0.1
    assert {body: value for body, value in apart.items() if value < 30} == {}


@pytest.mark.parametrize("body", OTHERWISE)
def test_what_is_not_known_to_be_drawn_right_is_named(body):
    first, *_ = remarks(body)
    assert OTHERWISE[body] in first


@pytest.mark.parametrize("end", ["&#13;", "&#13;&#10;", "&#10;&#13;", "\n"])
def test_all_line_ends_of_css_are_read(end):
    css = f".q{{}}{end}.b{{fill:{end}blue}}{end}.c{{stroke:{end}var(--x)}}"
    assert remarks(f"<style>{css}</style>{STYLED}") == ("stroke: var(...)",)
    assert remarks(f"<g style='fill:red;{end}stroke:blue'/>") == ()


@pytest.mark.parametrize(
    ("root", "remark"),
    [
        ('width="100vw" style="width:9vw;max-width:8px;background:#fff;display:block"', None),
        ('fill="red" opacity=".5" x="1vw" transform="translate(0,0)" background="red"', None),
        ('transform="scale(.5)"', "transform"),
        ('style="padding:1px"', "padding"),
        ('style="background:red"', "background"),
        ('display="none"', "display"),
    ],
)
def test_root_is_stretched_and_is_a_box(root, remark):
    found = remarks("", root)
    assert len(found) == (remark is not None)
    assert all(remark in each for each in found)


def test_remarks_are_few_and_short():
    many = "".join(f'<g fill="{k} {"x" * 999}"/>' for k in itertools.chain(range(999)))
    found = remarks(many)
    assert len(found) == 20
    assert max(map(len, found)) < 100
    assert np.unique(found).size == 20
