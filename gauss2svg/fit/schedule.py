"""When Gaussians are added, at what reduced size, and how the learning rate decays."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gauss2svg.errors import InputError, quoted

LARGEST_REDUCTION = 8
LARGEST_UNREDUCED = 640  # px of a side, of an enlarged target (docs/decisions/enlarged.md)


@dataclass(frozen=True)
class ScheduleTuning:
    """When a fit does what, as progress in 0..1 if nothing else is said (docs/decisions/fit.md).

    rounds                 of growth; 4 to 20 end within 0.1 dB of each other
    growth_share           by which all Gaussians have been added
    decay_start            up to which the learning rate is constant; then it decays by a cosine
    last_rate              share of the learning rate at the end
    quantized_from         from which exponents and colours are those of the file; earlier is worse
    pixels_per_gaussian    that each keeps on a reduced target: a fifth fewer pixel-Gaussian pairs
                           at no loss of PSNR
    smallest_side          px of a reduced target in growth
    full_from              progress up to which few Gaussians are refined at half the size or less
                           (docs/decisions/few.md, also for the next five)
    half_from              progress up to which they are refined at a quarter of the size
    smallest_refined_side  px of a reduced target in refinement; on smaller ones a step costs little
    reduced_steps          share of the steps of refinement until the full picture
    reduced_time           share of the time until then, where time ends the fit
                           (docs/decisions/time.md)
    extended               times a preset's steps, where most are on reduced targets
    relocate_from          from which Gaussians are relocated
    relocate_until         until which Gaussians are relocated
    relocate_every         steps from one relocation to the next
    relocate_share         share of a long fit's steps from one to the next, where it relocates no
                           more often than a short one (docs/decisions/time.md)
    """

    rounds: int = 6
    growth_share: float = 0.3
    decay_start: float = 0.75
    last_rate: float = 0.02
    quantized_from: float = 0.85
    pixels_per_gaussian: int = 36
    smallest_side: int = 32
    full_from: float = 0.55
    half_from: float = 0.45
    smallest_refined_side: int = 128
    reduced_steps: float = 0.72
    reduced_time: float = 0.4
    extended: int = 2
    relocate_from: float = 0.2
    relocate_until: float = 0.75
    relocate_every: int = 10
    relocate_share: float = 0.05


TUNING = ScheduleTuning()


def totals(
    schedule: str, gaussians: int, iterations: int | None, per_round: int | None = None
) -> list[int]:
    """Ascending numbers of Gaussians after each round of a fit of `gaussians` (>= 0).

    exponential: the total doubles in each round; linear: equal parts; all-at-once: one round.
    With per_round >= 1, as in the paper, round i = 0, 1, .. adds min(2^i, per_round) if the
    schedule is exponential and per_round if it is linear.
    Without per_round there are at most as many rounds as iterations. Raises InputError for
    per_round with all-at-once.
    """
    if per_round is not None:
        if schedule == "all-at-once":
            raise InputError(
                "schedule must be exponential or linear where per_round is given; got "
                f"{quoted(schedule)}"
            )
        return _totals_by_round(schedule, gaussians, per_round)
    count = TUNING.rounds if iterations is None else min(TUNING.rounds, iterations)
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
    """The factor by which width and height are divided in a round of so many Gaussians."""
    factor = 1
    while (
        factor < LARGEST_REDUCTION
        and width * height / (4 * factor**2 * gaussians) >= TUNING.pixels_per_gaussian
        and min(width, height) / (2 * factor) >= TUNING.smallest_side
    ):
        factor *= 2
    return factor


def refinement_reduction(done: float, gaussians: int, width: int, height: int) -> int:
    """The factor by which width and height are divided in refinement at progress `done` in 0..1.

    Each of full_from and half_from that is still ahead halves the picture once more, as long as
    each Gaussian keeps 36 pixels.
    """
    factor = 1
    for until in (TUNING.full_from, TUNING.half_from):
        pixels = width * height / (4 * factor**2 * max(gaussians, 1))
        fits = min(width, height) / (2 * factor) >= TUNING.smallest_refined_side
        if done < until and pixels >= TUNING.pixels_per_gaussian and fits:
            factor *= 2
    return factor


def enlarged_reduction(done: float, width: int, height: int) -> int:
    """Return the factor by which a fit to an enlarged picture divides width and height.

    All but the last steps run at half the size where that is as large as most pictures.
    """
    is_large = max(width, height) > LARGEST_UNREDUCED
    return 2 if is_large and done < TUNING.quantized_from else 1


def steps_of(iterations: int, gaussians: int, width: int, height: int) -> int:
    """Optimiser steps of a preset with so many iterations: twice those where most are reduced."""
    reduced = refinement_reduction(TUNING.growth_share, gaussians, width, height) > 1
    return iterations * TUNING.extended if reduced and gaussians else iterations


def relocates(done: float, iteration: int, sparsely: bool = False) -> bool:
    """Whether Gaussians are relocated before this step, at progress `done` in 0..1.

    sparsely  no more often in a long fit than in a short one
    """
    every = TUNING.relocate_every
    if sparsely and done > TUNING.relocate_from:
        every = max(every, int(TUNING.relocate_share * iteration / done))
    return TUNING.relocate_from < done < TUNING.relocate_until and iteration % every == 0


def rate(done: float) -> float:
    """Learning rate at progress `done` in 0..1, as a share in 0.02..1 of the full one."""
    start = TUNING.decay_start
    if done < start:
        return 1.0
    fall = 0.5 * (1 + math.cos(math.pi * (done - start) / (1 - start)))
    return max(TUNING.last_rate, fall)
