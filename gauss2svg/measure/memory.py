"""Memory that is left to this process, by the machine, its container and its own limits."""

from __future__ import annotations

from pathlib import Path

import psutil

SHARE = 0.8  # of the free memory, which work may take by default


def held_bytes() -> int:
    """Memory that this process holds."""
    return psutil.Process().memory_info().rss


def free_bytes(process: Path = Path("/proc/self"), cgroups: Path = Path("/sys/fs/cgroup")) -> int:
    """Memory that is left to this process by the machine, its container and its own limits."""
    bounds = [psutil.virtual_memory().available, *_cgroup_rooms(process, cgroups), *_rlimit_rooms()]
    return max(0, min(bounds))


def _cgroup_rooms(process: Path, cgroups: Path) -> list[int]:
    """Bytes that each control group of this process leaves, version 1 and 2; only on Linux."""
    try:
        lines = (process / "cgroup").read_text(encoding="utf-8").splitlines()
    except OSError:
        return []
    rooms: list[int | None] = []
    for _, controllers, path in (line.split(":", 2) for line in lines):
        root = cgroups
        names = "memory.max", "memory.current", "inactive_file"
        if "memory" in controllers.split(","):
            root = cgroups / "memory"
            names = "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"
        elif controllers:
            continue
        # In a container the path may be the host's, of which only the root is mounted.
        groups = [root / path.strip("/"), *(root / path.strip("/")).parents]
        rooms += [_room(group, *names) for group in groups[: groups.index(root) + 1]]
    return [room for room in rooms if room is not None]


def _room(group: Path, most: str, used: str, cached: str) -> int | None:
    """Bytes that a control group leaves; None if it has no limit or does not exist."""
    try:
        limit, taken, stat = (
            (group / name).read_text(encoding="utf-8") for name in (most, used, "memory.stat")
        )
        # cgroup v1 without a limit reports more than any machine has.
        if limit.strip() == "max" or int(limit) >= 1 << 60:
            return None
        # Cached files count as used, and are dropped when memory is short.
        idle = int(dict(line.split() for line in stat.splitlines()).get(cached, 0))
        return int(limit) - max(int(taken) - idle, 0)
    except (OSError, ValueError):
        return None


def _rlimit_rooms() -> list[int]:
    """Bytes that RLIMIT_AS and RLIMIT_DATA leave, where they are set."""
    try:
        import resource
    except ImportError:  # Windows
        return []
    held = psutil.Process().memory_info()
    limited = (resource.RLIMIT_AS, held.vms), (resource.RLIMIT_DATA, held.rss)
    limits = [(resource.getrlimit(kind)[0], taken) for kind, taken in limited]
    return [soft - taken for soft, taken in limits if soft != resource.RLIM_INFINITY]
