"""Vectorising many photos: what is to be done, and by which workers."""

from __future__ import annotations

import os
import pickle
import tempfile
import time
import zlib
from array import array
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import cache
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from gauss2svg.batch import BatchOptions
from gauss2svg.batch.inputs import check_apart, photos_of
from gauss2svg.batch.stores import PARTS_OF, STATE, is_url, prepare, reason_of, write
from gauss2svg.batch.table import write_table
from gauss2svg.batch.worker import BatchSpec, Photo, PhotoRecord, identity_of, now, versions, work
from gauss2svg.errors import (
    ClusterError,
    Gauss2SvgError,
    InputError,
    brief,
    instance,
    quoted,
    refusal,
)
from gauss2svg.files import STANDARD_STREAM, as_json, folds_case
from gauss2svg.measure.memory import SHARE, free_bytes
from gauss2svg.options import file_name
from gauss2svg.photo.photo import Header
from gauss2svg.pipeline.memory_budget import allowed
from gauss2svg.pipeline.options import NOT_OF_PICTURE, Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pool import Pool, completed

if TYPE_CHECKING:
    from distributed import Client

_USUAL = Header(4000, 3000, has_alpha=False)  # a photo of a camera, for which memory is shared out
_SINGLE = 50_000  # photos up to which each is a job of its own
_JOBS = 5000  # of more photos
_CONNECT_S = 10.0  # a scheduler on a busy machine or far away answers in less
_KNOWN_S = 1.0  # for which a number of workers is taken as known
_DIED = "its workers died; was there enough memory? Try --max-size, or --retry-failed with more"


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
    batch    BatchOptions(workers=4), (scheduler="tcp://host:8786"), (retry_failed=True)
    client   of a Dask cluster with one thread for each worker; None: as `batch` says

    What an earlier run has done is skipped; where that is all, no worker is needed. A bad photo is
    a record with an error. Raises InputError for bad arguments, before anything runs; OutputError
    where nothing can be written; ClusterError for workers that are of other versions or gone.
    """
    made = Batch(sources, output, options, batch)

    def records() -> Iterator[PhotoRecord]:
        yield from made.run(client)
        made.finish()

    return records()


class _Spool:
    """Tuples in a temporary file, so that a million take little memory."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 (for as long as the batch)
        self.count = 0

    def __del__(self) -> None:
        self._file.close()

    def add(self, one: tuple[Any, ...]) -> None:
        pickle.dump(one, self._file)
        self.count += 1

    def __iter__(self) -> Iterator[Any]:
        self._file.seek(0)
        for _ in range(self.count):
            yield pickle.load(self._file)


class Batch:
    """Photos to vectorise: checked and listed.

    Raises InputError for bad arguments, no photos, two that would write one file, and an output
    folder inside an input one; OutputError for a folder that cannot be written.
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
        named = [file_name("sources", name).removeprefix("file://") for name in sources]
        root = file_name("output", output, "the name or the URL of a folder")
        root = root.removeprefix("file://")
        if root == STANDARD_STREAM:
            raise refusal("output", "a folder", quoted(root), "-o out/")
        self.root = root.rstrip("/") if is_url(root) else os.path.abspath(root)
        check_apart(named, self.root)
        identities = (
            identity_of(self.options, NOT_OF_PICTURE),
            identity_of(self.options, {"threads"}),
        )
        retry = self.batch.retry_failed
        self._spec = BatchSpec(self.options, self.root, versions(), identities, retry)
        self._begun_at = now()
        self._records = _Spool()  # of all that is known
        self._photos = self._listed(named)
        if not (count := self._photos.count):
            searched = brief(f"none in {', '.join(named) or 'no folder'}")
            raise refusal("photos", "one or more", searched, "gauss2svg batch photos/")
        self.count = count
        prepare(self.root)

    def _listed(self, sources: list[str]) -> _Spool:
        """List photos, each once. Raise InputError for two that would write one file."""
        folder = self.root
        while not (is_url(folder) or os.path.isdir(folder)):  # a new one is as its parent
            folder = os.path.dirname(folder)
        key_of = str.casefold if not is_url(folder) and folds_case(folder) else str
        photos, hashes = _Spool(), array("q")
        for path, name in photos_of(sources):
            output = name + (".svgz" if self.options.svg.gzip else ".svg")
            parts = PARTS_OF.split(key_of(output))
            if not {"", ".", ".."}.isdisjoint(parts) or parts[0] == STATE or ":" in parts[0]:
                needed = f"in the output folder and outside of its {STATE}"
                raise refusal("output", needed, f"{output}, of {path}", "another glob or folder")
            # Workers may have another current folder.
            photos.add((path if is_url(path) else os.path.abspath(path), output))
            hashes.append(hash(key_of(output)))
        if len(np.unique(hashes)) == photos.count:
            return photos
        unique, paths = _Spool(), dict[str, str]()
        for path, output in photos:
            key = key_of(output)
            if key not in paths:
                unique.add((path, output))
            if (other := paths.setdefault(key, path)) != path:
                needed, advice = "with outputs of their own", "a run and a folder for each"
                got = f"{other} and {path}, which would both write {output}"
                raise refusal("photos", needed, got, advice)
        return unique

    def run(
        self, client: Client | None = None, say: Callable[[str], None] = lambda _: None
    ) -> Generator[PhotoRecord]:
        """Yield what becomes of each photo; workers are needed where one is left to be done.

        say  called with a line about the cluster
        """
        for record in self._known(client, cache(say)):
            self._records.add(record)
            yield record

    def finish(self) -> list[str]:
        """Write the table of all photos of which it is known what became; return its paths."""
        return write_table(self.root, self._records)

    def _known(self, client: Client | None, say: Callable[[str], None]) -> Iterator[PhotoRecord]:
        left = _Spool()
        for photo in self._photos:
            # Workers ask stores, for whose answers they wait at the same time.
            is_here = not (is_url(photo[0]) or is_url(self.root))
            if is_here and (record := self._spec.kept(photo)):
                yield record
            else:
                left.add(photo)
        if not left.count:
            return
        described = as_json({**self._spec.versions, "options": self.options.flat()})
        write(self.root, f"{STATE}/options-{self._spec.identities[0]}.json", described)
        with ExitStack() as stack:
            if client is not None or self.batch.scheduler is not None:
                client = client or stack.enter_context(_connected(self.batch.scheduler or ""))
                pool, threads, memory = _Cluster(client, say), 1, None
            else:
                pool, threads, memory = self._local_pool(left.count)
                stack.enter_context(pool)
            options = self.options.changed(threads=self.options.run.threads or threads)
            spec = replace(self._spec, options=options, memory=memory)
            yield from self._worked(pool, spec, left)

    def _worked(
        self, pool: Pool | _Cluster, spec: BatchSpec, left: _Spool
    ) -> Iterator[PhotoRecord]:
        """Yield what workers make of photos; one that kills its workers has failed."""
        photos, again = iter(left), deque[list[Photo]]()
        size = 1 if left.count <= _SINGLE else left.count // _JOBS
        deaths = Counter[Photo]()

        def next_request() -> tuple[list[Photo]] | None:
            some = again.popleft() if again else list(islice(photos, size))
            return (some,) if some else None

        def submit(some: list[Photo]) -> Future[list[PhotoRecord]]:
            # Dask's scheduler remembers its last thousand tasks, with all that is in them.
            return pool.submit(work, zlib.compress(pickle.dumps((spec, some))))

        for (some,), job in completed(submit, next_request, pool.width):
            try:
                records = job.result()
            except pool.died:
                deaths.update(some if len(some) == 1 else ())
                if deaths[some[0]] < pool.most_deaths:
                    again.extend([photo] for photo in some)
                    continue
                records = [spec.failed(some[0], "WorkerDied", _DIED)]
            for record in records:  # of photos of which some were done before a worker died
                yield record._replace(skipped=record.time < self._begun_at)

    def _local_pool(self, most: int) -> tuple[Pool, int, int]:
        """Return processes of this machine, threads of each, and bytes that a run of each may take.

        Processes times threads are the cores, and processes times the estimate of a usual run are
        at most the memory that a single run would take.
        """
        from gauss2svg.pipeline.memory_budget import load_of  # and numba, which takes a while
        from gauss2svg.pipeline.run import compile_kernels, thread_count

        compile_kernels(self.options.fit.blend)
        cores, needed = thread_count(None), load_of(Plan(self.options), _USUAL).bytes
        fitting = min(cores // (self.options.run.threads or 1), allowed(None) // needed, most)
        workers = self.batch.workers or max(1, fitting)
        memory = free_bytes() // workers
        return Pool(workers, memory), max(1, cores // workers), int(SHARE * memory)


class _Cluster:
    """The workers of a Dask client, by the interface of a pool; each works on one job."""

    most_deaths = 1  # at a job, after those that the scheduler allows

    def __init__(self, client: Client, say: Callable[[str], None]) -> None:
        from distributed import KilledWorker

        self._client, self._say, self.died = client, say, KilledWorker
        self._width, self._known_until = 1, 0.0
        self.submit: Callable[..., Future[Any]] = client.get_executor(pure=False).submit

    def width(self) -> int:
        """Return the number of workers, which may change. Raise ClusterError for other threads."""
        if time.monotonic() < self._known_until:
            return self._width
        threads: Any = self._client.nthreads()
        for worker, count in threads.items():
            if count != 1:  # numba's kernels are for one thread of a process at a time
                got = f"threads of worker {worker} must be 1; got {count}"
                raise ClusterError(f"{got}. Try dask worker --nthreads 1")
        if not threads:
            self._say("no workers yet; waiting for them")
        self._width, self._known_until = max(1, len(threads)), time.monotonic() + _KNOWN_S
        return self._width


@contextmanager
def _connected(scheduler: str) -> Iterator[Client]:
    """Yield a client of a scheduler, such as tcp://host:8786. Raise ClusterError without answer."""
    try:
        from distributed import Client
    except ImportError as error:
        advice = 'pip install "gauss2svg[cluster]"'
        message = f"distributed must be installed for --scheduler. Try {advice}"
        raise InputError(message) from error
    client = Client.__new__(Client)
    try:
        client.__init__(scheduler, timeout=_CONNECT_S, set_as_default=False)
    except Exception as error:  # of addresses, names, sockets and handshakes
        client.status = "closed"  # or its finaliser would complain
        needed, got = "the address of a running Dask scheduler", quoted(scheduler)
        got = f"{got} ({reason_of(error)[:200]})"
        advice = "starting `dask scheduler`, and its address tcp://host:8786"
        raise ClusterError(f"scheduler must be {needed}; got {got}. Try {advice}") from error
    with client:
        try:
            yield client
        except Gauss2SvgError:
            raise
        except Exception as error:  # the scheduler is gone, or a worker lacks gauss2svg
            why = f"{type(error).__name__}: {reason_of(error)}"
            advice = "the same command again: it goes on where this one ended"
            raise ClusterError(f"lost {scheduler} or its workers ({why}). Try {advice}") from error
