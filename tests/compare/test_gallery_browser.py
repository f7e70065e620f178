"""Laws of a gallery's pages in a browser: complete, accessible, and true to the files.

The file is long because all of them share one gallery and one browser.
"""

import json
from functools import partial
from operator import itemgetter

import numpy as np
import pytest
from gallery_site import COUNTS, HOSTILE, PHONE, WIDE, box, pages_of, shot, zoomed
from PIL import Image
from scipy.ndimage import binary_dilation
from screens import CONTROLS, OVERFLOW, grave_faults

from gauss2svg.compare import chart
from gauss2svg.measure.heatmap import error_map
from gauss2svg.measure.scores import PSNR, SCORES
from gauss2svg.photo.alpha import over, pixels_of
from gauss2svg.photo.load import load_image
from gauss2svg.raster import rasterize

pytestmark = pytest.mark.browser

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
# A busy machine calls the observer of sizes late.
CENTRED = """() => {
    const [stage, photo] = ["#stage", "#photo"].map((one) =>
        document.querySelector(one).getBoundingClientRect());
    return ["left", "top"].every((near, axis) => {
        const far = ["right", "bottom"][axis];
        return Math.abs(stage[near] + stage[far] - photo[near] - photo[far]) < 2;
    });
}"""


def names(page):
    """The photos of the visible cards, in order."""
    return page.locator(".card:visible .name").all_text_contents()


def rows_of(gallery, variant):
    return [row for row in gallery.rows if f"/{variant}/" in row["files"]["SVG"]]


def check_access(page):
    """The page in light and dark, wide and narrow; dark differs from light by colours alone."""
    for size in (WIDE, PHONE):
        page.set_viewport_size(size)
        page.emulate_media(color_scheme="light")
        assert page.evaluate(OVERFLOW) == 0, (page.url, size)
        assert not grave_faults(page), (page.url, size)
        page.emulate_media(color_scheme="dark")
        assert page.evaluate(OVERFLOW) == 0, (page.url, size)
        assert not grave_faults(page, runOnly=["color-contrast"]), (page.url, size)


@pytest.mark.parametrize("at", range(5))
def test_no_page_has_a_grave_accessibility_fault_or_moves_or_is_wider_than_its_screen(
    gallery, visit, at
):
    name = pages_of(gallery.directory)[at]  # the pages of two photos are enough
    for size in (WIDE, PHONE):
        page = visit(viewport=size).go(name)
        assert page.evaluate(SHIFT) < 1e-3, size  # nothing moves while it loads
    check_access(page)


def test_nor_has_a_photo_page_that_shows_errors_and_outlines(gallery, visit):
    page = visit().go(gallery.rows[-1]["page"])
    for name in ("Error map", "Outlines", "8\N{MULTIPLICATION SIGN}"):
        page.get_by_label(name).check()
    check_access(page)


def test_index_sorts_by_the_numbers_of_the_data(gallery, visit):
    page = visit().go("index.html")
    given = [row["photo"] for row in rows_of(gallery, SLUGS[1])]
    assert HOSTILE in given
    assert names(page) == given
    by_name, of = [HOSTILE, "astronaut.png", "cat 9.png", "Cat 10.png"], partial(rows_of, gallery)
    for variant in SLUGS:
        page.locator("#variant").select_option(variant)
        for key in KEYS:
            for reverse in (False, True):
                page.locator("#sort").select_option(key)
                page.locator("#reverse").set_checked(reverse)
                rows = [row | {"photo": by_name.index(row["photo"])} for row in of(variant)]
                rows.sort(key=itemgetter(key), reverse=reverse)
                wanted = [by_name[row["photo"]] for row in rows]
                assert names(page) == wanted, (variant, key, reverse)
    page.locator("#sort").select_option("")
    assert names(page) == given[::-1]


def test_index_shows_what_fits_and_counts_it(gallery, visit):
    page = visit().go("index.html")
    rows = rows_of(gallery, SLUGS[1])
    floors = sorted(row["psnr_svg"] for row in rows)
    for text, floor, count in (
        ("", "", len(rows)), ("CAT", "", 2), ("<img", "", 1), ("no such", "", 0),
        ("", f"{(floors[1] + floors[2]) / 2}", 2), ("", "99", 0), ("cat 10", "10", 1),
    ):  # fmt: skip
        page.locator("#find").fill(text)
        page.locator("#least").fill(floor)
        fitting = [row["photo"] for row in rows if row["psnr_svg"] >= float(floor or 0)]
        assert names(page) == [name for name in fitting if text.lower() in name.lower()]
        told = f"{count} of {len(rows)} shown" if count else "No photo matches"
        assert page.locator("#count").text_content() == told


def test_score_of_the_charts_is_chosen_by_keys_and_without_scripts(visit):
    page = visit(java_script_enabled=False).go("trade-off.html")
    sections = page.locator("section[data-score]")
    assert sections.count() == 6
    chosen = page.locator("[name=score]:checked")
    for slug in ("psnr", "ssim", "flip"):
        assert chosen.get_attribute("value") == slug
        seen = [one.get_attribute("data-score") for one in sections.all() if one.is_visible()]
        assert seen == [slug] * 2
        chosen.focus()
        page.keyboard.press("ArrowRight")
    assert "SSIMULACRA2 is not measured: it needs at least 225 px a side." in (
        page.locator("main").text_content()
    )


def test_index_shows_and_links_the_chosen_variant(gallery, visit):
    page = visit().go("index.html")
    for variant in SLUGS:
        page.locator("#variant").select_option(variant)
        for row in rows_of(gallery, variant):
            card = page.locator(".card", has=page.get_by_text(row["photo"], exact=True))
            told = card.locator("dd").all_text_contents()
            assert told == [
                *(axis.text(row[axis.key]) for axis in SCORES if axis.slug != "ssimulacra2"),
                chart.size(row["svg_bytes"]), chart.whole(row["gaussians"]),
                chart.seconds(row["total_s"]),
            ]  # fmt: skip
            assert card.locator(".variant").text_content() == row["variant"]
            thumbnail = row["files"]["SVG"].replace("picture.svg", "thumbnail.png")
            assert card.locator("img").get_attribute("src") == thumbnail
            assert card.locator("a").get_attribute("href") == f"{row['page']}#{variant}"


def test_cards_and_controls_agree_after_navigating_back(visit):
    page = visit().go("index.html")
    page.locator("#variant").select_option(SLUGS[0])
    page.locator("#sort").select_option("psnr_svg")
    page.locator("#least").fill("3")
    page.locator(".card a").first.click()
    page.wait_for_selector("#viewer")
    page.go_back()
    page.wait_for_selector("#cards")
    page.wait_for_timeout(300)  # a browser restores the controls
    chosen = page.locator("#variant").input_value()
    labels = set(page.locator(".card:not([hidden]) .variant").all_text_contents())
    assert labels == {page.locator(f"#variant option[value={chosen}]").text_content().strip()}
    numbers_shown = page.locator(".card:not([hidden]) [data-number=psnr_svg]").all_text_contents()
    psnrs = [float(text.split("\u202f")[0]) for text in numbers_shown if text != "equal"]
    assert page.locator("#sort").input_value() == "psnr_svg"
    assert psnrs == sorted(psnrs)


def test_svgs_are_loaded_on_demand_only(gallery, visit):
    one = visit()
    page = one.go("index.html")
    assert not [url for url in one.requests if url.endswith(".svg")]
    small = shot(page, box(page, ".card .frame"))
    page.get_by_label("Show the SVGs themselves").check()
    page.wait_for_function("[...document.images].every((one) => one.complete)")
    asked = {url.removeprefix(one.site.as_uri() + "/") for url in one.requests}
    wanted = [row["files"]["SVG"] for row in rows_of(gallery, SLUGS[1])]
    assert {url for url in asked if url.endswith(".svg")} == set(wanted)
    shown = page.locator(".card img").evaluate_all("all => all.map((e) => e.getAttribute('src'))")
    assert shown == wanted
    # The same image, but sharper than a stretched thumbnail.
    difference = abs(shot(page, box(page, ".card .frame")) - small).mean()
    assert 0.3 < difference < 12
    page.get_by_label("Show the SVGs themselves").uncheck()
    assert page.locator(".card img[src$='.png']").count() == len(wanted)


def test_each_point_of_the_trade_off_opens_its_svg(gallery, visit):
    one = visit()
    page = one.go("trade-off.html")
    charts = page.locator(".chart svg")
    axes = [axis for axis in SCORES if axis.key != "ssimulacra2_svg"]  # they are too small
    assert charts.count() == 2 * len(axes)
    wanted = {f"{row['page']}#{row['files']['SVG'].split('/')[-2]}" for row in gallery.rows}
    for one_chart, axis in zip(charts.all(), np.repeat(axes, 2), strict=True):
        links = one_chart.locator("a").evaluate_all("all => all.map((e) => e.getAttribute('href'))")
        assert sorted(links) == sorted(wanted)
        told = one_chart.locator("a").evaluate_all("all => all.map((e) => e.ariaLabel)")
        for row, text in zip(gallery.rows, told, strict=True):
            assert text.startswith(f"{row['photo']}, {row['variant']}: ")
            assert f": {axis.text(row[axis.key])}, " in text
    charts.first.locator(f"a[href='{gallery.rows[0]['page']}#{SLUGS[0]}']").click()
    for address in [page.url.removeprefix(one.site.as_uri() + "/"), *sorted(wanted)]:
        one.go(address)
        chosen = page.locator("[name=variant]:checked").get_attribute("value")
        assert chosen == address.partition("#")[2]
        assert page.locator("#svg").get_attribute("src") == f"{chosen}/picture.svg"


def test_without_scripts_pictures_and_links_are_there_and_no_dead_control(gallery, visit):
    one = visit(java_script_enabled=False)
    for name in pages_of(gallery.directory):
        page = one.go(name)
        seen = [e for e in page.locator(CONTROLS).all() if e.is_visible()]
        # The score of the charts is chosen by the style sheet.
        assert {e.get_attribute("name") for e in seen} <= {"score"}, name
        assert page.evaluate(OVERFLOW) == 0
    page = one.go("index.html")
    assert [e.get_attribute("href") for e in page.locator(".card > a").all()] == [
        row["page"] for row in rows_of(gallery, SLUGS[1])
    ]
    for row in rows_of(gallery, SLUGS[1]):
        page = one.go(row["page"])
        photo, drawn = box(page, "#photo"), box(page, "#svg")
        assert photo["width"] == drawn["width"] > 300
        assert photo["height"] == pytest.approx(
            photo["width"] * row["height"] / row["width"], abs=0.1
        )
        assert drawn["y"] >= photo["y"] + photo["height"]
        for source in ("photo.webp", f"{SLUGS[1]}/picture.svg"):
            assert page.locator(f".stage img[src='{source}']").is_visible()
        links = {e.get_attribute("href").split("../")[-1] for e in page.locator("td a").all()}
        assert set(row["files"].values()) <= links
        assert page.locator("noscript a[href*='#round-']").count() > 3


def test_paper_shows_pictures_and_no_control(gallery, visit):
    one = visit()
    for name in ("index.html", gallery.rows[0]["page"]):
        page = one.go(name)
        page.emulate_media(media="print")
        shown = page.locator("input, select, button, .handle, nav, .skip")
        assert not [e for e in shown.all() if e.is_visible()]
        assert page.locator("main img").first.is_visible()
        assert page.evaluate(OVERFLOW) == 0


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


def record(gallery, variant, folder=PAGE):
    rows = map(json.loads, (gallery.directory / "gallery.jsonl").read_text().splitlines())
    return next(row for row in rows if row["folder"] == f"{folder}/{variant}")


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


@pytest.mark.parametrize("zoom", ["Fit", ZOOMS[8]])
def test_divider_follows_the_mouse(visit, headless, zoom):
    page = opened(visit)
    page.get_by_label(zoom).check()
    stage, before = box(page, "#stage"), box(page, "#photo")
    middle = stage["y"] + stage["height"] / 2
    check_halves(page, headless, 0.5)
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


def test_a_finger_moves_the_divider_and_the_picture_that_is_zoomed(visit):
    one = visit(has_touch=True, viewport=SCREEN)
    page = one.go(f"{PAGE}/index.html")
    stage = box(page, "#stage")
    x, y = stage["x"] + 0.5 * stage["width"], stage["y"] + 100
    one.touch("Start", (x, y))
    for at in (0.55, 0.7, 0.8):
        one.touch("Move", (stage["x"] + at * stage["width"], y))
    one.touch("End")
    assert share(page) == 80
    page.get_by_label(ZOOMS[8]).check()
    before = box(page, "#svg")
    one.touch("Start", (x - 50, y))
    one.touch("Move", (x - 70, y + 10))
    one.touch("Move", (x - 90, y + 20))
    one.touch("End")
    assert share(page) == 80
    after = box(page, "#svg")
    assert (after["x"] - before["x"], after["y"] - before["y"]) == (-40, 20)
    assert box(page, "#photo") == after


def test_divider_follows_the_keyboard(visit, headless):
    page = opened(visit)
    slider = page.locator("#slider")
    assert slider.get_attribute("role") == "slider"
    for key, wanted in (
        ("Home", 0), ("ArrowLeft", 0), ("PageUp", 10), ("ArrowRight", 12), ("ArrowUp", 14),
        ("ArrowDown", 12), ("ArrowLeft", 10), ("End", 100), ("PageUp", 100), ("PageDown", 90),
        ("Control+Home", 90), ("Alt+ArrowUp", 90),
    ):  # fmt: skip
        slide_to(page, key)
        assert share(page) == wanted, key
        assert slider.get_attribute("aria-valuetext") == f"{wanted} % photo, {100 - wanted} % SVG"
    check_halves(page, headless, 0.9)


def test_the_side_that_is_hardly_seen_has_no_name(visit):
    page = visit(viewport=SCREEN).go(f"{PAGE}/index.html")
    badges = [page.locator(f"#badge-{side}") for side in ("left", "right")]
    for key, seen in (("Home", [False, True]), ("End", [True, False]), ("PageDown", [True, False])):
        slide_to(page, key)
        assert [badge.is_visible() for badge in badges] == seen, key
    slide_to(page, "PageDown")
    assert all(badge.is_visible() for badge in badges)


def test_photo_hides_what_is_behind_it_where_it_is_transparent(visit):
    page = opened(visit, "photos/cat-10/index.html")
    slide_to(page, "End")
    stage = box(page, "#stage")
    pictures = [shot(page, stage)]
    for name in (NAME, "Error map"):
        page.get_by_role("radio", name=name).check()
        page.evaluate(DECODED)
        pictures.append(shot(page, stage))
    assert alike(pictures[0], pictures[1])
    assert alike(pictures[0], pictures[2])


@pytest.mark.parametrize("zoom", [1, 8])
def test_zoom_is_exact_and_both_sides_move_in_step(visit, headless, zoom):
    page = opened(visit)
    page.get_by_label(ZOOMS[zoom]).check()
    stage = box(page, "#stage")

    def place():
        at = box(page, "#photo")
        assert box(page, "#svg") == at
        assert (at["width"], at["height"]) == (SIZE["x"] * zoom, SIZE["y"] * zoom)
        return at

    slide_to(page, "Home")
    for key, axis, extent, end in (
        ("ArrowLeft", "x", "width", 1), ("ArrowRight", "x", "width", 0),
        ("ArrowUp", "y", "height", 1), ("ArrowDown", "y", "height", 0),
    ):  # fmt: skip
        before = place()
        room = stage[extent] - before[extent]  # where the picture may begin, from 0 on
        at = stage[axis] + (room / 2 if room > 0 else (room, 0)[end])
        slide_to(page, f"Shift+{key}")
        step = min(60, abs(at - before[axis]))
        assert abs(place()[axis] - before[axis]) == pytest.approx(step, abs=1)
        for _ in range(6 if zoom == 8 else 1):
            slide_to(page, f"Shift+{key}")
        assert place()[axis] == pytest.approx(at, abs=1)
    assert share(page) == 0  # the divider stays
    page.mouse.move(stage["x"] + 300, stage["y"] + 300)
    page.mouse.down()
    page.mouse.move(stage["x"] + 333, stage["y"] + 322, steps=3)
    page.mouse.up()
    moved = place()
    page.mouse.move(stage["x"] + 400, stage["y"] + 400)
    assert place() == moved
    part = stage if zoom == 8 else moved
    wanted = headless.alone(f"{PAGE}/{MAIN}/picture.svg", moved, part)
    assert alike(shot(page, part), wanted)


def zoom_told(page):
    """What the buttons of the zoom show, None where it is between them."""
    chosen = page.locator("[name=zoom]:checked")
    return chosen.get_attribute("value") if chosen.count() else None


def test_keys_zoom_and_move(visit):
    page = opened(visit)
    fit = zoom_of(page)
    for key, wanted, told in (
        ("+", 1.5 * fit, None), ("+", 2.25 * fit, None), ("-", 1.5 * fit, None), ("1", 1, "1"),
        ("0", fit, "fit"), ("-", fit, "fit"), ("=", 1.5 * fit, None),
    ):  # fmt: skip
        slide_to(page, key)
        assert zoom_of(page) == pytest.approx(wanted, rel=0.01), key
        assert zoom_told(page) == told, key
    before = box(page, "#photo")
    slide_to(page, "Shift+ArrowLeft")
    assert box(page, "#photo")["x"] - before["x"] == pytest.approx(60, abs=2)
    assert zoom_of(page) == pytest.approx(1.5 * fit, rel=0.01)


def test_a_zoom_in_steps_ends_as_sharp_as_one_at_once(visit, headless):
    page = opened(visit)
    for key in ("Home", "+"):
        slide_to(page, key)
    page.wait_for_function("document.getElementById('stage').style.getPropertyValue('--by') == 1")
    stage, place = box(page, "#stage"), box(page, "#svg")
    assert alike(shot(page, stage), headless.alone(f"{PAGE}/{MAIN}/picture.svg", place, stage))


def test_the_wheel_zooms_around_the_pointer_where_zoom_is_meant(visit):
    page = opened(visit, viewport={"width": 1280, "height": 700})
    stage = box(page, "#stage")
    x, y = stage["x"] + stage["width"] / 4, stage["y"] + stage["height"] / 4
    page.mouse.move(x, y)
    page.keyboard.down("Control")
    page.mouse.wheel(0, -100)
    page.keyboard.up("Control")
    page.wait_for_selector("#stage.zoomed")
    place = box(page, "#photo")
    assert (x - place["x"]) / place["width"] == pytest.approx(0.25, abs=0.01)
    assert (y - place["y"]) / place["height"] == pytest.approx(0.25, abs=0.01)
    slide_to(page, "0")
    page.evaluate("document.activeElement.blur()")
    page.mouse.wheel(0, 200)
    page.wait_for_function("scrollY > 0")
    assert zoom_told(page) == "fit"


def test_two_fingers_zoom_and_leave_the_divider(visit):
    one = visit(has_touch=True, viewport=SCREEN)
    page = one.go(f"{PAGE}/index.html")
    stage, fit = box(page, "#stage"), zoom_of(page)
    x, y = stage["x"] + stage["width"] / 2, stage["y"] + stage["height"] / 2
    one.touch("Start", (x - 40, y), (x + 40, y))
    for step in (50, 60, 70, 80):
        one.touch("Move", (x - step, y), (x + step, y))
    one.touch("End")
    assert zoom_of(page) == pytest.approx(2 * fit, rel=0.1)
    assert share(page) == 50


def test_nothing_glides_where_no_motion_is_wanted(visit):
    page = opened(visit, reduced_motion="reduce")
    moves = """() => {
        const slider = document.getElementById("slider");
        slider.value = slider.value > 50 ? 20 : 80;
        return slider.shadowRoot.getAnimations().length + document.getAnimations().length;
    }"""
    assert page.evaluate(moves) == 0
    assert page.evaluate("getComputedStyle(document.documentElement).scrollBehavior") == "auto"
    page.emulate_media(reduced_motion="no-preference")
    assert page.evaluate(moves) > 0


def test_layout_follows_the_window(visit):
    page = opened(visit)
    for zoom in ("Fit", ZOOMS[8]):
        page.get_by_label(zoom).check()
        for size in (PHONE, WIDE):
            page.set_viewport_size(size)
            page.wait_for_function(CENTRED)  # the observer of sizes has been called
            stage, place = box(page, "#stage"), box(page, "#photo")
            assert box(page, "#svg") == place
            for a, b in (("x", "width"), ("y", "height")):
                assert abs((place[a] + place[b] / 2) - (stage[a] + stage[b] / 2)) <= 1
            if zoom == "Fit":
                assert place == pytest.approx(stage, abs=0.1)


@pytest.mark.parametrize("variant", [MAIN, OTHER])
def test_rounds_are_those_of_the_file(gallery, visit, headless, variant):
    page = opened(visit, f"{PAGE}/index.html#{variant}")
    slide_to(page, "Home")
    stage, rounds = box(page, "#stage"), page.locator("#rounds")
    known = record(gallery, variant)["rounds"]
    assert len(known) > 2
    assert rounds.get_attribute("max") == rounds.input_value() == str(len(known))
    picture = f"{PAGE}/{variant}/picture.svg"
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
    assert known[-1][1] == int(variant.partition("-")[2])
    for key, at in (("Home", 1), ("ArrowRight", 2)):
        rounds.press(key)
        assert rounds.input_value() == str(at)


def test_error_map_is_that_of_the_two_pictures(gallery, visit):
    page = opened(visit)
    legend = page.locator("#legend")
    assert not legend.is_visible()
    assert not page.locator("#rounds").is_disabled()
    page.get_by_label("Error map").check()
    assert legend.is_visible()
    assert page.locator("#rounds").is_disabled()
    page.get_by_label(ZOOMS[4]).check()
    slide_to(page, "Home")
    page.evaluate(DECODED)
    assert page.locator("#svg").get_attribute("src") == f"{MAIN}/errors.png"
    folder = gallery.directory / PAGE
    photo = over(pixels_of(load_image(folder / "photo.webp")))
    rendered = over(rasterize((folder / MAIN / "picture.svg").read_text(), *SIZE.values()))
    wanted = np.asarray(error_map(rendered, photo).convert("RGB"), float)
    with Image.open(folder / MAIN / "errors.png") as file:
        np.testing.assert_array_equal(np.asarray(file.convert("RGB")), wanted)
    assert len(np.unique(wanted.reshape(-1, 3), axis=0)) > 20
    # Every pixel of it is a square of one colour.
    screen = shot(page, box(page, "#svg"))
    assert alike(screen, wanted.repeat(4, 0).repeat(4, 1))
    assert "% error map" in page.locator("#slider").get_attribute("aria-valuetext")
    page.get_by_label("SVG", exact=True).check()
    assert not legend.is_visible()


def test_outlines_lie_over_both_sides(visit, headless):
    page = opened(visit)
    assert not page.locator("#outlines-right").is_visible()
    stage = box(page, "#stage")
    plain = shot(page, stage)
    page.get_by_label("Outlines").check()
    page.evaluate(DECODED)
    changed = np.abs(shot(page, stage) - plain).max(axis=2) > 10
    file = f"{PAGE}/{MAIN}/outlines.svg"
    on_white = headless.alone(file, stage, stage).min(axis=2) < 250
    on_black = headless.alone(file, stage, stage, "background:#000").max(axis=2) > 5
    strokes = binary_dilation(on_white | on_black)  # in a layer that may lie within pixels
    for half in (np.s_[:, :260], np.s_[:, 290:]):
        assert changed[half].mean() > 0.05
        assert not (changed & ~strokes)[half].any()
    page.get_by_label("Outlines").uncheck()
    assert alike(shot(page, stage), plain)


@pytest.mark.parametrize("by_hand", [True, False])
def test_a_variant_is_chosen_everywhere(gallery, visit, headless, by_hand):
    if by_hand:
        page = opened(visit)
        page.get_by_role("radio", name=NAME).check()
        assert page.url.endswith(f"#{OTHER}")
    else:
        page = opened(visit, f"{PAGE}/index.html#{OTHER}")
        assert page.get_by_role("radio", name=NAME).is_checked()
    page.evaluate(DECODED)
    assert page.locator("#badge-right").text_content() == f"SVG, {NAME}"
    assert set(page.locator("[data-chosen]").all_text_contents()) == {NAME}
    found = record(gallery, OTHER)
    for kind in ("worst", "typical"):
        assert page.locator(f"[data-psnr={kind}]").text_content() == PSNR.text(
            found["crops"][kind]["psnr"]
        )
    for picture in page.locator("[data-errors]").all():
        assert picture.get_attribute("src") == f"{OTHER}/errors.png"
    check_halves(page, headless, 0.5, right=f"{OTHER}/picture.svg")
    page.get_by_label("Error map").check()
    assert page.locator("#svg").get_attribute("src") == f"{OTHER}/errors.png"
    assert page.locator("#badge-right").text_content() == f"Errors, {NAME}"
    page.get_by_label("Outlines").check()
    assert page.locator("#outlines-right").get_attribute("src") == f"{OTHER}/outlines.svg"


@pytest.mark.parametrize(("variant", "compared"), [(MAIN, "worst"), (OTHER, "typical")])
def test_crops_are_those_of_the_record_three_times_as_large(
    gallery, visit, headless, variant, compared
):
    # Tall, so that all of it is on the screen.
    page = opened(visit, f"{PAGE}/index.html#{variant}", viewport={"width": 1280, "height": 2200})
    page.wait_for_function("[...document.images].every((e) => e.complete || !e.src)")
    files = ["photo.webp", f"{variant}/errors.png", f"{OTHER}/picture.svg", f"{MAIN}/picture.svg"]
    for kind in ("worst", "typical"):
        crop = record(gallery, variant)["crops"][kind]
        tiles = page.locator(f"[data-kind={kind}] .crop")
        assert tiles.count() == len(files)
        for at, file in enumerate(files):
            tile, place = tiles.nth(at).bounding_box(), tiles.nth(at).locator("img").bounding_box()
            assert (tile["width"], tile["height"]) == (3 * crop["width"], 3 * crop["height"])
            assert place == {
                "x": tile["x"] - 3 * crop["x"], "y": tile["y"] - 3 * crop["y"],
                "width": 3 * SIZE["x"], "height": 3 * SIZE["y"],
            }  # fmt: skip
            if kind == compared:
                style = "image-rendering:pixelated" if "errors" in file else ""
                wanted = headless.alone(f"{PAGE}/{file}", place, tile, style)
                assert alike(shot(page, tile)[6:-6, 6:-6], wanted[6:-6, 6:-6]), file  # no corners
