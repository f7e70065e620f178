"""Scenes and pictures that the tests share; everything is made here or ships with scikit-image."""

from __future__ import annotations

import dataclasses
import gc
import importlib
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

# As gauss2svg.render.cpu does, which is too late where a test module imports torch first.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import galleries
import gallery_site
import numpy as np
import psutil
import pytest
from batches import PoolHere
from hypothesis import settings
from numpy.typing import NDArray
from screens import chromium
from skimage import data

from gauss2svg.compare import pages, run
from gauss2svg.errors import RendererError
from gauss2svg.measure import NO_SCORES
from gauss2svg.raster import RENDERERS, rasterize
from gauss2svg.render import cpu


def pytest_addoption(parser):
    parser.addoption("--rewrite-golden", action="store_true", help="make files of Inkscape anew")


def pytest_xdist_auto_num_workers(config) -> int:
    """Two processes for a folder of tests; files that are named start none besides their own."""
    return 2 if any(Path(name).is_dir() for name in config.args) else 0


def pytest_configure(config) -> None:
    """The same examples in every run, so that a failure is found again; Ctrl-C as at a terminal."""
    # Ignored where this is in the background of a shell, and then by all that is started here.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    examples = int(os.environ.get("GAUSS2SVG_EXAMPLES", "10"))
    settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=examples)
    settings.load_profile("repeatable")


def _draw_no_constants_of_modules() -> None:
    """Keep hypothesis from drawing numbers that it finds in the source of loaded modules.

    It does so from 6.131 on, and examples would depend on which test modules are loaded and in
    which order. No setting turns it off, as of 6.170: here no file passes for one of the project.
    Versions that do not look for such numbers have no such names and are left as they are.
    """
    for name in ("internal.constants_ast", "internal.conjecture.providers"):
        with suppress(ImportError):
            module = importlib.import_module(f"hypothesis.{name}")
            for predicate in ("is_local_module_file", "_is_local_module_file"):
                if hasattr(module, predicate):
                    setattr(module, predicate, lambda path: False)


_draw_no_constants_of_modules()


@pytest.fixture(scope="session")
def photo() -> NDArray[np.float32]:
    """A quarter of the scikit-image astronaut: 128 x 128 px with a face in it."""
    return np.ascontiguousarray(data.astronaut()[:256:2, 128:384:2], np.float32) / 255


NEED_VARIABLE = "GAUSS2SVG_NEED_BROWSER"
_WHITE_DOT = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"/>'


@cache
def why_not(name: str) -> str:
    """Why a renderer cannot draw here, "" where it draws a pixel."""
    try:
        assert (rasterize(_WHITE_DOT, 1, 1, name) == 1).all()
    except RendererError as error:
        return str(error)
    return ""


def needs(name: str) -> None:
    """Skip the test where a renderer cannot draw.

    It fails where a browser is asked for, and without cairo, which all systems but Windows have.
    """
    reason = why_not(name)
    if reason and name == "chromium" and os.environ.get(NEED_VARIABLE):
        pytest.fail(f"{NEED_VARIABLE} is set, and {reason}")
    if reason and name == "cairo" and sys.platform != "win32":
        pytest.fail(reason)
    if reason:
        pytest.skip(reason)


@pytest.fixture(params=RENDERERS)
def renderer(request) -> str:
    """Name of each renderer in turn; those that are no part of the package where they draw."""
    if request.param != "resvg":
        needs(request.param)
    return request.param


_LANES = {"browser", "process", "sweep", "example"}


def pytest_collection_finish() -> None:
    """Modules stay, and need no looking through at each of hundreds of collections of garbage."""
    gc.freeze()


def pytest_collection_modifyitems(items) -> None:
    """Tests that need a browser or another program to render are of the lane `browser`.

    One of `nightly` that had another lane's marker would run in that lane too.
    """
    for item in items:
        if os.name == "nt" and item.get_closest_marker("posix"):
            item.add_marker(pytest.mark.skip(reason="needs POSIX"))
        given = getattr(item, "callspec", None)
        values = [] if given is None else given.params.values()
        renderers = {value for value in values if isinstance(value, str)}
        needed = {"browser", "tabs", "visit", "shown"} & set(item.fixturenames)
        if needed or renderers & {"chromium", "firefox", "inkscape", "librsvg"}:
            item.add_marker(pytest.mark.browser)
        marks = {mark.name for mark in item.iter_markers()}
        if "nightly" in marks and marks & _LANES:
            raise pytest.UsageError(f"{item.nodeid} must be nightly alone; got {marks & _LANES}")


@pytest.fixture
def browser() -> None:
    """For tests that draw by Chromium."""
    needs("chromium")


# Two threads also on one core, so that the tests of thread counts have two to compare.
cpu.CORES = max(2, cpu.CORES)


@pytest.fixture
def hasty(monkeypatch) -> None:
    """Fits of a few steps, for what says nothing of how close they come."""
    from gauss2svg.pipeline import by_bytes
    from gauss2svg.pipeline.plan import PRESETS

    for name, preset in PRESETS.items():
        monkeypatch.setitem(PRESETS, name, dataclasses.replace(preset, iterations=8, cap=60))
    monkeypatch.setattr(by_bytes, "ITERATIONS", 8)


@pytest.fixture
def unscored(monkeypatch) -> None:
    """`check` has no perceptual scores, which take half a second in a process of their own."""
    monkeypatch.setattr("gauss2svg.measure.check.perceptual_scores", lambda *_: NO_SCORES)


@pytest.fixture
def drawn_here(monkeypatch, unscored) -> None:
    """`check` draws without a process of its own, which takes a third of a second; no scores."""

    def draw(svg, width, height, renderer, _, channels):
        pixels = rasterize(svg, width, height, renderer, alpha=channels == 4)
        return pixels, []

    monkeypatch.setattr("gauss2svg.measure.check.draw", draw)


@pytest.fixture
def refusal(capsys):
    """The line of a command that is refused: status 2, one line, and nothing else is said."""
    from gauss2svg.cli.main import main

    def refused(*words) -> str:
        capsys.readouterr()
        assert main([str(word) for word in words]) == 2
        out, line = capsys.readouterr()
        assert (out, line.count("\n")) == ("", 1)
        return line

    return refused


def has_ended(process_id: int) -> bool:
    """Whether a process has, at the latest in 5 s; what init has yet to reap has ended too."""
    for _ in range(100):
        try:
            if psutil.Process(process_id).status() == psutil.STATUS_ZOMBIE:
                return True
        except psutil.NoSuchProcess:
            return True
        time.sleep(0.05)
    return False


@pytest.fixture(scope="session")
def gallery(tmp_path_factory):
    """A small gallery that no test changes."""
    return gallery_site.build(tmp_path_factory.mktemp("gallery"))


@pytest.fixture(scope="module")
def tabs() -> Iterator[Any]:
    """The browser of the renderer chromium."""
    needs("chromium")
    with chromium() as browser:
        yield browser


@pytest.fixture
def visit(tabs, gallery):
    """Opens visits to that gallery, each of which must end without errors."""
    visits = partial(gallery_site.Visit, tabs, gallery.directory)
    with gallery_site.closed_after(visits) as open_one:
        yield open_one


@pytest.fixture
def asked(monkeypatch):
    """The requests of a gallery, answered in this process: SVGs by `galleries.canned`."""
    found, make_photo = galleries.Asked(), run.make_photo

    def answer(kind, make, request):
        folder = Path(request["folder"]).as_posix()
        found.append((kind, folder.rpartition("/photos/")[2]))
        return make(request)

    monkeypatch.setattr(pages, "Pool", PoolHere)
    monkeypatch.setattr(run, "make_photo", partial(answer, "photo", make_photo))
    monkeypatch.setattr(run, "make_svg", partial(answer, "variant", lambda r: galleries.canned(r)))
    return found


@pytest.fixture
def picture(photo, tmp_path):
    """The path of a photo of 64x48 px, of 96 px an inch."""
    return galleries.save(photo[:48, :64], tmp_path / "photo.png", dpi=(96, 96))


@pytest.fixture
def two(photo, tmp_path):
    """Paths of two photos."""
    names = enumerate(("a.png", "b.png"), 1)
    return [galleries.save(photo[:9, i : 9 + i], tmp_path / name) for i, name in names]


@pytest.fixture
def pool_here(monkeypatch) -> None:
    """Batches have no processes of their own."""
    monkeypatch.setattr("gauss2svg.batch.many.Pool", PoolHere)
