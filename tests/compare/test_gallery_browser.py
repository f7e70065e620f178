"""A gallery's pages in a browser: complete, accessible, and true to the files."""

import json
from functools import partial
from operator import itemgetter

import numpy as np
import pytest
from gallery_site import COUNTS, HOSTILE, PHONE, WIDE, box, pages_of, shot, zoomed
from screens import CONTROLS, check_access

from gauss2svg.compare import chart
from gauss2svg.measure import PSNR, SCORES

pytestmark = pytest.mark.browser

AXES = [axis for axis in SCORES if axis.slug != "ssimulacra2"]  # the photos are too small for it
SLUGS = [f"gaussians-{count}" for count in COUNTS]
NAME = f"gaussians {COUNTS[0]}"
PAGE = "photos/cat-9"
zoom_of = partial(zoomed, width=120)
SCREEN = {"width": 600, "height": 900}  # with a stage of 552 x 414 px
SAME = 9.0  # levels of 255: a layer of its own is dithered otherwise, by fractions of a pixel
# Overlays are hidden, so that pictures can be compared.
BARE = ".badge, .handle { visibility: hidden !important } .slider { --divider-width: 0 !important;"
BARE += " --divider-shadow: none !important } .stage { border-radius: 0 !important }"
DECODED = "() => Promise.all([...document.querySelectorAll('.layer[src]')].map((e) => e.decode()))"


def rows_of(gallery, variant):
    return [row for row in gallery.rows if f"/{variant}/" in row["files"]["SVG"]]


# Crops beside the screen, and px by which a card is wider than its numbers
OUTSIDE = "all => all.filter((e) => e.getBoundingClientRect().right > innerWidth).length"
LEFT = "all => Math.min(0, ...all.map((e) => e.closest('.card').clientWidth - e.scrollWidth))"


@pytest.mark.parametrize("at", range(4))  # the page of one photo is enough
def test_no_page_has_a_grave_accessibility_fault_or_is_wider_than_its_screen(gallery, visit, at):
    page = visit(viewport=PHONE).go(pages_of(gallery.directory)[at])
    for name in ("Error map", "Outlines", "8\N{MULTIPLICATION SIGN}"):
        if page.get_by_label(name).count():
            page.get_by_label(name).check()
    check_access(page, WIDE, PHONE)
    assert page.locator(".crop").evaluate_all(OUTSIDE) == 0
    # The longest score, which photos of this size do not have
    page.locator(".card dt").evaluate_all(
        "all => all.map((e) => { e.textContent = 'SSIMULACRA2'; })"
    )
    assert page.locator(".card dl").evaluate_all(LEFT) == 0


def test_index_sorts_filters_and_links_by_the_numbers_of_the_data(gallery, visit):
    """SVGs are loaded once they are asked for."""
    one = visit()
    page = one.go("index.html")
    names = page.locator(".card:visible .name")
    by_name = [HOSTILE, "astronaut.png", "cat 9.png", "Cat 10.png"]
    page.locator("#variant").select_option(SLUGS[0])
    rows = [row | {"photo": by_name.index(row["photo"])} for row in rows_of(gallery, SLUGS[0])]
    for key in ("photo", "psnr_svg", "ssim_svg", "flip_svg", "svg_bytes", "gaussians", "total_s"):
        page.locator("#sort").select_option(key)
        for reverse in (False, True):
            page.locator("#reverse").set_checked(reverse)
            ordered = sorted(rows, key=itemgetter(key), reverse=reverse)
            assert names.all_text_contents() == [by_name[row["photo"]] for row in ordered], key
    for row in rows_of(gallery, SLUGS[0]):
        card = page.locator(".card", has=page.get_by_text(row["photo"], exact=True))
        scores = [axis.text(row[axis.key]) for axis in AXES]
        assert card.locator("dd").all_text_contents()[: len(scores)] == scores
        assert card.locator("a").get_attribute("href") == f"{row['page']}#{SLUGS[0]}"
    floors = sorted(row["psnr_svg"] for row in rows)
    for text, floor, count in (("CAT", "", 2), ("<img", "", 1), ("", f"{sum(floors[1:3]) / 2}", 2)):
        page.locator("#find").fill(text)
        page.locator("#least").fill(floor)
        assert names.count() == count
        assert page.locator("#count").text_content() == f"{count} of {len(rows)} shown"
    assert not [url for url in one.requests if url.endswith(".svg")]
    with page.expect_request("**/picture.svg"):
        page.get_by_label("Show the SVGs themselves").check()


def test_each_point_of_the_trade_off_opens_its_svg(gallery, visit):
    page = visit().go("trade-off.html")
    wanted = {f"{row['page']}#{row['files']['SVG'].split('/')[-2]}" for row in gallery.rows}
    for drawn in page.locator(".chart svg").all():
        links = drawn.locator("a").evaluate_all("all => all.map((e) => e.getAttribute('href'))")
        assert sorted(links) == sorted(wanted)
    page.locator(f".chart svg a[href='{gallery.rows[0]['page']}#{SLUGS[0]}']").first.click()
    assert page.locator("[name=variant]:checked").get_attribute("value") == SLUGS[0]
    assert page.locator("#svg").get_attribute("src") == f"{SLUGS[0]}/picture.svg"


def test_without_scripts_pictures_and_links_are_there_and_no_dead_control(gallery, visit):
    one = visit(java_script_enabled=False)
    for name in pages_of(gallery.directory)[:4]:  # the page of one photo is enough
        page = one.go(name)
        seen = [e for e in page.locator(CONTROLS).all() if e.is_visible()]
        # The score of the charts is chosen by the style sheet.
        assert {e.get_attribute("name") for e in seen} <= {"score"}, name
    row = rows_of(gallery, SLUGS[1])[0]
    page = one.go(row["page"])
    photo, drawn = box(page, "#photo"), box(page, "#svg")
    assert drawn["y"] >= photo["y"] + photo["height"] > photo["y"] + 200
    links = {e.get_attribute("href").split("../")[-1] for e in page.locator("td a").all()}
    assert set(row["files"].values()) <= links


def alike(one, other):
    # Not at the edge, where the stage may end within a pixel; dither adds up in single pixels.
    return np.quantile(np.abs(one - other)[1:-1, 1:-1], 0.99999) <= SAME


def test_a_photo_is_compared_by_mouse_and_keyboard_with_any_variant_and_round(gallery, visit):
    page = visit(viewport=SCREEN).go(f"{PAGE}/index.html")
    page.add_style_tag(content=BARE)
    slider, stage = page.locator("#slider"), box(page, "#stage")

    def seen(key):
        slider.press(key)
        page.evaluate(DECODED)
        return shot(page, stage)

    photo, svg = seen("End"), seen("Home")
    assert np.abs(photo - svg).mean() > 2
    middle = stage["y"] + stage["height"] / 2
    page.mouse.move(stage["x"] + 1, middle)
    page.mouse.down()
    page.mouse.move(stage["x"] + 0.25 * stage["width"], middle)
    page.mouse.up()
    page.mouse.move(stage["x"] + 0.9 * stage["width"], middle)
    edge, both = round(0.25 * photo.shape[1]), shot(page, stage)
    assert alike(both[:, : edge - 2], photo[:, : edge - 2])
    assert alike(both[:, edge + 2 :], svg[:, edge + 2 :])
    for key, share in (("ArrowRight", 27), ("PageUp", 37), ("Home", 0), ("ArrowDown", 0)):
        slider.press(key)
        assert slider.get_attribute("aria-valuenow") == str(share)
        assert slider.get_attribute("aria-valuetext") == f"{share} % photo, {100 - share} % SVG"
    fit = zoom_of(page)
    for key, wanted in (("+", 1.5 * fit), ("-", fit), ("-", fit), ("1", 1), ("0", fit)):
        slider.press(key)
        assert zoom_of(page) == pytest.approx(wanted, rel=0.01), key
    page.get_by_role("radio", name=NAME).check()
    assert page.url.endswith(f"#{SLUGS[0]}")
    assert set(page.locator("[data-chosen]").all_text_contents()) == {NAME}
    other = seen("Home")
    assert not alike(other, svg)
    assert alike(seen("End"), photo)
    lines = (gallery.directory / "gallery.jsonl").read_text().splitlines()
    record = next(r for r in map(json.loads, lines) if r["folder"] == f"{PAGE}/{SLUGS[0]}")
    for kind, crop in record["crops"].items():
        assert page.locator(f"[data-psnr={kind}]").text_content() == PSNR.text(crop["psnr"])
    off = []
    for at, (number, count) in enumerate(record["rounds"], 1):
        page.locator("#rounds").fill(str(at))
        told = f"after round {number}: {chart.whole(count)} Gaussians"
        assert page.locator("#round").text_content() == told
        off.append(np.abs(seen("Home") - other).mean())
    assert off[0] > 3 > off[-1] == min(off)
