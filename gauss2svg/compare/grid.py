"""Vectorise every photo with every variant, and keep a record of each of these runs.

The benchmark and the galleries are reports on such a grid of runs. When a run ends, its record is
appended to a file as a line of JSON. If that file already has the record of a run, the run is not
made again.
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
from typing import Any

from gauss2svg.batch.inputs import ListedPhoto
from gauss2svg.batch.many import as_cell
from gauss2svg.compare.records import Row, json_safe, machine
from gauss2svg.compare.variants import Variant
from gauss2svg.errors import OutputError, error_line
from gauss2svg.files import make_folder, reading, writing
from gauss2svg.measure import packages
from gauss2svg.pipeline.progress_display import counting
from gauss2svg.pool import Pool, completed
from gauss2svg.raster import DEFAULT_RENDERER, renderer_version

FOLDER = "the name of a folder, such as . for this one"  # needed directory, for error messages


@cache
def code_digest() -> str:
    """Return the SHA-256 of the package's source files, and of the data that it reads.

    The key of a record contains it. So if the code changes, all runs are made again.
    """
    package = Path(__file__).parent.parent
    kinds = {".py", ".c", ".h", ".json"}
    sources = sorted(path for path in package.rglob("*") if path.suffix in kinds)
    parts = (str(path.relative_to(package)).encode() + path.read_bytes() for path in sources)
    return hashlib.sha256(b"".join(parts)).hexdigest()


@dataclass(eq=False)
class Task:
    """One run, which vectorises one photo with one variant, or the preparation of one photo.

    Only a gallery prepares photos.

    photo         photo of the run
    variant       variant of the run, or None if the task prepares a photo
    parameters    entries of the request besides those of the photo and the variant
    dependencies  values on which the result depends, besides those that are part of every key
    columns       entries that the record has in addition to those of every record
    entry         what another method has of the photo, as of `entries_of`. Empty for a tool
    file          file that the task writes in its own folder, or None. If it is not None, the task
                  counts as finished only if this file exists.
    """

    photo: ListedPhoto
    variant: Variant | None
    parameters: Mapping[str, Any]
    dependencies: tuple[Any, ...]
    columns: Mapping[str, Any]
    entry: Mapping[str, Any]
    file: Path | None = None

    @property
    def request(self) -> dict[str, Any]:
        """Argument of the function that does this task."""
        variant = self.variant
        tool = {"tool": variant.tool, "settings": dict(variant.settings)} if variant else {}
        return {"source": self.photo.path, **tool, **self.entry, **self.parameters}

    @cached_property
    def key(self) -> str:
        """Hash of everything on which the record depends.

        The photo counts with its content and not with its path.
        """
        software = code_digest(), renderer_version(DEFAULT_RENDERER), packages()
        own = self.photo.digest, self.variant, self.entry, self.dependencies
        return hashlib.sha256(json.dumps([software, own]).encode()).hexdigest()

    @property
    def name(self) -> str:
        """Names of the photo and of the variant."""
        return self.photo.name + (f", {self.variant.label}" if self.variant else "")


class Grid:
    """The tasks of a grid and their records.

    path      file of all records. It and its folder are created if they do not exist
    progress  whether to show a bar on a terminal or in a notebook
    records  record of each task, in the order of the tasks. A record is empty until its task has
             ended. If the task failed, the record has the entry "error", which says why.
    """

    def __init__(self, path: Path, tasks: Iterable[Task], progress: bool) -> None:
        self._path, self._progress = path, progress
        make_folder(path.parent)
        with writing(path), path.open("ab"):
            pass  # if the file cannot be written, this raises an error before the first task
        self.records: dict[Task, Row] = {task: {} for task in tasks}
        rows_before = rows_in(path)
        for task in self.records:
            row = rows_before.get(task.columns.get("folder", task.key), {"key": ""})
            is_whole = "error" not in row and (task.file is None or task.file.exists())
            if is_whole and row["key"] == task.key:
                # The photo may have been renamed after the record was made, so its present name is
                # put into the record.
                self.records[task] = row | {"image": task.photo.name}

    def has_succeeded(self, task: Task) -> bool:
        """Return whether a task has ended without an error."""
        return "error" not in (self.records[task] or {"error": "not run yet"})

    def run(
        self, tasks: Iterable[Task], pool: Pool, make: Callable[[Mapping[str, Any]], Row]
    ) -> Iterator[Row]:
        """Do the tasks that have no record. Save each new record, and yield it.

        To do a task, a process of `pool` calls the function `make`. Raise OutputError if a file
        cannot be written, for example because the disk is full. The other tasks would then fail
        too.
        """
        tasks, now = list(tasks), list[str]()  # names of the tasks that are running

        def report() -> None:
            update("; ".join(now), sum(bool(self.records[task]) for task in tasks), len(tasks))

        def submitted(task: Task) -> Future[Row]:
            now.append(task.name)
            report()
            if task.file is not None and task.file.exists():
                # The file will be replaced, so its old record must not be used again, even if this
                # run is interrupted.
                row = {"key": task.key, "folder": task.columns["folder"]}
                add_row(self._path, row | {"error": "it was interrupted"})
            return pool.submit(make, task.request)

        missing = (task for task in tasks if not self.records[task])
        with counting(quiet=not self._progress) as update:
            report()
            for task, job in completed(submitted, missing, pool.workers):
                try:
                    answer = json_safe(job.result())
                except OutputError:
                    raise
                except Exception as error:  # another tool may raise any exception
                    answer = {"error": error_line(error, "smaller photos or fewer Gaussians")}
                now.remove(task.name)
                self.records[task] = record = {
                    "key": task.key,
                    **(task.variant.columns if task.variant else {}),
                    "image": task.photo.name,
                    "image_sha256": task.photo.digest,
                    **task.columns,
                    "date": datetime.now(UTC).isoformat(timespec="seconds"),
                    "machine": machine(),
                    **answer,
                }
                add_row(self._path, record)
                yield record
                report()


def rows_in(path: Path) -> dict[str, Row]:
    """Read the rows of a file of JSON lines, and return {folder of a row: row}.

    For a row without the entry "folder", its entry "key" is used instead. If several rows have the
    same folder or key, only the last one is returned. Damaged lines and rows without a key are left
    out. Raise InputError if the file cannot be read.
    """
    rows: dict[str, Row] = {}
    with reading(path, "another folder") as file:
        for line in file:
            with suppress(ValueError, TypeError, KeyError, AttributeError):
                row = json.loads(line)
                rows[row.get("folder", row["key"])] = row
    return rows


def add_row(path: Path, row: Row) -> None:
    """Append a row to a file of JSON lines, and flush it. Raise OutputError on failure."""
    line = json.dumps(row, allow_nan=False).encode() + b"\n"
    with writing(path), path.open("a+b") as stream:
        if stream.tell():
            # An interruption may have cut off the last line, so a line break is added if it is
            # missing.
            stream.seek(-1, os.SEEK_END)
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
    """Return CSV text with a column for each name that a row has. None becomes an empty cell."""
    flattened = [flat(row) for row in rows]
    columns = list(dict.fromkeys(name for row in flattened for name in row))
    stream = io.StringIO()
    writer = csv.DictWriter(stream, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: as_cell(value) for name, value in row.items()} for row in flattened)
    return stream.getvalue()
