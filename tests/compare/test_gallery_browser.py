"""Laws of a gallery's pages in a browser: complete, accessible, and true to the files.

The file is long because all of them share one gallery and one browser.
"""

import json
from functools import partial
from operator import itemgetter

import numpy as np
import pytest
from gallery_site import COUNTS, HOSTILE, PHONE, WIDE, box, pages_of, shot, zoomed
from screens import CONTROLS, OVERFLOW, check_access

from gauss2svg.compare import chart
from gauss2svg.measure import PSNR, SCORES

pytestmark = pytest.mark.browser

AXES = [axis for axis in SCORES if axis.slug != "ssimulacra2"]  # the photos are too small for it
SLUGS = [f"gaussians-{count}" for count in COUNTS]
KEYS = ("photo", "psnr_svg", "ssim_svg", "flip_svg", "svg_bytes", "gaussians", "total_s")
# Sum of the shifts that the browser has seen; 1 is a screenful by its whole height.
SHIFT = """() => new Promise((done) => {
    let sum = 0;
    new PerformanceObserver((list) => {
        for (const entry of list.getEntries()) sum += entry.value;
    }).observe({type: "layout-shift", buffered: true});
    setTimeout(() => done(sum), 100);
})"""
MAIN = f"gaussians-{COUNTS[1]}"
OTHER = f"gaussians-{COUNTS[0]}"
NAME = f"{COUNTS[0]} Gaussians"
PAGE = "photos/cat-9"
TIMES = "\N{MULTIPLICATION SIGN}"
ZOOMS = {1: "1:1", 2: f"2{TIMES}", 4: f"4{TIMES}", 8: f"8{TIMES}"}
SIZE = {"x": 120, "y": 90}
zoom_of = partial(zoomed, width=SIZE["x"])
SCREEN = {"width": 600, "height": 900}  # with a stage of 552 x 414 px
SAME = 9.0  # levels of 255: a layer of its own is dithered otherwise, by fractions of a pixel
# Overlays are hidden, so that the image can be compared.
BARE = ".badge, .handle { visibility: hidden !important } .slider { --divider-width: 0 !important;"
BARE += " --divider-shadow: none !important } .stage { border-radius: 0 !important }"
DECODED = "() => Promise.all([...document.querySelectorAll('.layer[src]')].map((e) => e.decode()))"


def rows_of(gallery, variant):
    return [row for row in gallery.rows if f"/{variant}/" in row["files"]["SVG"]]


@pytest.mark.parametrize("at", range(4))  # the page of one photo is enough
def test_no_page_has_a_grave_accessibility_fault_or_moves_or_is_wider_than_its_screen(
    gallery, visit, at
):
    page = visit(viewport=PHONE).go(pages_of(gallery.directory)[at])
    assert page.evaluate(SHIFT) < 1e-3  # nothing moves while it loads
    for name in ("Error map", "Outlines", ZOOMS[8]):
        if page.get_by_label(name).count():
            page.get_by_label(name).check()
    check_access(page, WIDE, PHONE)


def test_index_sorts_filters_and_links_by_the_numbers_of_the_data(gallery, visit):
    page = visit().go("index.html")
    names = page.locator(".card:visible .name")
    by_name = [HOSTILE, "astronaut.png", "cat 9.png", "Cat 10.png"]
    for variant in SLUGS:
        page.locator("#variant").select_option(variant)
        rows = [row | {"photo": by_name.index(row["photo"])} for row in rows_of(gallery, variant)]
        for key in KEYS:
            page.locator("#sort").select_option(key)
            for reverse in (False, True):
                page.locator("#reverse").set_checked(reverse)
                ordered = sorted(rows, key=itemgetter(key), reverse=reverse)
                assert names.all_text_contents() == [by_name[row["photo"]] for row in ordered], key
        for row in rows_of(gallery, variant):
            card = page.locator(".card", has=page.get_by_text(row["photo"], exact=True))
            scores = [axis.text(row[axis.key]) for axis in AXES]
            assert card.locator("dd").all_text_contents()[: len(scores)] == scores
            assert card.locator(".variant").text_content() == row["variant"]
            thumbnail = row["files"]["SVG"].replace("picture.svg", "thumbnail.png")
            assert card.locator("img").get_attribute("src") == thumbnail
            assert card.locator("a").get_attribute("href") == f"{row['page']}#{variant}"
    floors = sorted(row["psnr_svg"] for row in rows)
    for text, floor, count in (("CAT", "", 2), ("<img", "", 1), ("", f"{sum(floors[1:3]) / 2}", 2)):
        page.locator("#find").fill(text)
        page.locator("#least").fill(floor)
        assert names.count() == count
        assert page.locator("#count").text_content() == f"{count} of {len(rows)} shown"


def test_each_point_of_the_trade_off_opens_its_svg(gallery, visit):
    one = visit()
    page = one.go("trade-off.html")
    charts = page.locator(".chart svg").all()
    wanted = {f"{row['page']}#{row['files']['SVG'].split('/')[-2]}" for row in gallery.rows}
    for links, axis in zip((c.locator("a") for c in charts), np.repeat(AXES, 2), strict=True):
        addresses = links.evaluate_all("all => all.map((e) => e.getAttribute('href'))")
        assert sorted(addresses) == sorted(wanted)
        told = links.evaluate_all("all => all.map((e) => e.ariaLabel)")
        for row, text in zip(gallery.rows, told, strict=True):
            assert text.startswith(f"{row['photo']}, {row['variant']}: {axis.text(row[axis.key])},")
    charts[0].locator(f"a[href='{gallery.rows[0]['page']}#{SLUGS[0]}']").click()
    assert page.locator("[name=variant]:checked").get_attribute("value") == SLUGS[0]
    assert page.locator("#svg").get_attribute("src") == f"{SLUGS[0]}/picture.svg"


def test_without_scripts_pictures_and_links_are_there_and_no_dead_control(gallery, visit):
    one = visit(java_script_enabled=False)
    for name in pages_of(gallery.directory):
        page = one.go(name)
        seen = [e for e in page.locator(CONTROLS).all() if e.is_visible()]
        # The score of the charts is chosen by the style sheet.
        assert {e.get_attribute("name") for e in seen} <= {"score"}, name
        assert page.evaluate(OVERFLOW) == 0
    for row in rows_of(gallery, SLUGS[1]):
        page = one.go(row["page"])
        photo, drawn = box(page, "#photo"), box(page, "#svg")
        assert photo["width"] == drawn["width"] > 300
        shape = photo["width"] * row["height"] / row["width"]
        assert photo["height"] == pytest.approx(shape, abs=0.1)
        assert drawn["y"] >= photo["y"] + photo["height"]
        for source in ("photo.webp", f"{SLUGS[1]}/picture.svg"):
            assert page.locator(f".stage img[src='{source}']").is_visible()
        links = {e.get_attribute("href").split("../")[-1] for e in page.locator("td a").all()}
        assert set(row["files"].values()) <= links
        assert page.locator("noscript a[href*='#round-']").count() > 3


def opened(visit, name=f"{PAGE}/index.html", **options):
    page = visit(**({"viewport": SCREEN} | options)).go(name)
    page.add_style_tag(content=BARE)
    page.evaluate(DECODED)
    return page


def slide_to(page, key):
    page.locator("#slider").focus()
    page.keyboard.press(key)


def share(page):
    return int(page.locator("#slider").get_attribute("aria-valuenow"))


def record(gallery, variant):
    rows = map(json.loads, (gallery.directory / "gallery.jsonl").read_text().splitlines())
    return next(row for row in rows if row["folder"] == f"{PAGE}/{variant}")


def alike(one, other):
    # Not at the edge, where the stage may end within a pixel; dither adds up in single pixels.
    return np.quantile(np.abs(one - other)[1:-1, 1:-1], 0.99999) <= SAME


def check_halves(page, headless, at, left="photo.webp", right=f"{MAIN}/picture.svg"):
    """Left of the divider is one image, right of it the other."""
    stage, place = box(page, "#stage"), box(page, "#photo")
    screen = shot(page, stage)
    pictures = [headless.alone(f"{PAGE}/{name}", place, stage) for name in (left, right)]
    assert np.abs(pictures[0] - pictures[1]).mean() > 2
    edge = round(at * screen.shape[1])
    before, after = max(edge - 2, 0), edge + 2
    assert alike(screen[:, :before], pictures[0][:, :before])
    assert alike(screen[:, after:], pictures[1][:, after:])


def test_divider_follows_the_mouse_and_the_keyboard(visit, headless):
    page = opened(visit)
    fit = zoom_of(page)
    for key, wanted in (("+", 1.5 * fit), ("-", fit), ("-", fit), ("1", 1), ("0", fit)):
        slide_to(page, key)
        assert zoom_of(page) == pytest.approx(wanted, rel=0.01), key
    page.get_by_label(ZOOMS[8]).check()
    stage, before = box(page, "#stage"), box(page, "#photo")
    middle = stage["y"] + stage["height"] / 2
    page.mouse.move(stage["x"] + 0.5 * stage["width"], middle)
    page.mouse.down()
    for at in (0.4, 0.25):
        page.mouse.move(stage["x"] + at * stage["width"], middle)
        assert share(page) == round(at * 100)
    page.mouse.up()
    page.mouse.move(stage["x"] + 0.9 * stage["width"], middle)
    assert share(page) == 25
    assert box(page, "#photo") == before
    check_halves(page, headless, 0.25)
    for key, wanted in (
        ("Home", 0), ("ArrowLeft", 0), ("PageUp", 10), ("ArrowUp", 12), ("End", 100),
        ("ArrowDown", 98), ("PageDown", 88), ("Control+Home", 88),
    ):  # fmt: skip
        slide_to(page, key)
        assert share(page) == wanted, key
        told = page.locator("#slider[role=slider]").get_attribute("aria-valuetext")
        assert told == f"{wanted} % photo, {100 - wanted} % SVG"


def test_zoom_is_exact_and_both_sides_move_in_step(visit, headless):
    page = opened(visit)
    page.get_by_label(ZOOMS[8]).check()
    stage = box(page, "#stage")

    def place():
        at = box(page, "#photo")
        assert box(page, "#svg") == at
        assert (at["width"], at["height"]) == (SIZE["x"] * 8, SIZE["y"] * 8)
        return at

    before = place()
    slide_to(page, "Shift+ArrowLeft")
    assert place()["x"] - before["x"] == pytest.approx(60, abs=1)
    for _ in range(9):
        slide_to(page, "Shift+ArrowLeft")
    assert place()["x"] == pytest.approx(stage["x"], abs=1)  # no further than its edge
    page.mouse.move(stage["x"] + 300, stage["y"] + 300)
    page.mouse.down()
    page.mouse.move(stage["x"] + 333, stage["y"] + 322, steps=3)
    page.mouse.up()
    moved = place()
    page.mouse.move(stage["x"] + 400, stage["y"] + 400)
    assert place() == moved
    slide_to(page, "Home")
    wanted = headless.alone(f"{PAGE}/{MAIN}/picture.svg", moved, stage)
    assert alike(shot(page, stage), wanted)


def test_rounds_are_those_of_the_file(gallery, visit, headless):
    page = opened(visit, f"{PAGE}/index.html#{OTHER}")
    slide_to(page, "Home")
    stage, rounds = box(page, "#stage"), page.locator("#rounds")
    known = record(gallery, OTHER)["rounds"]
    assert len(known) > 2
    assert rounds.get_attribute("max") == rounds.input_value() == str(len(known))
    picture = f"{PAGE}/{OTHER}/picture.svg"
    whole = headless.alone(picture, stage, stage)
    assert alike(shot(page, stage), whole)
    distances = []
    for at, (number, count) in enumerate(known, 1):
        rounds.fill(str(at))
        page.evaluate(DECODED)
        wanted = headless.alone(f"{picture}#round-{number}", stage, stage)
        assert alike(shot(page, stage), wanted)
        distances.append(np.abs(wanted - whole).mean())
        told = f"after round {number}: {chart.whole(count)} Gaussians"
        assert page.locator("#round").text_content() == told
        assert rounds.get_attribute("aria-valuetext") == told
    assert distances[0] > 3
    assert distances[-1] <= SAME
    assert known[-1][1] == COUNTS[0]


def test_a_variant_is_chosen_everywhere(gallery, visit, headless):
    page = opened(visit)
    page.get_by_role("radio", name=NAME).check()
    assert page.url.endswith(f"#{OTHER}")
    page.evaluate(DECODED)
    assert page.locator("#badge-right").text_content() == f"SVG, {NAME}"
    assert set(page.locator("[data-chosen]").all_text_contents()) == {NAME}
    for kind, crop in record(gallery, OTHER)["crops"].items():
        assert page.locator(f"[data-psnr={kind}]").text_content() == PSNR.text(crop["psnr"])
    for picture in page.locator("[data-errors]").all():
        assert picture.get_attribute("src") == f"{OTHER}/errors.png"
    check_halves(page, headless, 0.5, right=f"{OTHER}/picture.svg")


def test_svgs_are_loaded_on_demand_only(gallery, visit):
    one = visit()
    page = one.go("index.html")
    page.wait_for_load_state("networkidle")
    assert not [url for url in one.requests if url.endswith(".svg")]
    page.get_by_label("Show the SVGs themselves").check()
    wanted = [row["files"]["SVG"] for row in rows_of(gallery, SLUGS[1])]
    page.wait_for_function("[...document.images].every((one) => one.complete)")
    assert {url.removeprefix(f"{one.site.as_uri()}/") for url in one.requests} >= set(wanted)
