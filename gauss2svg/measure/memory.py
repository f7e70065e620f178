"""Memory that the machine, the container and its own limits leave to this process."""

from __future__ import annotations

from pathlib import Path

import psutil

SHARE = 0.8  # share of the free memory that work may take by default


def held_bytes() -> int:
    """Return the memory (bytes) that this process holds."""
    return psutil.Process().memory_info().rss


def free_bytes(process: Path = Path("/proc/self"), cgroups: Path = Path("/sys/fs/cgroup")) -> int:
    """Return the memory (bytes) that is left to this process."""
    bounds = [*_left_by_cgroups(process, cgroups), *_left_by_rlimits()]
    return max(0, min([psutil.virtual_memory().available, *bounds]))


def _left_by_cgroups(process: Path, cgroups: Path) -> list[int]:
    """Return the bytes that each control group of this process leaves: on Linux, v1 or v2."""
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
        # In a container the path may be that of the host, of which only the root is mounted.
        groups = [root / path.strip("/"), *(root / path.strip("/")).parents]
        left += [_left_by_cgroup(group, *names) for group in groups[: groups.index(root) + 1]]
    return [free for free in left if free is not None]


def _left_by_cgroup(group: Path, limit_file: str, usage_file: str, cached: str) -> int | None:
    """Return the bytes that a control group leaves, or None if it has no limit or is missing."""
    try:
        names = limit_file, usage_file, "memory.stat"
        limit, used, stat = ((group / name).read_text(encoding="utf-8") for name in names)
        # cgroup v1 without a limit reports more than any machine has.
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
    memory = psutil.Process().memory_info()
    usages = (resource.RLIMIT_AS, memory.vms), (resource.RLIMIT_DATA, memory.rss)
    limits = [(resource.getrlimit(kind)[0], used) for kind, used in usages]
    return [soft - used for soft, used in limits if soft != resource.RLIM_INFINITY]
