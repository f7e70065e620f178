"""Properties of style sheets in files: rounds that fade in, and addresses that name a round."""

import io
import re

import numpy as np
import pytest
from conftest import needs
from PIL import Image
from scenes import random_scene
from screens import captured, chromium
from svg_texts import assert_same

from gauss2svg.raster import BROWSERS, rasterize
from gauss2svg.svg import Document
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import outline_svg, write_svg

SCENE = random_scene(30, 60, 45, 7, (2, 9))
STILL = write_svg(SCENE)
SHEET = re.compile("<style.*?</style>", re.DOTALL)
WITH_SHEETS = {
    kind: write_svg(SCENE, document=Document(**options))
    for kind, options in {
        "animated": {"animate": 6}, "fragments": {"fragments": True},
        "both": {"animate": 6, "fragments": True},
    }.items()
}  # fmt: skip
HIDING = "svg>g:target~g{display:none}"
# Played, paused at a time in ms, or finished; and what the root then looks like.
# Two frames later, as a busy browser may show an earlier one until then.
AT = """async (ms) => {
    for (const a of document.getAnimations()) {
        if (ms === null) a.finish(); else { a.pause(); a.currentTime = ms; await a.ready; }
    }
    for (let k = 0; k < 2; k++) await new Promise(requestAnimationFrame);
}"""


@pytest.mark.parametrize("kind", WITH_SHEETS)
def test_one_style_sheet_is_added_and_nothing_else(kind):
    svg = WITH_SHEETS[kind]
    assert SHEET.sub("", svg) == STILL
    (sheet,) = SHEET.findall(svg)
    assert (HIDING in sheet, "fade-in" in sheet) == (kind != "animated", kind != "fragments")
    spaced = svg.replace(HIDING, "/* later rounds */ svg > g:target ~ g\n{ display : none; } ")
    for text in (svg, spaced):  # as an editor may write it
        assert_same(read_svg(text), read_svg(STILL), atol=0)


@pytest.mark.browser
def test_every_renderer_draws_all_at_the_end(renderer):
    still = rasterize(STILL, 60, 45, renderer)
    for kind in ["both"] if renderer in BROWSERS else WITH_SHEETS:
        assert (rasterize(WITH_SHEETS[kind], 60, 45, renderer) == still).all()


@pytest.fixture(scope="module")
def shown():
    """A browser without the flags by which a renderer starts it."""
    needs("chromium")
    with chromium(flags=()) as browser:
        yield browser


def screenshots(shown, folder, motion: str, files: dict[str, str], visits: list) -> list[bytes]:
    """What Chromium shows of addresses of files at a time in ms, or after all (None)."""
    for name, svg in files.items():
        (folder / name).write_text(svg, encoding="utf-8")
    taken = []
    with shown.new_page(reduced_motion=motion, viewport={"width": 60, "height": 45}) as page:
        for address, time in visits:
            page.goto(f"{folder.as_uri()}/{address}")
            if time != 0:
                page.evaluate(AT, time)
            taken.append(captured(page))
    return taken


@pytest.mark.parametrize(
    ("kind", "motion"),
    [("fragments", "no-preference"), ("both", "no-preference"), ("outline", "reduce")],
)
def test_a_document_shows_the_rounds_up_to_the_one_in_its_address(kind, motion, shown, tmp_path):
    write = outline_svg if kind == "outline" else write_svg
    files = {f"{k}.svg": write(SCENE.select(SCENE.round_index < k)) for k in (1, 2, 3)}
    outlines = outline_svg(SCENE, Document(fragments=True))
    files["out.svg"] = outlines if kind == "outline" else WITH_SHEETS[kind]
    addresses = [*files, *(f"out.svg#round-{k}" for k in (1, 2, 3, 1, 9))]
    *parts, plain, first, middle, last, again, other = screenshots(
        shown, tmp_path, motion, files, [(address, None) for address in addresses]
    )
    assert [first, middle, last] == parts
    assert again == first
    assert plain == other == last
    assert len({first, middle, last}) == 3


def test_a_browser_fades_rounds_in_or_shows_the_end_at_once(shown, tmp_path):
    files = {"still.svg": STILL, "moving.svg": WITH_SHEETS["animated"]}
    still, begin, middle, end = screenshots(
        shown, tmp_path, "no-preference", files,
        [("still.svg", 0), ("moving.svg", 1e-3), ("moving.svg", 3000), ("moving.svg", None)],
    )  # fmt: skip
    assert end == still
    begun, halfway, ended = (
        np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), float)
        for png in (begin, middle, end)
    )
    assert np.abs(begun - np.round(SCENE.background * 255)).max() <= 1
    assert np.abs(halfway - begun).max() > 50
    assert np.abs(halfway - ended).max() > 50
    assert screenshots(shown, tmp_path, "reduce", files, [("moving.svg", 0)]) == [still]
