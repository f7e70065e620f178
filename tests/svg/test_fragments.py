"""Laws of fragments: a file whose address names a round shows the picture up to that one."""

import re

import pytest
from conftest import needs, random_scene
from screens import captured, opened_page
from svg_texts import assert_same

from gauss2svg import check
from gauss2svg.raster import BROWSERS, rasterize
from gauss2svg.svg.document import Document
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import outline_svg, write_svg

pytestmark = pytest.mark.browser

SCENE = random_scene(30, 60, 45, 7, (2, 9))
KINDS = {
    "plain": {},
    "animated": {"animate": 4.0},
}
SHEET = re.compile("<style.*?</style>", re.DOTALL)


def written(kind: str, rounds: int | None = None, fragments: bool = False) -> str:
    """The file of the first rounds, or of all."""
    scene = SCENE if rounds is None else SCENE.select(SCENE.round_index < rounds)
    return write_svg(scene, document=Document(**KINDS[kind], fragments=fragments))


def screenshots(folder, motion: str, files: dict[str, str], addresses: list[str]) -> list[bytes]:
    """What Chromium shows of files, as documents of their own, once all animation is over."""
    for name, svg in files.items():
        (folder / name).write_text(svg, encoding="utf-8")
    taken = []
    with opened_page(motion, 60, 45) as page:
        for address in addresses:
            page.goto(f"{folder.as_uri()}/{address}")
            page.evaluate("() => document.getAnimations().forEach(a => a.finish())")
            taken.append(captured(page))
    return taken


def test_fragments_add_a_style_sheet_and_nothing_else():
    assert SHEET.sub("", written("plain", fragments=True)) == written("plain")
    assert "<style" not in written("plain")
    alone, moving, both = (
        SHEET.findall(written(kind, fragments=fragments))
        for kind, fragments in (("plain", True), ("animated", False), ("animated", True))
    )
    assert [len(sheets) for sheets in (alone, moving, both)] == [1, 1, 1]
    assert both[0].startswith(alone[0].removesuffix("]]></style>").rstrip())
    assert both[0].endswith(moving[0].removeprefix('<style type="text/css"><![CDATA['))


@pytest.mark.parametrize(
    ("kind", "motion"),
    [("plain", "no-preference"), ("plain", "reduce"), ("animated", "no-preference")],
)
def test_document_shows_the_rounds_up_to_the_one_in_its_address(kind, motion, browser, tmp_path):
    parts = {f"part-{k}.svg": written(kind, k) for k in (1, 2, 3)}
    files = {"all.svg": written(kind), "out.svg": written(kind, fragments=True), **parts}
    *expected, whole, plain, first, middle, last, again, other = screenshots(
        tmp_path, motion, files,
        [*parts, "all.svg", "out.svg", *(f"out.svg#round-{k}" for k in (1, 2, 3, 1, 9))],
    )  # fmt: skip
    assert [first, middle, last] == expected
    assert again == first
    assert plain == other == last == whole
    assert len({first, middle, last}) == 3


@pytest.mark.parametrize("name", BROWSERS)
def test_image_shows_the_rounds_up_to_the_one_in_its_address(name, monkeypatch):
    needs(name)
    expected = rasterize(written("plain", 2), 60, 45, name)
    svg = written("animated", fragments=True)
    monkeypatch.setattr("gauss2svg.raster.program.DRAWING", "drawing.svg#round-2")
    assert (rasterize(svg, 60, 45, name) == expected).all()


def test_every_renderer_draws_all_without_a_fragment(renderer):
    expected = rasterize(written("plain"), 60, 45, renderer)
    for kind in ("plain", "animated"):
        drawn = rasterize(written(kind, fragments=True), 60, 45, renderer)
        assert (drawn == expected).all()


def test_outlines_have_fragments_too(browser, tmp_path):
    first = SCENE.select(SCENE.round_index < 1)
    files = {
        "part.svg": outline_svg(first),
        "out.svg": outline_svg(SCENE, Document(fragments=True)),
    }
    part, shown, whole = screenshots(
        tmp_path, "reduce", files, ["part.svg", "out.svg#round-1", "out.svg"]
    )
    assert part == shown != whole


@pytest.mark.parametrize("kind", KINDS)
def test_scene_is_read_back_from_a_file_with_fragments(kind):
    assert_same(read_svg(written(kind, fragments=True)), read_svg(written(kind)), atol=0)


def test_rule_is_read_however_an_editor_spaces_it():
    plain = written("plain")
    for sheet in (
        "\n svg > g:target ~ g\n{ display : none; } ",
        "/* later rounds */svg>g:target~g{display:none}",
    ):
        spaced = plain.replace("<g ", f"<style>{sheet}</style><g ", 1)
        assert_same(read_svg(spaced), read_svg(plain))


def test_check_has_no_notes_about_fragments(photo):
    assert check(photo[:45, :60], written("animated", fragments=True)).notes == ()
