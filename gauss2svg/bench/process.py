"""A run in a process of its own, and what is known of one that fails.

Not a worker of `batch`: Dask's own memory would count as the run's (docs/decisions/batch.md).
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from typing import IO, Any

from gauss2svg.bench.rows import Row, one_line
from gauss2svg.processes import end_of, end_tree, own_group


def in_own_process(request: Mapping[str, Any], timeout: float | None) -> Row:
    """The worker's row; one with "error" if it dies or takes more than timeout seconds."""
    # -P: the current folder is not on the module path.
    command = [sys.executable, "-P", "-m", "gauss2svg.bench.worker"]
    with (
        tempfile.TemporaryFile() as stdout,
        tempfile.TemporaryFile() as stderr,
        # Processes that a peer starts are killed with it.
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=stdout, stderr=stderr, **own_group()
        ) as process,
    ):
        assert process.stdin is not None
        try:
            with suppress(BrokenPipeError):  # it is dead, which its status tells
                process.stdin.write(json.dumps(request).encode() + b"\n")
                process.stdin.flush()
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


def last_line(stream: IO[bytes]) -> str:
    """The last line that a process wrote to this file."""
    stream.seek(0)
    lines = stream.read()[-4000:].decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else "no message"
