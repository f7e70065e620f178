"""Records of what became of each photo, and the photos of a batch.

Records are lines of JSON, in one file for each shard. Photos are in a temporary database on the
disk: a million in little memory.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sqlite3
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from importlib.metadata import version
from typing import Annotated, Any

import msgspec
from msgspec.structs import asdict, replace

from gauss2svg.batch.inputs import Source
from gauss2svg.batch.stores import STATE, Store, is_contained, is_url, stamp_of
from gauss2svg.errors import InputError, OutputError
from gauss2svg.pipeline.options import NOT_OF_PICTURE, Options
from gauss2svg.version import __version__

FOLDER = f"{STATE}/folder"  # tells this output folder from another of its name on other machines
RECORDS = f"{STATE}/records"
_WORKING = {"working": True}  # the last line of a shard that is worked on, or whose worker died
WORKER_DIED = "WorkerDied"  # the code of a photo at which workers died, who raise nothing
_SHARE = 0.05  # of a worker's time, for writing records
# The option that changes neither a picture nor whether there is one.
NOT_OF_LIMITS = frozenset({"threads"})
_Whole = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]  # as a table holds it


class PhotoRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What became of a photo.

    input                 path or URL of the photo
    output                name of the SVG, relative to the output folder
    options               identity of the version and the options, of `options-*.json`
    limits                of a failure: identity of all options, of which some may have made it fail
    stamp                 what the file system or the store says of the photo, such as size and date
    sha256                of the photo's bytes
    width, height         px of the photo
    gaussians, bytes      of the SVG
    psnr_svg              dB, None where it is infinite
    seconds, cpu_seconds  that the photo took, of the clock and of its worker's cores
    error                 why there is no SVG, one line; None where it is written
    unreached             targets that were missed
    versions              of gauss2svg, numba, NumPy and Python
    ssim_svg              -1..1
    paint_ms              estimate of what a browser takes to paint it
    stop_reason           why the fit ended, as in the report
    time                  at which it was done, ISO 8601 in UTC
    error_code            class of the error, such as InputError, or WorkerDied; None without
    skipped               True where an earlier run wrote it, or failed at it
    """

    input: str
    output: str
    options: str
    limits: str = ""
    stamp: str = ""
    sha256: str = ""
    width: _Whole | None = None
    height: _Whole | None = None
    gaussians: _Whole | None = None
    psnr_svg: float | None = None
    bytes: _Whole | None = None
    seconds: float | None = None
    error: str | None = None
    unreached: list[str] = []
    versions: dict[str, str] = {}
    ssim_svg: float | None = None
    paint_ms: float | None = None
    stop_reason: str | None = None
    time: str = ""
    cpu_seconds: float | None = None
    error_code: str | None = None
    skipped: bool = False

    @property
    def pixels(self) -> int:
        """Pixels of the photo; 0 where it was not read."""
        return (self.width or 0) * (self.height or 0)

    def line(self) -> dict[str, Any]:
        """The photo's line in a record; `skipped` is of a run and not of the photo."""
        found = msgspec.structs.asdict(self)
        del found["skipped"]
        return found


_LINES = msgspec.json.Decoder(PhotoRecord)


def record_of(line: str | bytes) -> PhotoRecord | None:
    """The record in a line of JSON; None for any other line, such as one that was cut."""
    try:
        return _LINES.decode(line)
    except (msgspec.DecodeError, RecursionError):
        pass
    try:  # names that are no valid Unicode are valid in Python's JSON alone
        return msgspec.convert(json.loads(line), PhotoRecord)
    except (msgspec.ValidationError, ValueError, RecursionError):
        return None


def versions() -> dict[str, str]:
    """The versions that workers and driver must share."""
    names = ("numba", "numpy")
    return {"gauss2svg": __version__} | {name: version(name) for name in names}


def identity_of(options: Options, without: frozenset[str] = NOT_OF_PICTURE) -> str:
    """A hash of the version and of the options but some: of all that a file depends on."""
    given = {k: v for k, v in options.flat().items() if k not in without}
    text = json.dumps([__version__, given], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


class ShardRecord:
    """The record of a shard, written whole every time, seldom enough to cost little.

    done    what became of its photos so far, by output
    begun   whether a worker has begun it and neither ended nor handed it back: it died
    A shard of photos that are all skipped leaves none.
    """

    def __init__(self, store: Store, key: str) -> None:
        self._store, self._name = store, f"{RECORDS}/{key}.jsonl"
        self._last = self._cost = 0.0
        lines = (store.read(self._name) or b"").splitlines()
        found = [record for line in lines if (record := record_of(line)) is not None]
        self.done = {record.output: record for record in found}
        self.begun = bool(lines) and lines[-1] == json.dumps(_WORKING).encode()

    def begin(self) -> None:
        """Say, where that is not known yet, that a worker has begun what it may die at."""
        if not self.begun:
            self.write(working=True)

    def end(self) -> None:
        """Say that the shard has ended, or that its other photos are handed back."""
        if self.begun:
            self.write()

    def add(self, record: PhotoRecord) -> None:
        """Add what became of a photo; it is written now or with a later one."""
        self.done[record.output] = record
        self.begun = True
        if time.monotonic() - self._last > self._cost / _SHARE:
            self.write(working=True)

    def write(self, working: bool = False) -> None:
        """Write the record of the shard; working: whether more is to come."""
        begun = time.monotonic()
        lines = [record.line() for record in self.done.values()]
        lines += [_WORKING] if working else []
        text = "".join(f"{json.dumps(line)}\n" for line in lines)
        self._store.write(self._name, text.encode())
        self.begun = working
        self._last = time.monotonic()
        self._cost = self._last - begun


class BatchPhoto(msgspec.Struct, frozen=True):
    """A photo of a batch: its path or URL, its output's name, and what an earlier run recorded."""

    path: str
    output: str
    prior: PhotoRecord | None = None


@dataclass(frozen=True)
class BatchSpec:
    """What all photos share.

    versions  that workers must have too
    identity  of the options; folder: content of FOLDER, by which workers know the output folder
    """

    options: Options
    store: Store
    versions: dict[str, str]
    identity: str
    folder: bytes | None = None
    retry_failed: bool = False

    @cached_property
    def limits(self) -> str:
        """Identity of all options that a failure depends on."""
        return identity_of(self.options, NOT_OF_LIMITS)

    def record(self, photo: BatchPhoto, **found: Any) -> PhotoRecord:
        """The record of a photo that was worked on until now, with what became of it."""
        return PhotoRecord(
            input=photo.path,
            output=photo.output,
            options=self.identity,
            limits=self.limits if "error" in found else "",
            versions=self.versions | {"python": platform.python_version()},
            time=datetime.now(UTC).isoformat(timespec="seconds"),
            **found,
        )


def kept(spec: BatchSpec, photo: BatchPhoto, stamp: str, digest: str = "") -> PhotoRecord | None:
    """The earlier record of a photo, where the photo would become the same again; else None.

    stamp  of its file now; digest: SHA-256 of its bytes, which tells where the stamp does not
    The record must be of the same options and its output there. One of a failure must be of the
    same limits too, and is not kept where failures are taken up.
    """
    prior = photo.prior
    if prior is None or prior.options != spec.identity:
        return None
    is_named = prior.input == photo.path
    is_same = digest == prior.sha256 if digest else is_named and stamp == prior.stamp != ""
    if not is_same:
        return None
    if prior.error is not None:
        holds = is_named and prior.limits == spec.limits and not spec.retry_failed
    else:
        holds = spec.store.size(photo.output) == prior.bytes is not None
    if not holds:
        return None
    return msgspec.structs.replace(prior, input=photo.path, stamp=stamp, skipped=True)


def unchanged(spec: BatchSpec, photo: BatchPhoto) -> PhotoRecord | None:
    """The earlier record of a photo of this machine that holds by its stamp, unread; else None.

    A worker decides about all others, and where the photo or its output cannot be looked at.
    """
    if photo.prior is None or is_url(photo.path) or not spec.store.is_local:
        return None
    try:
        return kept(spec, photo, stamp_of(photo.path))
    except (InputError, OutputError):
        return None


_TABLES = """
CREATE TABLE photo (
    key BLOB PRIMARY KEY, path BLOB, output BLOB, size INTEGER, prior BLOB
) WITHOUT ROWID;
CREATE TABLE record (key BLOB PRIMARY KEY, line TEXT) WITHOUT ROWID;
"""
_LEFT = "WHERE key NOT IN (SELECT key FROM record)"


@contextmanager
def _on_disk() -> Iterator[None]:
    try:
        yield
    except sqlite3.OperationalError as error:
        raise OutputError(
            f"cannot write the index of the photos: {error}. Try TMPDIR=/a/larger/disk"
        ) from error


class PhotoIndex:
    """The photos by their outputs, what earlier runs made of them, and what this one did.

    folds_case  whether outputs that differ by case alone are one file
    All methods raise OutputError where the disk is full.
    """

    def __init__(self, folds_case: bool = False) -> None:
        self._folds_case = folds_case
        self.count = 0
        with _on_disk():
            # The empty name is that of a database which sqlite itself deletes.
            self._base = sqlite3.connect("", check_same_thread=False, isolation_level=None)
            # KiB: little beside a worker; pages of the index beyond it are on the disk.
            self._base.execute("PRAGMA cache_size = -16384")
            self._base.execute("PRAGMA journal_mode = OFF")
            self._base.executescript(_TABLES)
            self._base.execute("BEGIN")  # for ever: nobody else reads it, and a commit writes

    def close(self) -> None:
        """Delete the index."""
        self._base.close()

    def _key(self, output: str) -> bytes:
        return _bytes(output.casefold() if self._folds_case else output)

    @_on_disk()
    def add(self, sources: Iterable[Source], suffix: str) -> None:
        """Add photos; a photo counts once.

        Raises InputError for two that would write one file, and for an output that would not be in
        the output folder or would be among the records.
        """
        insert = "INSERT OR IGNORE INTO photo (key, path, output, size) VALUES (?, ?, ?, ?)"
        state = self._key(STATE)
        for path, name, size in sources:
            output = name + suffix
            first, slash, _ = name.partition("/")
            if not is_contained(name) or (slash and self._key(first) == state):
                raise InputError(
                    f"output must be in the output folder and outside of its {STATE}; got "
                    f"{output}, of {path}. Try another glob or folder"
                )
            if not is_url(path):  # workers may have another current folder
                path = os.path.abspath(path)
            row = (self._key(output), _bytes(path), _bytes(output), size)
            if self._base.execute(insert, row).rowcount:
                self.count += 1
                continue
            ((other,),) = self._rows("SELECT path FROM photo WHERE key = ?", row[:1])
            if other != row[1]:
                raise InputError(
                    f"photos must have outputs of their own; got {_text(other)} and {path}, which "
                    f"would both write {output}. Try other names, or a run for each with an output "
                    "folder of its own"
                )

    @_on_disk()
    def add_prior(self, lines: Iterable[bytes]) -> None:
        """Add lines of earlier runs' records, oldest first."""
        records = ((line, record_of(line)) for line in lines)
        rows = ((line, self._key(one.output)) for line, one in records if one is not None)
        self._base.executemany("UPDATE photo SET prior = ? WHERE key = ?", rows)

    @_on_disk()
    def add_record(self, record: PhotoRecord) -> None:
        """Add what became of a photo."""
        row = (self._key(record.output), json.dumps(asdict(record)))
        self._base.execute("INSERT OR REPLACE INTO record VALUES (?, ?)", row)

    @_on_disk()
    def keep(self, outputs: Iterable[str]) -> None:
        """Add that photos are as an earlier run left them."""
        rows = ((self._key(output),) for output in outputs)
        self._base.executemany("INSERT INTO record (key) VALUES (?)", rows)

    @property
    def left(self) -> int:
        """Number of photos of which it is not known yet what becomes of them."""
        ((known,),) = self._rows("SELECT count(*) FROM record")
        return self.count - known

    def photos(self, known: bool = False) -> Iterator[tuple[BatchPhoto, int | None]]:
        """(photo, its bytes if known) of every photo that is left, by output.

        known  of those alone that have an earlier record
        """
        where = f"{_LEFT} AND prior IS NOT NULL" if known else _LEFT
        select = f"SELECT path, output, size, prior FROM photo {where} ORDER BY key"
        for path, output, size, prior in self._rows(select):
            earlier = None if prior is None else record_of(prior)
            yield BatchPhoto(_text(path), _text(output), earlier), size

    def records(self) -> Iterator[PhotoRecord]:
        """What became of every photo, by output."""
        # Without a line of its own a record is the earlier one.
        select = "SELECT line, prior FROM record LEFT JOIN photo USING (key) ORDER BY record.key"
        for line, prior in self._rows(select):
            record = record_of(prior if line is None else line)
            assert record is not None
            yield replace(record, skipped=True) if line is None else record

    def largest(self, most: int) -> list[str]:
        """The paths of the largest files that are left; of the first where no size is known."""
        select = f"SELECT path FROM photo {_LEFT} ORDER BY size DESC LIMIT ?"
        return [_text(path) for (path,) in self._rows(select, (most,))]

    def _rows(self, select: str, values: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
        with _on_disk():
            rows = self._base.execute(select, values)
            yield from iter(rows.fetchone, None)  # of the cursor itself it would close that


def _bytes(text: str) -> bytes:
    """Any file name, which may be no valid Unicode."""
    return text.encode(errors="surrogateescape")


def _text(data: bytes) -> str:
    return data.decode(errors="surrogateescape")
