"""An SVG from anyone is refused in one line where it would grow, load or read what it must not."""

import base64
import contextlib
import gzip
import io
import struct
import time
import zlib

import numpy as np
import pytest
from PIL import Image
from svg_texts import gradient

from gauss2svg.cli.main import main
from gauss2svg.errors import InputError, RendererError
from gauss2svg.measure.survey import frame_of, survey
from gauss2svg.raster import refuse_unsupported
from gauss2svg.svg.reader.read import read_svg
from gauss2svg.svg.syntax.source import svg_source

ROOT = (
    '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
    'xmlns:any="http://www.w3.org/1999/xlink" '
    'xmlns:s="http://sodipodi.sourceforge.net/DTD/sodipodi-0.dtd" viewBox="0 0 8 8">'
)
XHTML = 'xmlns:h="http://www.w3.org/1999/xhtml"'
LAUGHS = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 10))


def data_of(content, kind="image/png"):
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def png(width, height):
    """A PNG that says it is of that size; it is not to be read any further."""
    header = b"IHDR" + struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header
        + struct.pack(">I", zlib.crc32(header)) + bytes(4) + b"IDAT" + bytes(4)
    )  # fmt: skip


def bmp():
    stream = io.BytesIO()
    Image.new("RGB", (2, 2)).save(stream, "BMP")
    return stream.getvalue()


NESTED = f'{ROOT}<image href="/etc/hostname" width="8" height="8"/></svg>'.encode()
REFUSED = {
    "billion laughs": (
        f'<!DOCTYPE svg [<!ENTITY l0 "ha">{LAUGHS}]>{ROOT}<desc>&l9;</desc></svg>',
        "save it as plain SVG",
    ),
    "external entity": (
        f'<!DOCTYPE svg [<!ENTITY x SYSTEM "file:///etc/passwd">]>{ROOT}<desc>&x;</desc></svg>',
        "save it as plain SVG",
    ),
    "own attributes": (
        f'<!DOCTYPE svg [<!ATTLIST g fill CDATA "red">]>{ROOT}<g/></svg>', "type of its own",
    ),
    "undefined entity": (f"{ROOT}<desc>&x;</desc></svg>", "well-formed XML; got undefined entity"),
    "not closed": (f"{ROOT}<g>", "well-formed XML; got no element found"),
    "wrong end": (f"{ROOT}<g></svg>", "well-formed XML; got mismatched tag: line 1"),
    "no svg": ("<html/>", "root element must be <svg>; got <html>"),
    "nothing": ("", "got an empty file"),
    "odd encoding": (
        f'<?xml version="1.0" encoding="unicode_escape"?>{ROOT}</svg>', "save it as UTF-8",
    ),
    "local picture": (f'{ROOT}<image href="/etc/x.png"/></svg>', "got '/etc/x.png'"),
    "relative picture": (f'{ROOT}<image xlink:href="x.png"/></svg>', "got 'x.png'"),
    "any prefix": (f'{ROOT}<image any:href="x.png"/></svg>', "got 'x.png'"),
    "picture of an editor": (
        f'{ROOT}<image xlink:href="{data_of(png(3, 2))}" s:absref="/etc/x.png"/></svg>',
        "got '/etc/x.png'",
    ),
    "remote picture": (f'{ROOT}<image href="https://a/x.png"/></svg>', "got 'https://a/x.png'"),
    "filter": (f'{ROOT}<feImage href="file:///x.png"/></svg>', "got 'file:///x.png'"),
    "use": (f'{ROOT}<use href="other.svg#a"/></svg>', "got 'other.svg#a'"),
    "use of data": (f'{ROOT}<use href="{data_of(NESTED)}"/></svg>', "got 'data:"),
    "paint": (f'{ROOT}<g fill="url( \'x.svg#a\' )"/></svg>', "got 'x.svg#a'"),
    "style": (f'{ROOT}<g style="mask: URL(x.svg#a)"/></svg>', "got 'x.svg#a'"),
    "style sheet": (f"{ROOT}<style>g {{ mask: url(x.svg) }}</style></svg>", "got 'x.svg'"),
    "import": (f'{ROOT}<style>@IMPORT "x.css";</style></svg>', "@import of a style sheet"),
    "escaped paint": (f"{ROOT}<g style='fill:\\75r\\6c(x.svg)'/></svg>", "got 'x.svg'"),
    "escaped import": (f"{ROOT}<style>@\\69mport 'x.css';</style></svg>", "@import of a style"),
    "instruction": (f'<?xml-stylesheet href="x.css"?>{ROOT}</svg>', "@import of a style sheet"),
    "style sheet of a page": (
        f'{ROOT}<h:style {XHTML}>@import "x.css";</h:style></svg>', "@import of a style sheet",
    ),
    "element in a style sheet": (
        f'{ROOT}<style>@imp<g>x</g>ort "x.css";</style></svg>', "be of text alone; got <g> in it",
    ),
    "set of images": (f"{ROOT}<g style='fill:image-set(\"x.png\" 1x)'/></svg>", "got 'x.png'"),
    "picture of a page": (f'{ROOT}<h:img {XHTML} src="x.png"/></svg>', "got 'x.png'"),
    "base": (f'{ROOT}<image xml:base="/etc/x.png" href=""/></svg>', "got '/etc/x.png'"),
    "nested svg": (
        f'{ROOT}<image href="{data_of(NESTED)}"/></svg>', "data: in the SVG must be an image",
    ),
    "other format": (
        f'{ROOT}<image href="{data_of(bmp())}"/></svg>', "data: in the SVG must be an image",
    ),
    "nested bomb": (
        f'{ROOT}<image href="{data_of(gzip.compress(NESTED))}"/></svg>',
        "data: in the SVG must be an image",
    ),
    "large picture": (
        f'{ROOT}<image href="{data_of(png(20000, 9500))}"/></svg>',
        "image in the SVG must be smaller",
    ),
    "large pictures": (
        ROOT + f'<image href="{data_of(png(6000, 6000))}"/>' * 3 + "</svg>",
        "at most 100000000 px together; got 108000000",
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    ("renderer", "name"),
    [("resvg", name) for name in REFUSED]
    + [
        (renderer, name)
        for renderer in ("chromium", "librsvg", "inkscape")
        for name in ("external entity", "local picture", "picture of an editor", "escaped paint")
    ],
    indirect=["renderer"],
)
def test_it_is_refused_in_one_line(name, renderer, tmp_path, capsys):
    svg, message = REFUSED[name]
    (tmp_path / "x.svg").write_text(svg)
    Image.fromarray(np.zeros((8, 8, 3), np.uint8)).save(tmp_path / "x.png")
    before = sorted(tmp_path.iterdir())
    names = [str(tmp_path / n) for n in ("x.png", "x.svg", "r.json")]
    command = ["check", *names[:2], "--report", names[2], "--renderer", renderer]
    assert main(command) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err
    assert err.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    "inner",
    [
        '<use href="#a"/>',
        '<a xlink:href="https://example.com"><g/></a>',
        '<g fill="url(#a)" style="mask:url(\'#b\')"/>',
        "<style>@namespace url(http://a); /* url(x) */ g { fill: url(#a) }</style>",
        "<style>@font-face { src: url(data:font/woff2;base64,AAAA) }</style>",
        '<image href=""/>',
        "<style>g { fill: image-set(url(#a) 1x type('image/png'), 'data:image/png;base64,AA' 2x) }"
        "</style>",
        f'<h:a {XHTML} href="https://example.com"><h:img src="#a" alt="x.png"/></h:a>',
        f'<h:img {XHTML} src="{data_of(png(3, 2))}" title="image-set"/>',
        '<g class="image" data="1" src="x"/>',
        f'<image href="{data_of(png(3, 2))}"/>',
    ],
)
def test_what_stays_within_the_file_is_let_through(inner):
    assert survey(f"{ROOT}{inner}</svg>", 10)[0].elements > 1


LOADED = ("x.png", "file:///x.png", "https://a/x.png", "//a/x.png", "/etc/x.png")


@pytest.mark.parametrize("function", ["url", "src", "image", "image-set", "cross-fade"])
@pytest.mark.parametrize("prefix", ["", "-webkit-", "-MOZ-"])
def test_no_function_of_css_loads(function, prefix):
    spelled = {f"{prefix}{function}", function.upper(), f"\\{ord(function[0]):x} {function[1:]}"}
    for name in spelled:
        for target in LOADED:
            for value in (f"{name}('{target}' 1x)", f"{name}( {name}('{target}'), #000)"):
                sheet = f"g {{ background: none, {value} }}"
                for svg in (f'<g style="fill: {value}"/>', f"<style>{sheet}</style>",
                            f"<h:style {XHTML}>{sheet}</h:style>", f'<g fill="{value}"/>',
                            f'<h:p {XHTML} style="content: {value}"/>'):  # fmt: skip
                    with pytest.raises(InputError, match="reference in the SVG must be within"):
                        survey(f"{ROOT}{svg}</svg>", 9)
    indirect = f"--a: 'x.png'; background: {prefix}{function}(var(--a) 1x)"
    if function != "url":  # a function of which no part is taken from elsewhere
        with pytest.raises(InputError, match=r"got '.*\(var\(\)\)'"):
            survey(f'{ROOT}<g style="{indirect}"/></svg>', 9)


LOADING = ("src", "srcset", "href", "data", "poster", "background", "imagesrcset", "srcdoc", "code")


@pytest.mark.parametrize("attribute", LOADING)
@pytest.mark.parametrize(
    "space", ["http://www.w3.org/1999/xhtml", "http://www.w3.org/1998/Math/MathML"]
)
def test_no_attribute_of_another_namespace_loads(attribute, space):
    for tag in ("img", "object", "video", "body", "link", "style", "any"):
        for target in LOADED:
            inner = f'<x:{tag} xmlns:x="{space}" {attribute}="{target}"/>'
            for svg in (inner, inner.replace("x:", "").replace("xmlns:x", "xmlns"),
                        f"<foreignObject><g>{inner}</g></foreignObject>"):  # fmt: skip
                with pytest.raises(InputError, match="reference in the SVG must be within"):
                    survey(f"{ROOT}{svg}</svg>", 9)


def test_gzip_bomb_is_refused_without_being_unpacked(monkeypatch):
    unpacked = []
    real = gzip.GzipFile.read

    def counted(self, size=-1):
        data = real(self, size)
        unpacked.append(len(data))
        return data

    monkeypatch.setattr(gzip.GzipFile, "read", counted)
    packer = zlib.compressobj(wbits=31)
    bomb = b"".join(packer.compress(bytes(1 << 20)) for _ in range(50)) + packer.flush()
    with pytest.raises(InputError, match="gunzipped, must be at most 1000000 bytes"):
        svg_source(bomb, 1_000_000)
    assert sum(unpacked) == 1_000_001
    unpacked.clear()
    with pytest.raises(InputError, match="gunzipped, must be at most 2000000 bytes") as caught:
        read_svg(bomb, max_bytes=2_000_000)
    assert "\n" not in str(caught.value)
    assert sum(unpacked) == 2_000_001


def test_broken_gzip_is_refused():
    whole = gzip.compress(f"{ROOT}</svg>".encode())
    for broken in (whole[:-9], whole[:12] + b"\xff" * 9 + whole[21:]):
        with pytest.raises(InputError, match="complete gzip file"):
            svg_source(broken, 1000)


def test_endless_stream_is_not_read_to_its_end():
    class Endless(io.RawIOBase):
        def read(self, size=-1):
            assert size >= 0
            return b"<" * size

    with pytest.raises(InputError, match="at most 1000 bytes"):
        svg_source(Endless(), 1000)


def test_limits_are_the_last_that_is_let_through():
    svg = f"{ROOT}<g/><g/></svg>"
    assert survey(svg, 3)[0].tags == {"g": 2, "svg": 1}
    assert svg_source(svg, len(svg))[1] == svg
    with pytest.raises(InputError, match="at most 2 elements"):
        survey(svg, 2)
    with pytest.raises(InputError, match=f"at most {len(svg) - 1} bytes"):
        svg_source(svg, len(svg) - 1)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_text_is_read_in_its_encoding(encoding):
    svg = f"{ROOT}<title>Größe</title></svg>"
    assert svg_source(svg.encode(encoding), 10_000)[1] == svg


def test_declared_encoding_is_believed():
    svg = f"<?xml version='1.0' encoding='windows-1252'?>{ROOT}<title>10 €</title></svg>"
    assert svg_source(svg.encode("cp1252"), 10_000)[1] == svg


def test_null_characters_are_no_text():
    # expat takes these for UTF-16 and sees elements that no renderer of the text does
    with pytest.raises(
        InputError, match=r"got null characters, read as utf-8. Try to save it as UTF-8"
    ):
        svg_source(f"{ROOT}</svg>".encode("utf-16-le"), 10_000)


def test_tree_that_is_read_has_limits(tmp_path):
    inner = "<g></g>" * 9
    with pytest.raises(
        InputError, match=r"at most 9 elements; got more. Try a larger max_elements"
    ):
        read_svg(f"{ROOT}{inner}</svg>", max_elements=9)
    path = tmp_path / "x.svg"
    path.write_text(f"{ROOT}{inner}</svg>")
    with pytest.raises(InputError, match=r"at most 100 bytes; got more. Try a larger max_bytes"):
        read_svg(path, max_bytes=100)
    for tag in ("g", "style", "title"):
        deep = f"<{tag}>" * 1000 + f"</{tag}>" * 1000
        with pytest.raises(InputError, match="nested at most 1000 deep"):
            read_svg(f"{ROOT}{deep}</svg>")


MANY = 40_000
CHAIN = "".join(f'<radialGradient id="c{i}" xlink:href="#c{i + 1}"/>' for i in range(5000))
CHAIN += gradient("c5000")
HOSTILE = {
    "digits": f'<svg width="{"9" * MANY}x" viewBox="0 0 8 8"',
    "spaces": f'<svg width="9{" " * MANY}x" viewBox="0 0 8 8"',
    "word": f'{ROOT[:-1]} filter="url(#a)" transform="{"a" * MANY}"',
    "calls": f'{ROOT[:-1]} filter="url(#a)" transform="{"a(" * MANY}"',
    "unclosed comments": f"{ROOT}<style>{'/*' * MANY}</style>",
    "unclosed rules": f"{ROOT}<style>{'a{' * MANY}</style>",
    "one selector": f"{ROOT}<style>{'a' * MANY}</style>",
    "media": f"{ROOT}<style>{'@media ' * MANY}</style>",
    "keyframes": f"{ROOT}<style>{'@keyframes a{b{c}' * MANY}</style>",
    "open keyframes": f"{ROOT}<style>@keyframes a{{{'b{c:d}' * MANY}</style>",
    "chain": f"{ROOT}{CHAIN}" + "".join(f'<circle r="1" fill="url(#c{i})"/>' for i in range(5000)),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_time_grows_no_faster_than_the_text(name):
    svg = HOSTILE[name]
    svg += "/>" if svg.endswith('"') else "</svg>"
    begun = time.process_time()
    with contextlib.suppress(InputError, RendererError):
        _, text = svg_source(svg, len(svg))
        frame_of(survey(text, MANY)[0].root)
        refuse_unsupported(text, 8, 8, "resvg")
    with contextlib.suppress(InputError):
        read_svg(svg)
    assert time.process_time() - begun < 2


def test_one_large_attribute_is_parsed_once():
    begun = time.process_time()
    survey(f'{ROOT[:-1]} a="{"x" * 20_000_000}"/>', 9)
    assert time.process_time() - begun < 2
