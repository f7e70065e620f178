"""Tasks on Dask in a window: submitted as others finish, gathered as they do."""

from __future__ import annotations

import queue
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import suppress
from typing import Any, TypeVar

from distributed import Client, Future
from distributed.protocol.pickle import dumps, loads

from gauss2svg.batch.interrupts import raise_pending
from gauss2svg.errors import ClusterError

T = TypeVar("T")
_POLL_S = 1.0
_ADVICE = "Try the same command again: it goes on where this one ended"


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
            raise_pending()
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
            future = _next(client, finished, idle)
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


def _next(client: Client, finished: queue.SimpleQueue[Future], idle: Callable[[], None]) -> Future:
    while True:
        raise_pending()
        try:
            return finished.get(timeout=_POLL_S)
        except queue.Empty:
            if client.status not in ("running", "connecting"):
                raise _gone(client) from None
            idle()


def _outcome(client: Client, future: Future) -> Any:
    try:
        return future.exception() if future.status == "error" else future.result()
    except (OSError, CancelledError) as error:  # what a task raises is returned just above
        raise _gone(client) from error


def _gone(client: Client) -> ClusterError:
    scheduler = getattr(client.scheduler, "address", None) or "the scheduler"
    return ClusterError(f"lost the connection to {scheduler}. {_ADVICE}")
