"""A grid of photos and variants in progress: what is finished is kept, the rest is made."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from gauss2svg.compare.variants import Variant
from gauss2svg.errors import OutputError
from gauss2svg.pipeline.listing import ListedPhoto
from gauss2svg.raster import DEFAULT_RENDERER, renderer_version

Record = dict[str, Any]
Place = tuple[ListedPhoto, Variant | None]
# Takes requests and a function that it calls with an index as that request begins; yields (index,
# answer) as they are done. An answer has "error", one line, where the request failed.
Runner = Callable[
    [Sequence[Mapping[str, Any]], Callable[[int], None]], Iterator[tuple[int, Record]]
]


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
    request  what a worker gets, as JSON, with the key
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

    records  by their places; kept: number of files that were made before
    dropped  number of steps that will have no record
    """

    def __init__(
        self,
        finished: Callable[[Task], Record | None],
        steps: int,
        progress: Callable[[Progress], None] | None,
    ) -> None:
        """The first argument gives the record of a finished task, and None for any other."""
        self._finished, self._steps, self._progress = finished, steps, progress
        self.records: dict[Place, Record] = {}
        self.kept = self.dropped = 0
        self._now: list[str] = []

    def missing(self, tasks: Iterable[Task]) -> list[Task]:
        """The tasks that are not finished; the records of the others are kept."""
        missing = []
        for task in tasks:
            if task.place in self.records:
                continue
            record = self._finished(task)
            if record is None:
                missing.append(task)
            else:
                self.records[task.place] = record
                self.kept += task.variant is not None
        return missing

    def answers(self, runner: Runner, tasks: Sequence[Task]) -> Iterator[tuple[Task, Record]]:
        """Yields (task, answer) as tasks are done; raises OutputError where no other can be."""

        def begun(index: int) -> None:
            self._now.append(tasks[index].label)
            self._report()

        self._report()
        requests = [{**task.request, "key": task.key} for task in tasks]
        for index, answer in runner(requests, begun):
            self._now.remove(tasks[index].label)
            if "fatal" in answer:
                raise OutputError(answer["error"])
            yield tasks[index], answer
            self._report()

    def _report(self) -> None:
        if self._progress is not None:
            done = len(self.records) + self.dropped
            self._progress(Progress(done, self._steps, self.kept, tuple(self._now)))
