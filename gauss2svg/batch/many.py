"""Vectorising many photos: what is to be done, and by which workers."""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext, suppress
from functools import cache
from importlib.util import find_spec
from itertools import islice
from typing import TYPE_CHECKING

from gauss2svg.batch.inputs import check_apart, photos_of
from gauss2svg.batch.options import BatchOptions
from gauss2svg.batch.records import (
    FOLDER,
    RECORDS,
    BatchSpec,
    PhotoIndex,
    PhotoRecord,
    identity_of,
    unchanged,
    versions,
)
from gauss2svg.batch.stores import STATE, Store, opened, without_file_protocol
from gauss2svg.errors import InputError, brief, instance, quoted
from gauss2svg.files import STANDARD_STREAM, as_json, folds_case
from gauss2svg.measure.memory import free_bytes
from gauss2svg.options import file_name
from gauss2svg.photo.load import header_of
from gauss2svg.photo.photo import Header
from gauss2svg.pipeline.memory_budget import allowed
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan

if TYPE_CHECKING:
    from distributed import Client

_SAMPLE = 16  # photos, the largest files, by which memory is estimated
_COMPARED = 50  # photos at once; the memory of few is given back before Python's collector looks
_READERS = 16  # threads that read records, which on a store is mostly waiting
_STALE_S = 60.0  # by then a live worker has written its part, which takes moments


def vectorize_many(
    sources: Iterable[str | os.PathLike[str]],
    output: str | os.PathLike[str],
    options: Options | None = None,
    *,
    batch: BatchOptions | None = None,
    client: Client | None = None,
) -> Iterator[PhotoRecord]:
    """Vectorise many photos by the workers of Dask; yields what became of each, as it is known.

    sources  folders, globs, lists (.txt, .lst), photos: paths of this machine or URLs of fsspec
    output   folder of the SVGs and, in gauss2svg-batch, of records and the table
    options  of each vectorisation: Options(goal=Goal(quality="draft"), ...)
    batch    BatchOptions(workers=4), (scheduler="tcp://host:8786"), (retry_failed=True)
    client   of a cluster with one thread for each worker; None: as `batch` says

    What an earlier run has done is skipped; where that is all, no cluster is needed. A bad photo is
    a record with an error. A script that calls this without a client must guard its main part by
    `if __name__ == "__main__":`, for the workers are spawned. Raises InputError for bad arguments,
    before anything runs; OutputError where nothing can be written; ClusterError for workers that
    are of other versions or gone.
    """
    made = Batch(sources, output, options, batch)

    def records() -> Iterator[PhotoRecord]:
        with made:
            yield from made.run(client)
            made.finish()

    return records()


class Batch:
    """Photos to vectorise: checked, listed, and compared with what earlier runs have done.

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
            raise InputError(
                f"sources must be a sequence; got {quoted(sources)}. Try [{sources!r}]"
            )
        named = [without_file_protocol(file_name("sources", source)) for source in sources]
        root = file_name("output", output, "the name or the URL of a folder")
        root = without_file_protocol(root)
        if root == STANDARD_STREAM:
            raise InputError(f"output must be a folder; got {quoted(root)}. Try -o out/")
        self.store = Store(root)
        check_apart(named, self.store.root)
        self.index = PhotoIndex(self._folds_case())
        try:
            self.index.add(photos_of(named), ".svgz" if self.options.svg.gzip else ".svg")
            if not self.index.count:
                searched = brief(f"none in {', '.join(named) or 'no folder'}")
                raise InputError(
                    f"photos must be one or more; got {searched}. Try gauss2svg batch photos/"
                )
            self.store.prepare()
            self._add_prior()
        except BaseException:
            self.index.close()
            raise

    def __enter__(self) -> Batch:
        return self

    def __exit__(self, *_: object) -> None:
        self.index.close()

    def run(
        self, client: Client | None = None, say: Callable[[str], None] = lambda _: None
    ) -> Generator[PhotoRecord]:
        """Yield what becomes of each photo; a cluster is needed where one is left to be done.

        say  called with a line about the cluster
        """
        said, scheduler = cache(say), self.batch.scheduler  # each line once
        yield from self.unchanged()
        if self.index.left:
            with self.connected() if client is None else nullcontext(client) as found:
                if find_spec("bokeh"):  # which draws it
                    say(f"Dask's dashboard: {found.dashboard_link}")

                def waiting() -> None:
                    if scheduler is not None:  # a dead worker of this machine is started again
                        said(f"no workers at {scheduler} yet; waiting for them")

                yield from self.records(found, waiting)

    def connected(self) -> AbstractContextManager[Client]:
        """A client of the scheduler, or of worker processes of this machine."""
        from gauss2svg.batch.cluster import local_client, remote_client
        from gauss2svg.pipeline.run import compile_kernels

        if self.batch.scheduler is not None:
            return remote_client(self.batch.scheduler)
        workers, threads, memory = self._local_workers()
        self.options = self.options.changed(threads=threads)
        compile_kernels(self.options.fit.blend)
        return local_client(workers, memory)

    def _local_workers(self) -> tuple[int, int, int]:
        """Number of workers of this machine, threads of each, and memory of each in bytes.

        Workers times threads are the cores, and workers times the estimate of a run on the largest
        photos are at most the memory that a single run would take.
        """
        from gauss2svg.batch.cluster import cores

        threads = self.options.run.threads
        workers = self.batch.workers
        if workers is None:
            most = allowed(None) // self._estimate()
            workers = max(1, min(cores() // (threads or 1), most, self.index.left))
        return workers, threads or max(1, cores() // workers), free_bytes() // workers

    def unchanged(self) -> Iterator[PhotoRecord]:
        """The records of photos that are as an earlier run left them; these need no worker."""
        spec, photos = self._spec(), self.index.photos(known=True)
        while some := list(islice(photos, _COMPARED)):
            found = (unchanged(spec, photo) for photo, _ in some)
            records = [record for record in found if record is not None]
            self.index.keep(record.output for record in records)
            yield from records

    def records(
        self, client: Client, waiting: Callable[[], None] = lambda: None
    ) -> Iterator[PhotoRecord]:
        """What becomes of the photos that workers take up, as it is known.

        waiting  called about each second in which there is no worker
        Raises ClusterError and OutputError.
        """
        from gauss2svg.batch.cluster import check_workers, counter
        from gauss2svg.batch.driver import Driver

        if self.options.run.threads is None:
            self.options = self.options.changed(threads=1)
        folder = self.store.read(FOLDER)
        if not folder:
            folder = secrets.token_hex(16).encode()
            self.store.write(FOLDER, folder)
        spec = self._spec(folder)
        written = as_json({**spec.versions, "options": self.options.flat()})
        self.store.write(f"{STATE}/options-{spec.identity}.json", written)
        check_workers(client, spec)
        workers = counter(client)
        idle = lambda: None if workers() else waiting()  # noqa: E731
        for record in Driver(client, spec, self.index, workers, idle).records():
            self.index.add_record(record)
            yield record

    def finish(self) -> list[str]:
        """Write the table of all photos, remove unfinished files, and return the table's paths."""
        from gauss2svg.batch.table import write_table

        self.store.sweep(time.time() - _STALE_S)
        return [self.store.path(name) for name in write_table(self.store, self.index)]

    def _spec(self, folder: bytes | None = None) -> BatchSpec:
        identity = identity_of(self.options)
        failed = self.batch.retry_failed
        return BatchSpec(self.options, self.store, versions(), identity, folder, failed)

    def _folds_case(self) -> bool:
        if not self.store.is_local:
            return False
        folder = self.store.root
        while not os.path.isdir(folder):  # one that is created is as the folder that it is in
            folder = os.path.dirname(folder)
        return folds_case(folder)

    def _add_prior(self) -> None:
        """What earlier runs have recorded, oldest first."""
        names = iter([f"{RECORDS}/{name}" for name in self.store.names(RECORDS)])
        with ThreadPoolExecutor(_READERS) as readers:
            while some := list(islice(names, _READERS)):
                for data in readers.map(self.store.read, some):
                    self.index.add_prior((data or b"").splitlines())

    def _estimate(self) -> int:
        """Bytes that a run on the largest photos takes, by the headers of the largest files."""
        from gauss2svg.pipeline.memory_budget import load_of  # and numba, which takes a while

        given = self.options.run.max_memory
        if given is not None:
            return int(given)
        plan = Plan(self.options)
        loads = [load_of(plan, Header(1, 1, has_alpha=False))]
        for path in self.index.largest(_SAMPLE):
            # A photo that cannot be read is reported when its turn comes.
            with suppress(InputError), opened(path) as file:
                if header := header_of(file):
                    loads.append(load_of(plan, header))
        return max(load.bytes for load in loads)
