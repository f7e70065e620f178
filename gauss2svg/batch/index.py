"""The photos of a batch in a temporary database on the disk: a million in little memory."""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from msgspec.structs import asdict, replace

from gauss2svg.batch.inputs import Source
from gauss2svg.batch.records import BatchPhoto, PhotoRecord, record_of
from gauss2svg.batch.stores import STATE, is_contained, is_url
from gauss2svg.errors import InputError, OutputError

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
