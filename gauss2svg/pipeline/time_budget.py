"""The time budget of a run: how much of the time limit the fit may use."""

from __future__ import annotations

import time
from collections.abc import Callable

_RESERVE_SHARE = 0.3  # of the time left, reserved for the export until it is estimated
_ESTIMATE_AT = 0.4  # share of the fit done at the estimate
_MOST_RESERVED = 0.6  # of the time left; if the export needs more, Gaussians are removed


class TimeBudget:
    """The time left, and how much of it the fit may use.

    deadline  by time.perf_counter() in s, or None
    """

    def __init__(self, deadline: float | None) -> None:
        self.deadline = deadline
        self._estimated = deadline is None

    def fit_deadline(self, share: float = 1 - _RESERVE_SHARE) -> float | None:
        """End of a fit that may use this share of the time left."""
        if self.deadline is None:
            return None
        now = time.perf_counter()
        return now + share * max(self.deadline - now, 0.0)

    def reserve(
        self, done: float, count: int, estimate_s: Callable[[], float]
    ) -> tuple[float, int | None] | None:
        """Once in a fit, its new deadline, and the largest count to export in time or None.

        done        share of the fit that is over
        count       of Gaussians
        estimate_s  measures how long writing, rasterising and measuring will take
        """
        if self.deadline is None or self._estimated or done <= _ESTIMATE_AT:
            return None
        self._estimated = True
        reserve = estimate_s()
        left = self.deadline - time.perf_counter()
        share = min(_MOST_RESERVED * left / reserve, 1.0)
        most = max(1, int(count * share)) if share < 1 else None
        return self.deadline - share * reserve, most
