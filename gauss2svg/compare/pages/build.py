"""Building a gallery: make what is missing in worker processes, then write the pages."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from gauss2svg.compare.grid import Grid, Progress, Task, output_folder
from gauss2svg.compare.pages import GalleryOptions
from gauss2svg.compare.pages.artifacts import PHOTO, PICTURE, answer_to
from gauss2svg.compare.pages.pages import ASSETS, INDEX, OUTPUTS, PHOTOS, folder_of, write_pages
from gauss2svg.compare.records import Row
from gauss2svg.compare.variants import variants_of
from gauss2svg.errors import OutputError, on_one_line
from gauss2svg.files import make_folder
from gauss2svg.pipeline.listing import listed_photos
from gauss2svg.pipeline.memory_budget import allowed
from gauss2svg.pipeline.run import compile_kernels, thread_count
from gauss2svg.pool import Pool

GalleryProgress = Progress
_RECORDS = "gallery.jsonl"


@dataclass(frozen=True)
class Gallery:
    """A finished gallery.

    directory  its folder
    rows       one per SVG; summary: one per variant, with medians and totals; failures: photos,
               where variant is None, and SVGs that could not be made; all as in gallery.json
    kept       number of SVGs that were kept from before; absent: peers that are not installed
    """

    directory: Path
    rows: list[Row]
    summary: list[Row]
    failures: list[Row]
    kept: int
    absent: list[str]

    @property
    def index(self) -> Path:
        """The first page."""
        return self.directory / INDEX


def build_gallery(
    photos: Sequence[str | os.PathLike[str]],
    directory: str | os.PathLike[str],
    *,
    variants: Iterable[str] | None = None,
    counts: Iterable[int] | None = None,
    peers: Iterable[str] = (),
    options: GalleryOptions | None = None,
    command: str | None = None,
    progress: Callable[[GalleryProgress], None] | None = None,
) -> Gallery:
    """Vectorise photos in several variants, and write web pages that compare them.

    photos     paths
    directory  folder of the pages, created if missing
    variants   names of presets; counts: numbers of Gaussians; if neither is given: draft,
               balanced and high
    peers      vtracer, splatthis, primitive, with their defaults or in a style of the benchmark,
               such as "vtracer:detailed"; those not installed are skipped
    options    all other options, such as GalleryOptions(jobs=2, title="Flowers")
    command    the command that the pages show
    progress   called with a GalleryProgress whenever a step begins or ends

    Finished SVGs are kept, and made again only where the photo's bytes, the settings, this
    package's code or the packages of scores have changed. An interruption loses only unfinished
    ones. A photo that cannot be read is a failure, which the first page lists, and the others
    continue. The pages need neither a server nor a network. Raise InputError for bad arguments
    and OutputError for a folder that cannot be written, or that holds other files of the pages'
    names.
    """
    listed = listed_photos(photos)
    wanted, absent = variants_of(variants, counts, peers)
    options = options or GalleryOptions()
    jobs, size = options.jobs, options.photo_size
    threads = max(1, thread_count(None) // jobs)
    if options.threads is not None:
        threads = thread_count(options.threads)
    root = _folder(directory)

    def svg_task(photo: Any, variant: Any) -> Task:
        # Processes, threads, memory and time limits change no image, other tools take no seed.
        others = (size, options.seed) if variant.is_own else (size,)
        about = {"seed": options.seed, "jobs": jobs, "threads": threads}
        folder = folder_of(photo, variant)
        return Task(photo, variant, others, about | {"folder": folder}, (root / folder / PICTURE,))

    prepared = {
        photo: Task(photo, None, (size,), {"folder": folder}, (root / folder / PHOTO,))
        for photo in listed
        for folder in [folder_of(photo)]
    }
    svgs = [svg_task(photo, variant) for photo in listed for variant in wanted]
    grid = Grid(root / _RECORDS, [*prepared.values(), *svgs], progress)
    # The processes share the free memory: each would take most of it otherwise.
    run_options = {
        "seed": options.seed, "threads": threads, "max_memory": allowed(None) // jobs,
        "max_pixels": options.max_pixels, "fragments": True,
    }  # fmt: skip
    made = {
        "title": options.title,
        "command": on_one_line(
            command or f"build_gallery([.. {len(listed)} photos ..], {os.fspath(root)!r}, ..)"
        ),
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "seed": options.seed,
        "photo_size": size,
        "peers_absent": absent,
    }

    def write() -> Gallery:
        document = write_pages(root, made, wanted, grid)
        rows, summary, failures = (document[name] for name in ("rows", "summary", "failures"))
        return Gallery(root, rows, summary, failures, grid.kept, absent)

    def request_of(task: Task) -> Mapping[str, Any]:
        photo, variant = task.photo, task.variant
        request = {"source": photo.path, "folder": str(root / task.about["folder"])}
        if variant is None:
            limits = {"photo_size": size, "max_pixels": options.max_pixels}
            return {**request, **limits, "tool": None}
        # A reduced photo is the 8-bit one of the page; others are read as by the command line.
        if grid.records[prepared[photo]]["is_reduced"]:
            request["source"] = str(root / folder_of(photo) / PHOTO)
        return {
            **request, "tool": variant.tool, "settings": dict(variant.settings),
            "options": run_options, "peer_timeout": options.peer_timeout,
        }  # fmt: skip

    try:
        with Pool(jobs) as pool:

            def submit(task: Task) -> Future[Row]:
                return pool.submit(answer_to, request_of(task))

            if jobs > 1 and any(variant.is_own for variant in wanted):
                # Once, by one process: workers that start together would each compile them.
                compile_kernels()
            for record in grid.run(prepared.values(), submit, jobs):  # bad ones are known early
                if "error" in record:
                    grid.total -= len(wanted)
            readable = [t for t in svgs if "error" not in grid.records[prepared[t.photo]]]
            for _ in grid.run(readable, submit, jobs):
                pass
    except KeyboardInterrupt:
        write()
        raise
    return write()


def _folder(directory: str | os.PathLike[str]) -> Path:
    """Return the folder, created if missing; refuse to overwrite files of others."""
    root = output_folder(directory, ())
    if not (root / _RECORDS).exists():
        for name in (*OUTPUTS, PHOTOS, ASSETS):
            if os.path.lexists(root / name):
                raise OutputError(
                    f"{root / name} exists and is not part of a gallery, so it is kept. "
                    "Try another folder"
                )
    output_folder(root, (_RECORDS, *OUTPUTS))
    (root / _RECORDS).touch()
    for name in (PHOTOS, ASSETS):
        make_folder(root / name)
    return root
