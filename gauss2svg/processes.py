"""Child processes: `run` waits for one, `own_group` and `end_tree` are for those that stay."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, TypedDict

_LEAST_EXCEPTION = 0xC0000000  # first exit status of Windows that is an exception (ntstatus.h)

_LOOK_S = 0.2  # between two looks whether the parent is alive
_PLAIN = re.compile(r"[\w@+=:,./\\-]+", re.ASCII)

# A Ctrl-C is lost where what it raises is in a callback of Python's garbage collector or of C code:
# the handler of a command leaves it here as well.
pending: Callable[[], None] | None = None


def raise_pending() -> None:
    """Raise again what a signal has raised; called between tasks and at the end of a command."""
    if pending is not None:
        pending()


class _Group(TypedDict, total=False):
    """Keywords of Popen."""

    start_new_session: bool
    creationflags: int


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
    """Run a command to its end; an exception here, or a time limit, ends it and its children.

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
            **own_group(),
        ) as process,
    ):
        try:
            process.communicate(data, timeout_s)
        except BaseException as error:  # an interrupt too, which another group does not receive
            end_tree(process.pid)
            if isinstance(error, subprocess.TimeoutExpired):
                raise TimeoutError(f"not done in {timeout_s:g} s") from error
            raise
        stdout.seek(0)
        stderr.seek(0)
        return Ended(process.returncode, stdout.read(), last_line(stderr.read()))


def last_line(errors: bytes) -> str:
    """Return the last line of a standard error, which mostly says why a program failed."""
    return errors.decode(errors="replace").strip().rpartition("\n")[2].strip()


def module_command(name: str, *words: str) -> list[str]:
    """The command that runs a module in a Python of its own, to start with `module_path`."""
    return [sys.executable, "-P", "-m", name, *words]


def module_path() -> dict[str, str]:
    """The variable by which another Python imports as this one, but not from the current folder."""
    # Python puts the current folder first, also by its full name.
    first = int(not sys.flags.safe_path and _is_current(sys.path[0]))
    entries = [os.path.abspath(entry) for entry in sys.path[first:] if entry]
    # Last: the package itself may be imported from there.
    return {"PYTHONPATH": os.pathsep.join([*entries, str(Path(__file__).parents[1])])}


def _is_current(folder: str) -> bool:
    with suppress(OSError):  # one of them is gone
        return os.path.samefile(folder, os.curdir)
    return False


def own_group() -> _Group:
    """Return keywords of Popen for a process that `end_tree` ends and no Ctrl-C here reaches."""
    if sys.platform == "win32":
        import subprocess

        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    return {"start_new_session": True}


def end_tree(process_id: int) -> None:
    """Kill a process that was started with `own_group`, and what it has started."""
    import psutil

    with suppress(psutil.NoSuchProcess):
        root = psutil.Process(process_id)
        # What it has started may lead a group of its own.
        for process in (*root.children(recursive=True), *([root] if os.name == "nt" else [])):
            with suppress(psutil.NoSuchProcess):
                process.kill()
    if sys.platform != "win32":
        # It may be gone; macOS refuses where only its exit status is left.
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process_id, signal.SIGKILL)


def end_with_parent(parent: int, scratch: Path | None = None) -> None:
    """Let this process end, with what it has started, once its parent has; remove a folder then."""
    import psutil

    def wait() -> None:
        own = psutil.Process()
        while (now := own.parent()) is not None and now.pid == parent:
            time.sleep(_LOOK_S)
        while scratch is not None and scratch.exists():  # this process may still write there
            shutil.rmtree(scratch, ignore_errors=True)
        end_tree(os.getpid())

    threading.Thread(target=wait).start()


def end_of(status: int) -> str:
    """Return how a process with this exit status ended."""
    crash = crash_of(status)
    if crash is None:
        return f"ended with status {status}"
    return f"killed by {crash}; was there enough memory?"


def crash_of(status: int) -> str | None:
    """Return what killed a process with this exit status; None for one that ended by itself."""
    if sys.platform == "win32":
        status &= 0xFFFFFFFF
        return f"exception 0x{status:X}" if status >= _LEAST_EXCEPTION else None
    if status >= 0:
        return None
    with suppress(ValueError):  # those for programs' own use have no name
        return signal.Signals(-status).name
    return f"signal {-status}"


def command_line(words: Sequence[str]) -> str:
    """Return a command as it is typed in a POSIX shell, or on Windows in cmd and PowerShell."""
    if sys.platform != "win32":
        return shlex.join(words)
    import subprocess

    quoted = ((word, subprocess.list2cmdline([word])) for word in words)
    return " ".join(
        text if _PLAIN.fullmatch(word) or text.startswith('"') else f'"{text}"'
        for word, text in quoted
    )
