"""Laws of reading: what a scene cannot hold is refused in one line that names the element."""

import pytest
from svg_texts import AS_PATH, CIRCLE, RECT, document

from gauss2svg.errors import InputError
from gauss2svg.svg.reader.read import read_svg

USER_REGION = (
    '<filter id="user" filterUnits="userSpaceOnUse" x="-11" y="-11" width="22" height="22">'
    '<feGaussianBlur stdDeviation="2"/></filter>'
)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<text id="t">a</text>', '<text id="t">: elements must be ellipses'),
        ('<image id="i" href="a.png"/>', '<image id="i">'),
        ('<use id="u" href="#x"/>', "unlink the clone"),
        ('<path id="p" d="M 0 0 L 9 9 Z" fill="red"/>', '<path id="p">: its d must be an'),
        ('<path d="M1 0A1 1 0 0 1 0 1Z" fill="red"/>', "an ellipse of two or four arcs"),
        (f'<path {AS_PATH.replace("-1,0 1", "-2,0 1")} fill="red"/>', "two or four arcs"),
        ('<circle id="c" r="5" stroke="red"/>', '<circle id="c">: its stroke'),
        ('<circle id="c" r="5" style="stroke:#000"/>', '<circle id="c">: its stroke'),
        ('<g clip-path="url(#x)"/>', "its clip-path"),
        ('<circle r="5" mask="url(#x)"/>', "its mask"),
        ('<g style="mix-blend-mode:screen"/>', "its mix-blend-mode"),
        ("<style>#a rect{mix-blend-mode:difference}</style>", "blend must be 'over'.*--save-scene"),
        (f'<g id="h" style="display:none">{CIRCLE}</g>', '<g id="h">: .*got a hidden.*skip_hidden'),
        ('<circle r="5" visibility="hidden"/>', "got a hidden one"),
        (f'<g id="o" opacity=".5">{2 * CIRCLE}</g>', '<g id="o">: opacity of a group of 2'),
        ('<rect width="5" height="5"/>', "got x 0..5"),
        ('<rect x="5" width="99" height="99"/>', "got x 5..104"),
        ('<rect width="99" height="29"/>', "got x 0..99, y 0..29"),
        ('<rect x="-99" y="-99" width="300" height="300" transform="rotate(5)"/>', "upright"),
        (CIRCLE + RECT, "over shapes"),
        ('<circle r="nan"/>', "<circle r=\"nan\">: r must be .* got 'nan'"),
        ('<circle r="1e999"/>', "finite"),
        ('<circle r="-1"/>', "radii must be 0 or more; got -1"),
        ('<circle id="z" r="0" fill="red"/>', '<circle id="z">: its extent must'),
        ('<circle r="1" transform="matrix(1 1 1 1 0 0)" fill="red"/>', "its extent must"),
        ('<circle r="1" fill="none"/>', "fill must be .* got 'none'"),
        ('<circle r="1" fill="#ff00ff80"/>', "opaque colour"),
        ('<circle r="1" transform="matrix(1 2 3)" fill="red"/>', "transform must be a list"),
        ('<circle r="1" transform="matrix(1e200 0 0 1e200 0 0) scale(1e200)" fill="red"/>',
         "above 0 and finite"),
        ('<circle r="1" transform="turn(3)" fill="red"/>', "transform must be a list"),
        ('<circle r="1" fill="url(#missing)"/>', "gradient 'missing'.*is missing"),
        ('<circle r="1" fill="url(#loop)"/>', "refers to itself"),
        ('<circle r="1" fill="url(#cone)"/>', "one of the exponents"),
        ('<circle r="1" fill="url(#two)"/>', "of one colour; got 2 colours"),
        ('<circle r="1" fill="url(#line)"/>', "linear"),
        ('<circle r="1" fill="url(#aside)"/>', "'aside': its focus must be its centre; .* 0.3 rad"),
        ('<circle r=".9" transform="scale(9)" fill="url(#a)"/>', "cuts off 0.9 px"),
        ('<circle r="1" cx=".1" transform="scale(9)" fill="url(#a)"/>', "cuts off 0.9 px"),
        ('<circle id="b" r="5" fill="red" filter="url(#faint)"/>',
         '<circle id="b">.*must be 0.5..16'),
        ('<circle id="b" r="5" fill="red" filter="url(#a)"/>', "filter"),
        ('<circle r="0" fill="red" filter="url(#blur)"/>', "got a radius of 0"),
        ('<rect width="99" height="99" transform="matrix(1e308 0 0 1e308 0 0) scale(1e9)"/>',
         "got x nan..nan"),
        ("<g stroke='" + "a" * 9999 + "'/>", r"its stroke must .*; got 'a{199}\.\.\."),
        ('<g filter="url(#blur)"/>', "filter of a group"),
        ("<style>circle{fill:red}</style>", "got fill"),
        ("<style>@keyframes a{from{r:0}} circle { opacity : .5 }</style>", "got opacity"),
        ("<style>circle{FILL:red}</style>", "got fill"),
        ("<defs><style>circle{fill:red}</style></defs>", "got fill"),
        (f"<g><g>{CIRCLE}<style>*{{opacity:.5}}</style></g></g>", "got opacity"),
        (f"{CIRCLE[:-2]}><style>*{{opacity:.5}}</style></circle>", "got opacity"),
        (r"<style>circle{f\69ll:red}</style>", "got an escape"),
        ("<style>rect{width:1px}</style>", "got width"),
        ("<style>@media print{rect{animation:a 1s;width:1px}}</style>", "got width"),
        ("<style>@media print{g{animation:a 1s}circle{r:2}}</style>", "got r[.]"),
        ("<style>@import 'a.css';</style>", "got @import"),
        ("<style>@supports (r:1){g{animation:a 1s}}</style>", "got @supports"),
        ("<style>g{animation:a 1s forwards}</style>", "animation must .* got 'forwards'"),
        ('<g style="animation:a 1s infinite"/>', "animation must .* got 'infinite'"),
        ('<circle r="1"><set attributeName="r" to="9"/></circle>', "<set.*changes what is drawn"),
        ('<circle r="1"><animate attributeName="r" to="9" fill="freeze"/></circle>',
         "fill must be .* got 'freeze'"),
        ('<defs><animate repeatCount="indefinite"/></defs>', "repeatCount must be .* 'indefinite'"),
        ('<circle r="1" transform-origin="3 3" transform="scale(2)"/>', "its transform-origin"),
        ('<g style="Rotate:9deg"/>', "its rotate must .* got '9deg'"),
        ('<g systemLanguage="de"/>', "its systemLanguage"),
        ('<circle r="1" style="Stroke:red"/>', "its stroke"),
        ('<circle r="1" style="display:NONE"/>', "got a hidden one"),
        (r'<circle r="1" style="f\69ll:red"/>', "without escapes and !important"),
        ('<circle r="1" style="fill:red!important;fill:blue"/>', "without escapes and !important"),
        ('<circle r="5" fill="red" filter="url(#narrow)"/>', "x and width of .* got 0.4"),
        ('<circle r="5" cx="9" fill="red" filter="url(#user)"/>', "x and width of .* got -1.5"),
        ('<circle r="5" fill="red" filter="url(#alpha)"/>', "in of its blur .* got 'SourceAlpha'"),
        ('<circle r="5" fill="red" filter="url(#cut)"/>', "x of its blur .* got '0'"),
        ('<circle r="1" style="transform:scale(2)"/>', "its transform must be an attribute"),
        ('<g id="round-0"/>', "its round must be 1 or more"),
        ("<g>" * 200 + "</g>" * 200, "nested"),
        ("<svg/>", "must be ellipses alone"),
        ("<script/>", "must be ellipses alone"),
    ],
)  # fmt: skip
def test_what_a_scene_cannot_hold_is_refused_by_name(body, message):
    red, clear = '<stop offset="0" stop-color="red"/>', '<stop offset="1" stop-opacity="0" '
    defs = (
        '<radialGradient id="loop" xlink:href="#pool"/><radialGradient id="pool" '
        f'xlink:href="#loop"/><radialGradient id="two">{red}{clear}/></radialGradient>'
        f'<radialGradient id="cone">{red}{clear} stop-color="red"/></radialGradient>'
        f'<radialGradient id="aside" cx="0" fx=".3" r="1">{red}{clear}/></radialGradient>'
        '<linearGradient id="line"/><filter id="blur"><feGaussianBlur stdDeviation="2"/></filter>'
        '<filter id="faint"><feGaussianBlur stdDeviation="20"/></filter>'
        '<filter id="narrow"><feGaussianBlur stdDeviation="2.5"/></filter>'
        f'{USER_REGION}<filter id="alpha"><feGaussianBlur in="SourceAlpha" stdDeviation="1"/>'
        '</filter><filter id="cut"><feGaussianBlur x="0" stdDeviation="1"/></filter>'
    )
    with pytest.raises(InputError, match=message) as caught:
        read_svg(document(body, defs))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("root", "message"),
    [
        ('width="x" height="3"', "width must be .* got 'x'"),
        ('width="0" height="3"', "canvas must be .* got 0x3"),
        ('viewBox="0 0 40"', "viewBox must be"),
        ('viewBox="0 0 40 -3"', "viewBox must be"),
        ('width="40" height="31" viewBox="0 0 40 31" data-canvas="40 30"', "page was resized"),
        ('width="40" height="30" viewBox="0 0 40 30" data-canvas="40"', "data-canvas must be"),
        ('width="40" height="3" viewBox="0 0 40 30" preserveAspectRatio="a"', "preserveAspect"),
        ("", "canvas|width"),
    ],
)
def test_canvas_that_is_none_is_refused(root, message):
    with pytest.raises(InputError, match=message):
        read_svg(document(root=root or "id='x'"))


@pytest.mark.parametrize(
    "source",
    [
        "<svg", b"\x1f\x8bx", b"\xff\xfe\x00", "<html/>", "<svg/>", b"", "/none/there.svg", 5,
        '<!DOCTYPE svg [<!ENTITY a "b">]><svg xmlns="http://www.w3.org/2000/svg">&a;</svg>',
        '<!DOCTYPE svg SYSTEM "file:///etc/passwd"><svg xmlns="http://www.w3.org/2000/svg"/>',
        b'<?xml version="1.0" encoding="rubbish"?><svg/>',
    ],
    ids=str,
)  # fmt: skip
def test_what_is_no_svg_is_one_line(source):
    with pytest.raises(
        InputError, match=r"must be an SVG|cannot read|source must|an <svg>|gzip"
    ) as caught:
        read_svg(source)
    assert "\n" not in str(caught.value)


def test_long_rubbish_is_refused_at_once():
    for rubbish in ("1" * 20000 + "x", "1 " * 20000 + "x", "1e" * 20000, "-" * 20000):
        for body in (
            f'<circle r="1" transform="matrix({rubbish})"/>',
            f'<circle r="{rubbish}"/>',
            f'<path d="M {rubbish}"/>',
        ):
            with pytest.raises(InputError):
                read_svg(document(body))


def test_root_that_is_hidden_or_fades_all_is_refused():
    size = 'width="40" height="30" viewBox="0 0 40 30"'
    with pytest.raises(InputError, match=r"<svg.*visible; got display none"):
        read_svg(document(root=f'{size} display="none"'), skip_hidden=True)
    with pytest.raises(InputError, match=r"1 shape and the background must be 1"):
        read_svg(document(root=f'{size} opacity=".5"'), background=(1, 1, 1))
    faded = document(f'<g opacity=".5">{RECT}{CIRCLE}</g>', rect="")
    with pytest.raises(InputError, match=r"1 shape and the background must be 1"):
        read_svg(faded, background=(1, 1, 1))


@pytest.mark.parametrize(
    "body",
    [
        '<circle r="5" fill="red" filter="url(#user)"/>',
        '<circle r="1" fill="red"><animate attributeName="r" from="0" to="1" dur="1s"/></circle>',
        '<style type="text/css">@media print { g { animation: a 1s backwards } }</style>',
        "<style/>",
        '<circle r="1" style="Fill:red;/* FILL:none; */-inkscape-stroke:none"/>',
        f'<g opacity=".5">{CIRCLE}</g>',
    ],
)
def test_what_draws_as_it_is_written_is_read(body):
    scene = read_svg(document(body, USER_REGION))
    assert len(scene) == body.count("<circle")
