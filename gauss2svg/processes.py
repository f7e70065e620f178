"""Child processes, and the memory that this process may still take.

`run` waits for a child process. `NEW_GROUP` and `end_tree` are for children that run beside this
process. Its memory is limited by the machine, by the container, and by limits of the process.
"""

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

# Argument creationflags of Popen for a child in a group of its own. On other systems than Windows
# start_new_session=True makes the group. A Ctrl-C does not reach the child; `end_tree` ends it.
NEW_GROUP = 0x200 if sys.platform == "win32" else 0
MEMORY_SHARE = 0.8  # share of the free memory that work may take by default
_CHECK_S = 0.2  # seconds between two checks that the parent is alive


def nothing() -> None:
    """Do nothing, because no signal has come. This is the default of `pending`."""


# Function that is called between tasks and at the end of a command. After a signal it raises the
# exception of that signal once more, because Python drops an exception in a callback of its garbage
# collector or of C code. The signal handler of a command sets it.
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
    environment  variables to add to those of this process

    Raise TimeoutError after `timeout_s` seconds, or OSError if the command cannot be started.
    """
    import subprocess
    import tempfile

    with (
        # The outputs are files, because a process that is left behind would keep a pipe open.
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
        finally:  # also after an interrupt, which a child in its own group does not receive
            end_tree(process.pid)
        stdout.seek(0)
        stderr.seek(0)
        # The last line of standard error usually says why a program failed.
        complaint = stderr.read().decode(errors="replace").strip().rpartition("\n")[2].strip()
        return Ended(process.returncode, stdout.read(), complaint)


def module_command(name: str, *words: str) -> list[str]:
    """Return the command that runs a module in a new Python. It needs `python_environment()`."""
    return [sys.executable, "-P", "-m", name, *words]


def python_environment() -> dict[str, str]:
    """Return the environment in which another Python finds the same modules and prints UTF-8."""
    entries = [os.path.abspath(entry) for entry in sys.path if entry]
    # The current folder, "", is left out. The package may be in it, so its path is added last.
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
        # The group may be gone. If only its exited leader is left, macOS raises PermissionError.
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
    """Return text on how a process with this exit status ended."""
    if 0 <= status < 256:
        return f"ended with status {status}"
    killer = f"status {status:#x}"  # Windows lists its exceptions by hexadecimal numbers
    with suppress(ValueError):  # the status is no signal, or one without a name
        killer = signal.Signals(-status).name
    return f"killed by {killer}; was there enough memory?"


def command_line(words: Sequence[str]) -> str:
    """Return a command as it is typed in a POSIX shell, or on Windows in cmd and PowerShell."""
    if sys.platform != "win32":
        return shlex.join(words)
    is_safe = re.compile(r"[\w@+=:,./\\-]+", re.ASCII).fullmatch
    return " ".join(word if is_safe(word) else f'"{word}"' for word in words)


def held_bytes() -> int:
    """Return the memory (bytes) that this process holds."""
    import psutil

    return psutil.Process().memory_info().rss


def free_bytes(process: Path = Path("/proc/self"), cgroups: Path = Path("/sys/fs/cgroup")) -> int:
    """Return the memory (bytes) that is left to this process."""
    import psutil

    bounds = [*_left_by_cgroups(process, cgroups), *_left_by_rlimits()]
    return max(0, min([psutil.virtual_memory().available, *bounds]))


def _left_by_cgroups(process: Path, cgroups: Path) -> list[int]:
    """Return the bytes left by each control group of this process that has a limit (Linux)."""
    try:
        lines = (process / "cgroup").read_text(encoding="utf-8").splitlines()
    except OSError:
        return []
    left: list[int | None] = []
    for _, controllers, path in (line.split(":", 2) for line in lines):
        root = cgroups
        names = "memory.max", "memory.current", "inactive_file"
        if "memory" in controllers.split(","):
            root = cgroups / "memory"
            names = "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"
        elif controllers:
            continue
        # In a container, `path` may be that on the host, but the container's group is at `root`.
        groups = [root / path.strip("/"), *(root / path.strip("/")).parents]
        left += [_left_by_cgroup(group, *names) for group in groups[: groups.index(root) + 1]]
    return [free for free in left if free is not None]


def _left_by_cgroup(group: Path, limit_file: str, usage_file: str, cached: str) -> int | None:
    """Return the bytes that a control group leaves, or None if it has no limit or is missing."""
    try:
        names = limit_file, usage_file, "memory.stat"
        limit, used, stat = ((group / name).read_text(encoding="utf-8") for name in names)
        # Without a limit, cgroup v1 reports a number larger than the memory of any machine.
        if limit.strip() == "max" or int(limit) >= 1 << 60:
            return None
        # Cached files count as used, but the system drops them when memory is short.
        idle = int(dict(line.split() for line in stat.splitlines()).get(cached, 0))
        return int(limit) - max(int(used) - idle, 0)
    except (OSError, ValueError):
        return None


def _left_by_rlimits() -> list[int]:
    """Return the bytes that RLIMIT_AS and RLIMIT_DATA leave, if they are set."""
    try:
        import resource
    except ImportError:  # Windows
        return []
    import psutil

    memory = psutil.Process().memory_info()
    usages = (resource.RLIMIT_AS, memory.vms), (resource.RLIMIT_DATA, memory.rss)
    limits = [(resource.getrlimit(kind)[0], used) for kind, used in usages]
    return [soft - used for soft, used in limits if soft != resource.RLIM_INFINITY]
