"""A grid of photos and variants in progress: what is finished is kept, the rest is made."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from gauss2svg.compare.variants import Variant
from gauss2svg.errors import OutputError
from gauss2svg.pipeline.listing import ListedPhoto
from gauss2svg.pool import WorkerDiedError, completed
from gauss2svg.raster import DEFAULT_RENDERER, renderer_version

Record = dict[str, Any]
Place = tuple[ListedPhoto, Variant | None]


@cache
def code_digest() -> str:
    """SHA-256 of the package's source files; work of other code does not count as finished."""
    package = Path(__file__).parent.parent
    digest = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        digest.update(str(source.relative_to(package)).encode() + source.read_bytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class Task:
    """One piece of work.

    variant  None prepares the photo itself
    request  what a process gets, with the key
    others   what the result depends on beside photo, variant, code and renderer
    """

    photo: ListedPhoto
    variant: Variant | None
    request: Mapping[str, Any]
    others: tuple[Any, ...] = ()

    @property
    def label(self) -> str:
        """The task's name in a progress bar."""
        return self.photo.name + (f", {self.variant.name}" if self.variant else "")

    @property
    def place(self) -> Place:
        """The photo and the variant to which the task's record belongs."""
        return self.photo, self.variant

    @property
    def key(self) -> str:
        """A hash of all that the record depends on, the package's code among it, but no path."""
        one = self.variant
        parts = [self.photo.digest, code_digest(), renderer_version(DEFAULT_RENDERER), *self.others]
        parts += [one.tool, one.version, one.settings] if one else []
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


@dataclass(frozen=True)
class Progress:
    """Progress of a grid: finished and total steps, results that were kept, the current steps."""

    done: int
    total: int
    kept: int
    now: tuple[str, ...] = ()


class Grid:
    """The records of a grid in progress, which its user adds.

    finished  gives the record of a finished task, and None for any other
    records   by their places; kept: number of files that were made before
    dropped   number of steps that will have no record
    """

    def __init__(
        self,
        finished: Callable[[Task], Record | None],
        steps: int,
        progress: Callable[[Progress], None] | None,
    ) -> None:
        self._finished, self._steps, self._progress = finished, steps, progress
        self.records: dict[Place, Record] = {}
        self.kept = self.dropped = 0
        self._now: list[str] = []

    def missing(self, tasks: Iterable[Task]) -> list[Task]:
        """Return the tasks that are not finished; keep the records of the others."""
        missing = []
        for task in tasks:
            if task.place not in self.records:
                if (record := self._finished(task)) is None:
                    missing.append(task)
                else:
                    self.records[task.place] = record
                    self.kept += task.variant is not None
        return missing

    def answers(
        self, tasks: Iterable[Task], submit: Callable[[Record], Future[Record]], width: int
    ) -> Iterator[tuple[Task, Record]]:
        """Yield (task, answer) as tasks are done, of which `width` are submitted at once.

        An answer has "error", one line, if the task failed. Raise OutputError if no other can be
        done.
        """

        def submitted(task: Task) -> Future[Record]:
            self._now.append(task.label)
            self._report()
            return submit({**task.request, "key": task.key})

        self._report()
        for task, job in completed(submitted, iter(tasks), lambda: width):
            try:
                answer = job.result()
            except WorkerDiedError as error:
                answer = {"error": f"its worker died: {error}"}
            self._now.remove(task.label)
            if "fatal" in answer:
                raise OutputError(answer["error"])
            yield task, answer
            self._report()

    def _report(self) -> None:
        if self._progress is not None:
            done = len(self.records) + self.dropped
            self._progress(Progress(done, self._steps, self.kept, tuple(self._now)))
