"""Vectorising many photos: what is to be done, and by which workers."""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import sqlite3
import weakref
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from gauss2svg.batch import BatchOptions
from gauss2svg.batch.inputs import photos_of
from gauss2svg.batch.stores import PARTS_OF, STATE, is_url, prepare, write
from gauss2svg.batch.table import write_table
from gauss2svg.batch.worker import BatchSpec, Photo, PhotoRecord, kept, versions, work
from gauss2svg.errors import (
    ClusterError,
    Gauss2SvgError,
    InputError,
    OutputError,
    brief,
    instance,
    quoted,
    refusal,
)
from gauss2svg.files import STANDARD_STREAM, as_json, folds_case, reason_of
from gauss2svg.measure.memory import SHARE
from gauss2svg.options import file_name
from gauss2svg.photo.photo import Header
from gauss2svg.pipeline.memory_budget import allowed
from gauss2svg.pipeline.options import NOT_OF_PICTURE, Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pool import Pool, WorkerDiedError, completed
from gauss2svg.version import __version__

if TYPE_CHECKING:
    from distributed import Client

_CONNECT_S = 10.0  # a scheduler on a busy machine or far away answers in less
_SINGLE = 50_000  # photos below which each is a job of its own
_DIED = "its workers died; was there enough memory? Try --max-size, or fewer --workers"


def vectorize_many(
    sources: Iterable[str | os.PathLike[str]],
    output: str | os.PathLike[str],
    options: Options | None = None,
    *,
    batch: BatchOptions | None = None,
    client: Client | None = None,
) -> Iterator[PhotoRecord]:
    """Vectorise many photos; yields what became of each, as it is known.

    sources  folders, globs, lists (.txt, .lst), photos: paths of this machine or URLs of fsspec
    output   folder of the SVGs and their marks and, in gauss2svg-batch, of the table
    options  of each vectorisation: Options(goal=Goal(quality="draft"), ...)
    batch    BatchOptions(workers=4), (scheduler="tcp://host:8786")
    client   of a Dask cluster with one thread for each worker; None: as `batch` says

    What an earlier run has done is skipped; where that is all, no worker is needed. A bad photo is
    a record with an error. Raises InputError for bad arguments, before anything runs; OutputError
    where nothing can be written; ClusterError for workers that are of other versions or gone.
    """
    return Batch(sources, output, options, batch).run(client)


# Those who do jobs: `submit` of an executor of concurrent.futures, a function that returns how many
# jobs are worth submitting at once, what a job raises whose worker died, and the options of a job.
_Engine = tuple[Callable[..., Future[Any]], Callable[[], int], Any, Options]


@contextmanager
def _temporary_file() -> Iterator[None]:
    """Raise OutputError for what SQLite cannot write."""
    try:
        yield
    except sqlite3.Error as error:
        message = f"cannot write a temporary file: {error}. Try TMPDIR=another folder"
        raise OutputError(message) from error


class Batch:
    """Photos to vectorise: checked and listed.

    Raises InputError for bad arguments, no photos, and two that would write one file; OutputError
    for a folder that cannot be written.
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
        if isinstance(sources, (str, bytes, os.PathLike)):
            raise refusal("sources", "a sequence", quoted(sources), f"[{sources!r}]")
        named = [file_name("sources", name) for name in sources]
        root = file_name("output", output, "the name or the URL of a folder")
        if root == STANDARD_STREAM:
            raise refusal("output", "a folder", quoted(root), "-o out/")
        self.root = root.rstrip("/") if is_url(root) else os.path.abspath(root)
        given = {k: v for k, v in self.options.flat().items() if k not in NOT_OF_PICTURE}
        text = json.dumps([__version__, given], sort_keys=True)
        identity = hashlib.sha256(text.encode()).hexdigest()[:16]
        self._spec = BatchSpec(self.options, self.root, versions(), identity)
        # A temporary file, so that a million photos take little memory.
        self._db = sqlite3.connect("", check_same_thread=False)
        weakref.finalize(self, self._db.close)
        self.count = self._listed(named)
        if not self.count:
            searched = brief(f"none in {', '.join(named) or 'no folder'}")
            raise refusal("photos", "one or more", searched, "gauss2svg batch photos/")
        prepare(self.root)

    @_temporary_file()
    def _listed(self, sources: list[str]) -> int:
        """List photos, each once, and return their number.

        Raise InputError for two that would write one file.
        """
        folder = self.root
        while not (is_url(folder) or os.path.isdir(folder)):  # a new one is as its parent
            folder = os.path.dirname(folder)
        key_of = str.casefold if not is_url(folder) and folds_case(folder) else str

        def rows() -> Iterator[tuple[bytes, bytes]]:
            for path, name in photos_of(sources):
                output = name + (".svgz" if self.options.svg.gzip else ".svg")
                parts = PARTS_OF.split(key_of(output))
                if not {"", ".", ".."}.isdisjoint(parts) or parts[0] == STATE or ":" in parts[0]:
                    needed = f"in the output folder and outside of its {STATE}"
                    raise refusal("output", needed, f"{output}, of {path}", "another folder")
                # Workers may have another current folder.
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
        two = self._db.execute("SELECT photo, other FROM photos WHERE other IS NOT NULL").fetchone()
        if two is not None:
            (one, output), (other, _) = map(pickle.loads, two)
            got = f"{one} and {other}, which would both write {output}"
            raise refusal("photos", "with outputs of their own", got, "a run and a folder for each")
        return self._db.execute("SELECT count(*) FROM photos").fetchone()[0]

    def run(self, client: Client | None = None) -> Generator[PhotoRecord]:
        """Yield what becomes of each photo, then write the table.

        Workers are needed only if a photo is left to be done.
        """
        with _temporary_file():
            yield from self._done_before()
            yield from self._done_now(client)
            self.finish()

    def _record(self, record: PhotoRecord) -> PhotoRecord:
        self._db.execute("INSERT INTO records VALUES (?)", (pickle.dumps(record),))
        return record

    @_temporary_file()
    def finish(self) -> None:
        """Write the tables of all photos of which it is known what became."""
        records = self._db.execute("SELECT record FROM records")
        self.tables = write_table(self.root, (pickle.loads(record) for (record,) in records))

    def _done_before(self) -> Iterator[PhotoRecord]:
        for row, photo in self._db.execute("SELECT rowid, photo FROM photos"):
            source, output = pickle.loads(photo)
            # Workers ask stores, for whose answers they wait at the same time.
            is_here = not (is_url(source) or is_url(self.root))
            if is_here and (record := kept(self._spec, (source, output))):
                self._db.execute("DELETE FROM photos WHERE rowid = ?", (row,))
                yield self._record(record)

    def _done_now(self, client: Client | None) -> Iterator[PhotoRecord]:
        if not (count := self._db.execute("SELECT count(*) FROM photos").fetchone()[0]):
            return
        described = as_json({**self._spec.versions, "options": self.options.flat()})
        write(self.root, f"{STATE}/options-{self._spec.identity}.json", described)
        if client is None and self.batch.scheduler is None:
            engine = _on_this_machine(self.options, self.batch.workers, count)
        else:
            engine = _on_cluster(self.options, self.batch.scheduler, client)
        size = 1 + 10 * (count // _SINGLE)  # a million are 5000 jobs
        rows = self._db.execute("SELECT photo FROM photos")
        jobs = iter(lambda: [pickle.loads(photo) for (photo,) in rows.fetchmany(size)], [])
        suspects: list[Photo] = []
        # Memory that happens to be free now must not change a file.
        may_reduce = self.options.run.max_memory is not None
        with engine as (submit, width, died, options):
            spec = replace(self._spec, options=options, may_reduce=may_reduce)
            for again, some in (False, jobs), (True, ([photo] for photo in suspects)):
                for photos, job in completed(partial(submit, work, spec), some, width):
                    try:
                        made = job.result()
                    except died:
                        if not again:
                            suspects += photos
                            continue
                        of: Any = (*photos[0], spec.identity)
                        made = [PhotoRecord(*of, error=_DIED, error_code="WorkerDied")]
                    yield from map(self._record, made)


@contextmanager
def _on_this_machine(options: Options, workers: int | None, most: int) -> Iterator[_Engine]:
    """Yield processes of this machine.

    Processes times threads are the cores, and processes times the estimate of a usual run are at
    most the memory that a single run would take.
    """
    from gauss2svg.pipeline.memory_budget import load_of  # and numba, which takes a while
    from gauss2svg.pipeline.run import compile_kernels, thread_count

    compile_kernels(options.fit.blend)
    usual = Header(4000, 3000, has_alpha=False)  # a photo of a camera
    cores, needed = thread_count(None), load_of(Plan(options), usual).bytes
    threads, memory = options.run.threads, options.run.max_memory
    needed = max(needed, allowed(memory) if memory else 0)
    workers = workers or max(1, min(cores // (threads or 1), allowed(None) // needed, most))
    share = allowed(None) // workers
    memory, threads = allowed(memory or share), threads or max(1, cores // workers)
    with Pool(workers, int(max(share, memory) / SHARE)) as pool:
        # A job for each process, and one that waits.
        of_job = options.changed(threads=threads, max_memory=memory)
        yield pool.submit, lambda: 2 * workers, WorkerDiedError, of_job


@contextmanager
def _on_cluster(options: Options, scheduler: str | None, client: Any) -> Iterator[_Engine]:
    """Yield the workers of a Dask cluster. Raise ClusterError where it does not answer."""
    try:
        from distributed import Client, KilledWorker
    except ImportError as error:
        advice = 'Try pip install "gauss2svg[cluster]"'
        raise InputError(f"distributed must be installed for --scheduler. {advice}") from error
    try:
        given = {"timeout": _CONNECT_S, "set_as_default": False}
        with nullcontext(client) if client else Client(scheduler, **given) as used:

            def width() -> int:
                threads: Any = used.nthreads()
                if set(threads.values()) - {1}:  # numba's kernels are for one thread of a process
                    got, advice = quoted(threads), "dask worker --nthreads 1"
                    raise ClusterError(f"threads of workers must be 1; got {got}. Try {advice}")
                return max(1, 2 * len(threads))  # for each worker one, and one that waits

            submit = used.get_executor(pure=False).submit
            # Dask's executor raises ValueError for a result that is lost as it is fetched.
            of_job = options.changed(threads=options.run.threads or 1)
            yield submit, width, (KilledWorker, ValueError), of_job
    except Gauss2SvgError:
        raise
    except Exception as error:  # of addresses, sockets, handshakes; or a worker lacks gauss2svg
        got = f"{quoted(scheduler or client)} ({type(error).__name__}: {reason_of(error)[:200]})"
        needed = "the address of a Dask scheduler whose workers have gauss2svg"
        raise ClusterError(f"scheduler must be {needed}; got {got}. Try it once it runs") from error
