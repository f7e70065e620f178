"""Vectorise many photos: list them, submit the unfinished ones to workers, and write a table."""

from __future__ import annotations

import asyncio
import csv
import hashlib
import json
import os
import pickle
import re
import sqlite3
import sys
import tempfile
import time
import weakref
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from datetime import timedelta
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

from gauss2svg.batch import BatchOptions
from gauss2svg.batch.inputs import photos_of
from gauss2svg.batch.stores import (
    PARTS,
    PATH_SEPARATOR,
    STATE,
    TABLE,
    file_system_of,
    is_url,
    prepare,
    write,
)
from gauss2svg.batch.worker import BatchSpec, Photo, PhotoRecord, finished_record, versions, work
from gauss2svg.errors import (
    ClusterError,
    Gauss2SvgError,
    InputError,
    OutputError,
    brief,
    instance,
    of_file,
    quoted,
    refusal,
)
from gauss2svg.files import STANDARD_STREAM, as_json, folds_case, reason_of
from gauss2svg.options import Field, fields_of, file_name
from gauss2svg.photo.pixels import Header
from gauss2svg.pipeline.budgets import memory_limit
from gauss2svg.pipeline.options import Goal, Options, unknown_keyword
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.progress_display import counting
from gauss2svg.pool import Pool, WorkerDiedError, completed
from gauss2svg.processes import MEMORY_SHARE, command_line
from gauss2svg.version import __version__

if TYPE_CHECKING:
    from distributed import Client

# Longest time (s) to wait for the answer of a scheduler, which may be busy or far away.
_CONNECT_S = 10.0
# Beginning of text that a spreadsheet runs as a formula, after any number of apostrophes. If it has
# some, `as_cell` adds another one, because `text_of_cell` takes one off.
_FORMULA = re.compile(r"'*[=+\-@\t\r]")
# In a batch of fewer photos than this, each job has only one photo.
_FEW_PHOTOS = 50_000


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
    client    client of a Dask cluster, whose workers must have one thread each. If it is None,
              `batch` says where the photos are vectorised.
    progress  whether to show a bar on a terminal or in a notebook
    goals     fields of Goal, as in `vectorize`: vectorize_many(photos, "out", quality="draft")

    Photos that an earlier run has finished are skipped. Workers are started only if other photos
    are left. If a photo fails, its record has an error. Raise InputError for bad arguments, before
    any photo is read. Raise OutputError if no file can be written. Raise ClusterError if workers
    are lost, or if they have other versions of packages than this process. Raise TypeError for an
    unknown keyword.
    """
    for name in goals.keys() - {field.name for field in fields_of(Goal)}:
        raise unknown_keyword(name, "vectorize_many", "options=Options({})")
    options = instance(options, "options", Options).changed(**goals)
    show_progress = Field("progress", bool).checked(progress)
    job = Batch(sources, output, options, batch)
    return _shown(job, client) if show_progress else job.run(client)


def _shown(job: Batch, client: Client | None) -> Iterator[PhotoRecord]:
    summary = Summary()
    with counting() as update:
        for record in job.run(client):
            summary.add(record)
            update(summary.progress_text(job.count), summary.total, job.count)
            yield record


# The workers of a batch, as four items:
# 1. the method `submit` of an executor
# 2. a function that returns how many submitted jobs may be unfinished at the same time
# 3. the type or types of the exception that a job raises if its worker died
# 4. the options with which the workers vectorise the photos
_Engine = tuple[Callable[..., Future[Any]], Callable[[], int], Any, Options]


@contextmanager
def _sqlite_errors() -> Iterator[None]:
    """Turn an SQLite error of the with block, or of the decorated function, into an OutputError."""
    try:
        yield
    except sqlite3.Error as error:
        message = f"cannot write a temporary file: {error}. Try TMPDIR=another folder"
        raise OutputError(message) from error


class Batch:
    """The photos to vectorise, and the folder for their SVGs.

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
        self.root = root.rstrip("/") if is_url(root) else os.path.abspath(root)
        text = json.dumps([__version__, self.options.of_picture()], sort_keys=True)
        identity = hashlib.sha256(text.encode()).hexdigest()[:16]
        self._spec = BatchSpec(self.options, self.root, versions(), identity)
        # The list is kept in a temporary file, as an SQLite database, because a list of a million
        # photos would take much memory.
        self._db = sqlite3.connect("", check_same_thread=False)
        weakref.finalize(self, self._db.close)
        self.count = self._list_photos(names)
        if not self.count:
            got = brief(f"none in {', '.join(names) or 'no folder'}")
            raise refusal("photos", "one or more", got, "gauss2svg batch photos/ -o out/")
        prepare(self.root)

    @_sqlite_errors()
    def _list_photos(self, sources: list[str]) -> int:
        """Write each photo once into the table `photos`, and return the number of photos.

        Raise InputError if two photos would write the same file, or if the SVG of a photo would
        not be in the output folder.
        """
        folder = self.root
        # A new folder ignores case in file names if its parent folder does. So if the output
        # folder does not exist yet, the nearest folder above it that exists is tested.
        while not (is_url(folder) or os.path.isdir(folder)):
            folder = os.path.dirname(folder)
        # On Windows a colon in a name ends a drive, or the name of a file before that of a stream.
        on_windows = sys.platform == "win32" and not is_url(folder)
        key_of = str.casefold if not is_url(folder) and folds_case(folder) else str

        def rows() -> Iterator[tuple[bytes, bytes]]:
            for path, name in photos_of(sources):
                output = name + (".svgz" if self.options.svg.gzip else ".svg")
                parts = PATH_SEPARATOR.split(key_of(output))
                is_outside = not {"", ".", ".."}.isdisjoint(parts) or parts[0] == STATE
                if is_outside or (on_windows and ":" in output):
                    needed = f"in the output folder and outside of its {STATE}"
                    raise refusal("output", needed, f"{output}, of {path}", "another folder")
                # The path is made absolute, because workers may have another current folder.
                photo = path if is_url(path) else os.path.abspath(path), output
                yield os.fsencode(key_of(output)), pickle.dumps(photo)

        self._db.executescript(
            "CREATE TABLE records (record BLOB);"
            "CREATE TABLE photos (key BLOB PRIMARY KEY, photo BLOB, other BLOB)"
        )
        self._db.executemany(
            "INSERT INTO photos VALUES (?, ?, NULL) ON CONFLICT DO UPDATE"
            " SET other = excluded.photo WHERE excluded.photo != photo",
            rows(),
        )
        row = self._db.execute("SELECT photo, other FROM photos WHERE other IS NOT NULL").fetchone()
        if row is not None:
            (photo, output), (other, _) = map(pickle.loads, row)
            got = f"{photo} and {other}, which would both write {output}"
            advice = self._advice_for(photo, other)
            raise refusal("photos", "with outputs of their own", got, advice)
        return self._db.execute("SELECT count(*) FROM photos").fetchone()[0]

    def _advice_for(self, photo: str, other: str) -> str:
        """Return advice on two photos that would write the same file."""
        first, second = Path(photo).parent, Path(other).parent
        if not (is_url(photo) or is_url(other) or first == second):
            above = [first, *first.parents][:-1]
            if folder := next(filter(second.is_relative_to, above), None):
                # The outputs of the photos in a folder keep their subfolders.
                output = self.root if is_url(self.root) else _short(Path(self.root))
                return command_line(["gauss2svg", "batch", _short(folder), "-o", output])
        return "a run and a folder for each"

    def run(self, client: Client | None = None) -> Generator[PhotoRecord]:
        """Yield the records of all photos, then write the tables.

        Workers are started only if a photo is left to vectorise.
        """
        with _sqlite_errors():
            yield from self._done_before()
            yield from self._done_now(client)
            self.finish()

    def _store(self, record: PhotoRecord) -> PhotoRecord:
        self._db.execute("INSERT INTO records VALUES (?)", (pickle.dumps(record),))
        return record

    @_sqlite_errors()
    def finish(self) -> None:
        """Write the tables of all photos finished so far, and set `tables` to their paths."""
        records = self._db.execute("SELECT record FROM records")
        self.tables = write_table(self.root, (pickle.loads(record) for (record,) in records))

    def _done_before(self) -> Iterator[PhotoRecord]:
        for row, photo in self._db.execute("SELECT rowid, photo FROM photos"):
            source, output = pickle.loads(photo)
            # If the photo or the SVG is in a store, the check has to wait for the store. A worker
            # then makes the check later, because many workers can wait at the same time.
            is_local = not (is_url(source) or is_url(self.root))
            if is_local and (record := finished_record(self._spec, (source, output))):
                self._db.execute("DELETE FROM photos WHERE rowid = ?", (row,))
                yield self._store(record)

    def _done_now(self, client: Client | None) -> Iterator[PhotoRecord]:
        if not (count := self._db.execute("SELECT count(*) FROM photos").fetchone()[0]):
            return
        described = as_json({**self._spec.versions, "options": self.options.flat()})
        write(self.root, f"{STATE}/options-{self._spec.identity}.json", described)
        if client is None and self.batch.scheduler is None:
            engine = _on_this_machine(self.options, self.batch.workers, count)
        else:
            engine = _on_cluster(self.options, self.batch.scheduler, client)
        # Number of photos in a job. It grows with the batch, so that even a million photos make
        # only about 5000 jobs.
        size = 1 + 10 * (count // _FEW_PHOTOS)
        rows = self._db.execute("SELECT photo FROM photos")
        jobs = iter(lambda: [pickle.loads(photo) for (photo,) in rows.fetchmany(size)], [])
        # Photos of jobs whose worker died. One of the photos may be the cause. So each photo is
        # tried once more, in a job of its own.
        suspects: list[Photo] = []
        # If max_memory is not set, the limit is the memory that is free now. A photo that needs
        # more fails then. It is not fitted at a smaller size, because its SVG would depend on how
        # much memory happens to be free.
        may_reduce = self.options.run.max_memory is not None
        with engine as (submit, width, died, options):
            spec = replace(self._spec, options=options, may_reduce=may_reduce)
            for is_retry, requests in (False, jobs), (True, ([photo] for photo in suspects)):
                for photos, job in completed(partial(submit, work, spec), requests, width):
                    try:
                        records = job.result()
                    except died:
                        if not is_retry:
                            suspects += photos
                            continue
                        start: Any = (*photos[0], spec.identity)
                        line = "its workers died; was there enough memory? Try --max-size, or "
                        line += "fewer --workers"
                        records = [PhotoRecord(*start, error=line, error_code="WorkerDied")]
                    yield from map(self._store, records)


def _short(path: Path) -> str:
    """Return an absolute path, or the path from the current folder if it is in that folder."""
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


@contextmanager
def _on_this_machine(options: Options, workers: int | None, photos: int) -> Iterator[_Engine]:
    """Yield worker processes of this machine.

    If `workers` is None, there are as many processes as cores. But if the options set a number of
    threads for each process, there are only so many processes that their threads together are no
    more than the cores. There are fewer processes if there are fewer photos, or if the memory is
    not enough. A process is assumed to need the memory for a photo of usual size, or the value of
    max_memory if that is larger. If max_memory is not set, the memory that a single run could take
    is shared equally by the processes.
    """
    from gauss2svg.pipeline.budgets import load_of
    from gauss2svg.pipeline.run import thread_count

    usual = Header(4000, 3000, has_alpha=False)  # 12 megapixels, like a photo from a camera
    cores, needed = thread_count(None), load_of(Plan(options), usual).bytes
    threads, memory = options.run.threads, options.run.max_memory
    needed = max(needed, memory_limit(memory) if memory else 0)
    workers = workers or max(1, min(cores // (threads or 1), memory_limit(None) // needed, photos))
    share = memory_limit(None) // workers
    memory, threads = memory_limit(memory or share), threads or max(1, cores // workers)
    with Pool(workers, int(max(share, memory) / MEMORY_SHARE)) as pool:
        job_options = options.changed(threads=threads, max_memory=memory)
        # Two jobs are submitted for each process, so that one waits while the other runs.
        yield pool.submit, lambda: 2 * workers, WorkerDiedError, job_options


def _check_answer(scheduler: str) -> None:
    """Raise an exception if no scheduler answers at an address.

    A Client would raise it too. But after some of these exceptions it waits for 20 s when it is
    freed, and Python then prints a traceback.
    """
    from distributed import Security
    from distributed.comm.core import connect
    from distributed.utils import LoopRunner

    security: Any = Security().get_connection_args("client")
    if scheduler.startswith(("tls:", "wss:")) and security["ssl_context"] is None:
        needed = "given with certificates, in Dask's settings distributed.comm.tls"
        raise refusal("scheduler", needed, f"{scheduler} without any", "tcp:// if it has none")

    async def connect_once() -> None:
        answer = connect(scheduler, timeout=_CONNECT_S, **security)
        # Without wait_for(), connect() would wait for ever for a server that sends nothing.
        try:
            (await asyncio.wait_for(answer, 1.5 * _CONNECT_S)).abort()
        except TimeoutError as error:
            raise OSError("what is there sends no answer of Dask's") from error

    LoopRunner().run_sync(connect_once)


@contextmanager
def _on_cluster(options: Options, scheduler: str | None, client: Any) -> Iterator[_Engine]:
    """Connect to a Dask cluster, and yield its workers. Raise ClusterError if that fails."""
    try:
        from distributed import Client, KilledWorker
    except ImportError as error:
        advice = 'Try pip install "gauss2svg[cluster]"'
        raise InputError(f"distributed must be installed for --scheduler. {advice}") from error
    try:
        if client is None:
            _check_answer(str(scheduler))
        settings = {"timeout": _CONNECT_S, "set_as_default": False}
        with nullcontext(client) if client else Client(scheduler, **settings) as connected:

            def width() -> int:
                threads: Any = connected.nthreads()
                # A worker must have only one thread, because the kernels must not be called by
                # several threads of one process.
                if set(threads.values()) - {1}:
                    got, advice = quoted(threads), "dask worker --nthreads 1"
                    raise ClusterError(f"threads of workers must be 1; got {got}. Try {advice}")
                # Two jobs are submitted for each worker, so that one waits while the other runs.
                return max(1, 2 * len(threads))

            submit = connected.get_executor(pure=False).submit
            job_options = options.changed(threads=options.run.threads or 1)
            # A ValueError counts as the death of a worker too, because Dask's executor raises it
            # if a result is lost while it is fetched.
            yield submit, width, (KilledWorker, ValueError), job_options
    except Gauss2SvgError:
        raise
    except Exception as error:
        # This error has one of three causes: the address is wrong, the connection failed, or a
        # worker does not have gauss2svg.
        got = f"{quoted(scheduler or client)} ({type(error).__name__}: {reason_of(error)[:200]})"
        needed = "the address of a Dask scheduler whose workers have gauss2svg"
        raise ClusterError(f"scheduler must be {needed}; got {got}. Try it once it runs") from error


class Summary:
    """Three counts of the photos of a batch: done, skipped and failed so far."""

    def __init__(self) -> None:
        self.total = self.done = self.skipped = self.failed = 0
        self._failures: list[str] = []  # lines about the first five photos that failed
        self._begun = time.monotonic()

    def add(self, record: PhotoRecord) -> None:
        """Count the photo of a record as done, skipped or failed."""
        self.total += 1
        self.done += not (record.error or record.skipped)
        self.skipped += record.skipped
        self.failed += record.error is not None
        if record.error and len(self._failures) < 5:
            self._failures.append(f"failed: {of_file(record.input, record.error)}")

    def progress_text(self, count: int) -> str:
        """Return text with the speed, failures and remaining time of a batch of `count` photos."""
        rate = (self.done + self.failed) / self._seconds
        left = timedelta(seconds=round((count - self.total) / rate)) if rate else "unknown time"
        return f"{_speed(rate)}, {self.failed:,} failed, {left} left"

    @property
    def _seconds(self) -> float:
        # The clock may not have moved yet, and a speed is divided by this number.
        return max(time.monotonic() - self._begun, 1e-3)

    def lines(self) -> Iterator[str]:
        """Yield the lines of the final summary."""
        seconds = self._seconds
        counts = f"{self.done:,} done, {self.skipped:,} skipped, {self.failed:,} failed"
        yield f"{counts} in {seconds:.1f} s: {_speed(self.done / seconds)}"
        yield from self._failures


def _speed(rate: float) -> str:
    """Return text for a number of photos per second, which is the seconds of a photo below 1."""
    return f"{1 / rate:.3g} s a photo" if 0 < rate < 1 else f"{rate:.3g} photos a second"


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


def write_table(root: str, records: Iterable[PhotoRecord]) -> list[str]:
    """Write the records as CSV, and as Parquet if pyarrow is installed. Return the files' paths."""
    parts = None if is_url(root) else f"{root}/{PARTS}"
    with (
        file_system_of(f"{root}/{TABLE}", "write", OutputError) as (fs, _),
        tempfile.TemporaryDirectory(dir=parts) as folder,
    ):
        with open(f"{folder}/table.csv", "w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(PhotoRecord._fields)
            for record in records:
                row = record._replace(unreached="; ".join(record.unreached))
                writer.writerow(map(as_cell, row))
        # A table in Parquet is written only if pyarrow is installed, which is an optional extra.
        if find_spec("pyarrow") is not None:
            _write_parquet(f"{folder}/table.csv", f"{folder}/table.parquet")
        for name in (names := sorted(os.listdir(folder))):
            fs.put_file(f"{folder}/{name}", f"{root}/{STATE}/{name}")
    paths = [f"{root}/{STATE}/{name}" for name in names]
    return paths if is_url(root) else [os.fspath(Path(path)) for path in paths]


def _write_parquet(table: str, path: str) -> None:
    """Write a CSV table as Parquet, without the apostrophes of `as_cell`.

    Columns of integers may have nulls. The metadata keep pandas from reading them as floats.
    """
    import pyarrow as pa
    from pyarrow import compute
    from pyarrow import csv as reader
    from pyarrow.parquet import ParquetWriter

    kinds = {int | None: pa.int64(), float | None: pa.float64(), bool: pa.bool_()}
    types = {k: kinds.get(v, pa.string()) for k, v in get_type_hints(PhotoRecord).items()}
    lines = reader.ParseOptions(newlines_in_values=True)
    options = reader.ConvertOptions(column_types=types)
    rows = reader.open_csv(table, parse_options=lines, convert_options=options)
    numpy_types = {pa.int64(): "Int64", pa.float64(): "float64", pa.bool_(): "bool"}
    columns = [
        {
            "name": name, "field_name": name, "metadata": None,
            "pandas_type": "unicode" if kind == pa.string() else str(kind),
            "numpy_type": numpy_types.get(kind, "object"),
        }
        for name, kind in types.items()
    ]  # fmt: skip
    unquoted = compute.ReplaceSubstringOptions(f"^'({_FORMULA.pattern})", r"\1")
    described = {"index_columns": [], "column_indexes": [], "columns": columns}
    schema = rows.schema.with_metadata({"pandas": json.dumps(described)})
    with ParquetWriter(path, schema) as writer:
        for batch in rows:
            cells: Any = [
                compute.call_function("replace_substring_regex", [column], unquoted)
                if column.type == pa.string()
                else column
                for column in batch.columns
            ]
            writer.write_batch(pa.record_batch(cells, schema=schema))
