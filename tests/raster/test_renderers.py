"""Laws of the renderers, and of what each refuses."""

import asyncio
import builtins
import http.server
import os
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from conftest import needs, random_scene

from gauss2svg.errors import InputError, RendererError
from gauss2svg.measure import metrics
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
from gauss2svg.scene import Scene
from gauss2svg.svg.blur import GRADIENT, snapped
from gauss2svg.svg.document import SvgFormat
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
    scene = snapped(random_scene(60, 240, 160, 2, (2.0, 40.0), (1.0, 4.0)), GRADIENT)
    svg = write_svg(scene, SvgFormat(stops=12, precision=0.01))
    for scale in (1, 2):
        drawn = rasterize(svg, scale * 240, scale * 160, renderer)
        assert drawn.shape == (scale * 160, scale * 240, 3)
        assert drawn.dtype == np.float32
        model = render(scene, scale * 240, scale * 160)
        assert metrics.psnr(drawn, model) > LEAST_DB[renderer] - 6 * (scale - 1)
        assert abs(metrics.bias(drawn, model)) < 0.3


def test_background_comes_back_to_the_level(renderer):
    color = np.array([10, 200, 77]) / 255
    drawn = rasterize(write_svg(Scene(7, 5, background=color)), 7, 5, renderer)
    np.testing.assert_allclose(drawn, np.broadcast_to(color, (5, 7, 3)), atol=1e-6)


def test_any_size_is_filled_whatever_the_proportions(renderer):
    svg = (
        '<svg xmlns="http://www.w3.org/2000/svg" width="20" height="20" viewBox="0 0 20 20">'
        '<rect width="20" height="20" fill="#00f"/><rect width="10" height="20" fill="#f00"/></svg>'
    )
    for width, height in ((31, 64), (7, 5)):
        drawn = rasterize(svg, width, height, renderer)
        assert (drawn[:, : width // 2] == [1, 0, 0]).all()
        assert (drawn[:, (width + 1) // 2 :] == [0, 0, 1]).all()


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


REFUSED = {
    "unknown renderer": (GREEN, (5, 5), "photoshop", "renderer must be one of resvg, cairo, "),
    "too large": ("", (14_000, 14_000), "resvg", r"at most 179 million px; .* 196 million"),
    "broken": ("<svg", (5, 5), "resvg", "cannot draw the SVG: .* Try to re-save it"),
    "own document type": ('<!DOCTYPE svg [<!ENTITY a "b">]><svg/>', (4, 3), "resvg",
                          "cannot draw the SVG: .* document type of its own"),
    "half a character": (SVG.format("><title>\ud800</title>"), (4, 3), "resvg", "surrogates not"),
    "blend": (SVG.format('><g style="mix-blend-mode:screen"/>'), (4, 3), "cairo",
              "one of resvg, chromium, .* uses, mix-blend-mode; got cairo. Try --renderer resvg"),
    "blur": (SHEARED, (40, 30), "resvg", "must be one of chromium, firefox, inkscape for what"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_drawn_is_one_line(case):
    svg, size, name, line = REFUSED[case]
    with pytest.raises((InputError, RendererError), match=line) as caught:
        rasterize(svg, *size, name)
    assert "\n" not in str(caught.value)


FAILING = "#!/bin/sh\necho first >&2; echo no libfoo.so >&2; exit 127"
MISSING = {
    "cairo": ("cairo", "", "apt-get install libcairo2.*--renderer resvg"),
    "playwright": ("chromium", "", r'pip install "gauss2svg\[browser\]".*--renderer resvg'),
    "chromium by name": ("chromium", "", "GAUSS2SVG_CHROMIUM must be the path of a Chromium"),
    **{name: (name, "", f"{name} needs the program .*install.*--renderer resvg")
       for name in RENDERERS[2:]},
    **{f"{name} that fails": (name, FAILING, r"say its version: no libfoo\.so .*--renderer")
       for name in RENDERERS[2:]},
}  # fmt: skip


@pytest.mark.posix
@pytest.mark.parametrize("case", MISSING)
def test_a_missing_or_broken_program_is_one_line_that_says_what_to_do(case, monkeypatch, tmp_path):
    name, script, line = MISSING[case]
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep if script else None)
    monkeypatch.delenv(chromium.PROGRAM_VARIABLE, raising=False)
    if script:
        for called in ("chromium", "rsvg-convert", "firefox", "inkscape"):
            (tmp_path / called).write_text(script)
            (tmp_path / called).chmod(0o755)
    if case == "playwright":
        monkeypatch.setitem(sys.modules, "playwright", None)
    elif name == "chromium":
        pytest.importorskip("playwright")
    if case == "chromium by name":
        monkeypatch.setenv(chromium.PROGRAM_VARIABLE, str(tmp_path))
    if case == "cairo":
        real = builtins.__import__

        def without_cairo(module, *rest):
            if module == "cairosvg":
                raise OSError("no library called cairo was found")
            return real(module, *rest)

        monkeypatch.setattr(builtins, "__import__", without_cairo)
    monkeypatch.setattr(chromium, "_browser", lambda _: chromium._Browser())  # not started
    for ask in (lambda: renderer_version(name), lambda: rasterize(GREEN, 4, 3, name)):
        with pytest.raises(RendererError, match=line) as caught:
            ask()
        assert "\n" not in str(caught.value)
        if script:  # drawing fails in each program's own way
            break


@pytest.mark.posix
def test_a_chromium_that_does_not_start_is_one_line_with_its_complaint(monkeypatch, tmp_path):
    pytest.importorskip("playwright")
    (tmp_path / "chromium").write_text(FAILING)
    (tmp_path / "chromium").chmod(0o755)
    monkeypatch.setenv(chromium.PROGRAM_VARIABLE, str(tmp_path / "chromium"))
    monkeypatch.setattr(chromium, "_browser", lambda _: chromium._Browser())
    with pytest.raises(RendererError, match=r"start: no libfoo\.so\. Try to reinstall") as caught:
        rasterize(GREEN, 4, 3, "chromium")
    assert "\n" not in str(caught.value)


@pytest.mark.posix
def test_a_program_that_hangs_or_fails_is_an_error_and_its_children_end(tmp_path):
    mark = tmp_path / "mark"
    for command, line in (
        (["sh", "-c", f"(sleep 1; touch {mark}) & wait"], "the SVG: not done in 0.3 s"),
        (["sh", "-c", "echo no >&2; echo why >&2; exit 3"], r"SVG: why \(exit status 3\)"),
        ([str(tmp_path / "none")], "none cannot draw the SVG: No such file"),
    ):  # fmt: skip
        with pytest.raises(RendererError, match=f"{line}.*--renderer"):
            program.run(command, timeout_s=0.3)
    threading.Event().wait(1)
    assert not mark.exists()


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
    own = chromium._browser(os.getpid())
    asyncio.run_coroutine_threadsafe(own._browser.close(), own._loop).result()
    assert (rasterize(GREEN, 8, 6, "chromium") == [0, 1, 0]).all()


@pytest.mark.sweep
def test_a_large_file_is_drawn_by_chromium(browser):
    comment = "<!--" + "x" * 10_000_000 + "-->"
    svg = SVG.format(f'>{comment}<rect width="40" height="30" fill="#0f0"/>')
    assert (rasterize(svg, 40, 30, "chromium") == [0, 1, 0]).all()


@pytest.mark.parametrize(
    ("matrix", "refused"),
    [
        ("6 0 0 6 20 15", {"cairo"}),
        ("6,0,0,3,20,15", {"cairo"}),
        ("4 3 -3 4 20 15", {"cairo", "librsvg", "resvg"}),
        ("6 3 0 4 20 15", {"cairo", "librsvg", "resvg"}),
    ],
)
def test_blurs_are_refused_by_those_who_draw_them_wrongly(matrix, refused):
    assert refusing(SVG.format(BLUR.format(matrix))) == refused


@pytest.mark.parametrize("name", [n for n in RENDERERS if n not in ("chromium", "cairo")])
def test_a_blur_that_is_not_refused_is_drawn_as_chromium_draws_it(name, browser):
    needs(name)
    svg = STRAIGHT if name in refusing(SHEARED) else SHEARED
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
        ('><g transform="rotate(9)" style="filter:blur(2px)"/>', {"cairo", "librsvg", "resvg"}),
        ('><g transform="skewX(9)"><g filter="blur(2px)"/></g>', {"cairo", "librsvg", "resvg"}),
        ('><g style="transform:rotate(9deg);filter:blur(2px)"/>', {"cairo", "librsvg", "resvg"}),
        ('><g style="text-transform:none;filter:blur(2px)"/>', {"cairo"}),
        ('><g id="a"/><use href="#a"/>', {"inkscape"}),
        ('><a href="#a"/>', set()),
        (' xmlns:x="http://www.w3.org/1999/xlink"><g id="a"/><use x:href="#a"/>', set()),
        ("><title>No filter: raw photo, blur(2px); mix-blend-mode:screen</title>", set()),
        ("><!-- filter:blur(2px) --><g opacity='1'/>", set()),
        ('><g style="FILTER : Blur(2px)"/>', {"cairo"}),
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
        (write_svg(random_scene(20, 40, 30)).partition("<svg")[2].removesuffix("</svg>\n"), set()),
    ],
)  # fmt: skip
def test_what_a_file_uses_is_refused_by_those_who_do_not_draw_it(inside, refused):
    svg = SVG.format(inside) if inside.startswith((">", " xmlns:x")) else f"<svg{inside}</svg>"
    assert refusing(svg) == set(refused)


BEFORE_THE_ROOT = (
    '<!-- <svg viewBox="0 0 1 1"> -->',
    '<?xml version="1.0"?><?a <svg viewBox="0 0 1 1"> ?>\n',
    '<!DOCTYPE svg PUBLIC "a>" "b"><!-- "]> <svg viewBox=""> -->',
)


# The root is found without the renderer, so one case of the others is enough.
@pytest.mark.parametrize(
    ("renderer", "before", "prefix"),
    [("resvg", before, prefix) for before in BEFORE_THE_ROOT for prefix in ("", "s:")]
    + [(name, BEFORE_THE_ROOT[1], "s:") for name in RENDERERS[1:]],
    indirect=["renderer"],
)
def test_the_root_is_what_is_stretched(before, prefix, renderer):
    spaces = 'xmlns="http://www.w3.org/2000/svg" xmlns:s="http://www.w3.org/2000/svg"'
    svg = (
        f'{before}<{prefix}svg {spaces} viewBox="0 0 10 10" style="width:5px; height:7px">'
        f'<svg viewBox="0 0 1 1" width="5" height="10" preserveAspectRatio="none">'
        f'<rect width="1" height="1" fill="#0f0"/></svg></{prefix}svg>'
    )
    drawn = rasterize(svg, 40, 30, renderer)
    assert (drawn[:, :20] == [0, 1, 0]).all()
    assert (drawn[:, 20:] == 1).all()


def test_difference_is_drawn_exactly(renderer):
    svg = SVG.format(
        '><rect width="40" height="30" fill="#804020"/>'
        '<rect width="40" height="30" fill="#609030" style="mix-blend-mode:difference"/>'
    )
    if renderer != "cairo":  # which refuses it
        drawn = rasterize(svg, 40, 30, renderer)
        np.testing.assert_allclose(drawn[9, 9] * 255, [32, 80, 16], atol=0.01)
