"""A run in a process of its own, and what is known of one that fails.

Not a worker of `batch`: Dask's own memory would count as the run's (docs/decisions/batch.md).
"""

from __future__ import annotations

import errno
import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from typing import IO, Any

from gauss2svg.compare.records import Row, one_line
from gauss2svg.processes import end_of, end_tree, own_group


def in_own_process(request: Mapping[str, Any], timeout: float | None) -> Row:
    """The worker's row; one with "error" if it dies or takes more than timeout seconds."""
    # -P: the current folder is not on the module path.
    command = [sys.executable, "-P", "-m", "gauss2svg.compare.worker"]
    with (
        tempfile.TemporaryFile() as stdout,
        tempfile.TemporaryFile() as stderr,
        # Without a buffer: what one could not write it would try again as it is closed, and raise.
        # Processes that a peer starts are killed with it.
        subprocess.Popen(
            command, 0, stdin=subprocess.PIPE, stdout=stdout, stderr=stderr, **own_group()
        ) as process,
    ):
        assert process.stdin is not None
        try:
            _send(process.stdin, json.dumps(request).encode() + b"\n")
            # Its input stays open: where that ends, its parent is gone.
            process.wait(timeout)
        except subprocess.TimeoutExpired:
            end_tree(process.pid)
            return {"error": f"timed out after {timeout:g} s. Try a longer --peer-timeout"}
        except BaseException:
            end_tree(process.pid)
            raise
        if process.returncode == 0:
            stdout.seek(0)
            return json.load(stdout)
        return {"error": one_line(f"{end_of(process.returncode)}: {last_line(stderr)}")}


def _send(stream: IO[bytes], data: bytes) -> None:
    """Write all to a process, which may be dead already: its status tells that."""
    rest = memoryview(data)
    try:
        while rest:
            rest = rest[stream.write(rest) :]
    except OSError as error:
        if error.errno not in (errno.EPIPE, errno.EINVAL):  # the second is that of Windows
            raise


def last_line(stream: IO[bytes]) -> str:
    """The last line that a process wrote to this file."""
    stream.seek(0)
    lines = stream.read()[-4000:].decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else "no message"
