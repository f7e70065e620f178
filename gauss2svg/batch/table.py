"""The end of a batch: one table of all photos, and a summary."""

from __future__ import annotations

import csv
import json
import os
import re
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from importlib.util import find_spec
from typing import Any, get_type_hints

from gauss2svg.batch.stores import PARTS, STATE, is_url, reached
from gauss2svg.batch.worker import PhotoRecord
from gauss2svg.errors import OutputError

TABLE, PARQUET = f"{STATE}/table.csv", f"{STATE}/table.parquet"
_MOST_REASONS = 1000  # of failures that are distinguished
_FORMULA = ("=", "+", "-", "@", "\t", "\r")  # by OWASP's page on CSV injection
_NAMED = 5  # failed photos, in the summary


class Summary:
    """What became of the photos so far.

    done, skipped  with an SVG, from now and from an earlier run; pixels: of the first
    failed         now and in earlier runs; earlier: of them those that were skipped
    """

    def __init__(self) -> None:
        self.done = self.skipped = self.failed = self.earlier = self.pixels = 0
        self._reasons: Counter[str] = Counter()
        self._named: list[str] = []
        self._begun = time.monotonic()
        self._first_s = 0.0  # when the first photo that is not skipped was done

    def add(self, record: PhotoRecord) -> None:
        """Count a photo; one that failed counts as failed also where it was skipped."""
        if not record.skipped and self.done + self.failed == self.earlier:
            self._first_s = self.seconds
        if record.error is None:
            self.done += not record.skipped
            self.skipped += record.skipped
            self.pixels += 0 if record.skipped else (record.width or 0) * (record.height or 0)
            return
        self.failed += 1
        self.earlier += record.skipped
        # An error without what is the photo's own: its name and numbers.
        text = record.error.replace(record.input, "photo")
        text = re.sub(r"[0-9]+", "N", text.replace(os.path.basename(record.input), "photo"))
        is_known = text in self._reasons or len(self._reasons) < _MOST_REASONS
        self._reasons[text if is_known else "other reasons"] += 1
        if len(self._named) < _NAMED:
            self._named.append(record.input)

    @property
    def total(self) -> int:
        """Number of photos so far."""
        return self.done + self.failed + self.skipped

    @property
    def seconds(self) -> float:
        """Seconds since the summary was made."""
        return time.monotonic() - self._begun

    def state(self, count: int) -> str:
        """Return photos a second since the first, failures and time left, of so many photos."""
        worked = self.done + self.failed - self.earlier
        rate = max(worked - 1, 0) / max(self.seconds - self._first_s, 0.2)
        left_s = (count - self.total) / rate if rate else 0.0
        hours, minutes = divmod(round(left_s / 60), 60)
        time_left = f"{hours} h {minutes} min" if hours else f"{minutes} min"
        time_left = time_left if left_s >= 90 else f"{left_s:.0f} s"
        return f"{rate:.3g} photos/s, {self.failures}, {time_left} left"

    @property
    def failures(self) -> str:
        """How many failed, and how many of them in an earlier run."""
        now = f"{self.failed - self.earlier:,} failed"
        return f"{now}, {self.earlier:,} failed earlier" if self.earlier else now

    def lines(self) -> Iterator[str]:
        """Yield the summary for a terminal."""
        rate, pixels = self.done / self.seconds, self.pixels / self.seconds / 1e6
        yield (
            f"{self.done:,} done, {self.skipped:,} skipped, {self.failures} in "
            f"{self.seconds:.1f} s: {rate:.3g} photos and {pixels:.3g} megapixels a second"
        )
        if self.earlier:
            yield "what failed earlier was skipped: --retry-failed takes it up"
        for reason, count in self._reasons.most_common(10):
            yield f"failed, {count:,}: {reason}"
        if self._named:
            others = self.failed - len(self._named)
            more = f" and {others:,} more" if others else ""
            yield f"failed photos: {', '.join(self._named)}{more}"


def as_cell(value: Any) -> Any:
    """Return a value for a CSV: text that a spreadsheet would calculate begins with a '."""
    if not isinstance(value, str):
        return value
    # Names of files need not be Unicode.
    text = value if value.isascii() else value.encode(errors="backslashreplace").decode()
    return f"'{text}" if text.startswith(_FORMULA) else text


def write_table(root: str, records: Iterable[PhotoRecord]) -> list[str]:
    """Write what became of all photos as CSV, and as Parquet with pyarrow; return the paths."""
    parts = None if is_url(root) else f"{root}/{PARTS}"
    with (
        reached(f"{root}/{TABLE}", "write", OutputError) as (fs, _),
        tempfile.TemporaryDirectory(dir=parts) as folder,
    ):
        with open(f"{folder}/table.csv", "w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(PhotoRecord._fields)
            for record in records:
                texts = "; ".join(record.unreached), json.dumps(record.versions)
                row = record._replace(unreached=texts[0], versions=texts[1])
                writer.writerow(map(as_cell, row))
        if find_spec("pyarrow") is not None:  # an extra
            _write_parquet(f"{folder}/table.csv", f"{folder}/table.parquet")
        for name in (names := sorted(os.listdir(folder))):
            fs.put_file(f"{folder}/{name}", f"{root}/{STATE}/{name}")
    return [f"{root}/{STATE}/{name}" for name in names]


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
