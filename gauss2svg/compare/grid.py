"""A grid of photos and variants: the records of finished runs are kept, the others are made.

The benchmark and galleries are reports on it. A record is one line of a file, added when its run
has ended.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from gauss2svg.compare.machine import machine
from gauss2svg.compare.records import Row, add_row, rows_in
from gauss2svg.compare.variants import Variant
from gauss2svg.errors import OutputError, on_one_line
from gauss2svg.files import check_writable, make_folder
from gauss2svg.measure.perceptual import packages
from gauss2svg.options import file_name
from gauss2svg.pipeline.listing import ListedPhoto
from gauss2svg.pool import WorkerDiedError, completed
from gauss2svg.raster import DEFAULT_RENDERER, renderer_version


@cache
def code_digest() -> str:
    """Return the SHA-256 of the package's source files: runs of other code are other runs."""
    package = Path(__file__).parent.parent
    digest = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        digest.update(str(source.relative_to(package)).encode() + source.read_bytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class Task:
    """A run of a photo.

    variant  None prepares the photo itself
    others   what the result depends on beside photo, variant, code, renderer and scores
    about    further columns of its record, among them the folder of its files
    files    without which it is not finished
    """

    photo: ListedPhoto
    variant: Variant | None
    others: tuple[Any, ...] = ()
    about: Mapping[str, Any] = field(default_factory=dict, hash=False)
    files: tuple[Path, ...] = ()

    @property
    def label(self) -> str:
        """The task's name in a progress bar."""
        return self.photo.name + (f", {self.variant.name}" if self.variant else "")

    @cached_property
    def key(self) -> str:
        """A hash of all that the record depends on, but no path."""
        one = self.variant
        parts = [self.photo.digest, code_digest(), renderer_version(DEFAULT_RENDERER), packages()]
        parts += [*self.others, *((one.tool, one.version, one.settings) if one else ())]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()

    def record(self, answer: Mapping[str, Any]) -> Row:
        """Return the record: the photo, the variant, when and where it was made, the answer."""
        return {
            "key": self.key,
            **(self.variant.columns if self.variant else {}),
            "image": self.photo.name,
            "image_sha256": self.photo.digest,
            **self.about,
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            "machine": machine(),
            **answer,
        }


@dataclass(frozen=True)
class Progress:
    """Progress of a grid: finished and total runs, SVGs that were kept, the current runs."""

    done: int
    total: int
    kept: int
    now: tuple[str, ...] = ()


class Grid:
    """The records of a grid in progress.

    path     the file of all records
    records  of the tasks that have ended; of one that failed it has "error", one line
    kept     number of files that were made before
    total    number of tasks that will have a record
    """

    def __init__(
        self, path: Path, tasks: Iterable[Task], progress: Callable[[Progress], None] | None
    ) -> None:
        self._path, self._progress = path, progress
        self.tasks = list(tasks)
        self.total = len(self.tasks)
        self.records: dict[Task, Row] = {}
        self._now: list[str] = []
        known = rows_in(path)
        for task in self.tasks:
            row = known.get(task.about.get("folder", task.key), {"key": ""})
            is_whole = "error" not in row and all(file.exists() for file in task.files)
            if is_whole and row["key"] == task.key:
                self.records[task] = row | {"image": task.photo.name}  # which it may not have had
        self.kept = sum(task.variant is not None for task in self.records)

    @property
    def rows(self) -> list[Row]:
        """The records in the order of their tasks."""
        return [self.records[task] for task in self.tasks if task in self.records]

    def run(
        self, tasks: Iterable[Task], submit: Callable[[Task], Future[Row]], width: int
    ) -> Iterator[Row]:
        """Run those of the tasks that have no record, `width` at once; yield each record.

        Raise OutputError if no other can be run.
        """

        def submitted(task: Task) -> Future[Row]:
            self._now.append(task.label)
            self._report()
            if any(file.exists() for file in task.files):  # of a run whose row counts no more
                add_row(self._path, task.record({"error": "it was interrupted"}))
            return submit(task)

        self._report()
        missing = [task for task in tasks if task not in self.records]
        for task, job in completed(submitted, iter(missing), lambda: width):
            try:
                answer = job.result()
            except WorkerDiedError as error:
                answer = {"error": f"its worker died: {error}"}
            self._now.remove(task.label)
            if "fatal" in answer:
                raise OutputError(answer["error"])
            if "error" in answer:
                answer = {"error": on_one_line(answer["error"])}
            self.records[task] = task.record(answer)
            add_row(self._path, self.records[task])
            yield self.records[task]
            self._report()

    def _report(self) -> None:
        if self._progress is not None:
            done = len(self.records)
            self._progress(Progress(done, self.total, self.kept, tuple(self._now)))


def output_folder(directory: str | os.PathLike[str], outputs: Iterable[str]) -> Path:
    """Return a folder, created if missing; raise OutputError unless its files can be written."""
    folder = Path(file_name("directory", directory, "the name of a folder, such as . for this one"))
    make_folder(folder)
    for name in outputs:
        check_writable(folder / name)  # before the work, not after it
    return folder
