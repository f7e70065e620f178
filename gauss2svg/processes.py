"""Child processes: `run` waits for one, `own_group` and `end_tree` are for those that stay."""

from __future__ import annotations

import os
import re
import shlex
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, NamedTuple, TypedDict

if TYPE_CHECKING:
    import subprocess

_LEAST_EXCEPTION = 0xC0000000  # first exit status of Windows that is an exception (ntstatus.h)
_EXCEPTIONS = {
    0xC0000005: "access violation",
    0xC0000017: "out of memory",
    0xC000001D: "illegal instruction",
    0xC00000FD: "stack overflow",
    0xC000013A: "Ctrl-C",
    0xC0000374: "heap corruption",
    0xC0000409: "abort",
}
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
    apart: bool = True,
    tied: bool = False,
    ending_s: float = 0.0,
) -> Ended:
    """Run a command to its end; the group that it leads ends with an exception here.

    data         standard input; None: the null device
    timeout_s    after which the group is killed; None: no limit
    environment  variables besides those of this process
    apart        whether it leads a group of its own; without one it ends with the group of this
                 process, and is for a process that is itself killed after a time limit
    tied         whether its standard input is open as long as this process lives, and has nothing
    ending_s     seconds in which a process may end its own children when it is asked to end, by
                 SIGTERM; on Windows, where nobody can be asked, they are found by their parent

    Raises TimeoutError, and another OSError where the command cannot be started.
    """
    import subprocess
    import tempfile

    source = subprocess.DEVNULL if data is None and not tied else subprocess.PIPE
    with (
        # No pipes, which have no end while anything that the process has left behind is alive.
        tempfile.TemporaryFile() as stdout,
        tempfile.TemporaryFile() as stderr,
        subprocess.Popen(
            command,
            stdin=source,
            stdout=stdout,
            stderr=stderr,
            cwd=folder,
            env={**os.environ, **(environment or {})},
            **(own_group() if apart else _Group()),
        ) as process,
    ):
        tie = process.stdin if tied else None
        if tie is not None:
            process.stdin = None  # `communicate` would close it
        try:
            process.communicate(data, timeout_s)
        except BaseException as error:  # an interrupt too, which another group does not receive
            _end(process, apart, ending_s)
            if isinstance(error, subprocess.TimeoutExpired):
                raise TimeoutError(f"not done in {timeout_s:g} s") from error
            raise
        finally:
            if tie is not None:
                tie.close()
        stdout.seek(0)
        return Ended(process.returncode, stdout.read(), _last_line(stderr))


def _end(process: subprocess.Popen[bytes], apart: bool, ending_s: float) -> None:
    import subprocess

    if ending_s and sys.platform != "win32":
        process.terminate()
        with suppress(subprocess.TimeoutExpired):  # it is inside a library
            process.wait(ending_s)
    if not apart:
        process.kill()
    # A group outlives its leader; on Windows the number of a dead one may be another's.
    elif sys.platform != "win32" or process.poll() is None:
        end_tree(process.pid)


def _last_line(stream: IO[bytes]) -> str:
    stream.seek(0, os.SEEK_END)
    # The last line is looked for in so many bytes.
    stream.seek(max(0, stream.tell() - 4000))
    lines = stream.read().decode(errors="replace").strip().splitlines()
    return lines[-1].strip() if lines else ""


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
    try:
        return os.path.samefile(folder, os.curdir)
    except OSError:  # one of them is gone
        return False


def own_group() -> _Group:
    """Return keywords of Popen for a process that `end_tree` ends and no Ctrl-C here reaches."""
    if sys.platform == "win32":
        import subprocess

        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    return {"start_new_session": True}


def end_tree(process_id: int) -> None:
    """Kill a process that was started with `own_group`, and what it has started."""
    if sys.platform == "win32":
        end_family(process_id)
    else:
        # It may be gone; macOS refuses where only its exit status is left.
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process_id, signal.SIGKILL)


def end_family(process_id: int) -> None:
    """Kill any process and what it has started, which are found by their parents."""
    import psutil

    with suppress(psutil.NoSuchProcess):
        root = psutil.Process(process_id)
        for process in (root, *root.children(recursive=True)):
            with suppress(psutil.NoSuchProcess):
                process.kill()


def crash_of(status: int) -> str | None:
    """Return what killed a process with this exit status; None for one that ended by itself."""
    if sys.platform == "win32":
        status &= 0xFFFFFFFF
        if status < _LEAST_EXCEPTION:
            return None
        return f"{_EXCEPTIONS.get(status, 'exception')}, 0x{status:X}"
    if status >= 0:
        return None
    try:
        return signal.Signals(-status).name
    except ValueError:  # those for programs' own use have no name
        return f"signal {-status}"


def end_of(status: int) -> str:
    """Return how a process with this exit status ended."""
    crash = crash_of(status)
    if crash is None:
        return f"ended with status {status}"
    return f"killed by {crash}; was there enough memory?"


def command_line(words: Sequence[str]) -> str:
    """Return a command as it is typed in a POSIX shell, or on Windows in cmd and PowerShell."""
    if sys.platform == "win32":
        return " ".join(word if _PLAIN.fullmatch(word) else _in_quotes(word) for word in words)
    return shlex.join(words)


def _in_quotes(word: str) -> str:
    import subprocess

    quoted = subprocess.list2cmdline([word])
    return quoted if quoted.startswith('"') else f'"{quoted}"'
