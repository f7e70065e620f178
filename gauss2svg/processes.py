"""Start and end child processes, and manage the memory of this process.

`run` starts a child process and waits until it ends. `start` and `end_tree` are for children that
run while this process continues.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import subprocess

MEMORY_SHARE = 0.8  # share of the free memory that this program may take by default


def keep_freed_memory() -> None:
    """Keep the memory of freed arrays for the next arrays.

    An array of more than 32 MiB has memory of its own, which is given back when the array is freed.
    All other arrays lie in a heap, of whose end up to 64 MiB are kept. Each thread may have a heap.
    Otherwise each step of a fit would give memory back, and the system would clear it for the next
    step (docs/decisions/memory.md). The function changes the whole process, so only the program
    calls it, for itself and for its processes, and the library does not. It does nothing with other
    C libraries than glibc.
    """
    if sys.platform == "linux":
        import ctypes

        with suppress(AttributeError):  # raised if the C library has no mallopt
            ctypes.CDLL(None).mallopt(-3, 32 << 20)  # M_MMAP_THRESHOLD
            ctypes.CDLL(None).mallopt(-1, 64 << 20)  # M_TRIM_THRESHOLD


class Ended(NamedTuple):
    """A process that has ended.

    status     exit status
    output     standard output
    complaint  last line of standard error, or ""
    """

    status: int
    output: bytes
    complaint: str


def start(
    command: Sequence[str], environment: Mapping[str, str] | None = None, **options: Any
) -> subprocess.Popen[Any]:
    """Start a command in a process group of its own, and return its process.

    A Ctrl-C does not reach a child in another group, so `end_tree` has to end it.

    environment  variables to add to those of this process
    options      further arguments of Popen
    """
    import subprocess

    # On Windows, start_new_session has no effect, and this flag makes the group.
    flags = 0x200 if sys.platform == "win32" else 0
    variables = {**os.environ, **(environment or {})}
    return subprocess.Popen(
        command, env=variables, start_new_session=True, creationflags=flags, **options
    )


def run(
    command: Sequence[str],
    data: bytes | None = None,
    *,
    timeout_s: float | None = None,
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> Ended:
    """Run a command to its end, and then kill the processes that it has left behind.

    If an exception is raised meanwhile, for example after a Ctrl-C, the command is killed too.

    data         bytes for standard input, which is empty for None
    environment  variables to add to those of this process

    Raise TimeoutError after `timeout_s` seconds, or OSError if the command cannot be started.
    """
    import subprocess
    import tempfile

    # The outputs are files and not pipes. A process that the command leaves behind would keep a
    # pipe open, so reading the pipe would not end.
    with tempfile.TemporaryFile() as stdout, tempfile.TemporaryFile() as stderr:
        streams = {"stdin": subprocess.PIPE, "stdout": stdout, "stderr": stderr}
        with start(command, environment, cwd=folder, **streams) as process:
            try:
                process.communicate(data, timeout_s)
            except subprocess.TimeoutExpired as error:
                raise TimeoutError(f"not done in {timeout_s:g} s") from error
            finally:
                # A child in a group of its own does not receive a Ctrl-C, so it is killed here.
                end_tree(process.pid)
        stdout.seek(0)
        stderr.seek(0)
        # The last line of standard error usually says why a program failed.
        complaint = stderr.read().decode(errors="replace").strip().rpartition("\n")[2].strip()
        return Ended(process.returncode, stdout.read(), complaint)


def module_command(name: str) -> list[str]:
    """Return the command that runs a module in a new process of Python.

    The process needs the environment variables of `python_environment()`.
    """
    return [sys.executable, "-P", "-m", name]


def python_environment() -> dict[str, str]:
    """Return environment variables for a new process of Python.

    With them, the new process finds the same modules as this process, and prints UTF-8.
    """
    entries = [os.path.abspath(entry) for entry in sys.path if entry]
    # The entry "", which stands for the current folder, is left out. This package may have been
    # found by that entry. So that the new process finds it too, the folder that contains the
    # package is added.
    path = os.pathsep.join([*entries, str(Path(__file__).parents[1])])
    return {"PYTHONPATH": path, "PYTHONIOENCODING": "utf-8"}


def end_tree(process_id: int) -> None:
    """Kill a process that leads its own group, and all processes that it has started."""
    import psutil

    with suppress(psutil.NoSuchProcess):
        root = psutil.Process(process_id)
        # Some children may be in another group than the process. Those do not end when the
        # group is killed below. So each child is also killed by its own number.
        for process in (*root.children(recursive=True), root):
            with suppress(psutil.NoSuchProcess):
                process.kill()
    if sys.platform != "win32":
        # This call fails if the group no longer exists. On macOS it raises PermissionError if only
        # the leader of the group is left and has already exited.
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process_id, signal.SIGKILL)


def end_of(status: int) -> str:
    """Return text on how a process with this exit status ended."""
    if 0 <= status < 256:
        return f"its process ended with status {status}"
    # On Windows, the status of a process that crashed says why. It is shown in hexadecimal, so that
    # users can find it in Microsoft's list.
    killer = f"status {status:#x}"
    with suppress(ValueError):  # the status is not that of a signal, or the signal has no name
        killer = signal.Signals(-status).name
    return f"its process was killed by {killer}; was there enough memory?"


def command_line(words: Sequence[str]) -> str:
    """Return a command as a user types it in a POSIX shell, or on Windows in cmd or PowerShell."""
    import subprocess

    return (subprocess.list2cmdline if sys.platform == "win32" else shlex.join)(words)


def held_bytes() -> int:
    """Return the number of bytes of memory that this process holds."""
    import psutil

    return psutil.Process().memory_info().rss


def free_bytes(process: Path = Path("/proc/self"), cgroups: Path = Path("/sys/fs/cgroup")) -> int:
    """Return the number of bytes of memory that this process can still take."""
    import psutil

    left = [psutil.virtual_memory().available]
    with suppress(OSError, ValueError):  # raised on systems without control groups (v2 of Linux)
        path = (process / "cgroup").read_text(encoding="utf-8").strip().rpartition(":")[2]
        group = cgroups / path.strip("/")
        # The limits of a group also hold for the groups in it. In a container, `path` may not exist
        # there, and the limits are found at `cgroups`.
        for folder in [group, *group.parents][: len(group.relative_to(cgroups).parts) + 1]:
            with suppress(
                OSError, ValueError
            ):  # raised for a group that is missing or has no limit
                names = "memory.max", "memory.current", "memory.stat"
                limit, used, stat = ((folder / name).read_text(encoding="utf-8") for name in names)
                # `used` includes the cache of files, which the system empties if memory is short.
                cached = re.search(r"^inactive_file (\d+)", stat, re.MULTILINE)
                left.append(int(limit) - max(0, int(used) - int(cached[1] if cached else 0)))
    return max(0, min(left))
