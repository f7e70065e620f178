"""Write the table of all photos of a batch, and count photos for the printed summary."""

from __future__ import annotations

import csv
import os
import tempfile
import time
from collections.abc import Iterable, Iterator
from datetime import timedelta
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_type_hints

from gauss2svg.batch.stores import PARTS, STATE, file_system_of, is_url
from gauss2svg.batch.worker import PhotoRecord
from gauss2svg.errors import OutputError

TABLE, PARQUET = f"{STATE}/table.csv", f"{STATE}/table.parquet"
# Characters with which a formula in a spreadsheet begins. Source: OWASP, "CSV Injection".
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


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
            self._failures.append(f"failed: {record.input}: {record.error}")

    def progress_text(self, count: int) -> str:
        """Return text with the speed, failures and remaining time of a batch of `count` photos."""
        rate = (self.done + self.failed) / self._seconds
        left = timedelta(seconds=round((count - self.total) / rate)) if rate else "unknown time"
        return f"{rate:.3g} photos/s, {self.failed:,} failed, {left} left"

    @property
    def _seconds(self) -> float:
        # The clock may not have moved yet, and a speed is divided by this number.
        return max(time.monotonic() - self._begun, 1e-3)

    def lines(self) -> Iterator[str]:
        """Yield the lines of the final summary."""
        seconds = self._seconds
        counts = f"{self.done:,} done, {self.skipped:,} skipped, {self.failed:,} failed"
        yield f"{counts} in {seconds:.1f} s: {self.done / seconds:.3g} photos a second"
        yield from self._failures


def as_cell(value: Any) -> Any:
    """Return a value as a CSV cell.

    An apostrophe is put before text that begins like a formula, so that no spreadsheet runs it.
    """
    if not isinstance(value, str):
        return value
    # A file name may have bytes that are not valid Unicode. They are escaped.
    text = value if value.isascii() else value.encode(errors="backslashreplace").decode()
    return f"'{text}" if text.startswith(_FORMULA) else text


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
    import pyarrow as pa
    from pyarrow import csv as reader
    from pyarrow.parquet import ParquetWriter

    kinds = {int | None: pa.int64(), float | None: pa.float64(), bool: pa.bool_()}
    types = {k: kinds.get(v, pa.string()) for k, v in get_type_hints(PhotoRecord).items()}
    lines = reader.ParseOptions(newlines_in_values=True)
    options = reader.ConvertOptions(column_types=types)
    rows = reader.open_csv(table, parse_options=lines, convert_options=options)
    with ParquetWriter(path, rows.schema) as writer:
        for batch in rows:
            writer.write_batch(batch)
