"""Records of runs: errors, costs and the machine. This module imports nothing heavy."""

from __future__ import annotations

import json
import os
import platform
import re
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import psutil

from gauss2svg.errors import Gauss2SvgError, OutputError, error_line, on_one_line

Row = dict[str, Any]
TOOL = "gauss2svg"  # value of "tool" in rows of gauss2svg itself


def record_or_error(make: Callable[..., Mapping[str, Any]], *arguments: Any) -> dict[str, Any]:
    """Return the record that a function makes, or {"error": one line} if it raises an exception.

    So a task that fails does not stop the others. The record also has "fatal" after an OutputError,
    because no other task can succeed, for example if the disk is full. Infinities become None.
    """
    try:
        return json_safe(make(*arguments))
    except OutputError as error:
        return {"error": error_line(str(error)), "fatal": True}
    except MemoryError as error:
        line = f"out of memory ({error}). Try smaller photos or fewer Gaussians"
    except Exception as error:  # a peer may raise anything, and a bug is shown with its type
        line = f"{type(error).__name__}: " * (not isinstance(error, Gauss2SvgError)) + str(error)
    return {"error": error_line(on_one_line(line))}


def json_safe(value: Any) -> Any:
    """Return a value as JSON keeps it. Infinities and NaN become None, because JSON lacks them."""
    return json.loads(json.dumps(value), parse_constant=lambda _: None)


def start_watch() -> Callable[[], dict[str, Any]]:
    """Start a watch, and return a function that returns the costs since the start.

    total_s      wall-clock seconds
    cpu_s        CPU seconds of this process and its children
    other_cpu_s  CPU seconds of all other programs. If these programs occupy the cores, threads that
                 wait for each other take much longer.
    peak_bytes   peak memory of this process or an ended child since it began; None if unknown
    """
    start = _seconds()

    def read() -> dict[str, Any]:
        wall, own, busy = (now - then for now, then in zip(_seconds(), start, strict=True))
        others = max(0.0, busy - own)
        return {"total_s": wall, "cpu_s": own, "other_cpu_s": others, "peak_bytes": _peak_bytes()}

    return read


def _seconds() -> tuple[float, float, float]:
    """Return wall-clock seconds and two kinds of CPU seconds.

    The first kind is of this process and its children, the second is of all programs.
    """
    own, busy = os.times(), psutil.cpu_times()._asdict()
    kinds = ("user", "nice", "system", "irq", "softirq", "steal")
    children = own.children_user + own.children_system
    all_cpu = sum(busy.get(kind, 0.0) for kind in kinds)
    return time.perf_counter(), time.process_time() + children, all_cpu


def _peak_bytes() -> int | None:
    try:
        import resource
    except ImportError:  # Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * unit
    if peak := _from_proc("self/status", "VmHWM").removesuffix(" kB"):
        return max(int(peak) * 1024, children)  # Linux adds the parent's peak to ru_maxrss
    return max(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit, children)


def machine() -> dict[str, Any]:
    """Return the CPU model, the number of usable cores and the platform."""
    affinity = getattr(os, "sched_getaffinity", None)  # macOS lacks it
    cores = len(affinity(0)) if affinity else os.cpu_count() or 1
    cpu = _from_proc("cpuinfo", "model name") or platform.processor() or platform.machine()
    return {"cpu": cpu, "cores": cores, "platform": platform.platform()}


def _from_proc(file: str, name: str) -> str:
    """Return the first value after "name:" in a file of /proc, or "" if there is none."""
    try:
        text = Path("/proc", file).read_text(encoding="utf-8")
    except OSError:
        return ""
    values = re.findall(rf"^{name}[\t ]*:[\t ]*(.*?)[\t ]*$", text, re.MULTILINE)
    return values[0] if values else ""
