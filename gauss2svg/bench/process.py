"""A run in a process of its own, and what is known of one that fails.

Not a worker of `batch`: Dask's own memory would count as the run's (docs/decisions/batch.md).
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from typing import IO, Any

from gauss2svg.bench.rows import Row, one_line


def in_own_process(request: Mapping[str, Any], timeout: float | None) -> Row:
    """The worker's row; one with "error" if it dies or takes more than timeout seconds."""
    # -P: the current folder is not on the module path.
    command = [sys.executable, "-P", "-m", "gauss2svg.bench.worker"]
    with ExitStack() as stack:
        stderr = stack.enter_context(tempfile.TemporaryFile())
        process = stack.enter_context(
            # In a new session, so that processes that a peer starts are killed with it.
            subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=stderr,
                start_new_session=True,
            )
        )
        try:
            answer, _ = process.communicate(json.dumps(request).encode(), timeout)
        except subprocess.TimeoutExpired:
            _kill(process)
            return {"error": f"timed out after {timeout:g} s. Try a longer --peer-timeout"}
        except BaseException:
            _kill(process)
            raise
        if process.returncode == 0:
            return json.loads(answer)
        return {"error": one_line(f"{end_of(process.returncode)}: {last_line(stderr)}")}


def _kill(process: subprocess.Popen[bytes]) -> None:
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except (AttributeError, ProcessLookupError):  # Windows; or gone already
        process.kill()


def end_of(status: int) -> str:
    """How a process with this exit status ended."""
    if status < 0:
        return f"killed by {signal.Signals(-status).name}; was there enough memory?"
    return f"ended with status {status}"


def last_line(stream: IO[bytes]) -> str:
    """The last line that a process wrote to this file."""
    stream.seek(0)
    lines = stream.read()[-4000:].decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else "no message"
