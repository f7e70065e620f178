"""The studio's page in a browser: from a photo to its SVG, and out."""

import base64
import io
import json
import zipfile

import numpy as np
import pytest
import studio_site
from galleries import save
from gallery_site import HOSTILE, PHONE, WIDE, box
from pictures import antialiased_badge
from PIL import Image
from screens import OVERFLOW, check_access, expect
from studio_site import PLAIN, UPRIGHT, aim, await_run, difference, draft, job_of, pick

from gauss2svg.compare import chart
from gauss2svg.measure import PSNR, SSIM
from gauss2svg.studio.options import USES

pytestmark = pytest.mark.browser
photos, server, visit = studio_site.photos, studio_site.server, studio_site.visit

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
SCREEN, HUGE = {"width": 1280, "height": 1000}, {"width": 1920, "height": 1080}
LONG = 200_000  # iterations, of a fit that only a person ends


def give(page, kind, *paths):
    files = [[path.name, "image/png", list(path.read_bytes())] for path in paths]
    page.evaluate(GIVE, [kind, files])


def after_a_run(visit, *complaints):
    """A page with a finished draft of the small photo; its browser may complain so."""
    one = visit(viewport=SCREEN)
    one.expected += complaints
    page = one.open()
    draft(page)
    pick(page, PLAIN)
    await_run(page, 1)
    return page


def open_options(page):
    page.locator("#more > summary").click()
    for summary in page.locator(".group > summary").all():
        summary.click()


def report_of(page, server):
    return json.loads(server.get(f"api/jobs/{job_of(page)}/report.json"))


def run_asks(page):
    """Options that a click on Run sends; the run is not made, which its visit expects."""
    refused = {"status": 422, "json": {"error": "not made"}}
    page.route("**/api/jobs", lambda route: route.fulfill(**refused), times=1)
    with page.expect_response("**/api/jobs") as answered:
        page.locator("#run").click()
    body = answered.value.request.post_data_buffer
    return json.loads(body.split(b'name="options"\r\n\r\n')[1].split(b"\r\n--")[0])


def test_the_pictures_are_those_of_the_service_and_the_figures_those_of_the_report(visit, server):
    page = after_a_run(visit)
    home, report = f"api/jobs/{job_of(page)}", report_of(page, server)
    cells = page.locator("#runs tbody td").all_text_contents()
    assert cells[:7] == [
        "draft, 1 more option", chart.whole(report["gaussians"]), PSNR.text(report["psnr_svg"]),
        SSIM.text(report["ssim_svg"]), chart.size(report["svg_bytes"]),
        chart.size(report["svgz_bytes"]), chart.seconds(report["total_s"]),
    ]  # fmt: skip
    told = page.locator("#figures").text_content()
    assert all(text in told for text in (cells[1], cells[2], cells[4], cells[6]))
    assert difference(page, f"{home}/picture.svg") == 0
    assert difference(page, f"{home}/errors.png") > 30
    page.get_by_label("Outlines").check()
    for strokes in ("#outlines-left", "#outlines-right"):
        expect(page.locator(strokes)).to_be_visible()
        assert difference(page, f"{home}/outlines.svg", strokes) == 0
    page.get_by_label("Error map").check()
    expect(page.locator("#legend")).to_be_visible()
    assert difference(page, f"{home}/errors.png") == 0


def test_areas_and_lines_are_counted_and_each_kind_can_be_hidden(visit, server, photos, tmp_path):
    """In both markups. In minimal markup lines share an attribute, which tells them from areas."""
    drawing = antialiased_badge(96)
    for k, color in enumerate(((0.5, 0.1, 0.6), (0.1, 0.1, 0.1), (0.9, 0.5, 0.1))):
        drawing[6 + 7 * k : 9 + 7 * k, 50:90] = color
    save(drawing, tmp_path / "badge.png")
    page = visit(viewport=SCREEN).open()
    page.locator("#files").set_input_files(tmp_path / "badge.png")
    await_run(page, 1)
    aim(page, "kB", 3)
    page.locator("#run").click()
    await_run(page, 2)
    for run, markup in enumerate(("editable", "minimal")):
        page.locator(f"[data-action=show-{run + 1}]").click()
        report, file = report_of(page, server), f"api/jobs/{job_of(page)}/picture.svg"
        assert report["markup"] == markup
        counts = [report[key] for key in ("area_count", "line_count", "gaussians")]
        cells = page.locator("#runs tbody tr").nth(run).locator("td").all_text_contents()
        assert cells[1:4] == [chart.whole(count) for count in counts]
        for part in ("areas", "lines"):
            page.locator(f"[name={part}]").uncheck()
            assert difference(page, file) > 30
            page.locator(f"[name={part}]").check()
            assert difference(page, file) == 0


def test_shapes_are_seen_as_they_are_fitted_and_a_fit_is_canceled_or_stopped(visit, server):
    page = visit().open()
    page.locator("#run").click()
    expect(page.locator("#photo-error")).to_have_text("Choose a photo first.")
    aim(page, "Shapes", 300)
    open_options(page)
    page.locator("#option-iterations").fill(str(LONG))
    pick(page, PLAIN)
    page.wait_for_selector("#stop:not([disabled])")
    first = page.locator("#svg").get_attribute("src")
    assert "/frame?n=" in first
    expect(page.locator("#svg")).not_to_have_attribute("src", first)
    for name, unit in {"psnr": "dB", "size": "B", "time": "s"}.items():
        expect(page.locator(f"#now-{name}")).to_contain_text(unit)
    with page.expect_response(lambda answer: answer.request.method == "DELETE") as answered:
        page.locator("#cancel").click()
    assert answered.value.status == 204
    expect(page.locator("#live")).to_have_text("Run canceled")
    page.locator("#run").click()
    page.wait_for_selector("#stop:not([disabled])")
    page.locator("#stop").click()
    await_run(page, 1)
    assert 0 < report_of(page, server)["iterations"] < LONG


def test_controls_are_options_of_a_run_and_what_is_wrong_is_told_where_it_is(visit, tmp_path):
    page = after_a_run(visit, "422")
    assert run_asks(page) == {"quality": "draft", "iterations": 20}
    for kind, value, sent in (
        ("Shapes", 45, {"gaussians": 45}), ("kB", 7.5, {"max_bytes": 7500}),
        ("dB", 24.5, {"target_psnr": 24.5}), ("Seconds", 0.75, {"time_limit": 0.75}),
    ):  # fmt: skip
        aim(page, kind, value)
        assert run_asks(page) == sent | {"iterations": 20}
        page.locator("#amount").press("ArrowRight")  # the number follows the slider
        assert float(page.locator("#exact").input_value()) > value
    open_options(page)
    page.locator("#option-seed").fill("7")
    page.locator("#option-relocate").uncheck()
    page.locator("#option-stops").select_option("8")
    expect(page.locator("#changed")).to_have_text("4 changed")
    changed = {"iterations": 20, "seed": 7, "relocate": False, "stops": 8}
    assert {"time_limit", *changed} == set(run_asks(page))
    page.locator("#reset").click()
    assert not changed.keys() & run_asks(page).keys()
    page.locator("#option-matte").fill("no colour")
    page.locator("#run").click()
    expect(page.locator("#option-matte-error")).to_contain_text("matte must be")
    expect(page.locator("#option-matte")).to_be_focused()
    page.locator("#option-matte").fill("")
    (tmp_path / "notes.png").write_text("no photo")
    give(page, "drop", tmp_path / "notes.png")
    expect(page.locator("#photo-error")).to_contain_text("notes.png")
    expect(page.locator("#photo-error")).to_have_role("alert")


def test_a_first_choice_sets_the_controls_shows_them_and_leaves_the_others(visit):
    page = after_a_run(visit, "422")
    page.locator("#more > summary").click()
    page.get_by_text("Fit", exact=True).nth(1).click()
    page.locator("#option-seed").fill("7")
    for title, options in reversed(USES.values()):  # the first is chosen already
        page.locator("#uses").get_by_role("radio", name=title, exact=True).check()
        goal = {} if options.keys() & {"max_bytes"} else {"quality": "balanced"}
        asked = goal | options | {"iterations": 20, "seed": 7}
        sent = run_asks(page)
        assert sent | ({"inks": int(sent["inks"])} if "inks" in sent else {}) == asked
        for name, value in options.items():
            if name not in ("quality", "max_bytes"):
                expect(page.locator(f"#set #option-{name}")).to_have_value(str(value))
                expect(page.locator("#use-set")).to_contain_text(f"{name} {value}")


def test_inks_are_listed_and_what_a_run_can_save_is_offered(visit, server):
    page = after_a_run(visit)
    expect(page.locator("#meaning")).to_contain_text("35 is good")
    aim(page, "kB", 5)
    page.locator("#run").click()
    await_run(page, 2)
    expect(page.locator("#set #option-markup-note")).to_contain_text("--markup editable")
    expect(page.locator("#notes")).to_have_text("")
    expect(page.get_by_role("link", name="HTML", exact=True)).to_be_visible()
    expect(page.get_by_role("link", name="Plates", exact=True)).to_be_hidden()
    page.locator("#uses").get_by_role("radio", name="Poster in inks", exact=True).check()
    draft(page)
    page.locator("#run").click()
    await_run(page, 3)
    expect(page.locator("#meaning")).not_to_contain_text("35")
    report = report_of(page, server)
    listed = page.locator("#inks li").all_text_contents()
    assert [line.split()[0] for line in listed] == report["inks"].split(",")
    assert sum(float(line.split()[1]) for line in listed) == pytest.approx(100, abs=0.4)


def test_files_and_the_clipboard_have_what_the_service_has(visit, server):
    page = after_a_run(visit)
    home = f"api/jobs/{job_of(page)}"

    def saved(link):
        with page.expect_download() as saving:
            link.click()
        return saving.value.suggested_filename, saving.value.path().read_bytes()

    for name, query, file in (
        ("SVG, minimal", "?markup=minimal", "cat-minimal.svg"),
        ("SVGZ", "?gzip=1&download=1", "cat.svgz"),
    ):
        link = page.locator("#save").get_by_role("link", name=name, exact=True)
        assert saved(link) == (file, server.get(f"{home}/picture.svg{query}"))
    page.locator("#png-width").fill("200")
    with Image.open(io.BytesIO(saved(page.locator("#png"))[1])) as picture:
        assert picture.size == (200, 134)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    svg, command = server.get(f"{home}/picture.svg"), json.loads(server.get(home))["command"]
    uri = f"data:image/svg+xml;base64,{base64.b64encode(svg).decode()}"
    texts = {"svg": svg.decode(), "data-uri": uri, "command": command}
    for name, text in texts.items():
        page.locator(f"[data-copy={name}]").click()
        expect(page.locator(f"[data-copy={name}]")).to_have_text("Copied")
        assert page.evaluate("navigator.clipboard.readText()") == text


def test_photos_are_dropped_pasted_or_chosen_and_their_files_come_as_a_zip(visit, server, photos):
    page = visit().open()
    draft(page)
    give(page, "drop", photos[PLAIN], photos[UPRIGHT])
    page.locator("#files").set_input_files(photos[HOSTILE])
    for number in (1, 2, 3):
        await_run(page, number)
    items = page.locator("#thumbnails button")
    assert page.locator("img[onerror]").count() == 0  # names are text
    assert items.locator(".name").all_text_contents() == [*photos]
    items.nth(1).click()
    expect(page.locator("#title")).to_have_text(UPRIGHT)
    expect(page.locator("#facts")).to_have_text("64 \N{MULTIPLICATION SIGN} 96 px")
    stage = box(page, "#stage")
    assert stage["width"] / stage["height"] == pytest.approx(64 / 96, rel=0.01)
    svg = server.get(f"api/jobs/{job_of(page)}/picture.svg")
    with page.expect_download() as saving:
        page.locator("#zip").click()
    with zipfile.ZipFile(io.BytesIO(saving.value.path().read_bytes())) as archive:
        assert len(archive.namelist()) == 3
        assert svg in [archive.read(name) for name in archive.namelist()]
    give(page, "paste", photos[UPRIGHT])
    await_run(page, 4)


def test_where_the_brush_paints_is_the_focus_of_the_next_run(visit, server):
    page = after_a_run(visit, "404")
    page.locator("#paint").check()
    stage = box(page, "#stage")
    at = [
        (stage["x"] + share * stage["width"], stage["y"] + stage["height"] / 2)
        for share in (0.2, 0.5)
    ]
    page.mouse.move(*at[0])
    page.mouse.down()
    page.mouse.move(*at[1], steps=4)
    page.mouse.up()
    page.locator("#run").click()
    await_run(page, 2)
    job = job_of(page)
    mask = np.asarray(Image.open(io.BytesIO(server.get(f"api/jobs/{job}/focus.png"))))
    middle = mask[len(mask) // 2, :, 3] / 255
    assert (mask[mask[:, :, 3] > 0, :3] == 255).all()
    assert middle[len(middle) // 5 :][: len(middle) // 4].min() == 1
    assert middle[int(0.7 * len(middle)) :].max() == mask[0].max() == 0
    report = json.loads(server.get(f"api/jobs/{job}/report.json"))
    for part in ("inside", "outside"):
        expect(page.locator("#figures")).to_contain_text(f"{report[f'psnr_svg_{part}']:.2f}")


def test_every_run_is_a_point_that_brings_its_picture_back(visit, server):
    page = after_a_run(visit)
    aim(page, "Shapes", 20)
    page.locator("#run").click()
    await_run(page, 2)
    expect(page.locator("#chart .point")).to_have_count(2)
    jobs = []
    for number in (1, 2):
        point = page.locator(f"#chart [data-run='{number}']")
        point.locator(".target").click()
        expect(point).to_have_attribute("aria-pressed", "true")
        jobs.append(job_of(page))
        assert difference(page, f"api/jobs/{jobs[-1]}/picture.svg") == 0
        assert PSNR.text(report_of(page, server)["psnr_svg"]) in point.get_attribute("aria-label")
    page.locator("[data-action=compare-1]").click()
    expect(page.locator("#badge-left")).to_contain_text("Run 1")
    assert difference(page, f"api/jobs/{jobs[0]}/picture.svg", "#photo") == 0
    assert difference(page, f"api/jobs/{jobs[0]}/picture.svg") > 0


def test_no_grave_accessibility_fault_while_the_page_shows_all(visit, photos):
    page = after_a_run(visit)
    open_options(page)
    page.locator("#files").set_input_files(photos[UPRIGHT])
    await_run(page, 2)
    page.locator("#run").click()
    await_run(page, 3)
    page.locator("[data-action=compare-2]").click()
    page.get_by_label("Outlines").check()
    page.get_by_label("Error map").check()
    page.evaluate("document.getElementById('photo-error').hidden = false")
    check_access(page, PHONE, WIDE)
    page.set_viewport_size(HUGE)
    assert page.evaluate(OVERFLOW) == 0


def test_everything_is_done_by_keys(visit):
    page = visit(viewport=SCREEN).open()
    draft(page)

    def tab_to(what, key):
        for _ in range(60):
            page.keyboard.press("Tab")
            if page.evaluate("what => document.activeElement.matches(what)", what):
                break
        else:
            raise AssertionError(what)
        page.keyboard.press(key)

    page.locator(".skip").focus()
    tab_to("#samples button", "Enter")
    await_run(page, 1)
    tab_to("#amount", "ArrowRight")
    expect(page.locator("#preset")).to_have_value("fast")
    page.keyboard.press("ArrowLeft")
    tab_to("#run", "Enter")
    await_run(page, 2)
    tab_to("#chart .point", "Shift+Enter")
    expect(page.locator("#badge-left")).to_contain_text("Run 1")
    with page.expect_download():
        tab_to("[data-file]", "Enter")
    tab_to("[data-action=show-1]", "Enter")
    expect(page.locator("#badge-right")).to_contain_text("SVG, draft")
