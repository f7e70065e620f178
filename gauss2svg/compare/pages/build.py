"""Building a gallery: make what is missing in worker processes, then write the pages.

A worker that dies fails its own request only, and is replaced.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from gauss2svg.compare.grid import Grid, Place, Progress, Record, Task
from gauss2svg.compare.pages import GalleryOptions
from gauss2svg.compare.pages.artifacts import (
    PHOTOS,
    RECORD,
    answer_to,
    finished,
    folder_of,
    is_scored,
    with_kept_slugs,
)
from gauss2svg.compare.pages.pages import (
    ASSETS,
    DATA,
    INDEX,
    OUTPUTS,
    Failure,
    Row,
    is_gallery,
    results_of,
    rows_of,
    summary_of,
    write_pages,
)
from gauss2svg.compare.variants import Variant, variants_of
from gauss2svg.errors import InputError, OutputError, on_one_line
from gauss2svg.files import check_writable, make_folder
from gauss2svg.options import file_name
from gauss2svg.pipeline.listing import ListedPhoto, listed_photos
from gauss2svg.pipeline.memory_budget import allowed
from gauss2svg.pipeline.run import compile_kernels, thread_count
from gauss2svg.pool import Pool
from gauss2svg.version import __version__

GalleryProgress = Progress


@dataclass(frozen=True)
class Gallery:
    """A finished gallery.

    directory  its folder
    rows       one per SVG; summary: one per variant, with medians and totals; as in gallery.json
    failures   photos and SVGs that could not be made, and why
    kept       number of SVGs that were kept from before; absent: peers that are not installed
    """

    directory: Path
    rows: list[Row]
    summary: list[Row]
    failures: list[Failure]
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

    Finished SVGs are kept, and made again only where the photo's bytes, the settings or this
    package's code have changed; scores whose packages were missing then are added to them. An
    interruption loses only unfinished ones. A photo that cannot be read is a failure, which the
    first page lists, and the others continue. The pages need neither a server nor a network.
    Raises InputError for bad arguments and OutputError for a folder that cannot be written, or
    that holds other files of the pages' names.
    """
    listed = listed_photos(photos)
    wanted, absent = variants_of(variants, counts, peers)
    options = options or GalleryOptions()
    threads = max(1, thread_count(None) // options.jobs)
    if options.threads is not None:
        threads = thread_count(options.threads)
    root = _folder(directory, listed)
    listed = with_kept_slugs(listed, root / PHOTOS)
    build = _Build(root, listed, wanted, options, threads, progress)
    made = {
        "gauss2svg": __version__,
        "title": options.title,
        "command": on_one_line(
            command or f"build_gallery([.. {len(listed)} photos ..], {os.fspath(root)!r}, ..)"
        ),
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "seed": options.seed,
        "photo_size": options.photo_size,
    }
    try:
        build.run()
    except KeyboardInterrupt:
        build.look_up_finished()  # of which the workers had no time to tell
        build.write(made, absent)
        raise
    return build.write(made, absent)


class _Build:
    """A gallery in progress: its tasks, its grid and its failures; threads: of each process."""

    def __init__(
        self,
        root: Path,
        photos: list[ListedPhoto],
        variants: list[Variant],
        options: GalleryOptions,
        threads: int,
        progress: Callable[[GalleryProgress], None] | None,
    ) -> None:
        self._root, self._photos, self._variants = root, photos, variants
        self._options, self._threads = options, threads
        # The processes share the free memory: each would take most of it otherwise.
        self._max_memory = allowed(None) // options.jobs
        self._failures: dict[Place, str] = {}
        self._grid = Grid(self._finished, len(photos) * (1 + len(variants)), progress)

    def run(self) -> None:
        """Prepare the photos, so that bad ones are known early; then make the SVGs."""
        jobs = self._options.jobs
        with Pool(jobs) as pool:
            for photo in self._photos:
                if photo.problem is not None:
                    self._fail(photo, None, photo.problem)
            if jobs > 1 and any(variant.is_own for variant in self._variants):
                # Once, by one process: workers that start together would each compile them.
                compile_kernels()
            readable = [photo for photo in self._photos if photo.problem is None]
            missing = self._grid.missing(map(self._task_of_photo, readable))
            self.look_up_finished()
            self._make(pool, missing)
            self._make(pool, self.look_up_finished())

    def look_up_finished(self) -> list[Task]:
        """Take in the SVGs that are finished; returns the tasks for the others.

        A photo that is not prepared has none yet.
        """
        return self._grid.missing(
            self._task_of_svg(photo, variant, prepared)
            for photo in self._photos
            if (prepared := self._grid.records.get((photo, None))) is not None
            for variant in self._variants
        )

    def write(self, made: Mapping[str, Any], absent: list[str]) -> Gallery:
        """Write the pages of all that is finished."""
        records = self._grid.records
        results = results_of(self._root, self._photos, self._variants, records)
        rows = rows_of(results)
        summary = summary_of(rows, self._variants)
        places = [(photo, one) for photo in self._photos for one in (None, *self._variants)]
        failures = [
            Failure(*place, self._failures[place]) for place in places if place in self._failures
        ]
        unmade = sum(  # by an interruption
            (photo, variant) not in records
            and not {(photo, None), (photo, variant)} & self._failures.keys()
            for photo in self._photos
            for variant in self._variants
        )
        document = {
            **made,
            "renderers": sorted({row["renderer"] for row in rows}),
            "missing": unmade,
            "peers_absent": absent,
            "summary": summary,
            "rows": rows,
            "failures": [
                {
                    "photo": failure.photo.name,
                    "variant": failure.variant.name if failure.variant else None,
                    "error": failure.error,
                }
                for failure in failures
            ],
        }
        write_pages(self._root, document, self._variants, results)
        return Gallery(self._root, rows, summary, failures, self._grid.kept, absent)

    def _task_of_photo(self, photo: ListedPhoto) -> Task:
        request = self._request(photo, None) | {"kind": "photo", "digest": photo.digest}
        return Task(photo, None, request, (self._options.photo_size,))

    def _task_of_svg(self, photo: ListedPhoto, variant: Variant, prepared: Record) -> Task:
        """The task of making an SVG of a photo; prepared: the record of the photo."""
        options = self._options
        request = self._request(photo, variant) | {
            "kind": "variant",
            "shown": str(self._root / folder_of(photo) / prepared["photo"]),
            "tool": variant.tool,
            "settings": dict(variant.settings),
            "options": {
                "seed": options.seed,
                "threads": self._threads,
                "max_memory": self._max_memory,
                "max_pixels": options.max_pixels,
                "fragments": True,
            },
            "jobs": options.jobs,
            "peer_timeout": options.peer_timeout,
        }
        # Processes, threads, memory and time limits change no image.
        seed = options.seed if variant.is_own else None  # which other tools are not given
        return Task(photo, variant, request, (options.photo_size, seed))

    def _request(self, photo: ListedPhoto, variant: Variant | None) -> dict[str, Any]:
        return {
            "path": photo.path,
            "folder": str(self._root / folder_of(photo, variant)),
            "photo_size": self._options.photo_size,
            "max_pixels": self._options.max_pixels,
        }

    def _finished(self, task: Task) -> Record | None:
        record = finished(self._root / folder_of(*task.place), task.key)
        return record if record is not None and is_scored(record) else None

    def _make(self, pool: Pool, tasks: list[Task]) -> None:
        def submit(request: Record) -> Future[Record]:
            return pool.submit(answer_to, request)

        for task, answer in self._grid.answers(tasks, submit, pool.workers):
            if "error" in answer:
                self._fail(task.photo, task.variant, on_one_line(answer["error"]))
            else:
                self._grid.records[task.place] = answer

    def _fail(self, photo: ListedPhoto, variant: Variant | None, error: str) -> None:
        self._failures[photo, variant] = error
        self._grid.dropped += 1 if variant else 1 + len(self._variants)


def _folder(directory: str | os.PathLike[str], photos: Iterable[ListedPhoto]) -> Path:
    """The folder, created if missing; refused where files of others would be overwritten."""
    root = Path(file_name("directory", directory, "the name of a folder, such as . for this one"))
    make_folder(root)
    if not is_gallery(root / DATA):
        foreign = [root / name for name in (PHOTOS, ASSETS) if _is_foreign(root / name)]
        foreign += [root / name for name in OUTPUTS if os.path.lexists(root / name)]
        if foreign:
            raise OutputError(
                f"{foreign[0]} exists and is not part of a gallery, so it is kept. "
                "Try another folder"
            )
    kept = os.path.realpath(root / PHOTOS)
    for photo in photos:
        if not photo.problem and Path(os.path.realpath(photo.path)).is_relative_to(kept):
            raise InputError(
                f"{photo.path} must not be among the gallery's own images. Try another folder"
            )
    for name in OUTPUTS:
        check_writable(root / name)  # before the work, not after it
    for name in (PHOTOS, ASSETS):
        make_folder(root / name)
    return root


def _is_foreign(folder: Path) -> bool:
    """Whether a folder holds anything that no gallery, finished or interrupted, has written."""
    if not folder.exists():
        return False
    try:
        return any(
            not one.is_dir() or (any(one.iterdir()) and not (one / RECORD).exists())
            for one in folder.iterdir()
            if not one.name.startswith(".")  # a temporary file of an interruption
        )
    except OSError:
        return True
