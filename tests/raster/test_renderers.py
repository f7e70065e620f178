"""Properties of the renderers, and of what each refuses."""

import asyncio
import os
import select
import socket
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from conftest import needs
from scenes import random_scene

from gauss2svg.errors import InputError, RendererError
from gauss2svg.measure import metrics
from gauss2svg.raster import (
    BROWSERS,
    RENDERERS,
    chromium,
    rasterize,
    refuse_unsupported,
    renderer_version,
    renderers,
)
from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.svg import SvgFormat
from gauss2svg.svg.forms import GRADIENT, as_written
from gauss2svg.svg.write import write_svg

SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 40 30" width="40" height="30"{}</svg>'
GREEN = SVG.format('><rect width="40" height="30" fill="#0f0"/>')
BLUR = (
    '><defs><filter id="b" filterUnits="userSpaceOnUse" x="-4" y="-4" width="8" height="8" '
    'color-interpolation-filters="sRGB"><feGaussianBlur stdDeviation=".6"/></filter></defs>'
    '<rect width="40" height="30" fill="#fff"/>'
    '<circle r="1" transform="matrix({})" filter="url(#b)" fill="#00f"/>'
)
STRAIGHT, SHEARED = (SVG.format(BLUR.format(m)) for m in ("6 0 0 3 20 15", "6 3 0 4 20 15"))
TURNING = {"cairo", "librsvg", "resvg"}  # who draw blurs under a rotation wrongly
# Least dB of a random scene against the model; each has 1.5 to 2.5 more.
LEAST_DB = {
    "resvg": 52, "cairo": 50, "chromium": 55, "librsvg": 50, "firefox": 52, "inkscape": 50
}  # fmt: skip


def refusing(svg: str) -> set[str]:
    """The renderers that refuse an SVG, each by one line that names one that does not."""
    lines = {}
    for name in RENDERERS:
        try:
            refuse_unsupported(svg, name)
        except RendererError as error:
            lines[name] = str(error)
    assert not any("\n" in line for line in lines.values())
    assert not {line.rpartition("--renderer ")[2] for line in lines.values()} & set(lines)
    return set(lines)


def test_every_renderer_draws_the_model_at_its_decibels(renderer):
    scene = as_written(random_scene(60, 240, 160, 2, (2.0, 40.0), (1.0, 4.0)), GRADIENT)
    svg = write_svg(scene, SvgFormat(stops=12, precision=0.01))
    for scale in (1,) if renderer in BROWSERS else (1, 2):
        drawn = rasterize(svg, scale * 240, scale * 160, renderer)
        assert drawn.shape == (scale * 160, scale * 240, 3)
        assert drawn.dtype == np.float32
        model = render(scene, scale * 240, scale * 160)
        assert metrics.psnr(drawn, model) > LEAST_DB[renderer] - 6 * (scale - 1)
        assert abs(metrics.bias(drawn, model)) < 0.3
    color = np.array([10, 200, 77]) / 255
    drawn = rasterize(write_svg(Scene(7, 5, background=color)), 7, 5, renderer)
    np.testing.assert_allclose(drawn, np.broadcast_to(color, (5, 7, 3)), atol=1e-6)


def test_nothing_of_the_file_runs_and_nothing_is_loaded(renderer):
    with socket.create_server(("127.0.0.1", 0)) as server:
        site = f"http://127.0.0.1:{server.getsockname()[1]}"
        svg = SVG.format(
            ' xmlns:xlink="http://www.w3.org/1999/xlink" onload="paint()">'
            f"<style>@import url({site}/a.css);</style>"
            '<rect id="r" width="40" height="30" fill="#0f0"/>'
            f'<image x="20" width="20" height="30" xlink:href="{site}/a.png"/><script>'
            'function paint() { document.getElementById("r").setAttribute("fill", "#f00"); '
            f'fetch("{site}/a.js"); }} paint();</script>'
        )
        drawn = rasterize(svg, 40, 30, renderer)
        assert not select.select([server], [], [], 0)[0]  # nobody has called
    assert drawn[2, 2].tolist() == [0, 1, 0]


REFUSED = {
    "unknown renderer": (GREEN, (5, 5), "photoshop", "renderer must be one of resvg, cairo, "),
    "too large": ("", (14_000, 14_000), "resvg", r"at most 179 million px; .* 196 million"),
    "broken": ("<svg", (5, 5), "resvg", "cannot draw the SVG: .* Try to re-save it"),
    "blend": (SVG.format('><g style="mix-blend-mode:screen"/>'), (4, 3), "cairo",
              "one of resvg, chromium, .* uses, mix-blend-mode; got cairo. Try --renderer resvg"),
    "animation": (SVG.format('><g><set attributeName="x" to="1"/></g>'), (4, 3), "chromium",
                  "some moment of it; got chromium. Try a copy without the animation"),
    "blur": (SHEARED, (40, 30), "resvg", "must be one of chromium, firefox, inkscape for what"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_drawn_is_one_line(case):
    svg, size, name, line = REFUSED[case]
    with pytest.raises((InputError, RendererError), match=line) as caught:
        rasterize(svg, *size, name)
    assert "\n" not in str(caught.value)


MISSING = {
    "playwright": ("chromium", r'pip install "gauss2svg\[browser\]".*--renderer resvg'),
    "chromium": ("chromium", "chromium needs the program .*install.*--renderer resvg"),
    "librsvg": ("librsvg", "librsvg needs the program .*install.*--renderer resvg"),
    "firefox that fails": ("firefox", r"say its version: no libfoo\.so .*--renderer"),
}  # fmt: skip


@pytest.mark.posix
@pytest.mark.parametrize("case", MISSING)
def test_a_missing_or_broken_program_is_one_line_that_says_what_to_do(case, monkeypatch, tmp_path):
    name, line = MISSING[case]
    fails = case.endswith("fails")
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep if fails else None)
    if fails:
        program = tmp_path / "firefox"
        program.write_text("#!/bin/sh\necho a >&2; echo no libfoo.so >&2; exit 127")
        program.chmod(0o755)
    if case == "playwright":
        monkeypatch.setitem(sys.modules, "playwright", None)
    elif name == "chromium":
        pytest.importorskip("playwright")
    # Drawing fails in each program's own way.
    for ask in (renderer_version, lambda name: rasterize(GREEN, 4, 3, name))[: 1 if fails else 2]:
        with pytest.raises(RendererError, match=line) as caught:
            ask(name)
        assert "\n" not in str(caught.value)


@pytest.mark.posix
def test_a_program_that_hangs_or_fails_is_an_error(tmp_path):
    for command, line in (
        (["sleep", "60"], "the SVG: not done in 0.3 s"),
        (["sh", "-c", "echo no >&2; echo why >&2; exit 3"], r"SVG: why \(exit status 3\)"),
        ([str(tmp_path / "none")], "none cannot draw the SVG: No such file"),
    ):  # fmt: skip
        with pytest.raises(RendererError, match=f"{line}.*--renderer"):
            renderers.run(command, timeout_s=0.3)


def test_chromium_draws_for_many_threads_and_beside_a_running_loop(browser):
    async def inside() -> np.ndarray:
        return rasterize(GREEN, 30, 20, "chromium")

    with ThreadPoolExecutor(2) as threads:
        sizes = [(10, 20), (11, 19)]
        drawn = threads.map(lambda size: rasterize(GREEN, *size, "chromium"), sizes)
        assert [d.shape[1::-1] for d in drawn] == sizes
    assert (asyncio.run(inside()) == [0, 1, 0]).all()


def test_a_page_that_fails_is_one_line(browser, monkeypatch):
    monkeypatch.setattr(chromium, "_SITE", "chrome://crash")
    with pytest.raises(RendererError, match="Chromium cannot draw the SVG at 8x6") as caught:
        rasterize(GREEN, 8, 6, "chromium")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", [n for n in RENDERERS if n not in ("chromium", "cairo")])
def test_a_blur_that_is_not_refused_is_drawn_as_chromium_draws_it(name, browser):
    needs(name)
    svg = STRAIGHT if name in refusing(SHEARED) else SHEARED
    drawn = rasterize(svg, 160, 120, name)
    assert metrics.psnr(drawn, rasterize(svg, 160, 120, "chromium")) > 44


@pytest.mark.parametrize(
    ("inside", "refused"),
    [
        (BLUR.format("6 3 0 4 20 15"), TURNING),
        ('><g style="mix-blend-mode:normal;filter:none"/>', set()),
        ('><style>.a { mix-blend-mode : difference }</style><g class="a"/>', {"cairo"}),
        ('><g style="mix-blend-mode:plus-lighter"/>', set(RENDERERS) - {"chromium", "firefox"}),
        ('><g style="transform:rotate(9deg);filter:blur(2px)"/>', TURNING),
        ('><g id="a"/><use href="#a"/>', {"inkscape"}),
        (' xmlns:x="http://www.w3.org/1999/xlink"><g id="a"/><use x:href="#a"/>', set()),
        ("><title>No filter: raw photo, blur(2px); mix-blend-mode:screen</title>", set()),
        ("><style>@media (prefers-reduced-motion){g{animation:a 1s}}</style>", BROWSERS),
        ('><g><set attributeName="x" to="1"/></g>', BROWSERS),
        ('><mask id="m"><circle/></mask>', {"cairo"}),
        (write_svg(random_scene(20, 40, 30)).partition("<svg")[2].removesuffix("</svg>\n"), set()),
    ],
)  # fmt: skip
def test_what_a_file_uses_is_refused_by_those_who_do_not_draw_it(inside, refused):
    svg = SVG.format(inside) if inside.startswith((">", " xmlns:x")) else f"<svg{inside}</svg>"
    assert refusing(svg) == set(refused)
