"""Records as rows: a file of one JSON object per line, and CSV."""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from gauss2svg.errors import OutputError
from gauss2svg.files import as_cell, write_atomically

Row = dict[str, Any]
TOOL = "gauss2svg"  # the tool of all rows that are not a peer's


class RowStore:
    """Rows by key, in a file of one JSON object per line.

    A last line that a kill truncated is dropped, as are lines that are not rows. Of two rows with
    one key the later counts. Raises OutputError if the file cannot be read or written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._rows: dict[str, Row] = {}
        try:
            data = path.read_bytes() if path.exists() else b""
        except OSError as error:
            raise OutputError(f"cannot read {path}: {error.strerror or error}") from error
        whole = data[: data.rfind(b"\n") + 1]
        for line in whole.splitlines():
            row = _row(line)
            if row is not None:
                self._rows[row["key"]] = row
        if whole != data:
            write_atomically(path, whole)

    def finished(self, key: str) -> Row | None:
        """The row with this key and without error; None if there is none."""
        row = self._rows.get(key)
        return None if row is None or "error" in row else row

    def append(self, row: Row) -> None:
        """Add a row and flush it to the disk."""
        line = json.dumps(row, allow_nan=False) + "\n"
        try:
            with self._path.open("ab") as stream:
                stream.write(line.encode())
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise OutputError(f"cannot write {self._path}: {error.strerror or error}") from error
        self._rows[row["key"]] = row


# A row without these is damaged, and is measured again.
_REQUIRED = {"key", "label", "tool", "tool_version", "image", "settings", "machine"}


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
    flattened = [flat(row) for row in rows]
    columns = list(dict.fromkeys(name for row in flattened for name in row))
    stream = io.StringIO()
    writer = csv.DictWriter(stream, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: as_cell(value) for name, value in row.items()} for row in flattened)
    return stream.getvalue()


def one_line(text: str) -> str:
    """Text on one line, truncated to 400 characters."""
    return " ".join(text.split())[:400]


def finite(value: Any) -> Any:
    """The value with None for every infinity and NaN, which JSON does not have."""
    if isinstance(value, dict):
        return {name: finite(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
