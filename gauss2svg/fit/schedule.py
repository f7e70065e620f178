"""When Gaussians are added, on how large a picture, and how large the steps are."""

from __future__ import annotations

import math

from gauss2svg.errors import InputError

ROUNDS = 6  # 4 to 20 rounds end within 0.1 dB of each other
# All Gaussians are there after this share of the iterations.
GROWTH_SHARE = 0.3
# Steps are full until here, then fall to a fiftieth by a cosine.
DECAY_START = 0.75
_LAST_RATE = 0.02
# From here on exponents and colours are those of the file: from 75 % instead of 85 %, three
# Kodak photos lose 0.02 dB at 1000 and 0.03 at 5000 shapes.
SETTLED_FROM = 0.85
# A round runs on a picture reduced until fewer pixels than this are left for each of
# its Gaussians: with 36, a fifth fewer pixel pairs and +0.02 dB on three Kodak photos.
_PIXELS_PER_GAUSSIAN = 36
LARGEST_REDUCTION = 8
_SMALLEST_SIDE = 32


def totals(
    schedule: str, gaussians: int, iterations: int | None, per_round: int | None = None
) -> list[int]:
    """Ascending totals of the rounds of a fit of `gaussians` (>= 0).

    exponential: totals double from round to round; linear: equal parts; all-at-once: one.
    With per_round >= 1 as in the paper: round i = 0, 1, .. adds min(2^i, per_round) if it is
    exponential, per_round if it is linear.
    Without it fewer iterations than ROUNDS make fewer rounds. Raises InputError for per_round
    with all at once.
    """
    if per_round is not None:
        if schedule == "all-at-once":
            raise InputError(
                "schedule must be exponential or linear where per_round is given; got 'all-at-once'"
            )
        return _totals_by_round(schedule, gaussians, per_round)
    count = ROUNDS if iterations is None else min(ROUNDS, iterations)
    if schedule == "exponential":
        counts = [math.ceil(gaussians * 0.5 ** (count - 1 - r)) for r in range(count)]
    elif schedule == "linear":
        counts = [math.ceil(gaussians * (r + 1) / count) for r in range(count)]
    else:
        counts = [gaussians]
    return sorted(set(counts) - {0})


def _totals_by_round(schedule: str, gaussians: int, per_round: int) -> list[int]:
    counts, added = [], 1 if schedule == "exponential" else per_round
    while (counts[-1] if counts else 0) < gaussians:
        counts.append(min((counts[-1] if counts else 0) + min(added, per_round), gaussians))
        added *= 2
    return counts


def reduction(gaussians: int, width: int, height: int) -> int:
    """A round of so many Gaussians runs on a picture of 1 / this the width and height."""
    factor = 1
    while (
        factor < LARGEST_REDUCTION
        and width * height / (4 * factor**2 * gaussians) >= _PIXELS_PER_GAUSSIAN
        and min(width, height) / (2 * factor) >= _SMALLEST_SIDE
    ):
        factor *= 2
    return factor


def rate(done: float) -> float:
    """Share of the full step size, in 0.02..1, when `done` in 0..1 of the fit is over."""
    if done < DECAY_START:
        return 1.0
    fall = 0.5 * (1 + math.cos(math.pi * (done - DECAY_START) / (1 - DECAY_START)))
    return max(_LAST_RATE, fall)
