"""Laws of the studio's page in a browser: from a photo to its SVG, and out."""

import io
import json
import zipfile

import numpy as np
import pytest
import studio_site
from gallery_site import box
from PIL import Image
from screens import expect
from studio_site import HOSTILE, PLAIN, UPRIGHT, aim, await_run, difference, draft, job_of, pick

from gauss2svg.compare import chart
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
    page = visit().open()
    draft(page)
    pick(page, PLAIN)
    await_run(page, 1)
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
    assert shorts == [chart.short_size(value) for value in counts]
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
    one = visit()
    one.expected.append("422")
    page = one.open()
    draft(page)
    pick(page, PLAIN)
    await_run(page, 1)
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
    page = visit(permissions=["clipboard-read", "clipboard-write"]).open()
    draft(page)
    pick(page, PLAIN)
    await_run(page, 1)
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
