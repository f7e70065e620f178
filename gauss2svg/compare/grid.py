"""The grid of photos and variants: records of finished runs are kept, and missing runs are made.

The benchmark and galleries are reports on a grid. When a run ends, its record is appended to a file
as a line of JSON.
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

from gauss2svg.batch.listing import ListedPhoto
from gauss2svg.batch.table import as_cell
from gauss2svg.compare.records import Row, machine, record_or_error
from gauss2svg.compare.variants import Variant
from gauss2svg.errors import OutputError
from gauss2svg.files import check_writable, make_folder, reading, writing
from gauss2svg.measure import packages
from gauss2svg.options import file_name
from gauss2svg.pool import Pool, WorkerDiedError, completed
from gauss2svg.raster import DEFAULT_RENDERER, renderer_version


@cache
def code_digest() -> str:
    """Return the SHA-256 of the package's source files. If it changes, all runs are made again."""
    package = Path(__file__).parent.parent
    sources = sorted(package.rglob("*.py"))
    parts = (str(path.relative_to(package)).encode() + path.read_bytes() for path in sources)
    return hashlib.sha256(b"".join(parts)).hexdigest()


@dataclass(eq=False)
class Task:
    """A run of a photo in a variant, or the preparation of a photo for a gallery.

    variant       variant of the run; None for a preparation
    parameters    values of the request other than the photo and the variant
    dependencies  values on which the result depends, besides those that are part of every key
    columns       further columns of the record
    file          file that the task writes in its own folder, or None. The task is finished only if
                  this file exists.
    """

    photo: ListedPhoto
    variant: Variant | None
    parameters: Mapping[str, Any]
    dependencies: tuple[Any, ...]
    columns: Mapping[str, Any]
    file: Path | None = None

    @property
    def request(self) -> dict[str, Any]:
        """Argument for the function that makes the record."""
        variant = self.variant
        tool = {"tool": variant.tool, "settings": dict(variant.settings)} if variant else {}
        return {"source": self.photo.path, **tool, **self.parameters}

    @cached_property
    def key(self) -> str:
        """Hash of everything that the record depends on. Paths are not part of it."""
        software = code_digest(), renderer_version(DEFAULT_RENDERER), packages()
        parts = [self.photo.digest, *software, self.variant, *self.dependencies]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()

    def record(self, answer: Mapping[str, Any]) -> Row:
        """Return the record: photo, variant, date, machine, and the items of `answer`."""
        return {
            "key": self.key,
            **(self.variant.columns if self.variant else {}),
            "image": self.photo.name,
            "image_sha256": self.photo.digest,
            **self.columns,
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            "machine": machine(),
            **answer,
        }


class Progress(NamedTuple):
    """Progress of a grid: finished tasks, all tasks, kept runs, names of the current tasks."""

    done: int
    total: int
    kept: int
    now: tuple[str, ...] = ()


class Grid:
    """The tasks of a grid and their records.

    path     file of all records
    records  record of each task, in the order of the tasks. A record is empty until its task has
             ended, and has a text "error" if the task failed.
    kept     number of runs whose records from before are still valid
    total    number of tasks that will have a record
    """

    def __init__(
        self, path: Path, tasks: Iterable[Task], progress: Callable[[Progress], None] | None
    ) -> None:
        self._path, self._progress = path, progress or (lambda _: None)
        self.records: dict[Task, Row] = {task: {} for task in tasks}
        self.total = len(self.records)
        self._now: list[Task] = []
        rows_before = rows_in(path)
        for task in self.records:
            row = rows_before.get(task.columns.get("folder", task.key), {"key": ""})
            is_whole = "error" not in row and (task.file is None or task.file.exists())
            if is_whole and row["key"] == task.key:
                self.records[task] = row | {"image": task.photo.name}  # it may have a new name
        self.kept = sum(1 for task, row in self.records.items() if row and task.variant)

    def has_succeeded(self, task: Task) -> bool:
        """Return whether a task has ended without an error."""
        return "error" not in (self.records[task] or {"error": "not run yet"})

    def run(
        self, tasks: Iterable[Task], pool: Pool, make: Callable[[Mapping[str, Any]], Row]
    ) -> Iterator[Row]:
        """Make each missing record by `make` in a process of `pool`, save it, and yield it.

        Raise OutputError if no other record can be made, for example because the disk is full.
        """

        def submitted(task: Task) -> Future[Row]:
            self._now.append(task)
            self._report()
            if task.file is not None and task.file.exists():
                # The old record of this file is wrong from now on, also after an interruption.
                add_row(self._path, task.record({"error": "it was interrupted"}))
            return pool.submit(record_or_error, make, task.request)

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
    """Return {folder of a row, or else its key: row} for a file of JSON lines.

    The last row of a folder or key counts. Damaged lines and rows without a key are left out. Raise
    InputError if the file cannot be read.
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
    """Append a row to a file of JSON lines, and flush it. Raise OutputError if that fails."""
    line = json.dumps(row, allow_nan=False).encode() + b"\n"
    with writing(path), path.open("a+b") as stream:
        if stream.tell():
            stream.seek(-1, os.SEEK_END)  # an interruption may have left half a line
            stream.write(b"" if stream.read(1) == b"\n" else b"\n")
        stream.write(line)
        stream.flush()
        os.fsync(stream.fileno())


def flat(row: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return a row with nested names joined by dots: {"a": {"b": 1}} becomes {"a.b": 1}."""
    cells: dict[str, Any] = {}
    for name, value in row.items():
        is_nested, name = isinstance(value, dict), prefix + name
        cells |= flat(value, f"{name}.") if is_nested else {name: value}
    return cells


def csv_text(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return CSV text with a column for every name in any row. None becomes an empty cell."""
    flattened = [flat(row) for row in rows]
    columns = list(dict.fromkeys(name for row in flattened for name in row))
    stream = io.StringIO()
    writer = csv.DictWriter(stream, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: as_cell(value) for name, value in row.items()} for row in flattened)
    return stream.getvalue()


def output_folder(directory: str | os.PathLike[str], outputs: Iterable[str]) -> Path:
    """Create a folder if missing. Return it, or raise OutputError if an output is not writable."""
    folder = Path(file_name("directory", directory, "the name of a folder, such as . for this one"))
    make_folder(folder)
    for name in outputs:
        check_writable(folder / name)  # fail before the work, not after it
    return folder
