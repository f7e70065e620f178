"""Whether a written file reaches its targets."""

from __future__ import annotations

from gauss2svg.pipeline.aims import aim_of
from gauss2svg.pipeline.options import Goal

_LATE_SHARE, _LATE_S = 0.05, 0.25  # over the time limit before it is reported


def unreached(
    goal: Goal, reached: float | None, size: int, seconds: float, reason: str, gaussians: int
) -> list[str]:
    """One line for each target or limit that the written result of so many Gaussians misses.

    reached  its score by the goal's aim, None without one
    """
    lines = []
    aim = aim_of(goal)
    if aim is not None and reached is not None and not aim.reached(reached):
        reported = reason not in (aim.name, "interrupted")
        ended = f", stopped by {reason.replace('_', ' ')}" if reported else ""
        name = "" if aim.of.unit else f"{aim.of.name} "
        target = f"target of {name}{aim.text(aim.value, 'g')}"
        lines.append(
            f"{target} not reached: {aim.text(reached, f'.{max(2, aim.of.digits)}f')}{ended}"
        )
    if goal.byte_limit is not None and size > goal.byte_limit:
        lines.append(
            f"limit of {goal.max_bytes} bytes exceeded: the file has {size} even without Gaussians"
        )
    elif reason == "max_bytes" and not gaussians:
        lines.append(
            f"limit of {goal.max_bytes} bytes leaves no room for a Gaussian: the file has none. "
            "Try a larger --max-bytes"
        )
    limit = goal.time_limit
    if limit is not None and seconds > (1 + _LATE_SHARE) * limit + _LATE_S:
        lines.append(
            f"time limit of {limit:.3g} s exceeded: {seconds:.1f} s. Try a smaller --max-size"
        )
    return lines
