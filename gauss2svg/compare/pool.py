"""The workers of a grid: one that dies fails its own request only, and is replaced."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any

from distributed import Client, KilledWorker

from gauss2svg.batch.cluster import answers, local_client

Answer = dict[str, Any]
_Numbered = tuple[int, Mapping[str, Any]]


class WorkerPool:
    """Up to `jobs` processes, started as requests need; its with statement ends them all."""

    def __init__(self, jobs: int, answer_to: Callable[[Mapping[str, Any]], Answer]) -> None:
        self._jobs, self._answer_to = jobs, answer_to
        self._client: Client | None = None
        self._started = 0
        self._stack = ExitStack()

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def run(
        self, requests: Sequence[Mapping[str, Any]], begun: Callable[[int], None]
    ) -> Iterator[tuple[int, Answer]]:
        """Yields (index, answer) as requests are done; begun(index) is called as they begin."""
        if not requests:
            return
        needed = min(self._jobs, len(requests))
        if self._client is None:
            self._client = self._stack.enter_context(local_client(needed, dashboard=False))
        elif needed > self._started:
            cluster: Any = self._client.cluster
            cluster.scale(needed)
            self._client.wait_for_workers(needed)
        self._started = max(self._started, needed)
        waiting = iter(enumerate(requests))

        def next_request() -> _Numbered | None:
            request = next(waiting, None)
            if request is not None:
                begun(request[0])
            return request

        for (index, _), answer in answers(
            self._client, partial(_answer, self._answer_to), next_request, lambda: self._jobs
        ):
            if isinstance(answer, KilledWorker):
                answer = {"error": "its worker died; was there enough memory? Try fewer --jobs"}
            elif isinstance(answer, Exception):
                raise answer
            yield index, answer


def _answer(answer_to: Callable[[Mapping[str, Any]], Answer], request: _Numbered) -> Answer:
    return answer_to(request[1])
