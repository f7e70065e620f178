"""The driver: shards from an index, what comes back of them, and what is done about deaths."""

from __future__ import annotations

import dataclasses
import secrets
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from itertools import count

from distributed import Client, KilledWorker

from gauss2svg.batch.cluster import answers
from gauss2svg.batch.records import (
    WORKER_DIED,
    BatchPhoto,
    BatchSpec,
    PhotoIndex,
    PhotoRecord,
    ShardRecord,
)
from gauss2svg.batch.stores import stamp_of
from gauss2svg.batch.worker import Shard, ShardResult, cannot_run, work
from gauss2svg.errors import ClusterError, Gauss2SvgError, InputError, OutputError

MOST_PHOTOS = 500  # of a shard: Dask is made for up to 100 000 tasks
_MOST_BYTES = 150_000_000  # of a shard's photos, some 50 of a camera
_UNKNOWN_BYTES = 300_000  # of a photo of a list
_SHARDS_A_WORKER = 8  # at least, so that workers end at about the same time
_WINDOW = 2  # shards for each worker: one that it works on, one that waits
_MOST_DEATHS = 2  # workers that a photo alone may kill
_MOST_REFUSALS = 3  # a store may refuse for a moment; a full disk stays full
# Workers lost while a shard waited: one that kills its worker may go before it, again and again
# until its photo is alone, some 2 log2(500) times.
_MOST_LOSSES = 20


class Driver:
    """Works on the photos of an index that have no record yet, by the workers of a client."""

    def __init__(
        self,
        client: Client,
        spec: BatchSpec,
        index: PhotoIndex,
        workers: Callable[[], int],
        idle: Callable[[], None] = lambda: None,
    ) -> None:
        self._client, self._spec, self._index = client, spec, index
        self._workers, self._idle = workers, idle
        # Records of later runs come later by name.
        run = f"{datetime.now(UTC):%Y%m%dT%H%M%S%f}-{secrets.token_hex(3)}"
        self._keys = (f"{run}-{number:07d}" for number in count())
        self._again: deque[Shard] = deque()
        self._new = self._shards()
        self._is_ending = False  # whether all photos were handed out once

    def records(self) -> Iterator[PhotoRecord]:
        """What becomes of each photo, as it is known.

        Raises OutputError where outputs cannot be written, ClusterError where the scheduler is gone
        or a worker has other versions.
        """
        for shard, answer in answers(
            self._client, partial(work, self._spec), self._next, self._window, self._idle
        ):
            if isinstance(answer, ShardResult) and not answer.has_died:
                yield from answer.records
                self._hand_out(shard, _left(shard, answer.records), answer.refused)
            elif isinstance(answer, (ShardResult, KilledWorker)):
                record = ShardRecord(self._spec.store, shard.key)
                if not record.begun:  # its worker died at another, or before it
                    self._hand_back(shard)
                    continue
                photos = {photo.output for photo in shard.photos}
                known = [one for output, one in record.done.items() if output in photos]
                record.write()  # it is begun no more
                yield from known
                yield from self._isolate(shard, _left(shard, known))
            elif isinstance(answer, Gauss2SvgError):
                raise answer
            else:
                raise cannot_run("a worker", answer, self._spec) from answer

    def _next(self) -> Shard | None:
        if self._again:
            return self._again.popleft()
        shard = next(self._new, None)
        self._is_ending = shard is None
        return shard

    def _window(self) -> int:
        return _WINDOW * max(1, self._workers())

    def _shards(self) -> Iterator[Shard]:
        """The index in shards by number and size of photos; few photos in small ones."""
        workers = max(1, self._workers())
        most = min(MOST_PHOTOS, max(1, self._index.left // (workers * _SHARDS_A_WORKER)))
        photos: list[BatchPhoto] = []
        size = 0
        for photo, bytes_ in self._index.photos():
            photos.append(photo)
            size += _UNKNOWN_BYTES if bytes_ is None else bytes_
            if len(photos) >= most or size >= _MOST_BYTES:
                yield Shard(next(self._keys), tuple(photos))
                photos, size = [], 0
        if photos:
            yield Shard(next(self._keys), tuple(photos))

    def _hand_out(self, shard: Shard, left: tuple[BatchPhoto, ...], refused: str | None) -> None:
        """Have what a worker handed back worked on again."""
        refusals = shard.refusals + (refused is not None)
        if refused is not None and refusals >= _MOST_REFUSALS:
            raise OutputError(refused)
        if left and not self._is_ending:
            # A record that could not be written may still say that its shard is worked on.
            key = shard.key if refused is None else next(self._keys)
            self._again.append(dataclasses.replace(shard, key=key, photos=left, refusals=refusals))
        elif left:
            share = -(-len(left) // max(1, self._workers()))
            for at in range(0, len(left), share):
                photos = left[at : at + share]
                self._again.append(Shard(next(self._keys), photos, refusals=refusals))

    def _hand_back(self, shard: Shard) -> None:
        """Have a shard that was not begun worked on, unless workers die without beginning any."""
        if shard.losses >= _MOST_LOSSES:
            raise ClusterError(
                f"{shard.losses} workers died before they began. Try `dask worker` by hand"
            )
        self._again.append(dataclasses.replace(shard, losses=shard.losses + 1))

    def _isolate(self, shard: Shard, left: tuple[BatchPhoto, ...]) -> Iterator[PhotoRecord]:
        """Split a shard at which a worker died: most likely at the first photo without a record."""
        if len(shard.photos) == 1 and left:
            if shard.deaths + 1 < _MOST_DEATHS:
                again = dataclasses.replace(shard, key=next(self._keys), deaths=shard.deaths + 1)
                self._again.append(again)
                return
            yield self._killer(shard, left[0])
            return
        middle = 1 + len(left) // 2
        for photos in (left[:1], left[1:middle], left[middle:]):
            if photos:
                again = Shard(next(self._keys), photos, refusals=shard.refusals)
                self._again.append(again)

    def _killer(self, shard: Shard, photo: BatchPhoto) -> PhotoRecord:
        """The record of a photo at which workers died, written here as no worker can."""
        stamp = ""
        with suppress(InputError):  # what is not known here is worked on again by the next run
            stamp = stamp_of(photo.path)
        found = self._spec.record(
            photo,
            stamp=stamp,
            error_code=WORKER_DIED,
            error=f"{_MOST_DEATHS} workers died at it, alone; was there enough memory? "
            "Try --max-size or --retry-failed on workers with more",
        )
        record = ShardRecord(self._spec.store, shard.key)
        record.done[photo.output] = found
        record.write()
        return found


def _left(shard: Shard, records: Iterable[PhotoRecord]) -> tuple[BatchPhoto, ...]:
    done = {record.output for record in records}
    return tuple(photo for photo in shard.photos if photo.output not in done)
