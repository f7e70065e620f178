"""A grid of photos and variants: the records of finished runs are kept, the others are made.

The benchmark and galleries are reports on it. A record is one line of a file, added when its run
has ended.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple

from gauss2svg.batch.table import as_cell
from gauss2svg.compare.records import Row, answered, machine
from gauss2svg.compare.variants import Variant
from gauss2svg.errors import OutputError
from gauss2svg.files import check_writable, make_folder, reading
from gauss2svg.measure.perceptual import packages
from gauss2svg.options import file_name
from gauss2svg.pipeline.listing import ListedPhoto
from gauss2svg.pool import Pool, WorkerDiedError, completed
from gauss2svg.raster import DEFAULT_RENDERER, renderer_version


@cache
def code_digest() -> str:
    """Return the SHA-256 of the package's source files: runs of other code are other runs."""
    package = Path(__file__).parent.parent
    sources = sorted(package.rglob("*.py"))
    parts = (str(one.relative_to(package)).encode() + one.read_bytes() for one in sources)
    return hashlib.sha256(b"".join(parts)).hexdigest()


@dataclass(eq=False)
class Task:
    """A run of a photo.

    variant  None prepares the photo itself
    given    what its request has beside the photo and the variant
    others   what the result depends on beside photo, variant, code, renderer and scores
    about    further columns of its record
    file     in a folder of its own, without which it is not finished; None: it makes no file
    """

    photo: ListedPhoto
    variant: Variant | None
    given: Mapping[str, Any]
    others: tuple[Any, ...]
    about: Mapping[str, Any]
    file: Path | None = None

    @property
    def request(self) -> dict[str, Any]:
        """What the function is called with that makes the record."""
        one = self.variant
        about = {"tool": one.tool, "settings": dict(one.settings)} if one else {}
        return {"source": self.photo.path, **about, **self.given}

    @cached_property
    def key(self) -> str:
        """A hash of all that the record depends on, but no path."""
        made_by = code_digest(), renderer_version(DEFAULT_RENDERER), packages()
        parts = [self.photo.digest, *made_by, self.variant, *self.others]
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


class Progress(NamedTuple):
    """Progress of a grid: finished and total runs, SVGs that were kept, the current runs."""

    done: int
    total: int
    kept: int
    now: tuple[str, ...] = ()


class Grid:
    """The records of a grid in progress.

    path     the file of all records
    records  of all tasks in their order, empty until a task has ended; one that failed has "error",
             one line
    kept     number of files that were made before
    total    number of tasks that will have a record
    """

    def __init__(
        self, path: Path, tasks: Iterable[Task], progress: Callable[[Progress], None] | None
    ) -> None:
        self._path, self._progress = path, progress or (lambda _: None)
        self.records: dict[Task, Row] = {task: {} for task in tasks}
        self.total = len(self.records)
        self._now: list[Task] = []
        known = rows_in(path)
        for task in self.records:
            row = known.get(task.about.get("folder", task.key), {"key": ""})
            is_whole = "error" not in row and (task.file is None or task.file.exists())
            if is_whole and row["key"] == task.key:
                self.records[task] = row | {"image": task.photo.name}  # which it may not have had
        self.kept = sum(1 for task, row in self.records.items() if row and task.variant)

    def is_made(self, task: Task) -> bool:
        """Whether a task has ended, and not failed."""
        return "error" not in (self.records[task] or {"error": "not run yet"})

    def run(
        self, tasks: Iterable[Task], pool: Pool, make: Callable[[Mapping[str, Any]], Row]
    ) -> Iterator[Row]:
        """Have processes make the records that are missing, by a function; yield each record.

        Raise OutputError if no other can be made.
        """

        def submitted(task: Task) -> Future[Row]:
            self._now.append(task)
            self._report()
            if task.file is not None and task.file.exists():  # of a run whose row counts no more
                add_row(self._path, task.record({"error": "it was interrupted"}))
            return pool.submit(answered, make, task.request)

        self._report()
        missing = (task for task in tasks if not self.records[task])
        for task, job in completed(submitted, missing, lambda: pool.workers):
            try:
                answer = job.result()
            except WorkerDiedError as error:
                answer = {"error": f"its worker died: {error}"}
            self._now.remove(task)
            if "fatal" in answer:
                raise OutputError(answer["error"])
            self.records[task] = record = task.record(answer)
            add_row(self._path, record)
            yield record
            self._report()

    def _report(self) -> None:
        done = sum(map(bool, self.records.values()))
        now = (t.photo.name + (f", {t.variant.name}" if t.variant else "") for t in self._now)
        self._progress(Progress(done, self.total, self.kept, tuple(now)))


def rows_in(path: Path) -> dict[str, Row]:
    """Return the last row of each folder, or else key, in a file of JSON lines.

    Damaged lines are left out. Raise InputError if the file cannot be read.
    """
    rows: dict[str, Row] = {}
    if path.exists():
        with reading(path, "another folder") as file:
            for line in file:
                with suppress(ValueError, TypeError, KeyError, AttributeError):
                    row = json.loads(line)
                    rows[row.get("folder", row["key"])] = row
    return rows


def add_row(path: Path, row: Row) -> None:
    """Append a row to such a file, and flush it to the disk; raise OutputError if that fails."""
    try:
        with path.open("a+b") as stream:
            if stream.tell():
                stream.seek(-1, os.SEEK_END)  # an interruption may have left half a line
                stream.write(b"" if stream.read(1) == b"\n" else b"\n")
            stream.write(json.dumps(row, allow_nan=False).encode() + b"\n")
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error


def flat(row: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Join nested names by dots: {"a": {"b": 1}} is {"a.b": 1}."""
    cells: dict[str, Any] = {}
    for name, value in row.items():
        is_nested, name = isinstance(value, dict), prefix + name
        cells |= flat(value, f"{name}.") if is_nested else {name: value}
    return cells


def csv_text(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return CSV with a column for every name in any row; null is an empty cell."""
    flattened = [flat(row) for row in rows]
    columns = list(dict.fromkeys(name for row in flattened for name in row))
    stream = io.StringIO()
    writer = csv.DictWriter(stream, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: as_cell(value) for name, value in row.items()} for row in flattened)
    return stream.getvalue()


def output_folder(directory: str | os.PathLike[str], outputs: Iterable[str]) -> Path:
    """Return a folder, created if missing; raise OutputError unless its files can be written."""
    folder = Path(file_name("directory", directory, "the name of a folder, such as . for this one"))
    make_folder(folder)
    for name in outputs:
        check_writable(folder / name)  # before the work, not after it
    return folder
