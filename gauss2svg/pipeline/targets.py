"""Whether a written file reaches its targets."""

from __future__ import annotations

from gauss2svg.pipeline.options import Goal

_LATE_SHARE, _LATE_S = 0.05, 0.25  # over the time limit before it is reported
TOLERANCE = 0.05  # dB under the target that still count as reached


def unreached(
    goal: Goal, psnr: float, size: int, seconds: float, reason: str, gaussians: int
) -> list[str]:
    """One line for each target or limit that the written result of so many Gaussians misses."""
    lines = []
    reported = reason not in ("target_psnr", "interrupted")
    ended = f", stopped by {reason.replace('_', ' ')}" if reported else ""
    if goal.target_psnr is not None and psnr < goal.target_psnr - TOLERANCE:
        lines.append(f"target of {goal.target_psnr:g} dB not reached: {psnr:.2f} dB{ended}")
    if isinstance(goal.max_bytes, int) and size > goal.max_bytes:
        lines.append(
            f"limit of {goal.max_bytes} bytes exceeded: the file has {size} even without Gaussians"
        )
    elif reason == "max_bytes" and not gaussians:
        lines.append(
            f"limit of {goal.max_bytes} bytes leaves no room for a Gaussian: the picture is one "
            "flat colour. Try a larger --max-bytes"
        )
    limit = goal.time_limit
    if limit is not None and seconds > (1 + _LATE_SHARE) * limit + _LATE_S:
        lines.append(
            f"time limit of {limit:.3g} s exceeded: {seconds:.1f} s. Try a lower --quality"
        )
    return lines
