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
        rows = [
            line.split(":", 2)
            for line in (process / "cgroup").read_text(encoding="utf-8").splitlines()
        ]
    except OSError:
        return []
    rooms = []
    for _, controllers, path in rows:
        if controllers == "":
            names = "memory.max", "memory.current", "inactive_file"
            root = cgroups
        elif "memory" in controllers.split(","):
            names = "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"
            root = cgroups / "memory"
        else:
            continue
        # In a container the path may be the host's, of which only the root is mounted.
        folder = root / path.strip("/")
        for group in (folder, *folder.parents):
            room = _room(group, *names)
            if room is not None:
                rooms.append(room)
            if group == root:
                break
    return rooms


def _room(group: Path, most: str, used: str, cached: str) -> int | None:
    """Bytes that a control group leaves; None if it has no limit or does not exist."""
    try:
        limit = (group / most).read_text(encoding="utf-8").strip()
        # cgroup v1 without a limit reports more than any machine has.
        if limit == "max" or int(limit) >= 1 << 60:
            return None
        rows = (
            line.split()
            for line in (group / "memory.stat").read_text(encoding="utf-8").splitlines()
        )
        # Cached files count as used, and are dropped when memory is short.
        idle = int(dict(rows).get(cached, 0))
        return int(limit) - max(int((group / used).read_text(encoding="utf-8")) - idle, 0)
    except (OSError, ValueError):
        return None


def _rlimit_rooms() -> list[int]:
    """Bytes that RLIMIT_AS and RLIMIT_DATA leave, where they are set."""
    try:
        import resource
    except ImportError:  # Windows
        return []
    held = psutil.Process().memory_info()
    rooms = []
    for kind, taken in ((resource.RLIMIT_AS, held.vms), (resource.RLIMIT_DATA, held.rss)):
        soft = resource.getrlimit(kind)[0]
        if soft != resource.RLIM_INFINITY:
            rooms.append(soft - taken)
    return rooms
