"""Laws of the studio's page in a browser: what it asks of its server, and what if that fails."""

import pytest
import studio_site
from screens import expect
from studio_site import PLAIN, UPRIGHT, await_run, difference, draft, job_of, pick

pytestmark = pytest.mark.browser
photos, server, tabs, visit = (
    studio_site.photos, studio_site.server, studio_site.tabs, studio_site.visit,
)  # fmt: skip


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
    one = visit()
    one.expected.extend(["503", "404"])
    page = one.open()
    draft(page)
    pick(page, PLAIN)
    await_run(page, 1)
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


def test_few_runs_are_followed_at_once_however_many_the_server_fits(visit, photos):
    page = visit().open()
    most = page.evaluate(
        """async () => {
            const { Lane } = await import("./static/job.js");
            const lane = new Lane(16, () => {});
            let most = 0;
            lane.follow = async () => {
                most = Math.max(most, lane.running);
                await new Promise((done) => setTimeout(done, 1));
            };
            const runs = Array.from({length: 20}, () => ({photo: {}}));
            runs.forEach((run) => lane.add(run));
            while (lane.running) await new Promise((done) => setTimeout(done, 5));
            return most;
        }"""
    )
    assert most == 3


def test_an_error_map_that_is_not_there_yet_holds_nothing_up(visit):
    one = visit()
    one.expected.append("ERR_ABORTED")
    page = one.open()
    draft(page)
    pick(page, PLAIN)
    await_run(page, 1)
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
