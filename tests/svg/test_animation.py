"""Laws of animated files: they end as the still one, which renderers show."""

import io
import re

import numpy as np
import pytest
from conftest import random_scene
from PIL import Image
from screens import captured, opened_page

from gauss2svg.raster import rasterize
from gauss2svg.svg.document import Document
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import write_svg

pytestmark = pytest.mark.browser

SCENE = random_scene(30, 60, 45, 7, (2, 9))
STILL = write_svg(SCENE)
MOVING = write_svg(SCENE, document=Document(animate=6))
# Played, paused at a time in ms, or finished; and what the root then looks like.
# Two frames later, as a busy browser may show an earlier one until then.
AT = """async (ms) => {
    for (const a of document.getAnimations()) {
        if (ms === null) a.finish(); else { a.pause(); a.currentTime = ms; await a.ready; }
    }
    for (let k = 0; k < 2; k++) await new Promise(requestAnimationFrame);
}"""


def test_animation_adds_a_style_sheet_and_nothing_else():
    assert re.sub(r"<style.*?</style>", "", MOVING, flags=re.DOTALL) == STILL
    assert "<style" not in STILL


def test_rounds_begin_one_after_the_other_and_end_in_time():
    times = re.findall(r"fade-in ([\d.]+)s ([\d.]+)s backwards", MOVING)
    begins = [float(delay) for _, delay in times]
    assert begins == sorted(set(begins))
    assert begins[0] == 0
    ends = [float(duration) + float(delay) for duration, delay in times]
    assert max(ends) == pytest.approx(6, rel=1e-3)
    assert len(times) == STILL.count('id="round-')


def test_every_renderer_draws_the_end(renderer):
    difference = rasterize(MOVING, 60, 45, renderer) - rasterize(STILL, 60, 45, renderer)
    assert not difference.any()


def test_scene_is_read_back_from_an_animated_file():
    back, still = read_svg(MOVING), read_svg(STILL)
    np.testing.assert_array_equal(back.mean, still.mean)
    np.testing.assert_array_equal(back.opacity, still.opacity)
    np.testing.assert_array_equal(back.round_index, still.round_index)


def screenshots(motion: str, svg: str, times: list[float | None]) -> list[bytes]:
    taken = []
    with opened_page(motion, 60, 45) as page:
        page.set_content(f'<!doctype html><body style="margin:0">{svg[svg.index("<svg") :]}</body>')
        for time in times:
            if time != 0:
                page.evaluate(AT, time)
            taken.append(captured(page))
    return taken


def pixels_of(png: bytes) -> np.ndarray:
    with Image.open(io.BytesIO(png)) as picture:
        return np.asarray(picture.convert("RGB"), np.float64)


def test_browser_fades_rounds_in_and_ends_with_the_still_picture(browser):
    still = screenshots("no-preference", STILL, [0])[0]
    begin, middle, end = screenshots("no-preference", MOVING, [1e-3, 3000, None])
    assert end == still
    background, begun, halfway, ended = (
        np.round(SCENE.background * 255), *(pixels_of(png) for png in (begin, middle, end))
    )  # fmt: skip
    assert np.abs(begun - background).max() <= 1
    assert np.abs(halfway - background).max() > 50
    assert np.abs(halfway - ended).max() > 50


def test_reduced_motion_shows_the_end_at_once(browser):
    still = screenshots("reduce", STILL, [0])[0]
    assert screenshots("reduce", MOVING, [0])[0] == still
