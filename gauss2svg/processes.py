"""Child processes on each system: how they begin and end with all they start, and how they ended.

Each function takes the system as an argument, by default that of this process.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
from collections.abc import Sequence
from contextlib import suppress
from typing import TypedDict

WINDOWS = "nt"  # as os.name says
_NEW_GROUP = 0x200  # CREATE_NEW_PROCESS_GROUP, which subprocess has on Windows alone
# Exit statuses of Windows from here on are those of exceptions (ntstatus.h).
_LEAST_EXCEPTION = 0xC0000000
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


class _Group(TypedDict, total=False):
    """Keywords of Popen."""

    start_new_session: bool
    creationflags: int


def own_group(system: str = os.name) -> _Group:
    """Keywords of Popen for a process that `end_tree` ends, and that no Ctrl-C here reaches."""
    return {"creationflags": _NEW_GROUP} if system == WINDOWS else {"start_new_session": True}


def end_tree(process_id: int, system: str = os.name) -> None:
    """Kill a process that was started with `own_group`, and what it has started."""
    if system != WINDOWS:
        # It may be gone; macOS refuses where only its exit status is left.
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process_id, signal.SIGKILL)
        return
    import psutil

    with suppress(psutil.NoSuchProcess):
        root = psutil.Process(process_id)
        for process in (*root.children(recursive=True), root):
            with suppress(psutil.NoSuchProcess):
                process.kill()


def crash_of(status: int, system: str = os.name) -> str | None:
    """What killed a process with this exit status; None for one that ended by itself."""
    if system == WINDOWS:
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


def end_of(status: int, system: str = os.name) -> str:
    """How a process with this exit status ended."""
    crash = crash_of(status, system)
    if crash is None:
        return f"ended with status {status}"
    return f"killed by {crash}; was there enough memory?"


def command_line(words: Sequence[str], system: str = os.name) -> str:
    """A command as it is typed: in a POSIX shell, or on Windows in cmd and PowerShell."""
    if system != WINDOWS:
        return shlex.join(words)
    return " ".join(word if _PLAIN.fullmatch(word) else _in_quotes(word) for word in words)


def _in_quotes(word: str) -> str:
    import subprocess

    quoted = subprocess.list2cmdline([word])
    return quoted if quoted.startswith('"') else f'"{quoted}"'
