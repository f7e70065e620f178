"""Records of runs: what a worker answers, and rows as one JSON object per line and as CSV."""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from gauss2svg.errors import Gauss2SvgError, OutputError, error_line

Row = dict[str, Any]
TOOL = "gauss2svg"  # the tool of all rows that are not a peer's

# A row without these is damaged, and is measured again.
_REQUIRED = {"key", "label", "tool", "tool_version", "image", "settings", "machine"}


def answered(
    make: Callable[[Mapping[str, Any]], dict[str, Any]], request: Mapping[str, Any]
) -> dict[str, Any]:
    """The record, or {"error": one line}, so that a request that fails stops no other.

    With "fatal" where no other request can succeed.
    """
    try:
        return make(request)
    except OutputError as error:  # of the others as well: a full disk, a deleted folder
        return {"error": error_line(str(error)), "fatal": True}
    except Gauss2SvgError as error:
        return {"error": error_line(str(error))}
    except MemoryError as error:
        return {"error": f"out of memory ({error}). Try smaller photos or fewer Gaussians"}
    except Exception as error:  # a peer may raise anything; a bug of ours is shown with its type
        return {"error": error_line(f"{type(error).__name__}: {error}")}


def rows_in(path: Path) -> dict[str, Row]:
    """Rows by key, of a file of one JSON object per line; lines that are no rows are left out.

    Raises OutputError if the file cannot be read.
    """
    try:
        lines = path.read_bytes().splitlines() if path.exists() else []
    except OSError as error:
        raise OutputError(f"cannot read {path}: {error.strerror or error}") from error
    return {row["key"]: row for line in lines if (row := _row(line)) is not None}


def add_row(path: Path, row: Row) -> None:
    """Append a row to such a file, and flush it to the disk; raises OutputError if that fails."""
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


def _row(line: bytes) -> Row | None:
    try:
        row = json.loads(line)
    except ValueError:
        return None
    return row if isinstance(row, dict) and row.keys() >= _REQUIRED else None


def flat(row: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested names joined by dots: {"a": {"b": 1}} is {"a.b": 1}."""
    found: dict[str, Any] = {}
    for name, value in row.items():
        found |= (
            flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
        )
    return found


def csv_text(rows: Iterable[Mapping[str, Any]]) -> str:
    """CSV with a column for every name in any row; null is an empty cell."""
    from gauss2svg.batch.table import as_cell  # what it loads would count as a peer's memory

    flattened = [flat(row) for row in rows]
    columns = list(dict.fromkeys(name for row in flattened for name in row))
    stream = io.StringIO()
    writer = csv.DictWriter(stream, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: as_cell(value) for name, value in row.items()} for row in flattened)
    return stream.getvalue()


def finite(value: Any) -> Any:
    """The value with None for every infinity and NaN, which JSON does not have."""
    if isinstance(value, dict):
        return {name: finite(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
