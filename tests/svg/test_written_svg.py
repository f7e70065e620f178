"""Properties of files: no script, no entity, nothing from outside, whatever is said in them."""

import dataclasses
import re
from collections import defaultdict
from functools import partial
from pathlib import Path
from typing import get_args
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import minimal_by_gradients, random_areas, random_scene, random_sum, with_levels

from gauss2svg.errors import InputError, SceneError
from gauss2svg.pipeline.plot import plotted
from gauss2svg.scene import PLAIN, Scene
from gauss2svg.scene.inks import ink_name
from gauss2svg.svg import Document, Form, Plotter, SvgFormat
from gauss2svg.svg.encode import outline_svg
from gauss2svg.svg.untrusted import Survey
from gauss2svg.svg.write import plate_svg, with_marks, write_svg

SCENE, ADDITIVE = random_scene(8, 40, 30, 1, sigma=(2.0, 9.0)), random_sum(6, 40, 30, 2)
IN_INKS = SCENE.replace(
    color=np.round(SCENE.color), opacity=np.ones(8), drawn=np.full(8, PLAIN), round_index=None
)
CRISP = SCENE.replace(beta=np.full(8, 64.0), opacity=np.resize([0.5, 1.0], 8))
ROUND = next(one for one in random_areas(40, 5) if (one.cap, one.width) == ("round", 3))
AREAS = SCENE.replace(areas=[*random_areas(40, 5), ROUND, ROUND])  # the last are a group
AREAS = with_levels(AREAS.select([0, 1]), 5).concatenate(AREAS.replace(areas=()))
ONE_COLOUR = [dataclasses.replace(a, paint=(0.2, 0, 0)) for a in AREAS.areas]
ICON = AREAS.select([]).replace(areas=ONE_COLOUR)
MINIMAL = SvgFormat(markup="minimal", precision=0.5)
BY_INK = SvgFormat(layers="inks")
# What writes each kind of file with the names of a document.
WRITERS = {
    **{form: partial(write_svg, SCENE, SvgFormat(form=form)) for form in get_args(Form)},
    "stops": partial(write_svg, SCENE, SvgFormat(stops=12)),
    "additive": partial(write_svg, ADDITIVE, None),
    "outline": partial(outline_svg, SCENE),
    "plot": lambda document: (
        plotted(SCENE, Plotter(sheet="60x60mm", margin=5.0, hatch=6.0), document).svg
    ),
    "inks": partial(write_svg, IN_INKS, BY_INK),
    "masks": partial(write_svg, SCENE.concatenate(SCENE), MINIMAL),
    "arcs": partial(write_svg, CRISP, MINIMAL),
    "gradients": partial(minimal_by_gradients, SCENE, 0.5, 6),
    "both": partial(minimal_by_gradients, SCENE.concatenate(CRISP), 0.5, 3),
    "areas": partial(write_svg, AREAS, None),
    "minimal areas": partial(write_svg, AREAS, MINIMAL),
    "outlined areas": partial(outline_svg, AREAS),
    "an icon": partial(write_svg, ICON, SvgFormat(current_color=True)),
    "a plate with marks": lambda document: with_marks(
        plate_svg(IN_INKS, ink_name(IN_INKS.inks[0]), document), IN_INKS, document, "1 & 2"
    ),
}
# What more a document of an editable file says.
SAID = {
    "sized": {"size": "9mm", "aspect": "none"}, "animated": {"animate": 3.0},
    "fragments": {"fragments": True},
}  # fmt: skip


KINDS = [*WRITERS, *SAID]


def written(kind, **said):
    """The file of a kind, by a document that says so."""
    document = Document(**said, **SAID.get(kind, {}))
    return WRITERS.get(kind, WRITERS["gradient"])(document=document)


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
SVG, INKSCAPE = "{http://www.w3.org/2000/svg}", "{http://www.inkscape.org/namespaces/inkscape}"
HOSTILE = [
    "</title><script>alert(1)</script>", "]]><script/>", "<![CDATA[<script/>]]>",
    "--><script/><!--", "&lol;", "&amp;lt;script&amp;gt;", '"><image href="http://a/x.png"/>',
    "<?xml-stylesheet href='a'?>", "<!DOCTYPE svg [<!ENTITY a SYSTEM 'file:///etc/passwd'>]>&a;",
    "' onload='alert(1)", "&#60;b&#62;", "url(http://a)", "javascript:alert(1)", "\u2028 ]]&gt;",
]  # fmt: skip


def read(svg):
    """Return the texts and attributes of elements by name, if nothing else is in the file."""
    assert not re.search(r"<\?(?!xml )|<!(?!\[CDATA\[)", svg)  # a declaration
    texts, seen = defaultdict(str), defaultdict(set)
    for element in ElementTree.fromstring(svg).iter():
        tag = element.tag.removeprefix(SVG)
        texts[tag] += element.text or ""
        seen[tag] |= {name.replace(INKSCAPE, "inkscape:") for name in element.attrib}
        assert element.get("href", "#").startswith("#")
        for value in element.attrib.values():
            targets = re.findall(r"url\(([^)]*)", value)
            assert all(re.fullmatch(r"#[\w-]+", target) for target in targets)
            assert not re.search("script:|//", value)
    assert set(seen) <= set(ELEMENTS)
    assert all(attributes <= ELEMENTS[tag] for tag, attributes in seen.items())
    assert not re.search(r"@import|url\(|expression|//|\\", texts["style"])
    return texts, seen


def test_the_table_has_nothing_that_no_file_has():
    found = defaultdict(set)
    for kind in KINDS:
        for tag, attributes in read(written(kind, title="a", alt="b"))[1].items():
            found[tag] |= attributes
    assert found == ELEMENTS


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_but_shapes_is_written_whatever_is_said_and_all_is_drawn_alike(kind):
    for said in (HOSTILE[0], " ".join(HOSTILE)):
        svg = written(kind, title=f"a {said}", alt=f"{said} b")
        texts, _ = read(svg)
        assert (texts["title"], texts["desc"]) == (f"a {said}", f"{said} b")
    assert not Survey(svg[svg.index("<svg") :]).unknown


@given(
    st.text(max_size=40), st.sampled_from(["gradient", "additive", "arcs", "a plate with marks"])
)
def test_any_text_is_kept_or_refused(said, kind):
    try:
        Document(title=said, alt=said)
    except InputError:
        return
    # XML makes every end of a line one \n.
    expected = said.replace("\r\n", "\n").replace("\r", "\n")
    texts, _ = read(written(kind, title=said, alt=said))
    assert texts["title"] in (said, expected)
    assert texts["desc"] in (said, expected) or not said


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


# The line, the writer, and what it is given.
REFUSED = [
    ("scene must be a Scene; got int", write_svg, 3),
    ("of opaque plain ellipses and areas alone", write_svg, ADDITIVE, BY_INK),
    ("given with layers inks", write_svg, IN_INKS, BY_INK, Document(animate=2.0)),
    ("one of #000000.*; got '#000'", plate_svg, IN_INKS, "#000"),
    (r"size must be larger; .*3000x1 px 0\.1000 by 0\.0000mm", write_svg, Scene(3000, 1), None,
     Document(size="0.1mm")),
    ("must reach at most", write_svg, SCENE.replace(sigma=np.full((8, 2), 1e9))),
    *(("canvas of an SVG must be", write_svg, SCENE.replace(width=1e-5), form)
      for form in (None, MINIMAL)),
]  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_written_is_refused_in_one_line(case):
    line, write, *given = case
    with pytest.raises((InputError, SceneError), match=line) as caught:
        write(*given)
    assert "\n" not in str(caught.value)
