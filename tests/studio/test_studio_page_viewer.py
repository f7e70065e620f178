"""Laws of the studio's page in a browser: the stage, the trade, and access for everyone."""

import json
import re

import numpy as np
import pytest
import studio_site
from gallery_site import PHONE, WIDE, box, shot, zoomed
from screens import CONTROLS, OVERFLOW, expect, grave_faults
from studio_site import HOSTILE, PLAIN, aim, await_run, difference, draft, job_of, pick

from gauss2svg.measure.scores import PSNR, SSIM

pytestmark = pytest.mark.browser
photos, server, tabs, visit = (
    studio_site.photos, studio_site.server, studio_site.tabs, studio_site.visit,
)  # fmt: skip

SCREEN = {"width": 1280, "height": 1000}
HUGE = {"width": 1920, "height": 1080}
# Whether the element with the focus looks different from how it looks without.
IS_SEEN = """() => {
    const one = document.activeElement.closest(".segments label")?.querySelector("span")
        ?? document.activeElement.querySelector(".target") ?? document.activeElement;
    const look = () => [one, document.activeElement, document.getElementById("stage")].map(
        (each) => ["outline", "stroke", "boxShadow"].map((it) => getComputedStyle(each)[it]).join(),
    ).join();
    const focused = document.activeElement, before = look();
    focused.blur();
    const after = look();
    focused.focus();
    return before !== after;
}"""


@pytest.fixture
def done(visit):
    """Opens the page with one run of the small photo."""

    def open_one(**options):
        one = visit(**({"viewport": SCREEN} | options))
        page = one.open()
        draft(page)
        pick(page, PLAIN)
        await_run(page, 1)
        expect(page.locator("#slider")).to_have_attribute("aria-valuenow", "50")
        return one

    return open_one


def run(page, number, count):
    aim(page, "Shapes", count)
    page.locator("#run").click()
    await_run(page, number)


def test_divider_shows_the_photo_on_its_left_and_the_svg_on_its_right(done):
    page = done().page
    stage = box(page, "#stage")
    slider = page.locator("#slider")
    slider.focus()
    screens = []
    for key in ("End", "Home"):
        page.keyboard.press(key)
        expect(slider).to_have_attribute("aria-valuenow", "100" if key == "End" else "0")
        page.wait_for_timeout(200)  # the divider glides
        screens.append(shot(page, stage))
    assert difference(page, f"api/samples/{PLAIN}", "#photo") == 0
    assert difference(page, f"api/jobs/{job_of(page)}/picture.svg") == 0
    assert np.abs(screens[0] - screens[1]).mean() > 1
    assert "% SVG" in slider.get_attribute("aria-valuetext")


def test_zoom_is_set_and_told_by_buttons(done):
    page = done().page
    fit = zoomed(page, 96)
    for button, wanted, pressed in (
        ("closer", 1.5 * fit, ""), ("closer", 2.25 * fit, ""), ("farther", 1.5 * fit, ""),
        ("actual", 1, "actual"), ("fit", fit, "fit"),
    ):  # fmt: skip
        page.locator(f"#{button}").click()
        assert zoomed(page, 96) == pytest.approx(wanted, rel=0.01)
        expect(page.locator("#zoom")).to_have_text(f"{round(100 * zoomed(page, 96))} %")
        for one in ("actual", "fit"):
            told = page.locator(f"#{one}").get_attribute("aria-pressed")
            assert told == str(one == pressed).lower()


def test_rounds_show_what_was_there_after_each(done):
    page = done().page
    rounds, words = page.locator("#rounds"), page.locator("#round")
    many = int(rounds.get_attribute("max"))
    assert many > 2
    assert rounds.input_value() == str(many)
    counts, last = [], page.locator("#svg").get_attribute("src")
    whole = f"api/jobs/{job_of(page)}/picture.svg"
    distances = []
    for at in range(1, many + 1):
        rounds.fill(str(at))
        expect(words).to_contain_text(f"after round {at}: ")
        counts.append(int(words.text_content().split()[-2]))
        if at == many:
            expect(page.locator("#svg")).to_have_attribute("src", last)
        else:
            expect(page.locator("#svg")).not_to_have_attribute("src", last)
        distances.append(difference(page, whole))
    assert counts == sorted(counts)
    assert page.locator("#figures").text_content().startswith(f"{counts[-1]} shapes")
    assert distances[0] > 30
    assert distances[-1] == 0


def test_outlines_and_error_map_are_those_of_the_service(done):
    page = done().page
    job = job_of(page)
    for strokes in ("#outlines-left", "#outlines-right"):
        expect(page.locator(strokes)).to_be_hidden()
    page.get_by_label("Outlines").check()
    for strokes in ("#outlines-left", "#outlines-right"):
        expect(page.locator(strokes)).to_be_visible()
        assert difference(page, f"api/jobs/{job}/outlines.svg", strokes) == 0
    page.get_by_label("Outlines").uncheck()
    expect(page.locator("#outlines-left")).to_be_hidden()
    page.get_by_label("Error map").check()
    expect(page.locator("#legend")).to_be_visible()
    expect(page.locator("#badge-right")).to_have_text("Errors, run 1")
    assert difference(page, f"api/jobs/{job}/errors.png") == 0
    assert "error map" in page.locator("#slider").get_attribute("aria-valuetext")
    ramp = page.locator(".ramp").evaluate("one => getComputedStyle(one).backgroundImage")
    assert ramp.count("rgb") > 5
    page.get_by_label("SVG", exact=True).check()
    expect(page.locator("#legend")).to_be_hidden()
    assert difference(page, f"api/jobs/{job}/picture.svg") == 0


def test_every_run_is_a_point_that_brings_its_picture_back(done, server):
    page = done().page
    run(page, 2, 20)
    run(page, 3, 60)
    expect(page.locator("#chart .point")).to_have_count(3)
    reports = {}
    for number in (1, 2, 3):
        point = page.locator(f"#chart [data-run='{number}']")
        if number == 2:
            point.focus()
            page.keyboard.press("Enter")
        else:
            point.locator(".target").click()
        expect(page.locator(f"#chart [data-run='{number}']")).to_have_attribute(
            "aria-pressed", "true"
        )
        assert difference(page, f"api/jobs/{job_of(page)}/picture.svg") == 0
        reports[number] = json.loads(server.get(f"api/jobs/{job_of(page)}/report.json"))
        label = page.locator(f"#chart [data-run='{number}']").get_attribute("aria-label")
        assert PSNR.text(reports[number]["psnr_svg"]) in label
        row = page.locator("#runs tbody tr").nth(number - 1)
        expect(row).to_have_attribute("aria-current", "true")
        expect(row).to_contain_text(SSIM.text(reports[number]["ssim_svg"]))
    # Right is more bytes, above is the better score; so for the other axes.
    for cost, key in (("Size", "svg_bytes"), ("Time", "total_s")):
        for score, of in (("PSNR", "psnr_svg"), ("SSIM", "ssim_svg")):
            page.locator("#axes").get_by_label(cost, exact=True).check()
            page.locator("#axes").get_by_label(score, exact=True).check()
            drawn = page.locator("#chart > svg")
            words = {"Size": "size of the SVG", "Time": "time, photo to"}[cost]
            expect(drawn).to_have_attribute("aria-label", re.compile(f"^{score}.*{words}"))
            places = {n: box(page, f"#chart [data-run='{n}'] .target") for n in reports}
            for axis, field, sign in (("x", key, 1), ("y", of, -1)):
                seen = sorted(reports, key=lambda n: sign * places[n][axis])
                assert seen == sorted(reports, key=lambda n: reports[n][field]), (axis, field)
    page.locator("[data-action=show-1]").click()
    expect(page.locator("#figures")).to_contain_text(PSNR.text(reports[1]["psnr_svg"]))


def test_two_runs_stand_side_by_side_by_the_chart_the_table_or_the_list(done):
    page = done().page
    first = job_of(page)
    run(page, 2, 15)
    second = job_of(page)
    for compare in (
        lambda: page.locator("#chart [data-run='1'] .target").click(modifiers=["Shift"]),
        lambda: page.locator("[data-action=compare-1]").click(),
        lambda: page.locator("#left").select_option("1"),
    ):
        compare()
        expect(page.locator("#badge-left")).to_contain_text("Run 1")
        expect(page.locator("#badge-right")).to_contain_text("Run 2")
        assert difference(page, f"api/jobs/{first}/picture.svg", "#photo") == 0
        assert difference(page, f"api/jobs/{second}/picture.svg") == 0
        expect(page.locator("[data-action=compare-1]")).to_have_attribute("aria-pressed", "true")
        assert "% run 1" in page.locator("#slider").get_attribute("aria-valuetext")
        page.locator("[data-action=compare-1]").click()
        expect(page.locator("#badge-left")).to_have_text("Photo")
        assert difference(page, f"api/samples/{PLAIN}", "#photo") == 0


def test_names_are_text(visit):
    page = visit().open()
    draft(page)
    pick(page, HOSTILE)
    expect(page.locator("#title")).to_have_text(HOSTILE)
    await_run(page, 1)
    expect(page.locator("#runs tbody th")).to_have_text(f"1, {HOSTILE}")
    assert page.locator("img[onerror]").count() == 0


def check_access(page):
    """The page from a phone to a wide screen, in light, dark and forced colours."""
    for size in (WIDE, PHONE, HUGE):
        page.set_viewport_size(size)
        for forced in ("active", "none"):
            page.emulate_media(color_scheme="light", forced_colors=forced)
            assert page.evaluate(OVERFLOW) == 0, size
        if size != WIDE:  # between the two
            assert not grave_faults(page), size
    page.emulate_media(color_scheme="dark")  # colours do not depend on the size
    assert not grave_faults(page, runOnly=["color-contrast"])


def test_no_grave_accessibility_fault_in_the_empty_page(visit):
    page = visit().open()
    assert not grave_faults(page)
    page.locator("#more > summary").click()
    for summary in page.locator(".group > summary").all():
        summary.click()
    check_access(page)


def test_nor_while_it_shows_all_it_can(done, photos):
    page = done().page
    page.locator("#files").set_input_files(list(photos.values())[:2])
    for number in (2, 3):
        await_run(page, number)
    run(page, 4, 15)
    page.locator("[data-action=compare-2]").click()
    page.get_by_label("Outlines").check()
    page.get_by_label("Error map").check()
    page.evaluate("document.getElementById('photo-error').hidden = false")
    check_access(page)


def test_everything_is_done_by_keys_and_the_focus_is_seen(visit):
    page = visit(viewport=SCREEN).open()
    draft(page)

    def tab_to(what, most=60):
        for _ in range(most):
            page.keyboard.press("Tab")
            if page.evaluate("what => document.activeElement.matches(what)", what):
                return
            focused = page.evaluate("document.activeElement.tagName")
            assert focused == "BODY" or page.evaluate(IS_SEEN), page.evaluate(
                "document.activeElement.outerHTML"
            )
        raise AssertionError(what)

    page.locator(".skip").focus()
    tab_to("#samples button")
    page.keyboard.press("Enter")
    await_run(page, 1)
    tab_to("#slider")
    page.keyboard.press("ArrowRight")
    expect(page.locator("#slider")).to_have_attribute("aria-valuenow", "52")
    tab_to("#amount")
    page.keyboard.press("ArrowRight")
    expect(page.locator("#preset")).to_have_value("fast")
    page.keyboard.press("ArrowLeft")
    tab_to("#run")
    page.keyboard.press("Enter")
    await_run(page, 2)
    tab_to("#chart .point")
    page.keyboard.press("Shift+Enter")
    expect(page.locator("#badge-left")).to_contain_text("Run 1")
    tab_to("[data-file]")
    with page.expect_download():
        page.keyboard.press("Enter")
    tab_to("[data-copy=python]")
    tab_to("[data-action=show-1]")
    page.keyboard.press("Enter")
    expect(page.locator("#badge-right")).to_contain_text("SVG, draft")


def test_controls_are_large_enough_and_named(done):
    page = done(viewport=PHONE).page
    for one in page.locator(CONTROLS).all():
        if one.is_visible() and one.evaluate(
            "e => e.matches('button, select, input[type=number]')"
        ):
            assert one.bounding_box()["height"] >= 24, one.evaluate("e => e.outerHTML")
    expect(page.get_by_role("button", name="Zoom in")).to_be_visible()
    expect(page.get_by_role("slider", name="Divider")).to_be_visible()


def test_points_are_seen_by_day_and_by_night(done):
    page = done(color_scheme="light").page
    for number, count in ((2, 15), (3, 60)):
        run(page, number, count)
    expect(page.locator("#chart .point")).to_have_count(3)
    page.locator("#chart").scroll_into_view_if_needed()
    check_points(page)
    page.emulate_media(color_scheme="dark")
    check_points(page)


def check_points(page):
    """Each point has its colour where it lies."""
    for number in range(1, 4):
        wanted = page.locator(f"#chart [data-run='{number}']").evaluate(
            "e => getComputedStyle(e).fill"
        )
        place = box(page, f"#chart [data-run='{number}'] .target")
        x, y = place["x"] + place["width"] / 2, place["y"] + place["height"] / 2
        seen = shot(page, {"x": x - 1, "y": y - 1, "width": 2, "height": 2}).reshape(-1, 3)
        levels = [int(text) for text in wanted[4:-1].split(",")]
        assert np.abs(seen - levels).max() < 3, number
