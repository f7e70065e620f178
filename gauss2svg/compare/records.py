"""Records of runs: what a worker answers, and rows as one JSON object per line and as CSV."""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from gauss2svg.errors import Gauss2SvgError, OutputError, error_line

Row = dict[str, Any]
TOOL = "gauss2svg"  # the tool of all rows that are not a peer's


def answered(
    make: Callable[[Mapping[str, Any]], dict[str, Any]], request: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the record, or {"error": one line}, so that a request that fails stops no other.

    It has "fatal" where no other request can succeed, as with a full disk.
    """
    try:
        return make(request)
    except OutputError as error:
        return {"error": error_line(str(error)), "fatal": True}
    except Gauss2SvgError as error:
        return {"error": error_line(str(error))}
    except MemoryError as error:
        return {"error": f"out of memory ({error}). Try smaller photos or fewer Gaussians"}
    except Exception as error:  # a peer may raise anything; a bug of ours is shown with its type
        return {"error": error_line(f"{type(error).__name__}: {error}")}


def rows_in(path: Path) -> dict[str, Row]:
    """Return the last row of each folder, or else key, in a file of JSON lines.

    Damaged lines are left out.
    Raise OutputError if the file cannot be read.
    """
    rows: dict[str, Row] = {}
    try:
        lines = path.read_bytes().splitlines() if path.exists() else []
    except OSError as error:
        raise OutputError(f"cannot read {path}: {error.strerror or error}") from error
    for line in lines:
        with suppress(ValueError, TypeError, KeyError, AttributeError):
            row = json.loads(line)
            rows[row.get("folder", row["key"])] = row
    return rows


def add_row(path: Path, row: Row) -> None:
    """Append a row to such a file, and flush it to the disk; raise OutputError if that fails."""
    try:
        with path.open("a+b") as stream:
            if stream.tell():
                stream.seek(-1, os.SEEK_END)  # an interruption may have left half a line
                stream.write(b"" if stream.read(1) == b"\n" else b"\n")
            stream.write(json.dumps(row, allow_nan=False).encode() + b"\n")
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error


def flat(row: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Join nested names by dots: {"a": {"b": 1}} is {"a.b": 1}."""
    cells: dict[str, Any] = {}
    for name, value in row.items():
        cells |= (
            flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
        )
    return cells


def csv_text(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return CSV with a column for every name in any row; null is an empty cell."""
    from gauss2svg.batch.table import as_cell  # what it loads would count as a peer's memory

    flattened = [flat(row) for row in rows]
    columns = list(dict.fromkeys(name for row in flattened for name in row))
    stream = io.StringIO()
    writer = csv.DictWriter(stream, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: as_cell(value) for name, value in row.items()} for row in flattened)
    return stream.getvalue()


def finite(value: Any) -> Any:
    """Return the value with None for every infinity and NaN, which JSON does not have."""
    if isinstance(value, dict):
        return {name: finite(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
