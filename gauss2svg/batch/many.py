"""Vectorise many photos: list them, submit the unfinished ones to workers, and write a table."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import re
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from datetime import timedelta
from functools import partial
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, NamedTuple

from gauss2svg.batch import BatchOptions
from gauss2svg.batch.inputs import photos_of
from gauss2svg.batch.stores import STATE, TABLE, is_url, write
from gauss2svg.batch.worker import BatchSpec, Photo, PhotoRecord, finished_record, work
from gauss2svg.errors import (
    ClusterError,
    Gauss2SvgError,
    InputError,
    brief,
    instance,
    of_file,
    quoted,
    refusal,
)
from gauss2svg.files import STANDARD_STREAM, as_json, folds_case, reason_of
from gauss2svg.options import Field, fields_of, file_name
from gauss2svg.photo.pixels import Header
from gauss2svg.pipeline.options import Goal, Options, unknown_keyword
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.progress_display import counting
from gauss2svg.pipeline.run import memory_limit
from gauss2svg.pool import Pool, WorkerDiedError, completed
from gauss2svg.version import __version__

if TYPE_CHECKING:
    from distributed import Client

_FORMULA = re.compile(r"'*[=+\-@\t\r]")  # beginning of text that a spreadsheet runs as a formula


def vectorize_many(
    sources: Iterable[str | os.PathLike[str]],
    output: str | os.PathLike[str],
    options: Options | None = None,
    *,
    batch: BatchOptions | None = None,
    client: Client | None = None,
    progress: bool = False,
    **goals: Any,
) -> Iterator[PhotoRecord]:
    """Vectorise many photos, and yield the record of each when it is finished.

    sources   folders, globs, lists (.txt, .lst) and photos, as local paths or as URLs for fsspec
    output    folder for the SVGs, and the table gauss2svg-batch/table.csv
    options   options for every photo, such as Options(goal=Goal(quality="draft"))
    batch     BatchOptions(workers=4), or BatchOptions(scheduler="tcp://host:8786")
    client    client of a Dask cluster, each worker of which does one photo at a time. If it is
              None, `batch` says where the photos are vectorised.
    progress  whether to show a bar on a terminal or in a notebook
    goals     fields of Goal, as in `vectorize`: vectorize_many(photos, "out", quality="draft")

    Photos that an earlier run has finished are skipped. Workers are started only if other photos
    are left. If a photo fails, its record has an error. Raise InputError for bad arguments, before
    any photo is read. Raise OutputError if no file can be written. Raise ClusterError if workers
    are lost, have another version of gauss2svg, or do not see the output folder. Raise TypeError
    for an unknown keyword.
    """
    for name in goals.keys() - {field.name for field in fields_of(Goal)}:
        raise unknown_keyword(name, "vectorize_many", "options=Options({})")
    options = instance(options, "options", Options).changed(**goals)
    show_progress = Field("progress", bool).checked(progress)
    job = Batch(sources, output, options, batch)
    return _with_bar(job.run(client), job.count) if show_progress else job.run(client)


def _with_bar(records: Iterator[PhotoRecord], count: int) -> Iterator[PhotoRecord]:
    summary = Summary()
    with counting() as update:
        for record in records:
            summary.add(record)
            update(summary.progress_text(count), summary.total, count)
            yield record


class _Engine(NamedTuple):
    """The workers of a batch.

    submit   method of an executor
    width    number of photos that are submitted at the same time
    died     types of the exception that a job raises if its worker died
    options  options with which the workers vectorise the photos
    """

    submit: Callable[..., Future[Any]]
    width: int
    died: Any
    options: Options


class Batch:
    """The photos to vectorise, and the folder for their SVGs.

    count  number of photos
    table  path of the table of the photos that are finished. It is written when a run ends

    The constructor checks its arguments, lists the photos, and creates the folder. It raises
    InputError if an argument is invalid, if there are no photos, or if two photos would write the
    same file. It raises OutputError if the folder cannot be written.
    """

    def __init__(
        self,
        sources: Iterable[str | os.PathLike[str]],
        output: str | os.PathLike[str],
        options: Options | None = None,
        batch: BatchOptions | None = None,
    ) -> None:
        self.options = instance(options, "options", Options)
        self.batch = instance(batch, "batch", BatchOptions)
        Plan(self.options).check_renderer()
        # Marks could not tell that the code of a function has changed.
        if callable(loss := self.options.fit.loss):
            raise refusal("loss", "a name in a batch", quoted(loss), "vectorize for each photo")
        if isinstance(sources, (str, bytes, os.PathLike)):
            raise refusal("sources", "a sequence", quoted(sources), f"[{sources!r}]")
        names = [file_name("sources", name) for name in sources]
        root = file_name("output", output, "the name or the URL of a folder")
        if root == STANDARD_STREAM:
            raise refusal("output", "a folder", quoted(root), "-o out/")
        root = root.rstrip("/") if is_url(root) else os.path.abspath(root)
        self.table = f"{root}/{TABLE}" if is_url(root) else os.path.join(root, *TABLE.split("/"))
        text = json.dumps([__version__, self.options.of_picture()], sort_keys=True)
        identity = hashlib.sha256(text.encode()).hexdigest()[:16]
        # If max_memory is not set, the limit is the memory that is free now. A photo that needs
        # more fails then. It is not fitted at a smaller size, because its SVG would depend on how
        # much memory happens to be free.
        may_reduce = self.options.run.max_memory is not None
        self._spec = BatchSpec(self.options, root, identity, may_reduce)
        self._photos = self._listed(names)
        self.count = len(self._photos)
        if not self.count:
            got = brief(f"none in {', '.join(names) or 'no folder'}")
            raise refusal("photos", "one or more", got, "gauss2svg batch photos/ -o out/")
        described = as_json({"gauss2svg": __version__, "options": self.options.flat()})
        write(root, f"{STATE}/options-{identity}.json", described)

    def _listed(self, sources: list[str]) -> list[Photo]:
        """Return each photo once. Raise InputError if two photos would write the same file."""
        folder = self._spec.root
        # A new folder ignores case in file names if its parent folder does. So if the output
        # folder does not exist yet, the nearest folder above it that exists is tested.
        while not (is_url(folder) or os.path.isdir(folder)):
            folder = os.path.dirname(folder)
        key_of = str.casefold if not is_url(folder) and folds_case(folder) else str
        photos: dict[str, Photo] = {}
        for path, name in photos_of(sources):
            output = name + (".svgz" if self.options.svg.gzip else ".svg")
            parts = PurePosixPath(output).parts
            if ".." in parts or parts[0] in ("/", STATE):
                needed = f"in the output folder and outside of its {STATE}"
                raise refusal("output", needed, f"{output}, of {path}", "another folder")
            # The path is made absolute, because workers may have another current folder.
            photo = path if is_url(path) else os.path.abspath(path), output
            if (other := photos.setdefault(key_of(output), photo)) != photo:
                got = f"{other[0]} and {path}, which would both write {output}"
                advice = "the folder that contains both, or a run and a folder for each"
                raise refusal("photos", "with outputs of their own", got, advice)
        return [*photos.values()]

    def run(self, client: Client | None = None) -> Generator[PhotoRecord]:
        """Yield the records of all photos, and finally write the table.

        Workers are started only if a photo is left to vectorise.
        """
        rows = io.StringIO()
        table = csv.writer(rows)
        table.writerow(PhotoRecord._fields)
        try:
            for record in self._records(client):
                row = record._replace(unreached="; ".join(record.unreached))
                table.writerow(map(as_cell, row))
                yield record
        finally:
            write(self._spec.root, TABLE, rows.getvalue().encode())

    def _records(self, client: Client | None) -> Iterator[PhotoRecord]:
        left: list[Photo] = []
        for photo in self._photos:
            # If the photo or the SVG is in a store, a worker makes this check, because many workers
            # can wait for the store at the same time.
            is_local = not (is_url(photo[0]) or is_url(self._spec.root))
            if is_local and (record := finished_record(self._spec, photo)):
                yield record
            else:
                left.append(photo)
        if not left:
            return
        if client is None and self.batch.scheduler is None:
            engine = _on_this_machine(self.options, self.batch.workers, len(left))
        else:
            engine = _on_cluster(self.options, self.batch.scheduler, client)
        with engine as (submit, width, died, options):
            spec = replace(self._spec, options=options)
            for photo, job in completed(partial(submit, work, spec), iter(left), width):
                try:
                    yield job.result()
                except died:
                    line = "its worker died; was there enough memory? Try --max-size, or "
                    line += "fewer --workers"
                    start: Any = (*photo, spec.identity)
                    yield PhotoRecord(*start, error=line, error_code="WorkerDied")


@contextmanager
def _on_this_machine(options: Options, workers: int | None, photos: int) -> Iterator[_Engine]:
    """Yield worker processes of this machine.

    If `workers` is None, there are as many processes as cores. There are fewer if the options set
    a number of threads for each, if there are fewer photos, or if the memory is not enough. A
    process is assumed to need the memory for a photo of usual size, or the value of max_memory if
    that is larger. If max_memory is not set, the processes share the memory equally.
    """
    from gauss2svg.pipeline.run import load_of, thread_count

    usual = Header(4000, 3000, has_alpha=False)  # 12 megapixels, like a photo from a camera
    cores, free = thread_count(None), memory_limit(None)
    threads, memory = options.run.threads, options.run.max_memory
    needed = max(load_of(Plan(options), usual).bytes, int(memory or 0))
    workers = workers or max(1, min(cores // (threads or 1), free // needed, photos))
    memory = memory or free // workers
    threads = threads or max(1, cores // workers)
    with Pool(workers) as pool:
        job_options = options.changed(threads=threads, max_memory=memory)
        # Two jobs are submitted for each process, so that one waits while the other runs.
        yield _Engine(pool.submit, 2 * workers, WorkerDiedError, job_options)


@contextmanager
def _on_cluster(options: Options, scheduler: str | None, client: Any) -> Iterator[_Engine]:
    """Connect to a Dask cluster, and yield its workers. Raise ClusterError if that fails."""
    try:
        from distributed import Client, KilledWorker
    except ImportError as error:
        advice = 'Try pip install "gauss2svg[cluster]"'
        raise InputError(f"distributed must be installed for --scheduler. {advice}") from error
    try:
        with nullcontext(client) if client else Client(scheduler, set_as_default=False) as found:
            job_options = options.changed(threads=options.run.threads or 1)
            submit = found.get_executor(pure=False).submit
            # The width is larger than the number of workers, so that workers may come later.
            # Dask's executor raises ValueError if a result is lost while it is fetched.
            yield _Engine(submit, 1000, (KilledWorker, ValueError), job_options)
    except Gauss2SvgError:
        raise
    except Exception as error:
        # The address is wrong, the connection failed, or a worker does not have gauss2svg.
        got = f"{quoted(scheduler or client)} ({type(error).__name__}: {reason_of(error)[:200]})"
        needed = "the address of a Dask scheduler whose workers have gauss2svg"
        raise ClusterError(f"scheduler must be {needed}; got {got}. Try it once it runs") from error


class Summary:
    """Counts of the photos of a batch: done, skipped, failed, and drawn as sketches so far."""

    def __init__(self) -> None:
        self.total = self.done = self.skipped = self.failed = self.sketches = 0
        self._failures: list[str] = []  # lines about the first five photos that failed
        self._begun = time.monotonic()

    def add(self, record: PhotoRecord) -> None:
        """Count the photo of a record as done, skipped or failed, and whether it is a sketch."""
        self.total += 1
        self.done += not (record.error or record.skipped)
        self.skipped += record.skipped
        self.failed += record.error is not None
        self.sketches += record.sketch is not None
        if record.error and len(self._failures) < 5:
            self._failures.append(f"failed: {of_file(record.input, record.error)}")

    def progress_text(self, count: int) -> str:
        """Return text with the speed, failures and remaining time of a batch of `count` photos."""
        seconds = (time.monotonic() - self._begun) / max(1, self.done + self.failed)
        left = timedelta(seconds=round(seconds * (count - self.total)))
        return f"{seconds:.3g} s a photo, {self.failed:,} failed, {left} left"

    def lines(self) -> Iterator[str]:
        """Yield the lines of the final summary."""
        counts = f"{self.done:,} done, {self.skipped:,} skipped, {self.failed:,} failed"
        yield f"{counts} in {time.monotonic() - self._begun:.1f} s"
        if self.sketches:
            as_they_are = "To compare photos, sort by psnr_photo, or give --areas never"
            yield f"{self.sketches:,} drawn as sketches, without their paper. {as_they_are}"
        yield from self._failures


def as_cell(value: Any) -> Any:
    """Return a value as a CSV cell, which `text_of_cell` turns back into the text.

    An apostrophe is put before text that begins like a formula, so that no spreadsheet runs it.
    Source: OWASP, "CSV Injection".
    """
    if not isinstance(value, str):
        return value
    # A file name may have bytes that are not valid Unicode. They are escaped.
    text = value if value.isascii() else value.encode(errors="backslashreplace").decode()
    return f"'{text}" if _FORMULA.match(text) else text


def text_of_cell(cell: str) -> str:
    """Return the text of a CSV cell without the apostrophe that `as_cell` puts before it."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell
