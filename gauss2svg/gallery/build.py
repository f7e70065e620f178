"""The gallery as a whole: plan, make what is missing, write the pages."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from numba.core import config

from gauss2svg.errors import InputError, OutputError, on_one_line, whole_number
from gauss2svg.files import check_writable
from gauss2svg.gallery.options import GalleryOptions
from gauss2svg.gallery.pages import (
    ASSETS,
    DATA,
    INDEX,
    OUTPUTS,
    Provenance,
    is_gallery,
    make_folder,
    write_pages,
)
from gauss2svg.gallery.photos import GalleryPhoto, gallery_photos, with_kept_slugs
from gauss2svg.gallery.plan import (
    PHOTOS,
    GallerySetup,
    Task,
    photo_folder,
    photo_task,
    variant_task,
)
from gauss2svg.gallery.pool import WorkerPool
from gauss2svg.gallery.records import Failure, Row, Shown, made_of, rows_of, summary_of
from gauss2svg.gallery.variants import Variant, variants_of
from gauss2svg.gallery.work import RECORD, finished
from gauss2svg.pipeline.kernels import compile_kernels
from gauss2svg.pipeline.memory_budget import allowed

Records = dict[str, dict[str, Any]]  # of finished folders


@dataclass(frozen=True)
class GalleryProgress:
    """Where a gallery stands: things done of all, SVGs kept from before, what is made now."""

    done: int
    total: int
    kept: int
    now: tuple[str, ...] = ()


@dataclass(frozen=True)
class Gallery:
    """A gallery that is written.

    directory  where it is
    rows       one an SVG, summary: one a variant, medians and totals; both as in gallery.json
    failures   what could not be made, and why
    kept       how many SVGs were there already; absent: peers that are not installed
    """

    directory: Path
    rows: list[Row]
    summary: list[Row]
    failures: list[Failure]
    kept: int
    absent: list[str]

    @property
    def index(self) -> Path:
        """The page to open first."""
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
    """Vectorise photos in several ways, and write pages that show what came of it.

    photos      paths; directory: where the pages go, made if missing
    variants    presets of gauss2svg.pipeline.presets; counts: of Gaussians; where neither is given,
                draft, balanced and high
    peers       vtracer, splatthis, primitive, as they are without options or in a style of the
                benchmark, such as "vtracer:detailed"; those not installed are left out
    options     the rest, such as GalleryOptions(jobs=2, title="Flowers")
    command     what the pages say that they were made by; progress: called with a
                GalleryProgress whenever something begins or ends

    What is finished is kept in the directory, and made again only where the photo's bytes, the
    settings or this package's code have changed; an interruption loses what was being made. A
    photo that cannot be read is a failure, told on the index, and stops no other. The pages need
    no server and no network. Raises InputError for bad arguments and OutputError for a directory
    that cannot be written, or whose index.html is not a gallery's.
    """
    listed = gallery_photos(photos)
    wanted, absent = variants_of(variants, counts, peers)
    options = options or GalleryOptions()
    # As many as numba has started; the attribute is made when its settings are read.
    cores = config.NUMBA_NUM_THREADS  # pyright: ignore[reportAttributeAccessIssue]
    threads = max(1, cores // options.jobs)
    if options.threads is not None:
        threads = whole_number("threads", options.threads, 1, cores)
    root = _folder(directory, listed)
    listed = with_kept_slugs(listed, root / PHOTOS)
    # What is free is shared out: every process would take most of it for its own.
    setup = GallerySetup(options, threads, allowed(None) // options.jobs)
    story = Provenance(
        title=options.title,
        command=on_one_line(
            command or f"build_gallery([.. {len(listed)} photos ..], {os.fspath(directory)!r}, ..)"
        ),
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        seed=options.seed,
        photo_size=options.photo_size,
        absent=tuple(absent),
    )
    making = _Making(root, listed, wanted, setup, progress)
    try:
        making.run(options.jobs)
    except KeyboardInterrupt:
        making.write(dataclasses.replace(story, missing=making.missing))
        raise
    return making.write(story)


class _Making:
    """A gallery on its way: what is finished so far, what failed, and who is told."""

    def __init__(
        self,
        root: Path,
        photos: list[GalleryPhoto],
        variants: list[Variant],
        setup: GallerySetup,
        progress: Callable[[GalleryProgress], None] | None,
    ) -> None:
        self._root, self._photos, self._variants = root, photos, variants
        self._setup = setup
        self._progress = progress or (lambda _: None)
        self._records: Records = {}
        self._failures: list[Failure] = []
        self._done = self._kept = 0
        self._now: list[str] = []

    def run(self, jobs: int) -> None:
        """Photos first, so that a bad one is known early; then the SVGs of the good ones."""
        with WorkerPool(jobs) as crew:
            readable = []
            for photo in self._photos:
                if photo.trouble is None:
                    readable.append(photo)
                else:
                    self._fail(photo, None, photo.trouble)
            if jobs > 1 and any(variant.is_own for variant in self._variants):
                # Once, by one: numba's cache mixes up what several processes save in it at a time.
                compile_kernels()
            photos = self._missing([photo_task(self._root, p, self._setup) for p in readable])
            # Known before anything is made, so that an interruption finds them.
            self._missing(self._variant_tasks())
            self._make(crew, photos)
            self._make(crew, self._missing(self._variant_tasks()))

    @property
    def missing(self) -> int:
        """How many SVGs are still to be made: an interruption came before them."""
        readable = len(self._photos) - sum(one.variant is None for one in self._failures)
        failed = sum(one.variant is not None for one in self._failures)
        made = sum(folder.count("/") > 1 for folder in self._records)
        return readable * len(self._variants) - failed - made

    def write(self, story: Provenance) -> Gallery:
        """Write the pages of what is finished."""
        shown = [
            self._shown(photo, record)
            for photo in self._photos
            if (record := self._records.get(photo_folder(photo))) is not None
        ]
        order = {photo: at for at, photo in enumerate(self._photos)}
        column = {variant: at for at, variant in enumerate([None, *self._variants])}
        failures = sorted(self._failures, key=lambda one: (order[one.photo], column[one.variant]))
        write_pages(self._root, story, self._variants, shown, failures)
        rows = rows_of(shown)
        summary = summary_of(rows, self._variants)
        return Gallery(self._root, rows, summary, failures, self._kept, list(story.absent))

    def _variant_tasks(self) -> list[Task]:
        """SVGs of the photos that are there."""
        return [
            variant_task(self._root, photo, variant, self._setup, record)
            for photo in self._photos
            if (record := self._records.get(photo_folder(photo))) is not None
            for variant in self._variants
        ]

    def _missing(self, tasks: Iterable[Task]) -> list[Task]:
        """Those that are still to be made; what others have made is kept."""
        missing = []
        for task in tasks:
            if task.folder in self._records:
                continue
            record = finished(self._root / task.folder, task.key)
            if record is None:
                missing.append(task)
                continue
            self._records[task.folder] = record
            self._kept += task.variant is not None
            self._done += 1
        return missing

    def _make(self, crew: WorkerPool, tasks: list[Task]) -> None:
        self._tell()
        for index, answer in crew.run([task.work for task in tasks]):
            task = tasks[index]
            if answer is None:
                self._now.append(task.label)
            else:
                self._now.remove(task.label)
                if "fatal" in answer:
                    raise OutputError(answer["error"])
                if "error" in answer:
                    self._fail(task.photo, task.variant, on_one_line(answer["error"]))
                else:
                    self._records[task.folder] = answer["record"]
                    self._done += 1
            self._tell()

    def _fail(self, photo: GalleryPhoto, variant: Variant | None, error: str) -> None:
        self._failures.append(Failure(photo, variant, error))
        self._done += 1 if variant else 1 + len(self._variants)

    def _tell(self) -> None:
        total = len(self._photos) * (1 + len(self._variants))
        self._progress(GalleryProgress(self._done, total, self._kept, tuple(self._now)))

    def _shown(self, photo: GalleryPhoto, record: dict[str, Any]) -> Shown:
        folder = photo_folder(photo)
        made = [
            made_of(self._root, f"{folder}/{variant.slug}", variant, record_of)
            for variant in self._variants
            if (record_of := self._records.get(f"{folder}/{variant.slug}")) is not None
        ]
        return Shown(
            photo, folder, f"{folder}/{record['photo']}", record["width"], record["height"],
            tuple(record["notes"]), tuple(made),
        )  # fmt: skip


def _folder(directory: str | os.PathLike[str], photos: Iterable[GalleryPhoto]) -> Path:
    """The folder, made where it is missing; refused where something would be lost."""
    if not os.fspath(directory):
        raise OutputError("the folder for the pages is ''; needed is a name, . for this one")
    root = Path(directory)
    make_folder(root)
    if not is_gallery(root / DATA):
        for name in (PHOTOS, ASSETS):
            if _is_foreign(root / name):
                raise OutputError(
                    f"{root / name} is there, of no gallery; choose another folder, so that it is "
                    "kept"
                )
        for name in OUTPUTS:
            if os.path.lexists(root / name):
                raise OutputError(
                    f"{root / name} is there, of no gallery; choose another folder, so that it is "
                    "kept"
                )
    kept = os.path.realpath(root / PHOTOS)
    for photo in photos:
        if not photo.trouble and Path(os.path.realpath(photo.path)).is_relative_to(kept):
            raise InputError(
                f"{photo.path} lies where the gallery keeps its own pictures; choose another folder"
            )
    for name in OUTPUTS:
        check_writable(root / name)  # told now, not after the work
    for name in (PHOTOS, ASSETS):
        make_folder(root / name)
    return root


def _is_foreign(folder: Path) -> bool:
    """Whether there is anything in it that no gallery, finished or interrupted, has put there."""
    if not folder.exists():
        return False
    try:
        return any(
            not one.is_dir() or (any(one.iterdir()) and not (one / RECORD).exists())
            for one in folder.iterdir()
            if not one.name.startswith(".")  # of a file that was being written
        )
    except OSError:
        return True
