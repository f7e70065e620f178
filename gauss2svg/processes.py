"""Child processes. `run` waits for one. `NEW_GROUP` and `end_tree` are for those that go on."""

from __future__ import annotations

import os
import re
import shlex
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

# Pass this as Popen's creationflags, along with start_new_session=True. Windows uses the flags, the
# other systems the session. A Ctrl-C here then does not reach the process, and `end_tree` ends it.
NEW_GROUP = 0x200 if sys.platform == "win32" else 0
_CHECK_S = 0.2  # seconds between two checks that the parent is alive


def nothing() -> None:
    """Do nothing, because no signal has come. This is the default of `pending`."""


# Raises the exception of a signal once more. It is called between tasks and at a command's end.
# Python drops the exception of a Ctrl-C that comes during a callback of its garbage collector or of
# C code. Therefore a command's signal handler also sets `pending` to a function that raises it.
pending: Callable[[], None] = nothing


class Ended(NamedTuple):
    """The end of a process.

    status     exit status
    output     standard output
    complaint  last line of standard error, or ""
    """

    status: int
    output: bytes
    complaint: str


def run(
    command: Sequence[str],
    data: bytes | None = None,
    *,
    timeout_s: float | None = None,
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> Ended:
    """Run a command to its end, and then kill the processes that it has left behind.

    An exception, such as an interrupt, kills the command as well.

    data         bytes for standard input, which is empty for None
    environment  variables to set besides those of this process

    Raise TimeoutError after `timeout_s` seconds, or OSError if the command cannot be started.
    """
    import subprocess
    import tempfile

    with (
        # Files and not pipes, because any process that is left behind would keep a pipe open.
        tempfile.TemporaryFile() as stdout,
        tempfile.TemporaryFile() as stderr,
        subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=stdout,
            stderr=stderr,
            cwd=folder,
            env={**os.environ, **(environment or {})},
            start_new_session=True,
            creationflags=NEW_GROUP,
        ) as process,
    ):
        try:
            process.communicate(data, timeout_s)
        except subprocess.TimeoutExpired as error:
            raise TimeoutError(f"not done in {timeout_s:g} s") from error
        finally:  # also after an interrupt, which a process of another group does not receive
            end_tree(process.pid)
        stdout.seek(0)
        stderr.seek(0)
        # The last line of standard error usually says why a program failed.
        complaint = stderr.read().decode(errors="replace").strip().rpartition("\n")[2].strip()
        return Ended(process.returncode, stdout.read(), complaint)


def module_command(name: str, *words: str) -> list[str]:
    """Return the command that runs a module in a new Python, with `module_path` as environment."""
    return [sys.executable, "-P", "-m", name, *words]


def module_path() -> dict[str, str]:
    """Return variables with which another Python finds the same modules, and prints UTF-8."""
    entries = [os.path.abspath(entry) for entry in sys.path if entry]
    # The current folder, "", is left out. The package may be in it, so its own folder comes last.
    path = os.pathsep.join([*entries, str(Path(__file__).parents[1])])
    return {"PYTHONPATH": path, "PYTHONIOENCODING": "utf-8"}


def end_tree(process_id: int) -> None:
    """Kill a process that leads its own group, and all processes that it has started."""
    import psutil

    with suppress(psutil.NoSuchProcess):
        root = psutil.Process(process_id)
        # A child may lead another group.
        for process in (*root.children(recursive=True), root):
            with suppress(psutil.NoSuchProcess):
                process.kill()
    if sys.platform != "win32":
        # The group may be gone. macOS refuses if only the exit status of its leader is left.
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process_id, signal.SIGKILL)


def end_with_parent(parent: int) -> None:
    """Start a thread that kills this process and its children after process `parent` has ended."""
    import psutil

    def wait() -> None:
        while (now := psutil.Process().parent()) is not None and now.pid == parent:
            time.sleep(_CHECK_S)
        end_tree(os.getpid())

    threading.Thread(target=wait, daemon=True).start()


def end_of(status: int) -> str:
    """Return how a process with this exit status ended."""
    if 0 <= status < 256:
        return f"ended with status {status}"
    killer = f"status {status:#x}"  # exceptions of Windows are known by hexadecimal numbers
    with suppress(ValueError):  # the status is no signal, or one without a name
        killer = signal.Signals(-status).name
    return f"killed by {killer}; was there enough memory?"


def command_line(words: Sequence[str]) -> str:
    """Return a command as it is typed in a POSIX shell, or on Windows in cmd and PowerShell."""
    if sys.platform != "win32":
        return shlex.join(words)
    is_plain = re.compile(r"[\w@+=:,./\\-]+", re.ASCII).fullmatch
    return " ".join(word if is_plain(word) else f'"{word}"' for word in words)
