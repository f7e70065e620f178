"""Dask's clusters, of this machine or with a scheduler that is named, and tasks on them."""

from __future__ import annotations

import logging
import queue
import time
import warnings
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

import dask.config
from distributed import Client, Future, LocalCluster
from distributed.protocol.pickle import dumps, loads
from distributed.security import Security
from numba.core import config

from gauss2svg import batch
from gauss2svg.batch.records import BatchSpec
from gauss2svg.batch.stores import reason_of
from gauss2svg.batch.worker import cannot_run, check_worker
from gauss2svg.errors import ClusterError, Gauss2SvgError, brief, quoted
from gauss2svg.pipeline.run import compile_kernels
from gauss2svg.processes import end_family

T = TypeVar("T")
_CONNECT_S = 10.0  # a scheduler on a busy machine or far away answers in less
_COUNT_S = 1.0  # for which a number of workers is taken as known
_CLOSE_S = 5.0  # by then the workers are killed, and nothing is lost with the rest
_POLL_S = 1.0
_PRELOAD = "distributed.worker.preload"
_LOCAL = {
    # A task whose worker died is reported at once.
    "distributed.scheduler.allowed-failures": 0,
    # A shard that is unfinished is not wanted on a worker whose turn may be long.
    "distributed.scheduler.worker-saturation": 1.0,
    # Memory is that of pictures, which Dask cannot write to disk, and a pause would never end.
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    # To look at threads and event loops, up to a hundred times a second, took a tenth of a core
    # (docs/decisions/batch.md).
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "2s",
    "distributed.scheduler.active-memory-manager.start": False,
    "distributed.diagnostics.nvml": False,
    "distributed.comm.timeouts.connect": f"{_CONNECT_S:g}s",
}


def cores() -> int:
    """The number of threads that numba has started: one for each core, or as its variable says."""
    return config.NUMBA_NUM_THREADS  # pyright: ignore[reportAttributeAccessIssue]


@contextmanager
def local_client(
    workers: int, memory: int | None = None, dashboard: bool = True
) -> Iterator[Client]:
    """A client of so many worker processes of this machine, which end with it.

    memory     bytes of each, above which it is killed; None: no limit
    dashboard  whether Dask's web page is served, at its usual port, if that is free, or at any
    Connections need a certificate that is made here and kept in memory: whoever can connect to a
    scheduler or a worker can have it run anything. Raises ClusterError where workers cannot start.
    """
    preload = dask.config.get(_PRELOAD)
    preload = [preload] if isinstance(preload, str) else list(preload)
    given = {**_LOCAL, _PRELOAD: [*preload, "gauss2svg.batch.worker"]}
    with dask.config.set(given), _quiet(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Port .* is already in use")  # another is taken
        try:
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=memory or 0,
                host="127.0.0.1",
                dashboard_address=f"127.0.0.1:{8787 if dashboard else 0}",
                scheduler_kwargs={"dashboard": dashboard},
                security=Security.temporary(),
                silence_logs=logging.CRITICAL,
            )
        except RuntimeError as error:  # Dask's; the first of its causes is what the system refused
            first: BaseException = error
            while before := first.__cause__ or first.__context__:
                first = before
            raise ClusterError(
                "the workers of this machine must start; got "
                f"{brief(reason_of(first))}. Try TMPDIR=/a/writable/folder, in "
                "a container a tmpfs at /tmp and /dev/shm, or fewer --workers"
            ) from error
        try:
            client = Client(cluster, set_as_default=False)
            try:
                yield client
            finally:
                _end(cluster)
                client.close(timeout=_CLOSE_S)
        finally:
            cluster.close(timeout=_CLOSE_S)


class _Connecting(Client):
    """A client whose finaliser says nothing, 20 s later, where it could not connect."""

    def start(self, **options: Any) -> None:
        try:
            super().start(**options)
        except BaseException:
            self.status = "closed"
            raise


@contextmanager
def remote_client(scheduler: str) -> Iterator[Client]:
    """A client of a scheduler, such as tcp://host:8786; raises ClusterError without an answer."""
    with _quiet():
        try:
            client = _Connecting(scheduler, timeout=_CONNECT_S, set_as_default=False)
        except Exception as error:  # of addresses, names, sockets and handshakes
            why = " ".join(str(error).split())[:200] or type(error).__name__
            raise ClusterError(
                "scheduler must be the address of a running Dask scheduler; got "
                f"{quoted(scheduler)} ({why}). Try starting `dask scheduler`, and its address "
                "tcp://host:8786"
            ) from error
        try:
            yield client
        finally:
            client.close(timeout=_CLOSE_S)


def check_workers(client: Client, spec: BatchSpec) -> None:
    """Raise ClusterError for workers that cannot do the work, before any of it begins.

    One of every machine then compiles the kernels. Workers that join later check themselves.
    """
    # A client's methods return coroutines only inside of coroutines.
    checked: Any = client.run(check_worker, spec, on_error="return")
    for address, found in checked.items():
        if isinstance(found, Gauss2SvgError):
            raise found
        if isinstance(found, Exception):
            raise cannot_run(f"worker {address}", found, spec) from found
    first: dict[str, str] = {}
    for address, worker in client.scheduler_info(n_workers=-1)["workers"].items():
        first.setdefault(worker["host"], address)
    if first:
        client.run(compile_kernels, spec.options.fit.blend, workers=list(first.values()))


def counter(client: Client) -> Callable[[], int]:
    """A function that gives the number of workers, which may change."""
    known, at = 0, -_COUNT_S

    def count() -> int:
        nonlocal known, at
        if time.monotonic() - at >= _COUNT_S:
            with suppress(Exception):  # the scheduler is gone, which the tasks report
                threads: Any = client.nthreads()
                known = len(threads)
            at = time.monotonic()
        return known

    return count


def _end(cluster: LocalCluster) -> None:
    """Kill the workers: what they write is whole or not there, and a photo may take minutes."""
    for nanny in cluster.workers.values():
        nanny.close_gracefully()  # and start no other
        if nanny.pid is None:  # it is being started again
            continue
        end_family(nanny.pid)  # with such as other tools


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the log of Dask inside: what is wrong is reported in our words."""
    names = ["distributed", *(n for n in logging.root.manager.loggerDict if "distributed." in n)]
    before = {logging.getLogger(name): logging.getLogger(name).level for name in names}
    for logger in before:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in before.items():
            logger.setLevel(level)


def answers(
    client: Client,
    function: Callable[[T], Any],
    next_request: Callable[[], T | None],
    window: Callable[[], int],
    idle: Callable[[], None] = lambda: None,
) -> Iterator[tuple[T, Any]]:
    """(request, what the function returned or the exception of its task) as tasks finish.

    next_request  the next one, or None while there is none: what a caller learns from an answer
                  may lead to more
    window        how many may be submitted at once; neither driver nor scheduler holds more
    idle          called about each second in which none has finished
    A worker that dies gives its tasks back to Dask, which raises KilledWorker for one at which
    several have died. Raises ClusterError where the scheduler is gone; tasks that are unfinished
    when the iterator is closed are cancelled.
    """
    finished: queue.SimpleQueue[Future] = queue.SimpleQueue()
    submitted: dict[Any, tuple[Future, T]] = {}
    try:
        while True:
            batch.raise_pending()
            while len(submitted) < window() and (request := next_request()) is not None:
                # The scheduler remembers its last thousand tasks, with all that is in them.
                packed = zlib.compress(dumps((function, request)))
                try:
                    future = client.submit(_call, packed, pure=False)
                except Exception as error:  # of a connection that is closed
                    raise _gone(client) from error
                submitted[future.key] = future, request
                future.add_done_callback(finished.put)
            if not submitted:
                return
            try:
                future = finished.get(timeout=_POLL_S)
            except queue.Empty:
                if client.status not in ("running", "connecting"):
                    raise _gone(client) from None
                idle()
                continue
            _, request = submitted.pop(future.key)
            yield request, _outcome(client, future)
            future.release()
    finally:
        if submitted and client.status == "running":
            with suppress(OSError, CancelledError):  # they end with the scheduler
                client.cancel([future for future, _ in submitted.values()], force=True)


def _call(packed: bytes) -> Any:
    function, request = loads(zlib.decompress(packed))
    return function(request)


def _outcome(client: Client, future: Future) -> Any:
    try:
        return future.exception() if future.status == "error" else future.result()
    except (OSError, CancelledError) as error:  # what a task raises is returned just above
        raise _gone(client) from error


def _gone(client: Client) -> ClusterError:
    scheduler = getattr(client.scheduler, "address", None) or "the scheduler"
    return ClusterError(
        f"lost the connection to {scheduler}. Try the same command again: it goes on where this "
        "one ended"
    )
