"""Laws of a gallery's photo pages in a browser: the screen shows what is in the files."""

import json
import re
from functools import partial

import numpy as np
import pytest
from gallery_site import COUNTS, PHONE, WIDE, box, shot, zoomed
from PIL import Image
from scipy.ndimage import binary_dilation

from gauss2svg.compare import chart
from gauss2svg.measure.heatmap import error_map
from gauss2svg.measure.scores import PSNR
from gauss2svg.photo.alpha import over, pixels_of
from gauss2svg.photo.load import load_image
from gauss2svg.raster import rasterize

pytestmark = pytest.mark.browser

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


def test_divider_follows_the_mouse(visit, headless):
    page = opened(visit)
    stage = box(page, "#stage")
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
    check_halves(page, headless, 0.25)


def test_divider_follows_a_finger(visit, headless):
    one = visit(has_touch=True, viewport=SCREEN)
    page = one.go(f"{PAGE}/index.html")
    page.add_style_tag(content=BARE)
    stage = box(page, "#stage")
    y = stage["y"] + 100
    places = [stage["x"] + at * stage["width"] for at in (0.5, 0.55, 0.7, 0.8)]
    one.touch("Start", (places[0], y))
    for x in places[1:]:
        one.touch("Move", (x, y))
    one.touch("End")
    assert share(page) == 80
    check_halves(page, headless, 0.8)


def test_a_finger_moves_the_picture_that_is_zoomed(visit):
    one = visit(has_touch=True, viewport=SCREEN)
    page = one.go(f"{PAGE}/index.html")
    page.get_by_label(ZOOMS[8]).check()
    stage, before = box(page, "#stage"), box(page, "#svg")
    x, y = stage["x"] + 200, stage["y"] + 200
    one.touch("Start", (x, y))
    one.touch("Move", (x - 20, y + 10))
    one.touch("Move", (x - 40, y + 20))
    one.touch("End")
    assert share(page) == 50
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


def test_focus_is_seen(visit):
    page = opened(visit)
    stage = box(page, "#stage")
    around = {"x": stage["x"] - 8, "y": stage["y"] + 8, "width": 7, "height": 200}
    before = shot(page, around)
    for _ in range(30):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.id") == "slider":
            break
    assert page.evaluate("document.activeElement.id") == "slider"
    assert np.abs(shot(page, around) - before).max() > 100


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


@pytest.mark.parametrize("zoom", ZOOMS)
def test_zoom_is_exact_and_both_sides_move_in_step(visit, headless, zoom):
    page = opened(visit)
    page.get_by_label("Outlines").check()
    page.get_by_label(ZOOMS[zoom]).check()
    stage = box(page, "#stage")

    def check_layout():
        place = box(page, "#photo")
        assert box(page, "#svg") == place == box(page, "#outlines-right")
        assert (place["width"], place["height"]) == (SIZE["x"] * zoom, SIZE["y"] * zoom)
        return place

    def room(place, axis, extent):
        """Least and most of where the picture may begin."""
        left = stage[extent] - place[extent]
        return (left, 0) if left < 0 else (left / 2, left / 2)

    slide_to(page, "Home")
    for key, axis, extent, end in (
        ("ArrowLeft", "x", "width", 1), ("ArrowRight", "x", "width", 0),
        ("ArrowUp", "y", "height", 1), ("ArrowDown", "y", "height", 0),
    ):  # fmt: skip
        before = check_layout()
        slide_to(page, f"Shift+{key}")
        assert share(page) == 0  # the divider stays
        after = check_layout()
        for _ in range(6 if zoom == 8 else 1):
            slide_to(page, f"Shift+{key}")
        last = check_layout()
        ends = room(before, axis, extent)
        at = stage[axis] + ends[end]
        assert last[axis] == pytest.approx(at, abs=1)
        step = min(60, abs(at - before[axis]))
        assert abs(after[axis] - before[axis]) == pytest.approx(step, abs=1)
    page.mouse.move(stage["x"] + 300, stage["y"] + 300)
    page.mouse.down()
    page.mouse.move(stage["x"] + 333, stage["y"] + 322, steps=3)
    page.mouse.up()
    moved = check_layout()
    if zoom == 8:
        assert (moved["x"] - last["x"], moved["y"] - last["y"]) == (33, 22)
    page.mouse.move(stage["x"] + 400, stage["y"] + 400)
    assert check_layout() == moved
    page.get_by_label("Outlines").uncheck()
    assert alike(shot(page, stage), _over_tint(page, headless, moved, stage))


def _over_tint(page, headless, place, stage):
    """The expected stage: the SVG rasterised at this size, on the stage's own colour."""
    wanted = headless.alone(f"{PAGE}/{MAIN}/picture.svg", place, stage)
    tint = page.evaluate("getComputedStyle(document.getElementById('stage')).backgroundColor")
    left, top = (round(place[axis]) - round(stage[axis]) for axis in "xy")
    y, x = np.mgrid[: wanted.shape[0], : wanted.shape[1]] + 0.5
    outside = (x < left) | (x > left + place["width"]) | (y < top) | (y > top + place["height"])
    wanted[outside] = [int(text) for text in re.findall(r"\d+", tint)]
    return wanted


def test_enlarged_the_svg_stays_sharp(visit):
    page = opened(visit)
    slide_to(page, "Home")
    stage = box(page, "#stage")
    page.get_by_label(ZOOMS[1]).check()
    small = shot(page, box(page, "#svg"))
    page.get_by_label(ZOOMS[8]).check()
    place, screen = box(page, "#svg"), shot(page, stage)
    blown_up = Image.fromarray(small.astype(np.uint8)).resize((960, 720), Image.Resampling.BICUBIC)
    left, top = round(stage["x"] - place["x"]), round(stage["y"] - place["y"])
    part = np.asarray(blown_up, float)[top : top + len(screen), left : left + screen.shape[1]]
    assert np.abs(part - screen).max() >= 2 * SAME
    assert np.abs(part - screen).mean() < 6  # and is the same part of the same picture


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


def test_the_side_that_is_hardly_seen_has_no_name(visit):
    page = visit(viewport=SCREEN).go(f"{PAGE}/index.html")
    left, right = page.locator("#badge-left"), page.locator("#badge-right")
    for key, seen in (("Home", (False, True)), ("End", (True, False)), ("PageDown", (True, False))):
        slide_to(page, key)
        assert (left.is_visible(), right.is_visible()) == seen, key
    slide_to(page, "PageDown")
    assert left.is_visible()
    assert right.is_visible()


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


def test_divider_is_dragged_by_its_handle_where_the_picture_is_zoomed(visit):
    page = opened(visit)
    page.get_by_label(ZOOMS[8]).check()
    stage, before = box(page, "#stage"), box(page, "#photo")
    x, y = stage["x"] + stage["width"] / 2, stage["y"] + stage["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(stage["x"] + 0.75 * stage["width"], y, steps=3)
    page.mouse.up()
    assert share(page) == 75
    assert box(page, "#photo") == before


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
    page.get_by_label("SVG", exact=True).check()
    assert not legend.is_visible()


def test_divider_names_what_is_beside_the_photo(visit):
    page = opened(visit)
    assert "% SVG" in page.locator("#slider").get_attribute("aria-valuetext")
    page.get_by_label("Error map").check()
    assert "% error map" in page.locator("#slider").get_attribute("aria-valuetext")


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
