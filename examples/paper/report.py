"""All sections in their order, then the page."""

from __future__ import annotations

import json
import platform
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

import torch
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from gauss2svg import __version__
from gauss2svg.bench.machine import machine
from gauss2svg.bench.rows import finite
from gauss2svg.errors import InputError
from gauss2svg.pipeline.kernels import compile_kernels

from . import drawn_sections, model_sections, table
from .book import Book, counted
from .pictures import ZOOM
from .settings import Settings

PAPER_URL = "https://infoscience.epfl.ch/entities/publication/92d5c115-6b56-4d7a-aae2-3bb8f29f66b0"
_TEMPLATE = "page.html.jinja"
_PAGE, _NUMBERS = "index.html", "numbers.json"
_PACKAGES = ("numpy", "numba", "scipy", "scikit-image", "torch", "resvg_py", "matplotlib", "Jinja2")


def write_report(
    settings: Settings, folder: Path, command: str, tell: Callable[[str], None]
) -> Path:
    """Measure everything and write index.html, its images and numbers.json; path of the page.

    command is what the page says it was made by; tell is called with each part's name. Raises
    InputError for a folder with files that are not an earlier page's, which this one replaces as
    a whole once it is done; OSError where nothing can be written.
    """
    older = _older_page(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=folder) as unfinished:
        _measure(settings, Path(unfinished), command, tell)
        for name in older:
            (folder / name).unlink()
        for path in sorted(Path(unfinished).iterdir()):
            shutil.move(path, folder / path.name)
    return folder / _PAGE


def _older_page(folder: Path) -> list[str]:
    """Names of the files of an earlier page there, [] if nothing is there."""
    there = {path.name for path in folder.iterdir()} if folder.exists() else set()
    older: set[str] = set()
    if _NUMBERS in there:
        try:
            older = set(json.loads((folder / _NUMBERS).read_text(encoding="utf-8"))["files"])
        except (ValueError, KeyError, TypeError):
            older = set()
    if others := sorted(there - older):
        more = f" and {len(others) - 3} more" if len(others) > 3 else ""
        raise InputError(
            f"{folder} has {', '.join(others[:3])}{more}; needed is an empty folder, a new one, or "
            "one with nothing but an earlier page of this command: try another name"
        )
    return sorted(there)


def _measure(settings: Settings, folder: Path, command: str, tell: Callable[[str], None]) -> None:
    """Write the page into an empty folder."""
    begun = time.perf_counter()
    parts: list[tuple[str, float]] = []

    @contextmanager
    def part(name: str) -> Iterator[None]:
        tell(name)
        since = time.perf_counter()
        yield
        parts.append((name, time.perf_counter() - since))

    # Torch has little to do here, and its threads would wait on the kernels' cores.
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with part("photos and kernels"):
            book = Book.begin(settings, folder)
            compile_kernels("float32")
        with part("rounds"):
            model_sections.progressive(book)
        with part("schedules"):
            model_sections.compared_schedules(book)
        with part("windows"):
            model_sections.cropped_windows(book)
        with part("losses"):
            model_sections.compared_losses(book)
        with part("drawn files"):
            error, edges = drawn_sections.drawn_files(book)
        with part("ellipses"):
            drawn_sections.crisp_ellipses(book, error, edges)
    finally:
        torch.set_num_threads(threads)
    book.verdicts.sort(key=lambda verdict: verdict.key)
    names = list(book.photos)
    versions = {"gauss2svg": __version__, "python": platform.python_version()}
    (folder / _PAGE).write_text(
        _page(
            **book.page,
            settings=settings,
            verdicts=book.verdicts,
            paper=PAPER_URL,
            photo_names=", ".join(names),
            photo_count=counted(len(names), "photo"),
            counted=counted,
            zoom=ZOOM,
            gain=model_sections.GAIN,
            best=table.BEST.name,
            machine=machine(),
            versions=versions | {name: version(name) for name in _PACKAGES} | _tracer(),
            command=command,
            parts=parts,
            seconds=time.perf_counter() - begun,
        ),
        encoding="utf-8",
    )
    _write_numbers(book)


def _tracer() -> dict[str, str]:
    """The version of the tracer of polygons by its name, if it is installed."""
    found = table.peer_version()
    return {table.PEER: found} if found else {}


def _page(**context: object) -> str:
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(_TEMPLATE).render(context)


def _write_numbers(book: Book) -> None:
    files = sorted([_NUMBERS, *(path.name for path in book.folder.iterdir())])
    told = {
        "settings": asdict(book.settings),
        "files": files,
        **book.numbers,
        "verdicts": [asdict(verdict) for verdict in book.verdicts],
    }
    text = json.dumps(finite(told), indent=1, allow_nan=False)
    (book.folder / _NUMBERS).write_text(text + "\n", encoding="utf-8")
