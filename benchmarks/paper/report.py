"""All sections in order, then the page."""

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
from gauss2svg.compare.records import finite, machine
from gauss2svg.errors import InputError
from gauss2svg.pipeline.run import compile_kernels

from . import model_sections, svg_sections, table
from .book import ZOOM, Book, counted
from .settings import Settings

PAPER_URL = "https://infoscience.epfl.ch/entities/publication/92d5c115-6b56-4d7a-aae2-3bb8f29f66b0"
_TEMPLATE = "page.html.jinja"
_PAGE, _NUMBERS = "index.html", "numbers.json"
_PACKAGES = ("numpy", "numba", "scipy", "scikit-image", "torch", "resvg_py", "matplotlib", "Jinja2")


def write_report(
    settings: Settings, folder: Path, command: str, progress: Callable[[str], None]
) -> Path:
    """Measure everything and write index.html, its images and numbers.json; path of the page.

    command   named on the page as its origin
    progress  called with the name of each part
    An earlier page in the folder is replaced once the new one is complete. Raises InputError for a
    folder with other files; OSError where nothing can be written.
    """
    older = _older_page(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=folder) as unfinished:
        _measure(settings, Path(unfinished), command, progress)
        for name in older:
            (folder / name).unlink()
        for path in sorted(Path(unfinished).iterdir()):
            shutil.move(path, folder / path.name)
    return folder / _PAGE


def _older_page(folder: Path) -> list[str]:
    """Names of the files of an earlier page in the folder, [] for an empty or missing folder."""
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
            f"{folder} must be new, empty or an earlier page of this command; got a folder with "
            f"{', '.join(others[:3])}{more}. Try another name"
        )
    return sorted(there)


def _measure(
    settings: Settings, folder: Path, command: str, progress: Callable[[str], None]
) -> None:
    """Write the page into an empty folder."""
    begun = time.perf_counter()
    parts: list[tuple[str, float]] = []

    @contextmanager
    def part(name: str) -> Iterator[None]:
        progress(name)
        since = time.perf_counter()
        yield
        parts.append((name, time.perf_counter() - since))

    # Torch has little work here, and its waiting threads would slow the kernels' threads.
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with part("photos and kernels"):
            book = Book.begin(settings, folder)
            compile_kernels()
        with part("rounds"):
            model_sections.progressive(book)
        with part("schedules"):
            model_sections.compared_schedules(book)
        with part("windows"):
            model_sections.cropped_windows(book)
        with part("losses"):
            model_sections.compared_losses(book)
        with part("SVG files"):
            error, edges = svg_sections.svg_files(book)
        with part("ellipses"):
            svg_sections.crisp_ellipses(book, error, edges)
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
    numbers = {
        "settings": asdict(book.settings),
        "files": files,
        **book.numbers,
        "verdicts": [asdict(verdict) for verdict in book.verdicts],
    }
    text = json.dumps(finite(numbers), indent=1, allow_nan=False)
    (book.folder / _NUMBERS).write_text(text + "\n", encoding="utf-8")
