"""Laws of the rules on what breaks where: each can be broken, and says where it is from."""

import json

import pytest
from conftest import random_scene

from gauss2svg.cli.main import main
from gauss2svg.errors import InputError
from gauss2svg.measure.places import PLACES, RULES, findings, rules_of
from gauss2svg.raster.features import Feature
from gauss2svg.svg.format import SvgFormat
from gauss2svg.svg.write import write_svg

SVG = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">{}</svg>'
STOP = '<stop offset="0" stop-opacity=".5"/>'
# What breaks a rule, by what it is about.
BROKEN = {
    "style sheet": "<style>.a{fill:red}</style>",
    "currentColor": '<path fill="currentColor"/>',
    "use": '<use xlink:href="#a"/>',
    "mask": "<mask/>" * 101,
    "foreignObject": "<foreignObject/>",
    "bytes": f"<desc>{'a' * 360_000}</desc>",
    "stops of a gradient": f"<radialGradient>{STOP * 17}</radialGradient>",
    Feature.FILTER: '<g filter="url(#a)"/>',
    Feature.PLAIN_HREF: '<use href="#a"/>',
    "script": "<script/>",
    "elements": "<g/>" * 5001,
    "svg": "",
    "transform": '<g transform="scale(2)"/>',
    "soft fills": f"<radialGradient>{STOP}</radialGradient>" + '<path fill="url(#a)"/>' * 1001,
    "text": "<text>a</text>",
}


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: f"{rule.place}-{rule.uses}")
def test_each_rule_is_broken_by_what_it_is_about_and_by_nothing_less(rule):
    text = "<svg/>" if rule.uses == "no namespace" else SVG.format(BROKEN[rule.uses])
    found = {finding.rule: finding for finding in findings(text, rule.place)}
    assert rule in found
    assert found[rule].line.startswith(f"{'breaks' if rule.breaks else 'slow'} in {rule.place}: ")
    plain = {finding.rule for finding in findings(SVG.format("<path/>"), rule.place)}
    assert rule.uses == "svg" or rule not in plain


def test_every_rule_has_its_source_and_what_was_tried_is_on_a_page_of_ours():
    for rule in (rule for place in PLACES for rule in rules_of(place)):
        assert rule.source
        if rule.tried:
            assert rule.source.startswith("docs/")


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


def test_the_command_has_a_line_for_each_and_a_status(tmp_path, capsys):
    path, report = tmp_path / "a.svg", tmp_path / "report.json"
    path.write_text(SVG.format(BROKEN["use"] + BROKEN["currentColor"]))
    assert main(["check", str(path), "--for", "figma", "--report", str(report)]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert all("breaks in figma" in line and "not tried" in line for line in lines)
    assert len(json.loads(report.read_text())["findings"]) == 2
    assert main(["check", str(path), "--for", "web"]) == 0
    assert "nothing that is known to break in web" in capsys.readouterr().err
    path.write_text(SVG.format(BROKEN["elements"]))
    assert main(["check", str(path), "--for", "web"]) == 0  # slow alone
    assert "slow in web" in capsys.readouterr().err


def test_what_cannot_be_checked_is_refused(tmp_path, capsys):
    with pytest.raises(InputError, match="place must be one of figma"):
        rules_of("word")
    with pytest.raises(InputError, match="within the file"):
        findings(SVG.format('<image xlink:href="http://a/b.png"/>'), "web")
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
