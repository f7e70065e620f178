"""When Gaussians are added, on how large a picture, and how large the steps are."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gauss2svg.errors import InputError

SCHEDULES = ("exponential", "linear", "all-at-once")
DEFAULT_SCHEDULE = "exponential"

ROUNDS = 6  # 4 to 20 rounds end within 0.1 dB of each other
# All Gaussians are there after this share of the iterations.
GROWTH_SHARE = 0.3
# Steps are full until here, then fall to a fiftieth by a cosine.
DECAY_START = 0.75
_LAST_RATE = 0.02
# A round runs on a picture reduced until fewer pixels than this are left for each of
# its Gaussians: with 36, a fifth fewer pixel pairs and +0.02 dB on three Kodak photos.
_PIXELS_PER_GAUSSIAN = 36
_LARGEST_REDUCTION = 8
_SMALLEST_SIDE = 32


@dataclass(frozen=True)
class Round:
    """From `first_iteration` on there are `gaussians` of them, on a 1 / `reduction` picture."""

    first_iteration: int
    gaussians: int
    reduction: int


def plan_rounds(
    schedule: str, gaussians: int, iterations: int, width: int, height: int
) -> list[Round]:
    """Rounds of a fit of `gaussians` (>= 1) in `iterations` (>= 1) on width x height px.

    exponential: totals double from round to round; linear: equal parts; all-at-once: one.
    A last entry, without new Gaussians, returns to the full picture where growth ended
    on a reduced one. Raises InputError for an unknown schedule.
    """
    if schedule not in SCHEDULES:
        raise InputError(f"schedule is {schedule!r}; needed is one of {', '.join(SCHEDULES)}")
    count = min(ROUNDS, iterations)
    if schedule == "exponential":
        totals = [math.ceil(gaussians * 0.5 ** (count - 1 - r)) for r in range(count)]
    elif schedule == "linear":
        totals = [math.ceil(gaussians * (r + 1) / count) for r in range(count)]
    else:
        totals = [gaussians]
    growth = int(iterations * GROWTH_SHARE)
    rounds: list[Round] = []
    for r, total in enumerate(totals):
        if not rounds or total > rounds[-1].gaussians:
            first = growth * r // len(totals)
            rounds.append(Round(first, total, _reduction(total, width, height)))
    if rounds[-1].reduction > 1:
        rounds.append(Round(max(growth, rounds[-1].first_iteration), gaussians, 1))
    return rounds


def _reduction(gaussians: int, width: int, height: int) -> int:
    reduction = 1
    while (
        reduction < _LARGEST_REDUCTION
        and width * height / (4 * reduction**2 * gaussians) >= _PIXELS_PER_GAUSSIAN
        and min(width, height) / (2 * reduction) >= _SMALLEST_SIDE
    ):
        reduction *= 2
    return reduction


def rate(iteration: int, iterations: int) -> float:
    """Share of the full step size, in 0.02..1."""
    done = iteration / iterations
    if done < DECAY_START:
        return 1.0
    fall = 0.5 * (1 + math.cos(math.pi * (done - DECAY_START) / (1 - DECAY_START)))
    return max(_LAST_RATE, fall)
