"""Laws of what is written: no script, no entity, nothing from outside, whatever it is told to say.

Read by expat alone, which knows nothing of this package.
"""

import re
from collections import defaultdict
from pathlib import Path
from typing import get_args
from xml.parsers import expat

import numpy as np
import pytest
from conftest import random_scene, random_sum
from hypothesis import given
from hypothesis import strategies as st

from gauss2svg.errors import InputError
from gauss2svg.scene import PLAIN
from gauss2svg.svg.document import Document, Form, SvgFormat
from gauss2svg.svg.minimal import minimal_svg
from gauss2svg.svg.write import outline_svg, write_svg

SCENE, ADDITIVE = random_scene(8, 40, 30, 1, sigma=(2.0, 9.0)), random_sum(6, 40, 30, 2)
IN_INKS = SCENE.replace(
    color=np.round(SCENE.color), opacity=np.ones(8), drawn=np.full(8, PLAIN), round_index=None
)
CRISP = SCENE.replace(beta=np.full(8, 64.0), opacity=np.resize([0.5, 1.0], 8))
MINIMAL = SvgFormat(markup="minimal", precision=0.5)
WRITERS = {
    **{
        form: lambda form=form, **said: write_svg(SCENE, SvgFormat(form=form), Document(**said))
        for form in get_args(Form)
    },
    "stops": lambda **said: write_svg(SCENE, SvgFormat(stops=12), Document(**said)),
    "additive": lambda **said: write_svg(ADDITIVE, None, Document(**said)),
    "outline": lambda **said: outline_svg(SCENE, Document(**said)),
    "pens": lambda **said: outline_svg(SCENE, Document(**said), pens=2),
    "sized": lambda **said: write_svg(SCENE, None, Document(**said, size="9mm", aspect="none")),
    "animated": lambda **said: write_svg(SCENE, None, Document(**said, animate=3.0)),
    "fragments": lambda **said: write_svg(SCENE, None, Document(**said, fragments=True)),
    "inks": lambda **said: write_svg(IN_INKS, SvgFormat(layers="inks"), Document(**said)),
    "masks": lambda **said: write_svg(SCENE.concatenate(SCENE), MINIMAL, Document(**said)),
    "arcs": lambda **said: write_svg(CRISP, MINIMAL, Document(**said)),
    "gradients": lambda **said: minimal_svg(SCENE, 0.5, 6, Document(**said), masked=False),
    "both": lambda **said: minimal_svg(
        SCENE.concatenate(CRISP), 0.5, 3, Document(**said), masked=False
    ),
}  # fmt: skip
PAGE = Path(__file__).parents[2] / "docs/reference/svg.md"


def subset():
    """The attributes of each element, by the rows of the page's table."""
    allowed, names = defaultdict(set), []
    text = PAGE.read_text(encoding="utf-8").split("| element | attributes | in files |\n", 1)[1]
    for line in text.split("\n\n")[0].splitlines()[1:]:
        _, elements, attributes, *_ = line.split("|")
        names = re.findall(r"`(\w+)`", elements) or names
        for name in names:
            allowed[name].update(attributes.replace("`", "").split())
    return allowed


ELEMENTS = subset()
NAMESPACES = {
    "http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink",
    "http://www.inkscape.org/namespaces/inkscape", "http://www.w3.org/2001/xml-events",
    "http://sodipodi.sourceforge.net/DTD/sodipodi-0.dtd",
}  # fmt: skip
HOSTILE = [
    "</title><script>alert(1)</script>", "]]><script/>", "<![CDATA[<script/>]]>",
    "--><script/><!--", "&lol;", "&amp;lt;script&amp;gt;", '"><image href="http://a/x.png"/>',
    "<?xml-stylesheet href='a'?>", "<!DOCTYPE svg [<!ENTITY a SYSTEM 'file:///etc/passwd'>]>&a;",
    "' onload='alert(1)", "&#60;b&#62;", "url(http://a)", "javascript:alert(1)", "\u2028 ]]&gt;",
]  # fmt: skip


def read(svg):
    """Texts of the elements by name; AssertionError for what must not be in the file."""
    texts, path, seen = {}, [], defaultdict(set)

    def begin(name, attributes):
        space, _, tag = name.rpartition(" ")
        assert space == "http://www.w3.org/2000/svg"
        assert tag in ELEMENTS
        seen[tag].update()
        path.append(tag)
        texts.setdefault(tag, "")
        for key, value in attributes.items():
            seen[tag].add(key.replace("http://www.inkscape.org/namespaces/inkscape ", "inkscape:"))
            assert key != "href" or value.startswith("#")
            for target in re.findall(r"url\(([^)]*)", value):
                assert re.fullmatch(r"#[\w-]+", target)
            assert "script:" not in value
            assert "//" not in value

    def forbidden(*_):
        raise AssertionError("a declaration that must not be there")

    parser = expat.ParserCreate(namespace_separator=" ")
    parser.StartElementHandler = begin
    parser.EndElementHandler = lambda _: path.pop()
    parser.CharacterDataHandler = lambda text: texts.update({path[-1]: texts[path[-1]] + text})
    parser.StartNamespaceDeclHandler = lambda _, uri: NAMESPACES.__contains__(uri) or forbidden()
    for name in (
        "StartDoctypeDeclHandler", "EntityDeclHandler", "ProcessingInstructionHandler",
        "UnparsedEntityDeclHandler", "NotationDeclHandler", "ExternalEntityRefHandler",
        "SkippedEntityHandler",
    ):  # fmt: skip
        setattr(parser, name, forbidden)
    parser.Parse(svg.encode(), True)
    for tag, attributes in seen.items():
        assert attributes <= ELEMENTS[tag], tag
    sheet = texts.get("style", "")
    assert not re.search(r"@import|url\(|expression|//|\\", sheet)
    texts["seen"] = seen
    return texts


def test_the_table_has_nothing_that_no_file_has():
    found = defaultdict(set)
    for writer in WRITERS.values():
        for tag, attributes in read(writer(title="a", alt="b"))["seen"].items():
            found[tag] |= attributes
    assert found == ELEMENTS


@pytest.mark.parametrize("writer", WRITERS)
def test_nothing_but_shapes_is_written_whatever_is_said(writer):
    said = " ".join(HOSTILE)
    texts = read(WRITERS[writer](title=f"a {said} b", alt=f"c {said} d"))
    assert texts["title"] == f"a {said} b"
    assert texts["desc"] == f"c {said} d"


@pytest.mark.parametrize("said", HOSTILE)
def test_each_text_is_kept_as_it_is(said):
    assert read(write_svg(SCENE, None, Document(title=said, alt=said)))["title"] == said


@given(st.text(max_size=40), st.sampled_from(list(WRITERS)))
def test_any_text_is_kept_or_refused(said, writer):
    try:
        Document(title=said, alt=said)
    except InputError:
        return
    # XML makes every end of a line one \n.
    expected = said.replace("\r\n", "\n").replace("\r", "\n")
    texts = read(WRITERS[writer](title=said, alt=said))
    assert texts["title"] in (said, expected)
    assert texts["desc"] in (said, expected) or not said


def test_what_must_not_be_there_is_seen():
    whole = write_svg(SCENE)
    for bad in (
        "<script/>", '<a/>', '<g onload="a"/>', '<g fill="url(http://a)"/>', "<?a b?>",
        '<rect xlink:href="#a"/>', "<style>@import 'a'</style>", '<g xmlns="http://a"/>',
    ):  # fmt: skip
        with pytest.raises((AssertionError, expat.ExpatError)):
            read(whole.replace("</svg>", f"{bad}</svg>"))
    with pytest.raises(AssertionError):
        read(whole.replace("<svg", "<!DOCTYPE svg><svg", 1))


@pytest.mark.parametrize("writer", WRITERS)
def test_text_depends_on_nothing_but_what_is_given(writer):
    assert WRITERS[writer]() == WRITERS[writer]()


@pytest.mark.parametrize(
    ("write", "element"),
    [
        (write_svg, "<circle"), (outline_svg, "<ellipse"),
        (lambda scene: write_svg(scene, MINIMAL), "<use"),
        (lambda scene: write_svg(scene.replace(opacity=np.ones(4), blend="add")), "<circle"),
    ],
)  # fmt: skip
def test_shapes_that_would_be_written_as_nothing_are_left_out(write, element):
    scene = random_scene(4).replace(
        sigma=[[8, 8], [1e-4, 8], [8, 1e-4], [8, 8]], opacity=[1, 1, 1, 1e-4], rho=np.zeros(4),
        color=[[0.5, 0, 0], [1, 1, 1], [1, 1, 1], [1e-5, 0, 0]], beta=np.ones(4), round_index=None,
    )  # fmt: skip
    assert write(scene).count(element) == 1
