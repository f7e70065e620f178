"""Laws of the rules on what breaks where: each can be broken, and says where it is from."""

import json
import sys
from pathlib import Path

import pytest
from conftest import random_scene

from gauss2svg.cli.main import main
from gauss2svg.errors import InputError
from gauss2svg.measure.contents import Contents
from gauss2svg.measure.places import PLACES, RULES, Finding, findings, rules_of
from gauss2svg.measure.survey import survey
from gauss2svg.raster.features import Feature
from gauss2svg.svg.format import SvgFormat
from gauss2svg.svg.write import write_svg

SVG = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">{}</svg>'
STOP = '<stop offset="0" stop-opacity=".5"/>'
SOFT = f'<radialGradient id="a">{STOP}</radialGradient>'
# Once what a rule without a limit is about.
ONCE = {
    "style sheet": "<style>.a{fill:red}</style>",
    "currentColor": '<path fill="currentColor"/>',
    "use": '<use xlink:href="#a"/>',
    "mask": "<mask/>",
    "foreignObject": "<foreignObject/>",
    Feature.FILTER: '<g filter="url(#a)"/>',
    Feature.PLAIN_HREF: '<use href="#a"/>',
    "script": "<script/>",
    "svg": "",
    "transform": '<g transform="scale(2)"/>',
    "text": "<text>a</text>",
    "borrowed places": '<radialGradient id="a" r="2"/>'
    '<radialGradient id="b" xlink:href="#a" fx="1"/>',
}
# So many of what a rule with a limit is about.
MANY = {
    "bytes": lambda n: "a" * (n - len(SVG.format(""))),
    "stops of a gradient": lambda n: f"<radialGradient>{STOP * n}</radialGradient>",
    "masked shapes": lambda n: '<path mask="url(#a)"/>' * n,
    "soft shapes": lambda n: SOFT + '<path fill="url(#a)"/>' * n,
    "elements": lambda n: "<g/>" * (n - 1),  # and the root
}


def uses(text, place):
    return {finding.rule.uses: finding.count for finding in findings(text, place)}


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: f"{rule.place}-{rule.uses}")
def test_each_rule_is_broken_by_one_more_than_its_limit_and_by_nothing_less(rule):
    if rule.over:
        over, less = (SVG.format(MANY[rule.uses](rule.over + more)) for more in (1, 0))
    elif rule.uses == "no namespace":
        over, less = "<svg/>", SVG.format("")
    else:
        over, less = SVG.format(ONCE[rule.uses]), SVG.format("<path/>")
    found = {finding.rule: finding for finding in findings(over, rule.place)}
    assert found[rule].count == rule.over + 1
    assert found[rule].line.startswith(f"{'breaks' if rule.breaks else 'slow'} in {rule.place}: ")
    assert rule.uses == "svg" or rule.uses not in uses(less, rule.place)


@pytest.mark.parametrize(
    "shape",
    [
        '<path fill="url(#a)"/>', "<path style='fill: url(\"#a\")'/>", '<path stroke="url(#a)"/>',
        '<path mask="url(#m)"/>', '<path style="mask:url(#m)"/>', '<path fill="URL( #a )"/>',
        '<defs><path id="b" fill="url(#a)"/></defs><use xlink:href="#b"/>',
        '<defs><use id="c" href="#b"/><path id="b" mask="url(#m)"/></defs><use href="#c"/>',
        '<linearGradient id="d" href="#a"/><path fill="url(#d)"/>',
    ],
)  # fmt: skip
def test_a_shape_is_soft_by_its_gradient_or_its_mask_or_by_what_it_uses(shape):
    assert uses(SVG.format(SOFT + shape * 251), "pdf")["soft shapes"] == 251


@pytest.mark.parametrize(
    "stop",
    [
        '<stop/>', '<stop stop-opacity="1"/>', '<stop stop-opacity="100%"/>',
        '<stop style="stop-color:#fff;stop-opacity:1"/>', '<stop stop-color="rgba(1,2,3,1)"/>',
        '<stop stop-color="rgb(1 2 3 / 100%)"/>', '<stop stop-color="color()"/>',
    ],
)  # fmt: skip
def test_a_gradient_of_opaque_stops_is_not_soft(stop):
    """Nor is one of which nothing is filled, beside one that is."""
    paths = '<path fill="url(#o)"/>' * 999
    text = SVG.format(f'{SOFT}<radialGradient id="o">{stop}</radialGradient>{paths}')
    assert "soft shapes" not in uses(text, "pdf")


@pytest.mark.parametrize(
    "stop",
    [
        '<stop stop-opacity="50%"/>', '<stop style="stop-opacity: .5"/>',
        '<stop stop-color="rgba(1,2,3,.5)"/>', '<stop stop-color="transparent"/>',
        '<stop stop-color="rgb(0 0 0 / 50%)"/>', '<stop stop-color="RGBA(0,0,0,50%)"/>',
        '<stop stop-color="hsl(0 0% 0% / .5)"/>', '<stop style="stop-color:/**/#0008"/>',
        '<stop/><style>stop{stop-opacity:.5}</style>',
    ],
)  # fmt: skip
def test_a_gradient_with_a_stop_that_lets_something_through_is_soft(stop):
    paths = '<path fill="url(#o)"/>' * 251
    text = SVG.format(f'<radialGradient id="o"><stop/>{stop}</radialGradient>{paths}')
    assert uses(text, "pdf")["soft shapes"] == 251


@pytest.mark.parametrize("mask", ['mask="NONE"', 'style="mask: None"', 'style="/*;mask:url(#m)*/"'])
def test_a_mask_that_is_none_is_none(mask):
    assert "masked shapes" not in uses(SVG.format(f"<path {mask}/>" * 101), "web")


def test_shapes_that_are_defined_and_not_drawn_cost_nothing():
    assert "masked shapes" not in uses(
        SVG.format(f"<defs>{MANY['masked shapes'](101)}</defs><path/>"), "web"
    )


@pytest.mark.parametrize(
    ("places", "count"),
    [
        (['x1="1"', 'x1="2" x2="2"'], 0), (['x1="1"', 'x2="2"'], 1), (["", 'x1="1"'], 0),
        (['cx="1" cy="1" r="2"', 'cx="3"'], 1), (['r="2"', 'r="2"', ""], 1), (["", "", ""], 0),
        (['r="2"', "", ""], 2), (['r="2"', "", 'r="1"', ""], 2), (['r="2"', 'cx="1"', 'r="2"'], 2),
    ],
)  # fmt: skip
def test_gradients_borrow_what_a_place_before_them_has_and_theirs_has_not(places, count):
    """Each refers to the one before it; what comes first in the file does not matter."""
    gradient = '<radialGradient id="a{}" xlink:href="#a{}" {}/>'
    texts = [gradient.format(k, k - 1, place) for k, place in enumerate(places)]
    for ordered in (texts, texts[::-1]):
        found = uses(SVG.format("".join(ordered)), "inkscape")
        assert found.get("borrowed places", 0) == count


def test_chains_of_references_are_followed_once():
    """Steps are calls of functions, those of C as well."""

    def steps(count, length=90):
        chain = "".join(
            f'<linearGradient id="g{k}" href="#g{k + 1}"/><use id="u{k}" href="#u{k + 1}"/>'
            for k in range(length)
        )
        text = SOFT.replace('"a"', f'"g{length}"') + f"<defs>{chain}</defs>"
        text += f'<path id="u{length}" fill="url(#g0)"/>' + '<use href="#u0"/>' * count
        contents, calls = Contents(), []
        survey(SVG.format(text), 9999, contents)
        before = sys.getprofile()
        sys.setprofile(lambda *_: calls.append(1))
        try:
            counts = contents.counts
        finally:
            sys.setprofile(before)
        assert counts["soft shapes"] == count + 1
        return len(calls)

    assert steps(400) - steps(200) < 200 * 50


def test_references_in_a_circle_end():
    text = '<use id="a" href="#b"/><use id="b" href="#a"/><linearGradient id="c" href="#c"/>'
    assert "soft shapes" not in uses(SVG.format(text + '<path fill="url(#c)"/>' * 251), "pdf")


@pytest.mark.parametrize(
    ("text", "place", "what"),
    [
        ('<path stroke="CURRENTCOLOR"/>', "figma", "currentColor"),
        ('<path style="fill:currentColor"/>', "figma", "currentColor"),
        ('<stop style="stop-color: currentcolor !important"/>', "figma", "currentColor"),
        ("<style>a{fill:currentColor}</style>", "figma", "currentColor"),
        ('<g style="transform:scale(2)"/>', "email", "transform"),
        ('<g style="fill:red;Transform : rotate(9deg)"/>', "email", "transform"),
        ("<style>g{transform:scale(2)}</style>", "email", "transform"),
        ("<style>/* transform: x */g{transform:scale(2)}</style>", "email", "transform"),
        ('<g style="/*c*/transform:scale(2)"/>', "email", "transform"),
    ],
)
def test_what_attributes_say_styles_say_too(text, place, what):
    assert uses(SVG.format(text), place)[what] == 1


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ('<path id="currentColor"/>', "figma"), ('<g style="transform:none"/>', "email"),
        ('<g style="text-transform:uppercase;transform-origin:0 0"/>', "email"),
        ("<style>text{text-transform:uppercase}</style>", "email"),
        ("<style>/* transform: x, currentColor */</style>", "email"),
        ("<style>/* currentColor */</style>", "figma"),
        ("<style>g{transform:none}path{Transform: NONE !important}</style>", "email"),
        ('<g transform=" None"/>', "email"),
    ],
)  # fmt: skip
def test_names_that_only_look_so_are_not_found(text, place):
    assert not {"currentColor", "transform"} & uses(SVG.format(text), place).keys()


def test_every_rule_has_its_source_or_says_that_it_has_none():
    """What was tried is on a page of ours."""
    for rule in (rule for place in PLACES for rule in rules_of(place)):
        assert rule.source.startswith("docs/" if rule.tried else ("https://", ""))
        assert rule.source or (rule.place, rule.uses) in {("figma", "use"), ("figma", "mask")}
        line = Finding(rule, 1).line
        assert line.endswith(f": {rule.source}]" if rule.source else "[not tried, no source]")
        pages = Path(__file__).parents[2]
        assert not rule.tried or (pages / rule.source).is_file()


def test_what_a_renderer_draws_wrongly_breaks_where_it_draws():
    blurred = SVG.format('<filter><feGaussianBlur stdDeviation="1"/></filter>')
    assert [one.rule.uses for one in findings(blurred, "pdf")] == [Feature.BLUR]
    linked = SVG.format('<linearGradient href="#a"/>')
    assert [one.rule.uses for one in findings(linked, "inkscape")] == [Feature.PLAIN_HREF]
    assert not findings(linked, "pdf")


def test_editable_files_are_for_editors_and_minimal_ones_are_not():
    scene = random_scene(30, 60, 45, 7)
    editable = write_svg(scene)
    for place in ("figma", "penpot", "illustrator", "inkscape", "web", "pdf"):  # of few shapes
        assert not findings(editable, place)
    minimal = write_svg(scene, SvgFormat(markup="minimal"))
    for place in ("figma", "inkscape", "illustrator"):
        assert any(finding.rule.breaks for finding in findings(minimal, place))


@pytest.mark.parametrize(("count", "masked"), [(350, True), (900, False)])
def test_minimal_files_of_many_shapes_are_slow_where_each_is_soft(count, masked):
    """Masked shapes use a few circles under a few masks; gradients are softened by a sheet."""
    minimal = write_svg(random_scene(count, 60, 45, 7), SvgFormat(markup="minimal"))
    assert ("<mask" in minimal, "<style" in minimal) == (masked, not masked)
    assert ("masked shapes" in uses(minimal, "web")) == masked
    assert uses(minimal, "pdf")["soft shapes"] > count / 2


def test_the_command_has_a_line_for_each_and_a_status(tmp_path, capsys):
    path, report = tmp_path / "a.svg", tmp_path / "report.json"
    path.write_text(SVG.format(ONCE["use"] + ONCE["currentColor"]))
    assert main(["check", str(path), "--for", "figma", "--report", str(report)]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert all("breaks in figma" in line and "not tried" in line for line in lines)
    assert len(json.loads(report.read_text())["findings"]) == 2
    assert main(["check", str(path), "--for", "web"]) == 0
    assert "nothing that is known to break in web" in capsys.readouterr().err
    path.write_text(SVG.format(MANY["elements"](5001)))
    assert main(["check", str(path), "--for", "web"]) == 0  # slow alone
    assert "slow in web" in capsys.readouterr().err


def test_what_cannot_be_checked_is_refused(tmp_path, capsys):
    with pytest.raises(InputError, match="place must be one of figma"):
        rules_of("word")
    with pytest.raises(InputError, match="within the file"):
        findings(SVG.format('<image xlink:href="http://a/b.png"/>'), "web")
    with pytest.raises(InputError, match="shorter numbers"):
        findings(SVG.format(f'<stop stop-color="rgba({"9" * 9999},0,0,1)"/>'), "pdf")
    path = tmp_path / "a.svg"
    path.write_text(SVG)
    assert main(["check", str(path)]) == 2
    assert main(["check", "photo.jpg", str(path), "--for", "web"]) == 2
    assert "--for must be given with an SVG alone" in capsys.readouterr().err


@pytest.mark.parametrize(
    "option",
    [
        ["--preview", "a.png"], ["--heatmap", "a.png"], ["--min-psnr", "30"], ["--max-size", "90"],
        ["--reference", "b.svg"], ["--renderer", "cairo"],
    ],
)  # fmt: skip
def test_what_measures_is_refused_beside_a_place(option, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.svg").write_text(SVG.format(""))
    assert main(["check", "a.svg", "--for", "web", *option]) == 2
    assert "--for" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["a.svg"]


def test_limits_of_untrusted_files_hold_beside_a_place(tmp_path, capsys):
    path = tmp_path / "a.svg"
    path.write_text(SVG.format("<path/><path/>"))
    assert main(["check", str(path), "--for", "pdf", "--max-elements", "2"]) == 2
    assert "element" in capsys.readouterr().err
    assert main(["check", str(path), "--for", "pdf", "--max-svg-bytes", "10"]) == 2
    assert main(["check", str(path), "--for", "pdf", "--max-elements", "9"]) == 0
