"""The end of a batch: one table of all photos, and a summary."""

from __future__ import annotations

import csv
import json
import os
import re
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

from msgspec.structs import astuple

from gauss2svg.batch.records import PhotoIndex, PhotoRecord
from gauss2svg.batch.stores import PARTS, STATE, Store, reason_of
from gauss2svg.errors import OutputError

TABLE, PARQUET = f"{STATE}/table.csv", f"{STATE}/table.parquet"
_COLUMNS = PhotoRecord.__struct_fields__
_MOST_REASONS = 1000  # of failures that are distinguished
_FORMULA = ("=", "+", "-", "@", "\t", "\r")  # by OWASP's page on CSV injection
_NAMED = 5  # failed photos, in the summary


class Summary:
    """What became of the photos so far: done, skipped, failed by reason; pixels; seconds.

    failed  now and in earlier runs; earlier: of them those that were skipped
    named   the first photos that failed
    """

    def __init__(self) -> None:
        self.done = self.skipped = self.failed = self.earlier = self.pixels = 0
        self.reasons: Counter[str] = Counter()
        self.named: list[str] = []
        self._begun = time.monotonic()
        self._first_s = 0.0  # when the first photo that is not skipped was done

    def add(self, record: PhotoRecord) -> None:
        """Count a photo; one that failed counts as failed also where it was skipped."""
        if not (self.worked or record.skipped):
            self._first_s = self.seconds
        if record.error is not None:
            self.failed += 1
            self.earlier += record.skipped
            reason = kind_of_failure(record)
            known = reason in self.reasons or len(self.reasons) < _MOST_REASONS
            self.reasons[reason if known else "other reasons"] += 1
            if len(self.named) < _NAMED:
                self.named.append(record.input)
        elif record.skipped:
            self.skipped += 1
        else:
            self.done += 1
            self.pixels += record.pixels

    @property
    def worked(self) -> int:
        """Number of photos so far that are not skipped."""
        return self.done + self.failed - self.earlier

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
        rate = (self.worked - 1) / max(self.seconds - self._first_s, 0.2) if self.worked else 0.0
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
        """The summary for a terminal."""
        rate = self.done / self.seconds
        pixels = self.pixels / self.seconds / 1e6
        yield (
            f"{self.done:,} done, {self.skipped:,} skipped, {self.failures} in "
            f"{self.seconds:.1f} s: {rate:.3g} photos and {pixels:.3g} megapixels a second"
        )
        if self.earlier:
            yield "what failed earlier was skipped: --retry-failed takes it up"
        for reason, count in self.reasons.most_common(10):
            yield f"failed, {count:,}: {reason}"
        if self.named:
            others = self.failed - len(self.named)
            more = f" and {others:,} more" if others else ""
            yield f"failed photos: {', '.join(self.named)}{more}"


def as_cell(value: Any) -> Any:
    """A value for a CSV: text that a spreadsheet would calculate, such as =1+1, begins with a '."""
    return f"'{value}" if isinstance(value, str) and value.startswith(_FORMULA) else value


def kind_of_failure(record: PhotoRecord) -> str:
    """An error without what is the photo's own: its name and numbers."""
    text = record.error or ""
    for name in (record.input, os.path.basename(record.input)):
        text = text.replace(name, "photo")
    return re.sub(r"[0-9]+", "N", text)


def write_table(store: Store, index: PhotoIndex) -> list[str]:
    """Write what became of all photos as CSV, and as Parquet with pyarrow; returns the names."""
    tables: dict[str, Any] = {TABLE: _csv}
    with suppress(ImportError):
        import pyarrow  # noqa: F401 (an extra, whose absence leaves the CSV)

        tables[PARQUET] = _parquet
    rows = map(_row, index.records())
    with ExitStack() as stack:
        adders = [stack.enter_context(_made(store, *table)) for table in tables.items()]
        while block := list(islice(rows, 10_000)):  # that are held at once
            for add in adders:
                add(block)
    return list(tables)


@contextmanager
def _made(store: Store, name: str, make: Any) -> Iterator[Any]:
    """Make a file on this machine, beside the outputs where they are here, and move it there."""
    folder = store.path(PARTS) if store.is_local else None
    path = ""
    try:
        descriptor, path = tempfile.mkstemp(dir=folder)
        os.close(descriptor)
        with make(Path(path)) as add:
            yield add
        os.chmod(path, 0o666 & ~_umask())
        store.adopt(Path(path), name)
    except OutputError:
        raise
    except (OSError, ValueError) as error:  # pyarrow's are both
        why = f"{reason_of(error)}. Try the same command again"
        raise OutputError(f"cannot write {store.path(name)}: {why}") from error
    finally:
        with suppress(FileNotFoundError):
            os.unlink(path)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


@contextmanager
def _csv(path: Path) -> Iterator[Any]:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)  # whose own line ends have names with either character quoted
        writer.writerow(_COLUMNS)
        yield lambda rows: writer.writerows(map(as_cell, row) for row in rows)


def _row(record: PhotoRecord) -> list[Any]:
    written = {
        "unreached": "; ".join(record.unreached),
        "versions": _json(tuple(record.versions.items())),
    }
    row = [written.get(name, value) for name, value in zip(_COLUMNS, astuple(record), strict=True)]
    # Names of files need not be Unicode.
    return [
        one.encode(errors="backslashreplace").decode() if isinstance(one, str) else one
        for one in row
    ]


@lru_cache  # of all photos of a run they are the same
def _json(items: tuple[tuple[str, str], ...]) -> str:
    return json.dumps(dict(items))


@contextmanager
def _parquet(path: Path) -> Iterator[Any]:
    import pyarrow as pa
    from pyarrow import parquet

    kinds = {
        "width": pa.int32(), "height": pa.int32(), "gaussians": pa.int32(), "bytes": pa.int64(),
        "psnr_svg": pa.float64(), "ssim_svg": pa.float64(), "paint_ms": pa.float64(),
        "seconds": pa.float64(), "cpu_seconds": pa.float64(), "skipped": pa.bool_(),
    }  # fmt: skip
    schema = pa.schema([(name, kinds.get(name, pa.string())) for name in _COLUMNS])
    with parquet.ParquetWriter(path, schema) as writer:

        def add(rows: list[Any]) -> None:
            arrays = list(map(pa.array, zip(*rows, strict=True), schema.types))
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))

        yield add
