"""Child processes: `run` waits for one, `NEW_GROUP` and `end_tree` are for those that stay."""

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

# Popen's creationflags beside start_new_session: no Ctrl-C here reaches the process, and `end_tree`
# ends it. Windows knows only the one, the other systems only the other.
NEW_GROUP = 0x200 if sys.platform == "win32" else 0
_LOOK_S = 0.2  # between two looks whether the parent is alive


def nothing() -> None:
    """Raise nothing, for no signal has come."""


# Raises again what a signal has raised; called between tasks and at the end of a command. A Ctrl-C
# is lost where what it raises is in a callback of Python's garbage collector or of C code: the
# handler of a command leaves it here as well.
pending: Callable[[], None] = nothing


class Ended(NamedTuple):
    """How a process ended.

    status     its exit status
    output     its standard output
    complaint  the last line of its standard error, "" for none
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
    """Run a command to its end, which is that of its children too, or to an exception here.

    data         standard input; None: none
    environment  variables besides those of this process

    Raises TimeoutError, and another OSError where the command cannot be started.
    """
    import subprocess
    import tempfile

    with (
        # No pipes, which have no end while anything that the process has left behind is alive.
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
        finally:  # after an interrupt too, which another group does not receive
            end_tree(process.pid)
        stdout.seek(0)
        stderr.seek(0)
        # The last line of a standard error mostly says why a program failed.
        complaint = stderr.read().decode(errors="replace").strip().rpartition("\n")[2].strip()
        return Ended(process.returncode, stdout.read(), complaint)


def module_command(name: str, *words: str) -> list[str]:
    """The command that runs a module in a Python of its own, to start with `module_path`."""
    return [sys.executable, "-P", "-m", name, *words]


def module_path() -> dict[str, str]:
    """Variables by which another Python imports as this one, and prints UTF-8."""
    entries = [os.path.abspath(entry) for entry in sys.path if entry]
    # Last: the package itself may be imported from the current folder, "", which is left out.
    path = os.pathsep.join([*entries, str(Path(__file__).parents[1])])
    return {"PYTHONPATH": path, "PYTHONIOENCODING": "utf-8"}


def end_tree(process_id: int) -> None:
    """Kill a process of a group of its own, and what it has started."""
    import psutil

    with suppress(psutil.NoSuchProcess):
        root = psutil.Process(process_id)
        # What it has started may lead a group of its own.
        for process in (*root.children(recursive=True), root):
            with suppress(psutil.NoSuchProcess):
                process.kill()
    if sys.platform != "win32":
        # It may be gone; macOS refuses where only its exit status is left.
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process_id, signal.SIGKILL)


def end_with_parent(parent: int) -> None:
    """Let this process end, with what it has started, once its parent has."""
    import psutil

    def wait() -> None:
        while (now := psutil.Process().parent()) is not None and now.pid == parent:
            time.sleep(_LOOK_S)
        end_tree(os.getpid())

    threading.Thread(target=wait, daemon=True).start()


def end_of(status: int) -> str:
    """Return how a process with this exit status ended."""
    if 0 <= status < 256:
        return f"ended with status {status}"
    killer = f"status {status:#x}"  # as exceptions of Windows are known
    with suppress(ValueError):  # no signal, or one for programs' own use
        killer = signal.Signals(-status).name
    return f"killed by {killer}; was there enough memory?"


def command_line(words: Sequence[str]) -> str:
    """Return a command as it is typed in a POSIX shell, or on Windows in cmd and PowerShell."""
    if sys.platform != "win32":
        return shlex.join(words)
    is_plain = re.compile(r"[\w@+=:,./\\-]+", re.ASCII).fullmatch
    return " ".join(word if is_plain(word) else f'"{word}"' for word in words)
