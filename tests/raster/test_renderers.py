"""Laws of the renderers that are installed beside the package, and of what each refuses."""

import asyncio
import http.server
import os
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from typing import get_args, get_type_hints

import numpy as np
import pytest
from conftest import needs, random_scene

from gauss2svg.cli.check import CheckOptions
from gauss2svg.errors import RendererError
from gauss2svg.measure import metrics
from gauss2svg.pipeline.options import RunOptions
from gauss2svg.raster import (
    BROWSERS,
    RENDERERS,
    chromium,
    program,
    rasterize,
    refuse_unsupported,
    renderer_version,
)
from gauss2svg.render import render
from gauss2svg.svg.blur import GRADIENT
from gauss2svg.svg.format import SvgFormat
from gauss2svg.svg.snap import snapped
from gauss2svg.svg.write import write_svg

SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 40 30" width="40" height="30"{}</svg>'
GREEN = SVG.format('><rect width="40" height="30" fill="#0f0"/>')
BLUR = (
    '><defs><filter id="b" filterUnits="userSpaceOnUse" x="-4" y="-4" width="8" height="8" '
    'color-interpolation-filters="sRGB"><feGaussianBlur stdDeviation=".6"/></filter></defs>'
    '<rect width="40" height="30" fill="#fff"/>'
    '<circle r="1" transform="matrix({})" filter="url(#b)" fill="#00f"/>'
)
# Least dB of a random scene against the model; each has 1.5 to 2.5 more.
LEAST_DB = {
    "resvg": 52, "cairo": 50, "chromium": 55, "librsvg": 50, "firefox": 52, "inkscape": 50
}  # fmt: skip


def refusal(svg: str, width: int, height: int, name: str) -> str | None:
    """What the renderer says that it cannot draw, None if it can."""
    try:
        refuse_unsupported(svg, width, height, name)
    except RendererError as error:
        return str(error)
    return None


def test_every_renderer_draws_the_model_at_its_decibels(renderer):
    scene = snapped(random_scene(60, 240, 160, 2, (2.0, 40.0), (1.0, 4.0)), GRADIENT)
    svg = write_svg(scene, SvgFormat(stops=12, precision=0.01))
    drawn = rasterize(svg, 240, 160, renderer)
    assert drawn.shape == (160, 240, 3)
    model = render(scene)
    assert metrics.psnr(drawn, model) > LEAST_DB[renderer]
    assert abs(metrics.bias(drawn, model)) < 0.3
    assert drawn.dtype == np.float32


def test_the_command_line_knows_every_renderer():
    for holder in (RunOptions, CheckOptions):
        assert get_args(get_type_hints(holder)["renderer"]) == RENDERERS


def test_nothing_of_the_file_runs_and_nothing_is_loaded(renderer):
    asked = []

    class Server(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            self.send_error(404)

        def log_message(self, *_):
            pass

    server = http.server.HTTPServer(("127.0.0.1", 0), Server)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        site = f"http://127.0.0.1:{server.server_port}"
        svg = SVG.format(
            ' xmlns:xlink="http://www.w3.org/1999/xlink" onload="paint()">'
            f"<style>@import url({site}/a.css);</style>"
            '<rect id="r" width="40" height="30" fill="#0f0"/>'
            f'<image x="20" width="20" height="30" xlink:href="{site}/a.png"/><script>'
            'function paint() { document.getElementById("r").setAttribute("fill", "#f00"); '
            f'fetch("{site}/a.js"); }} paint();</script>'
        )
        drawn = rasterize(svg, 40, 30, renderer)
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
    assert asked == []
    assert drawn[2, 2].tolist() == [0, 1, 0]


def test_pictures_that_are_too_large_are_refused_unread():
    with pytest.raises(RendererError, match=r"at most 179 .* 196 million") as caught:
        rasterize("", 14_000, 14_000)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", [n for n in RENDERERS if n not in ("resvg", "cairo")])
def test_a_missing_program_is_one_line_that_says_what_to_do(name, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv(chromium.PROGRAM_VARIABLE, raising=False)
    for ask in (lambda: renderer_version(name), lambda: rasterize(GREEN, 4, 3, name)):
        with pytest.raises(RendererError, match=f"{name} needs .*install.*--renderer resvg") as got:
            ask()
        assert "\n" not in str(got.value)


@pytest.mark.skipif(os.name != "posix", reason="a shell script stands in for a program")
@pytest.mark.parametrize("name", ["chromium", "librsvg", "firefox", "inkscape"])
def test_a_program_that_cannot_say_its_version_is_one_line(name, monkeypatch, tmp_path):
    for called in ("chromium", "rsvg-convert", "firefox", "inkscape"):
        (tmp_path / called).write_text("#!/bin/sh\necho no libfoo.so >&2; exit 127")
        (tmp_path / called).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.delenv(chromium.PROGRAM_VARIABLE, raising=False)
    with pytest.raises(RendererError, match=r"cannot say its version: no libfoo\.so .*--renderer"):
        renderer_version(name)


@pytest.mark.skipif(os.name != "posix", reason="a shell script stands in for a program")
def test_a_chromium_that_does_not_start_is_one_line_with_its_complaint(monkeypatch, tmp_path):
    pytest.importorskip("playwright")
    (tmp_path / "chromium").write_text("#!/bin/sh\necho first >&2; echo no libfoo.so >&2; exit 127")
    (tmp_path / "chromium").chmod(0o755)
    monkeypatch.setenv(chromium.PROGRAM_VARIABLE, str(tmp_path / "chromium"))
    monkeypatch.setattr(chromium, "_started", None)
    try:
        with pytest.raises(
            RendererError, match=r"did not start: no libfoo.so. Try to reinstall"
        ) as got:
            rasterize(GREEN, 4, 3, "chromium")
    finally:
        chromium._worker().close()
    assert "\n" not in str(got.value)


@pytest.mark.parametrize(("have", "refused"), [("1.57.9", True), ("1.58.0", False), ("2.0", False)])
def test_playwright_that_hangs_is_refused(have, refused, monkeypatch):
    pytest.importorskip("playwright")
    monkeypatch.setattr(chromium.importlib.metadata, "version", lambda _: have)
    with pytest.raises(RendererError, match=r"at least 1\.58") if refused else nullcontext():
        chromium._playwright()


def test_missing_playwright_is_one_line_that_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "playwright", None)
    with pytest.raises(RendererError, match=r'pip install "gauss2svg\[browser\]"') as caught:
        renderer_version("chromium")
    assert "\n" not in str(caught.value)


def test_a_named_chromium_that_is_none_is_an_error(monkeypatch, tmp_path):
    pytest.importorskip("playwright")
    monkeypatch.setenv(chromium.PROGRAM_VARIABLE, str(tmp_path))
    with pytest.raises(RendererError, match="must be the path of a Chromium"):
        renderer_version("chromium")


def test_chromium_draws_for_many_threads_and_beside_a_running_loop(browser):
    async def inside() -> np.ndarray:
        return rasterize(GREEN, 30, 20, "chromium")

    with ThreadPoolExecutor(3) as threads:
        sizes = [(10 + n, 20 - n) for n in range(4)]
        drawn = threads.map(lambda size: rasterize(GREEN, *size, "chromium"), sizes)
        assert [d.shape[1::-1] for d in drawn] == sizes
    assert (asyncio.run(inside()) == [0, 1, 0]).all()


def test_a_page_that_fails_is_an_error_and_the_next_is_drawn(browser, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(chromium, "_SITE", "chrome://crash")
        with pytest.raises(RendererError, match="Chromium cannot draw the SVG at 8x6") as caught:
            rasterize(GREEN, 8, 6, "chromium")
        assert "\n" not in str(caught.value)
    assert (rasterize(GREEN, 8, 6, "chromium") == [0, 1, 0]).all()


def test_a_browser_that_ended_is_started_again(browser):
    rasterize(GREEN, 8, 6, "chromium")
    worker = chromium._worker()
    worker.call(lambda: worker._browser.close())
    assert (rasterize(GREEN, 8, 6, "chromium") == [0, 1, 0]).all()


@pytest.mark.sweep
def test_a_large_file_is_drawn_by_chromium(browser):
    comment = "<!--" + "x" * 10_000_000 + "-->"
    svg = SVG.format(f'>{comment}<rect width="40" height="30" fill="#0f0"/>')
    assert (rasterize(svg, 40, 30, "chromium") == [0, 1, 0]).all()


@pytest.mark.skipif(os.name != "posix", reason="a shell script stands in for a program")
def test_a_program_that_hangs_or_fails_is_an_error_and_its_children_end(tmp_path):
    mark = tmp_path / "mark"
    with pytest.raises(
        RendererError, match=r"sh cannot draw the SVG in 0.3 s. Try to draw it smaller"
    ):
        program.run(["sh", "-c", f"(sleep 1; touch {mark}) & wait"], timeout_s=0.3)
    with pytest.raises(RendererError, match=r"sh cannot draw the SVG: why \(exit status 3\)"):
        program.run(["sh", "-c", "echo no >&2; echo why >&2; exit 3"])
    with pytest.raises(RendererError, match="cannot be started"):
        program.run([str(tmp_path / "none")])
    threading.Event().wait(1)
    assert not mark.exists()


@pytest.mark.parametrize(
    ("matrix", "size", "refused"),
    [
        ("6 0 0 6 20 15", (40, 30), {"cairo"}),
        ("6 0 0 3 20 15", (40, 30), {"cairo"}),
        ("0 3 -6 0 20 15", (40, 30), {"cairo"}),
        ("4 3 -3 4 20 15", (40, 30), {"cairo", "librsvg"}),
        ("4 3 3 -4 20 15", (40, 30), {"cairo", "librsvg"}),
        ("4 3 -3 4 20 15", (80, 30), {"cairo", "librsvg", "resvg"}),
        ("6 3 0 4 20 15", (40, 30), {"cairo", "librsvg", "resvg"}),
    ],
)
def test_blurs_are_refused_by_those_who_draw_them_wrongly(matrix, size, refused):
    svg = SVG.format(BLUR.format(matrix))
    said = {name: refusal(svg, *size, name) for name in RENDERERS}
    assert {name for name, text in said.items() if text} == refused
    lines = [line for line in said.values() if line is not None]
    assert all("\n" not in line for line in lines)
    assert not {line.rpartition("--renderer ")[2] for line in lines} & refused


@pytest.mark.parametrize("name", [n for n in RENDERERS if n != "chromium"])
def test_a_blur_that_is_not_refused_is_drawn_as_chromium_draws_it(name, browser):
    straight, sheared = (SVG.format(BLUR.format(m)) for m in ("6 0 0 3 20 15", "6 3 0 4 20 15"))
    svg = straight if refusal(sheared, 160, 120, name) else sheared
    if refusal(svg, 160, 120, name):
        with pytest.raises(RendererError, match="for what the SVG uses, a blur"):
            rasterize(svg, 160, 120, name)
        return
    needs(name)
    drawn = rasterize(svg, 160, 120, name)
    assert metrics.psnr(drawn, rasterize(svg, 160, 120, "chromium")) > 44


@pytest.mark.parametrize(
    ("inside", "refused"),
    [
        ('><g style="mix-blend-mode:normal;filter:none"/>', set()),
        ('><style>.a { mix-blend-mode : difference }</style><g class="a"/>', {"cairo"}),
        ('><g style="mix-blend-mode:plus-lighter"/>', set(RENDERERS) - {"chromium", "firefox"}),
        ('><filter id="f"><feOffset/></filter><g filter="url(#f)"/>', {"cairo"}),
        ('><g style="filter:blur(2px)"/>', {"cairo"}),
        ('><g transform="rotate(9)"><g style="filter:blur(2px)"/></g>', {"cairo", "librsvg"}),
        ('><g transform="skewX(9)"><g filter="blur(2px)"/></g>', {"cairo", "librsvg", "resvg"}),
        ('><g id="a"/><use href="#a"/>', {"inkscape"}),
        ('><a href="#a"/>', set()),
        (' xmlns:x="http://www.w3.org/1999/xlink"><g id="a"/><use x:href="#a"/>', set()),
        ("><title>No filter: raw photo, blur(2px); mix-blend-mode:screen</title>", set()),
        ("><style>/* filter:blur(2px) */ g { opacity:1 }</style>", set()),
        ('><g style="FILTER : Blur(2px)"/>', {"cairo"}),
        ('><g style="f\\69lter:blur(2px)"/>', {"cairo"}),
        ('><g style="f&#105;lter:blur(2px)"/>', {"cairo"}),
        ("><style>circle{-webkit-filter:blur(2px)}</style>", {"cairo"}),
        ('><g style="color-interpolation-filters:sRGB;backdrop-filter:none"/>', set()),
        ("><style>g{animation:a 1s}</style>", BROWSERS),
        ('><g style="animation-name:a"/>', BROWSERS),
        (
            "><style>@media (prefers-reduced-motion:no-preference){g{animation:a 1s} g{x:y}}"
            "g{animation:none}</style>",
            set(),
        ),
        ("><style>@media (prefers-reduced-motion){g{animation:a 1s}}</style>", BROWSERS),
        ('><g><set attributeName="x" to="1"/></g>', BROWSERS),
        ('><g><animateTransform attributeName="transform"/></g>', BROWSERS),
        ("><style>g{transition:fill 1s}</style>", set()),  # nothing changes in a still file
    ],
)
def test_what_a_file_uses_is_refused_by_those_who_do_not_draw_it(inside, refused):
    svg = SVG.format(inside)
    assert {name for name in RENDERERS if refusal(svg, 40, 30, name)} == set(refused)


@pytest.mark.parametrize("turn", ["rotate(1e999)", "skewX(-1e999)", "matrix(1 0 0 1e999 0 0)"])
def test_endless_numbers_in_a_file_of_blurs_are_one_line(turn):
    svg = SVG.format(f'><g transform="{turn}" style="filter:blur(2px)"/>')
    with pytest.raises(RendererError, match="must have finite numbers") as caught:
        rasterize(svg, 40, 30, "resvg")
    assert "\n" not in str(caught.value)
    huge = SVG.format('><g transform="matrix(1e200 0 1e200 1e200 0 0)" style="filter:blur(2px)"/>')
    assert refusal(huge, 40, 30, "resvg")


def test_half_a_character_is_refused_at_once(renderer):
    with pytest.raises(RendererError, match="text that a file can hold; got a lone surrogate"):
        rasterize(SVG.format("><title>\ud800</title>"), 4, 3, renderer)


BEFORE_THE_ROOT = (
    '<!-- <svg viewBox="0 0 1 1"> -->',
    '<?xml version="1.0"?><?a <svg viewBox="0 0 1 1"> ?>\n',
    '<!DOCTYPE svg [<!ENTITY green "#0f0"><!-- "]> <svg viewBox=""> -->]>',
)


# The root is found without the renderer, so one case of the others is enough.
@pytest.mark.parametrize(
    ("renderer", "before", "prefix"),
    [("resvg", before, prefix) for before in BEFORE_THE_ROOT for prefix in ("", "s:")]
    + [(name, BEFORE_THE_ROOT[1], "s:") for name in RENDERERS[1:]],
    indirect=["renderer"],
)
def test_the_root_is_what_is_stretched(before, prefix, renderer):
    fill = "&green;" if "ENTITY" in before else "#0f0"
    spaces = 'xmlns="http://www.w3.org/2000/svg" xmlns:s="http://www.w3.org/2000/svg"'
    svg = (
        f'{before}<{prefix}svg {spaces} viewBox="0 0 10 10" style="width:5px; height:7px">'
        f'<svg viewBox="0 0 1 1" width="5" height="10" preserveAspectRatio="none">'
        f'<rect width="1" height="1" fill="{fill}"/></svg></{prefix}svg>'
    )
    drawn = rasterize(svg, 40, 30, renderer)
    assert (drawn[:, :20] == [0, 1, 0]).all()
    assert (drawn[:, 20:] == 1).all()


def test_difference_is_drawn_exactly_or_refused(renderer):
    svg = SVG.format(
        '><rect width="40" height="30" fill="#804020"/>'
        '<rect width="40" height="30" fill="#609030" style="mix-blend-mode:difference"/>'
    )
    if renderer == "cairo":
        with pytest.raises(RendererError, match="must be one of resvg, chromium"):
            rasterize(svg, 40, 30, renderer)
    else:
        drawn = rasterize(svg, 40, 30, renderer)
        np.testing.assert_allclose(drawn[9, 9] * 255, [32, 80, 16], atol=0.01)


def test_a_written_file_uses_nothing_that_any_of_them_refuses():
    svg = write_svg(random_scene(20, 40, 30))
    assert not any(refusal(svg, 40, 30, name) for name in RENDERERS)
