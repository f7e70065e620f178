"""Time and memory of a run, and the machine it runs on; imports nothing heavy."""

from __future__ import annotations

import os
import platform
import sys
import time
from pathlib import Path
from typing import Any

import psutil


class Stopwatch:
    """Seconds of a machine since the watch was created."""

    def __init__(self) -> None:
        self._wall, self._own, self._all = time.perf_counter(), _cpu_seconds(), _busy_seconds()

    def read(self) -> dict[str, float]:
        """Seconds since the start: wall clock, and CPU time of this process and its children.

        other_cpu_s is the CPU time of everything else on the machine: threads that wait for each
        other take much longer where other programs occupy their cores.
        """
        cpu_s = _cpu_seconds() - self._own
        return {
            "total_s": time.perf_counter() - self._wall,
            "cpu_s": cpu_s,
            "other_cpu_s": max(0.0, _busy_seconds() - self._all - cpu_s),
        }


def _cpu_seconds() -> float:
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


def _busy_seconds() -> float:
    times = psutil.cpu_times()
    kinds = ("user", "nice", "system", "irq", "softirq", "steal")
    return sum(getattr(times, kind, 0.0) for kind in kinds)


def peak_bytes() -> int | None:
    """Peak memory of this process or a child that it waited for; None if unknown."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * unit
    try:
        # Linux carries ru_maxrss over from the process that started this one.
        status = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
        own = next(int(line.split()[1]) for line in status if line.startswith("VmHWM:")) * 1024
    except (OSError, StopIteration):
        own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    return max(own, children)


def machine() -> dict[str, Any]:
    """CPU model, number of usable cores, platform."""
    affinity = getattr(os, "sched_getaffinity", None)  # not on macOS
    cores = len(affinity(0)) if affinity else os.cpu_count() or 1
    return {"cpu": _cpu_model(), "cores": cores, "platform": platform.platform()}


def _cpu_model() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or platform.machine())
