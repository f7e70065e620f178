"""Laws of the studio's page in a browser: from a photo to its SVG, and out.

The file is long because the page has so many controls; each is used once.
"""

import io
import json
import re
import zipfile

import numpy as np
import pytest
import studio_site
from gallery_site import PHONE, WIDE, box, shot
from PIL import Image
from screens import OVERFLOW, expect, grave_faults
from studio_site import HOSTILE, PLAIN, UPRIGHT, aim, await_run, difference, draft, job_of, pick

from gauss2svg.compare import chart
from gauss2svg.measure.scores import PSNR, SSIM
from gauss2svg.studio.options import MOST_DRAWN

pytestmark = pytest.mark.browser
photos, server, tabs, visit = (
    studio_site.photos, studio_site.server, studio_site.tabs, studio_site.visit,
)  # fmt: skip

# Gives files to the page as a person does; a script may not set the files of a real event.
GIVE = """([kind, files]) => {
    const transfer = new DataTransfer();
    for (const [name, type, bytes] of files)
        transfer.items.add(new File([Uint8Array.from(bytes)], name, {type}));
    const given = {clipboardData: transfer, dataTransfer: transfer};
    const options = {bubbles: true, cancelable: true, ...given};
    if (kind === "paste") document.body.dispatchEvent(new ClipboardEvent("paste", options));
    else for (const one of ["dragenter", "dragover", "drop"])
        document.body.dispatchEvent(new DragEvent(one, options));
}"""
LONG = 200_000  # iterations, of a fit that only a person ends


def give(page, kind, *paths):
    files = [[path.name, "image/png", list(path.read_bytes())] for path in paths]
    page.evaluate(GIVE, [kind, files])


def start_long(page):
    """A fit that takes minutes, from its first shapes on."""
    aim(page, "Shapes", 300)
    page.locator("#more > summary").click()
    page.locator("#groups").get_by_text("Fit", exact=True).click()
    page.locator("#option-iterations").fill(str(LONG))
    pick(page, PLAIN)
    page.wait_for_selector("#stop:not([disabled])")


def after_a_run(visit, *complaints, **options):
    """A page with a finished draft of the small photo; its browser may complain so."""
    one = visit(**options)
    one.expected += complaints
    page = one.open()
    draft(page)
    pick(page, PLAIN)
    await_run(page, 1)
    expect(page.locator("#slider")).to_have_attribute("aria-valuenow", "50")
    return page


def asked_of(request):
    """The options in the body of a request for a run."""
    text = request.post_data_buffer.split(b'name="options"\r\n\r\n')[1].split(b"\r\n--")[0]
    return json.loads(text)


def run_asks(page):
    """Options that a click on Run sends; the run is not made, which its visit expects."""
    refused = {"status": 422, "json": {"error": "not made"}}
    page.route("**/api/jobs", lambda route: route.fulfill(**refused), times=1)
    with page.expect_response("**/api/jobs") as answered:
        page.locator("#run").click()
    return asked_of(answered.value.request)


def test_an_empty_page_says_what_happens_and_offers_samples(visit):
    page = visit().open()
    assert "before your eyes" in page.locator(".lead").text_content()
    assert page.locator("#samples li").all_text_contents() == sorted([HOSTILE, PLAIN, UPRIGHT])
    for one in page.locator("#samples img").all():
        expect(one).to_have_js_property("complete", True)
        assert one.evaluate("image => image.naturalWidth") > 0


@pytest.mark.parametrize("way", ["drop", "paste", "choose", "sample"])
def test_a_photo_comes_in(visit, photos, way):
    page = visit().open()
    draft(page)
    if way == "sample":
        pick(page, UPRIGHT)
    elif way == "choose":
        page.locator("#files").set_input_files(photos[UPRIGHT])
    else:
        give(page, way, photos[UPRIGHT])
    expect(page.locator("#title")).to_have_text(UPRIGHT)
    expect(page.locator("#facts")).to_have_text("64 \N{MULTIPLICATION SIGN} 96 px")
    await_run(page, 1)
    stage = box(page, "#stage")
    assert stage["width"] / stage["height"] == pytest.approx(64 / 96, rel=0.01)


def test_the_svg_is_that_of_the_service_and_its_figures_are_the_report_s(visit, server):
    page = after_a_run(visit)
    job = job_of(page)
    report = json.loads(server.get(f"api/jobs/{job}/report.json"))
    svg = server.get(f"api/jobs/{job}/picture.svg").decode()
    assert difference(page, f"api/jobs/{job}/picture.svg") == 0
    assert difference(page, f"api/jobs/{job}/errors.png") > 30
    assert len(svg) == report["svg_bytes"]
    cells = page.locator("#runs tbody td").all_text_contents()
    assert cells[:7] == [
        "draft", chart.whole(report["gaussians"]), f"{report['psnr_svg']:.2f}\u202fdB",
        f"{report['ssim_svg']:.3f}", chart.size(report["svg_bytes"]),
        chart.size(report["svgz_bytes"]), chart.seconds(report["total_s"]),
    ]  # fmt: skip
    figures = page.locator("#figures").text_content()
    assert all(text in figures for text in (*cells[1:5], f"({cells[5]} gzipped)", cells[6]))
    with page.expect_download() as saved:  # beside the figures, the file that they are of
        page.locator("#save-now").click()
    assert saved.value.path().read_text() == svg
    assert "35 is good" in page.locator("#meaning").text_content()
    last = page.locator("#last-run").text_content()
    assert last.startswith("The last run of this photo, draft, took ")
    assert all(text in last for text in (cells[1], cells[2], cells[4], cells[6]))
    expect(page.locator("#live")).to_contain_text("is done")


def test_the_page_s_own_numbers_are_those_of_all_pages(visit):
    """What is told while a fit runs is formatted by a script; the rest by Python."""
    counts = [0, 1, 999, 1000, 2625, 9994, 9996, 99_940, 99_960, 999_499, 999_501, 1_684_000, 10**8]
    times = [0.004, 0.5, 1.234, 9.994, 9.996, 12.34, 99.94, 99.96, 401.3, 1234.5678]
    asked = """async ([counts, times]) => {
        const { seconds, shortSize, size, whole } = await import("./static/numbers.js");
        return [
            [...counts, null].map(size), counts.map(shortSize), [...counts, null].map(whole),
            [...times, null].map(seconds),
        ];
    }"""
    sizes, shorts, wholes, seconds = visit().open().evaluate(asked, [counts, times])
    assert sizes == [chart.size(value) for value in (*counts, None)]
    assert shorts == [chart.tick(value, "bytes") for value in counts]
    assert wholes == [chart.whole(value) for value in (*counts, None)]
    assert seconds == [chart.seconds(value) for value in (*times, None)]


def test_shapes_are_seen_as_they_are_fitted_and_stop_keeps_the_best(visit, server):
    page = visit().open()
    start_long(page)
    assert "/frame?n=" in page.locator("#svg").get_attribute("src")
    expect(page.locator("#badge-right")).to_have_text("So far")
    first = page.locator("#svg").get_attribute("src")
    expect(page.locator("#svg")).not_to_have_attribute("src", first)
    for name in ("shapes", "psnr", "size", "time"):
        expect(page.locator(f"#now-{name}")).to_contain_text(
            {"shapes": "", "psnr": "dB", "size": "B", "time": "s"}[name]
        )
        assert page.locator(f"#now-{name}").is_visible()
    assert 0 <= page.locator("#bar").evaluate("bar => bar.value") < 1
    page.locator("#stop").click()
    await_run(page, 1)
    report = json.loads(server.get(f"api/jobs/{job_of(page)}/report.json"))
    assert report["stop_reason"] == "interrupted"
    assert 0 < report["iterations"] < LONG
    assert page.locator("#progress").is_hidden()


def test_cancel_leaves_no_run_and_the_photo(visit):
    page = visit().open()
    start_long(page)
    with page.expect_response(lambda answer: answer.request.method == "DELETE") as answered:
        page.locator("#cancel").click()
    assert answered.value.status == 204
    assert page.locator("#progress").is_hidden()
    assert page.locator("#trade").is_hidden()
    assert page.locator("#photo").is_visible()
    expect(page.locator("#live")).to_have_text("Run canceled")
    page.locator("#goal").get_by_role("radio", name="Quality", exact=True).check()
    draft(page)
    page.locator("#option-iterations").fill("5")
    page.locator("#run").click()
    await_run(page, 1)  # the core is free again


def test_a_page_that_goes_away_cancels_its_fit(visit, server):
    one = visit()
    page = one.open()
    with page.expect_response("**/api/jobs") as answered:
        start_long(page)
    job = answered.value.json()["id"]
    page.goto("about:blank")
    state = "running"
    for _ in range(100):
        state = json.loads(server.get(f"api/jobs/{job}"))["state"]
        if state != "running":
            break
        page.wait_for_timeout(100)
    assert state == "canceled"


def test_what_is_no_photo_is_refused_beside_where_it_was_dropped(visit, tmp_path):
    one = visit()
    one.expected.append("422")
    page = one.open()
    path = tmp_path / "notes.png"
    path.write_text("no photo")
    give(page, "drop", path)
    error = page.locator("#photo-error")
    expect(error).to_contain_text("notes.png")
    expect(error).to_have_role("alert")
    expect(page.locator("#empty")).to_be_visible()  # and the page is as before
    assert error.bounding_box()["y"] < page.locator(".drop").bounding_box()["y"]
    page.evaluate(GIVE, ["paste", []])
    expect(error).to_contain_text("no photo")
    draft(page)
    pick(page, PLAIN)
    expect(error).to_be_hidden()
    await_run(page, 1)


@pytest.mark.parametrize(
    ("kind", "value", "sent"),
    [
        ("Shapes", 45, {"gaussians": 45}),
        ("kB", 7.5, {"max_bytes": 7500}),
        ("dB", 24.5, {"target_psnr": 24.5}),
        ("Seconds", 0.75, {"time_limit": 0.75}),
    ],
)
def test_the_main_control_is_one_option_of_a_run(visit, server, kind, value, sent):
    page = visit().open()
    aim(page, kind, value)
    (name,) = sent
    expect(page.locator(f"#option-{name}")).to_be_hidden()
    at = page.locator("#amount").input_value()
    with page.expect_request("**/api/jobs") as asked:
        pick(page, PLAIN)
    assert asked_of(asked.value) == sent
    page.locator("#amount").focus()
    page.keyboard.press("ArrowRight")
    assert page.locator("#amount").input_value() != at
    assert float(page.locator("#exact").input_value()) > value  # the number follows the slider
    await_run(page, 1)
    report = json.loads(server.get(f"api/jobs/{job_of(page)}/report.json"))
    if kind == "Shapes":  # of which some may be pruned
        assert value / 2 < report["gaussians"] <= value
    else:
        assert {name: report[name] for name in sent} == sent


def test_quality_has_a_slider_too(visit):
    one = visit()
    one.expected.append("422")
    page = one.open()
    page.locator("#amount").focus()
    page.keyboard.press("Home")
    expect(page.locator("#preset")).to_have_value("draft")
    expect(page.locator("#amount")).to_have_attribute("aria-valuetext", "draft")
    pick(page, PLAIN)
    await_run(page, 1)
    page.keyboard.press("Tab")
    assert run_asks(page) == {"quality": "draft"}


def test_more_options_are_those_of_the_command_with_its_help(visit, server):
    page = visit().open()
    page.locator("#more > summary").click()
    groups = json.loads(server.get("api/options"))["groups"]
    assert len(groups) >= 5
    for group in groups:
        for option in group["options"]:
            field = page.locator(f"#option-{option['name']}")
            helped = page.locator(f"#option-{option['name']}-help")
            assert helped.text_content() == f"{option['help']} {option['flag']}"
            assert helped.get_attribute("id") in field.get_attribute("aria-describedby")
            if option["type"] == "boolean":
                assert field.is_checked() == option["default"]
            else:
                default = option["default"]
                shown = (
                    ""
                    if default is None
                    else f"{default:g}"
                    if isinstance(default, float)
                    else str(default)
                )
                assert field.input_value() == shown


def test_changed_options_are_sent_and_reset(visit):
    one = visit()
    one.expected.append("422")
    page = one.open()
    draft(page)
    page.locator("#more > summary").click()
    for summary in page.locator(".group > summary").all():
        summary.click()
    page.locator("#option-seed").fill("7")
    page.locator("#option-relocate").uncheck()
    page.locator("#option-stops").select_option("8")
    page.locator("#option-max_bytes").fill("8k")
    expect(page.locator("#changed")).to_have_text("4 changed")
    sent = {"quality": "draft", "seed": 7, "relocate": False, "stops": 8, "max_bytes": "8k"}
    with page.expect_request("**/api/jobs") as asked:
        pick(page, PLAIN)
    assert asked_of(asked.value) == sent
    await_run(page, 1)
    expect(page.locator("#runs tbody tr")).to_contain_text("draft, 4 more options")
    assert "--seed 7" in page.locator("#command").text_content()
    page.locator("#reset").click()
    assert run_asks(page) == {"quality": "draft"}


def test_a_bad_option_is_told_at_its_field(visit):
    page = after_a_run(visit, "422")
    page.locator("#more > summary").click()
    page.locator("#groups").get_by_text("SVG", exact=True).click()
    page.locator("#option-matte").fill("no colour")
    page.locator("#run").click()
    error = page.locator("#option-matte-error")
    expect(error).to_contain_text("matte must be")
    expect(page.locator("#option-matte")).to_be_focused()
    page.locator("#option-matte").fill("")
    expect(error).to_be_hidden()
    aim(page, "Shapes", -3)
    page.locator("#run").click()
    expect(page.locator("#goal-error")).not_to_be_empty()
    expect(page.locator("#exact")).to_be_focused()
    page.locator("#exact").fill("40")
    expect(page.locator("#goal-error")).to_be_empty()


def test_files_are_those_of_the_service(visit, server):
    one = visit()
    one.expected.append("422")
    page = one.open()
    draft(page)
    pick(page, UPRIGHT)
    await_run(page, 1)
    job = job_of(page)
    for name, query, full in (
        ("SVG", "", "cup.svg"),
        ("SVG, editable", "?markup=editable", "cup-editable.svg"),
        ("SVG, minimal", "?markup=minimal", "cup-minimal.svg"),
        ("SVGZ", "?gzip=1&download=1", "cup.svgz"),
    ):
        with page.expect_download() as saving:
            page.locator("#save").get_by_role("link", name=name, exact=True).click()
        saved = saving.value.path().read_bytes()
        assert saved == server.get(f"api/jobs/{job}/picture.svg{query}")
        assert saving.value.suggested_filename == full
    page.locator("#png-width").fill("200")
    with page.expect_download() as saving:
        page.locator("#png").click()
    with Image.open(saving.value.path()) as picture:
        assert picture.size == (200, 300)
    assert saving.value.suggested_filename == "cup-200.png"
    # The form and the service have one bound; a step wider is refused by both.
    most = int(page.locator("#png-width").get_attribute("max"))
    assert most * round(most * 1.5) <= MOST_DRAWN < (most + 1) * round((most + 1) * 1.5)
    page.locator("#png-width").fill(str(most + 1))
    expect(page.locator("#png-error")).to_contain_text(f"1 to {most} px")
    status = "async (path) => (await fetch(path)).status"
    assert page.evaluate(status, f"api/jobs/{job}/picture.png?width={most + 1}") == 422
    page.locator("#png-width").fill("0")
    expect(page.locator("#png-error")).to_contain_text("must be")
    assert page.locator("#png").get_attribute("href") is None


def test_the_clipboard_gets_what_the_buttons_say(visit, server):
    page = after_a_run(visit, permissions=["clipboard-read", "clipboard-write"])
    job = job_of(page)
    lines = json.loads(server.get(f"api/jobs/{job}"))["lines"]
    assert page.locator("#command").text_content() == lines["command"]
    assert page.locator("#python").text_content() == lines["python"]
    for what, wanted in (
        ("svg", server.get(f"api/jobs/{job}/picture.svg").decode()),
        ("data-uri", server.get(f"api/jobs/{job}/data-uri.txt").decode()),
        ("command", lines["command"]),
        ("python", lines["python"]),
    ):
        button = page.locator(f"[data-copy={what}]")
        button.click()
        expect(button).to_have_text("Copied")
        assert page.evaluate("navigator.clipboard.readText()") == wanted
    page.locator("[data-copy=png]").click()
    expect(page.locator("[data-copy=png]")).to_have_text("Copied")
    kinds = "navigator.clipboard.read().then((items) => items.flatMap((one) => one.types))"
    assert page.evaluate(kinds) == ["image/png"]


def test_several_photos_run_with_the_same_settings_and_come_as_a_zip(visit, server, photos):
    page = visit().open()
    draft(page)
    give(page, "drop", *photos.values())
    for number in (1, 2, 3):
        await_run(page, number)
    items = page.locator("#thumbnails button")
    assert items.count() == 3
    assert [one.locator(".name").text_content() for one in items.all()] == [*photos]
    items.nth(1).click()
    expect(page.locator("#title")).to_have_text(UPRIGHT)
    expect(items.nth(1)).to_have_attribute("aria-pressed", "true")
    svg = server.get(f"api/jobs/{job_of(page)}/picture.svg")
    with page.expect_download() as saving:
        page.locator("#zip").click()
    with zipfile.ZipFile(io.BytesIO(saving.value.path().read_bytes())) as archive:
        assert len(archive.namelist()) == 3
        assert svg in [archive.read(name) for name in archive.namelist()]
    aim(page, "Shapes", 20)
    page.locator("#run-all").click()
    for number in (4, 5, 6):
        await_run(page, number)
    counts = page.locator("#runs tbody tr td:nth-of-type(2)").all_text_contents()
    assert np.all(np.array(counts[3:], int) <= 20)


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


def run(page, number, count):
    aim(page, "Shapes", count)
    page.locator("#run").click()
    await_run(page, number)


def test_divider_shows_the_photo_on_its_left_and_the_svg_on_its_right(visit):
    page = after_a_run(visit, viewport=SCREEN)
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


def test_rounds_show_what_was_there_after_each(visit):
    page = after_a_run(visit, viewport=SCREEN)
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


def test_outlines_and_error_map_are_those_of_the_service(visit):
    page = after_a_run(visit, viewport=SCREEN)
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


def test_every_run_is_a_point_that_brings_its_picture_back(visit, server):
    page = after_a_run(visit, viewport=SCREEN)
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


def test_two_runs_stand_side_by_side_by_the_chart_the_table_or_the_list(visit):
    page = after_a_run(visit, viewport=SCREEN)
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


def test_nor_while_it_shows_all_it_can(visit, photos):
    page = after_a_run(visit, viewport=SCREEN)
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


def test_controls_are_large_enough_and_named(visit):
    page = after_a_run(visit, viewport=PHONE)
    for one in page.locator("button, select, input[type=number]").all():
        assert not one.is_visible() or one.bounding_box()["height"] >= 24, one.inner_html()
    expect(page.get_by_role("button", name="Zoom in")).to_be_visible()
    expect(page.get_by_role("slider", name="Divider")).to_be_visible()


def test_points_are_seen_by_day_and_by_night(visit):
    page = after_a_run(visit, viewport=SCREEN, color_scheme="light")
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


def test_a_photo_is_sent_once_and_again_when_the_server_has_lost_it(visit, server, photos):
    one = visit()
    one.expected.append("404")
    page = one.open()
    draft(page)
    again = []  # whether a run is asked for by its photo's earlier job

    def hear(asked):
        if asked.method == "POST" and asked.url.endswith("/api/jobs"):
            again.append(b'name="of"' in (asked.post_data_buffer or b""))

    page.on("request", hear)
    page.locator("#files").set_input_files(photos[UPRIGHT])
    await_run(page, 1)
    page.locator("#run").click()
    await_run(page, 2)
    assert again == [False, True]
    assert difference(page, f"api/jobs/{job_of(page)}/photo.png", "#photo") == 0
    page.evaluate("path => fetch(path, {method: 'DELETE'})", f"api/jobs/{job_of(page)}")
    page.locator("#run").click()
    await_run(page, 3)
    assert again == [False, True, True, False]
    expect(page.locator("#photo-error")).to_be_hidden()


def test_a_picture_that_fails_is_asked_for_again_before_its_run_is_called_forgotten(visit):
    page = after_a_run(visit, "503", "404")
    job = job_of(page)
    answers = iter([503])

    def once(route):
        status = next(answers, None)
        if status is None:
            route.continue_()
        else:
            route.fulfill(status=status)

    page.route("**/errors.png", once)
    page.get_by_label("Error map").check()
    expect(page.locator("#svg")).to_have_js_property("naturalWidth", 96)
    assert difference(page, f"api/jobs/{job}/errors.png") == 0
    expect(page.locator("#photo-error")).to_be_hidden()
    page.evaluate("path => fetch(path, {method: 'DELETE'})", f"api/jobs/{job}")
    page.get_by_label("Outlines").check()
    expect(page.locator("#photo-error")).to_contain_text("forgotten")


def test_an_error_map_that_is_not_there_yet_holds_nothing_up(visit):
    page = after_a_run(visit, "ERR_ABORTED")
    waiting = []
    page.route("**/errors.png", lambda route: waiting.append(route))
    picture = page.locator("#svg")
    page.get_by_label("Error map").check()
    expect(picture).to_have_attribute("aria-busy", "true")
    expect(picture).to_have_css("opacity", "0.3")  # it is still that of before
    page.get_by_label("SVG", exact=True).check()
    expect(picture).to_have_attribute("aria-busy", "false")
    assert difference(page, f"api/jobs/{job_of(page)}/picture.svg") == 0
    assert waiting
    page.unroute("**/errors.png")
    page.get_by_label("Error map").check()
    expect(picture).to_have_attribute("aria-busy", "false")
    assert difference(page, f"api/jobs/{job_of(page)}/errors.png") == 0
