"""What a run has to reach on the drawn SVG, and what it may cost."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from gauss2svg.errors import InputError

_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9}
_SIZE = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*([kmg]?)b?", re.IGNORECASE)
_MOST_DECIBELS = 100.0  # 8-bit pictures that differ anywhere are under 100 dB up to 65 megapixels


@dataclass(frozen=True)
class Targets:
    """Bounds of a run; None for those that were not asked for.

    psnr          dB of the drawn SVG against the photo, > 0
    max_bytes     of the file as it is written, >= 1
    time_limit_s  of the whole run, wall clock, > 0
    """

    psnr: float | None = None
    max_bytes: int | None = None
    time_limit_s: float | None = None

    def __post_init__(self) -> None:
        if self.psnr is not None and not 0 < self.psnr <= _MOST_DECIBELS:
            raise InputError(
                f"target_psnr is {self.psnr}; needed are more than 0 and at most "
                f"{_MOST_DECIBELS:g} dB: photos look good from 30 to 40"
            )
        if self.time_limit_s is not None and not 0 < self.time_limit_s < math.inf:
            raise InputError(
                f"time_limit is {self.time_limit_s}; needed are finite seconds above 0"
            )

    def unreached(self, psnr: float, size: int, seconds: float, reason: str) -> list[str]:
        """One line for each bound that the written result misses."""
        lines = []
        told = reason not in ("target_psnr", "interrupted")
        ended = f"{reason.replace('_', ' ')} ended the run" if told else ""
        if self.psnr is not None and psnr < self.psnr - TOLERANCE:
            lines.append(
                f"target of {self.psnr:g} dB not reached: {psnr:.2f} dB"
                + (f", {ended}" if ended else "")
            )
        if self.max_bytes is not None and size > self.max_bytes:
            lines.append(
                f"limit of {self.max_bytes} bytes not reached: without any Gaussian the file "
                f"has {size}"
            )
        limit = self.time_limit_s
        if limit is not None and seconds > (1 + _LATE_SHARE) * limit + _LATE_S:
            lines.append(
                f"time limit of {limit:.3g} s not kept: {seconds:.1f} s; try a lower --quality"
            )
        return lines


_LATE_SHARE, _LATE_S = 0.05, 0.25  # over the limit, from which on it is told
TOLERANCE = 0.05  # dB under the target that still count as reached


def size_in_bytes(value: int | str, name: str = "max_bytes") -> int:
    """Bytes of a size: 150000, "150000", "150k", "1.5M", "150 kB"; k, M and G are decimal.

    Raises InputError that says name for anything else, and for less than one byte.
    """
    if isinstance(value, str):
        match = _SIZE.fullmatch(value.strip())
        size = float(match[1]) * _UNITS[match[2].lower()] if match else 0.0
    else:
        size = value if isinstance(value, int) and not isinstance(value, bool) else 0
    if not 1 <= size < 2**63:
        raise InputError(f"{name} is {value!r}; needed is a size of at least 1: 150k or 1.5M")
    return int(size)
