"""Laws of a gallery's pages in a browser: complete, accessible, with and without scripts."""

import re

import numpy as np
import pytest
from gallery_site import COUNTS, HOSTILE, PHONE, WIDE, box, pages_of, shot
from screens import CONTROLS, OVERFLOW, grave_faults

from gauss2svg.compare import chart as numbers
from gauss2svg.measure.scores import SCORES

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


def names(page):
    """The photos of the visible cards, in order."""
    return page.locator(".card:visible .name").all_text_contents()


def rows_of(gallery, variant):
    return [row for row in gallery.rows if f"/{variant}/" in row["files"]["SVG"]]


def natural(name):
    return [(part.isdigit(), int(part) if part.isdigit() else part.lower())
            for part in re.split(r"(\d+)", name)]  # fmt: skip


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
def test_no_page_has_a_grave_accessibility_fault_or_is_wider_than_its_screen(gallery, visit, at):
    check_access(visit().go(pages_of(gallery.directory)[at]))  # the pages of two photos are enough


def test_nor_has_a_photo_page_that_shows_errors_and_outlines(gallery, visit):
    page = visit().go(gallery.rows[-1]["page"])
    for name in ("Error map", "Outlines", "8\N{MULTIPLICATION SIGN}"):
        page.get_by_label(name).check()
    check_access(page)


def test_nothing_moves_while_pages_load(gallery, visit):
    for size in (WIDE, PHONE):
        one = visit(viewport=size)
        for name in pages_of(gallery.directory):
            page = one.go(name)
            assert page.evaluate(SHIFT) < 1e-3, (name, size)
            assert page.evaluate(OVERFLOW) == 0, (name, size)


def test_names_are_text(gallery, visit):
    assert HOSTILE in names(visit().go("index.html"))


def test_index_sorts_by_the_numbers_of_the_data(gallery, visit):
    page = visit().go("index.html")
    given = [row["photo"] for row in rows_of(gallery, SLUGS[1])]
    assert names(page) == given

    def rank(row):
        return natural(row["photo"]) if key == "photo" else row[key]

    for variant in SLUGS:
        page.locator("#variant").select_option(variant)
        for key in KEYS:
            for reverse in (False, True):
                page.locator("#sort").select_option(key)
                page.locator("#reverse").set_checked(reverse)
                wanted = sorted(rows_of(gallery, variant), key=rank, reverse=reverse)
                assert names(page) == [row["photo"] for row in wanted], (variant, key, reverse)
    page.locator("#sort").select_option("")
    assert names(page) == given[::-1]


def test_index_shows_what_fits_and_counts_it(gallery, visit):
    page = visit().go("index.html")
    rows = rows_of(gallery, SLUGS[1])
    floors = sorted(row["psnr_svg"] for row in rows)
    between = (floors[1] + floors[2]) / 2
    for text, floor, by_hand in (
        ("", "", len(rows)),
        ("CAT", "", 2),
        ("<img", "", 1),
        ("no such", "", 0),
        ("", f"{between}", 2),
        ("", "99", 0),
        ("cat 10", "10", 1),
    ):
        page.locator("#find").fill(text)
        page.locator("#least").fill(floor)
        fitting = [
            row["photo"]
            for row in rows
            if text.lower() in row["photo"].lower() and row["psnr_svg"] >= float(floor or 0)
        ]
        assert names(page) == fitting
        assert len(fitting) == by_hand
        told = f"{by_hand} of {len(rows)} shown" if by_hand else "No photo matches"
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
                numbers.size(row["svg_bytes"]), numbers.whole(row["gaussians"]),
                numbers.seconds(row["total_s"]),
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


def test_cards_show_the_whole_picture(gallery, visit):
    page = visit().go("index.html")
    for row in rows_of(gallery, SLUGS[1]):
        card = page.locator(".card", has=page.get_by_text(row["photo"], exact=True))
        frame, image = card.locator(".frame").bounding_box(), card.locator("img").bounding_box()
        assert image == pytest.approx(frame, abs=1)  # the picture is fitted into its box


def test_index_lists_failures(gallery, visit):
    told = visit().go("index.html").locator(".failures").inner_text()
    assert gallery.failures[0]["photo"] == "broken.png"
    assert "Failed: 1" in told
    assert gallery.failures[0]["error"] in told


def test_each_point_of_the_trade_off_opens_its_svg(gallery, visit):
    one = visit()
    page = one.go("trade-off.html")
    charts = page.locator(".chart svg")
    axes = [axis for axis in SCORES if axis.key != "ssimulacra2_svg"]  # they are too small
    assert charts.count() == 2 * len(axes)
    wanted = {f"{row['page']}#{row['files']['SVG'].split('/')[-2]}" for row in gallery.rows}
    for chart, axis in zip(charts.all(), np.repeat(axes, 2), strict=True):
        links = chart.locator("a").evaluate_all("all => all.map((e) => e.getAttribute('href'))")
        assert sorted(links) == sorted(wanted)
        told = chart.locator("a").evaluate_all("all => all.map((e) => e.ariaLabel)")
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
        assert page.pdf().startswith(b"%PDF")
