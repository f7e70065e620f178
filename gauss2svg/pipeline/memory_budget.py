"""How much memory a run will take, and how much there is: told before the fit.

The estimate is of the largest resident size of the process, in bytes, for a photo of P px, a fit
on F px and N Gaussians: the largest of what three stages take,

    decoding    31 P
    fitting     12 P + a F + t,  a by the loss, t torch's own
    measuring   57 P + 36 F

(70, 28 and 151 P where it is transparent), and what the interpreter, the libraries and each shape
take, and a fifth more. `python examples/memory.py` prints what processes took beside it. Not
counted are programs that rasterise (Chromium, Firefox, Inkscape, rsvg-convert) and the compilation of the kernels in the first run ever, which
took 105 MB.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import psutil

from gauss2svg.errors import InputError
from gauss2svg.fit.losses import DEFAULT_LOSS, has_ssim
from gauss2svg.options import byte_size
from gauss2svg.scene import ADD, OVER

SHARE = 0.8  # of what is free, which a run may take if nothing else is said
_CGROUPS = Path("/sys/fs/cgroup")
_UNLIMITED = 1 << 60  # more than any machine has: cgroup v1 says so where there is no limit

# Bytes, as measured.
_BASE = 205e6  # a photo of a few pixels
# For each pixel of the photo: once it is there, while it is decoded, and while it is measured.
_OPAQUE, _ALPHA = (12, 31, 57), (28, 70, 151)
_HELD = 36  # for each pixel of the fit, once it is over
_FIT = {False: 75, True: 105}  # for each pixel of the fit, by whether the loss has SSIM
_SHAPE = 3000
_SUMS = 110e6  # what writes a sum
_TORCH = 440e6  # imported for every loss but the default one
_MARGIN = 1.2


@dataclass(frozen=True)
class Load:
    """What of a run decides how much memory it takes.

    width, height          px of the photo
    fit_width, fit_height  px that the fit runs on
    gaussians              the most that there may be
    """

    width: int
    height: int
    fit_width: int
    fit_height: int
    gaussians: int
    loss: str = DEFAULT_LOSS
    blend: str = OVER
    has_alpha: bool = False

    @property
    def bytes(self) -> int:
        """The estimate, an upper bound."""
        photo, fit = self.width * self.height, self.fit_width * self.fit_height
        by_torch = self.loss != DEFAULT_LOSS
        a_pixel = _FIT[has_ssim(self.loss)]
        held, decoded, drawn = _ALPHA if self.has_alpha else _OPAQUE
        fitting = held * photo + a_pixel * fit + _TORCH * by_torch
        measuring = drawn * photo + _HELD * fit + _TORCH * by_torch + _SUMS * (self.blend == ADD)
        most = max(decoded * photo, fitting, measuring)
        return math.ceil(_MARGIN * (_BASE + most + _SHAPE * self.gaussians))


def allowed(max_memory: int | str | None) -> int:
    """Bytes that a run may take: those given, as "2G", or SHARE of what is free with its own.

    Raises InputError for a size that is none.
    """
    if max_memory is not None:
        return byte_size("max_memory", max_memory)
    return int(SHARE * (free_bytes() + psutil.Process().memory_info().rss))


def size_that_fits(load: Load, limit: int, asked: bool) -> tuple[int, int, str | None]:
    """Width and height in px for the fit under a limit of bytes, and what to say of it, or None.

    The size that it is to have if that fits; else the largest of those proportions that does.
    asked  whether the size was asked for, and is not to be lowered
    Raises InputError where it does not fit and was asked for, and where none would.
    """
    if load.bytes <= limit:
        return load.fit_width, load.fit_height, None
    least = _scaled(load, 0.0)
    if least.bytes > limit:
        raise InputError(
            f"a photo of {load.width}x{load.height} px with up to {load.gaussians} Gaussians takes "
            f"about {_megabytes(least.bytes)} of memory and {_megabytes(limit)} may be taken; "
            "shrink the photo first, or give a larger --max-memory"
        )
    if asked:
        raise InputError(
            f"a fit on {load.fit_width}x{load.fit_height} px takes about {_megabytes(load.bytes)} "
            f"of memory and {_megabytes(limit)} may be taken; give a smaller --max-size, or a "
            "larger --max-memory"
        )
    low, high = 0.0, 1.0
    while high - low > 1 / max(load.fit_width, load.fit_height):
        middle = (low + high) / 2
        low, high = (middle, high) if _scaled(load, middle).bytes <= limit else (low, middle)
    found = _scaled(load, low)
    said = f"fitted at {found.fit_width}x{found.fit_height} px to stay under {_megabytes(limit)}"
    return found.fit_width, found.fit_height, f"{said} of memory"


def _scaled(load: Load, share: float) -> Load:
    width, height = (max(1, int(share * side)) for side in (load.fit_width, load.fit_height))
    return replace(load, fit_width=width, fit_height=height)


def _megabytes(size: float) -> str:
    return f"{size / 1e6:.0f} MB"


def free_bytes(process: Path = Path("/proc/self"), cgroups: Path = _CGROUPS) -> int:
    """Memory that this process could still take: the machine's, its container's, its limits'."""
    bounds = [psutil.virtual_memory().available, *_cgroup_rooms(process, cgroups), *_rlimit_rooms()]
    return max(0, min(bounds))


def _cgroup_rooms(process: Path, cgroups: Path) -> list[int]:
    """What each control group over this process leaves, of version 1 and 2; Linux alone."""
    try:
        rows = [line.split(":", 2) for line in (process / "cgroup").read_text().splitlines()]
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
        # In a container the path may be that of the host, of which only the root is mounted.
        folder = root / path.strip("/")
        for group in (folder, *folder.parents):
            room = _room(group, *names)
            if room is not None:
                rooms.append(room)
            if group == root:
                break
    return rooms


def _room(group: Path, most: str, used: str, cached: str) -> int | None:
    """Bytes that a control group leaves; None where it has no limit or is not there."""
    try:
        limit = (group / most).read_text().strip()
        if limit == "max" or int(limit) >= _UNLIMITED:
            return None
        rows = (line.split() for line in (group / "memory.stat").read_text().splitlines())
        # Files that were read count as used, and are let go when memory is short.
        idle = int(dict(rows).get(cached, 0))
        return int(limit) - max(int((group / used).read_text()) - idle, 0)
    except (OSError, ValueError):
        return None


def _rlimit_rooms() -> list[int]:
    """What RLIMIT_AS and RLIMIT_DATA leave; nothing where there are none."""
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
