"""When Gaussians are added, at what reduced size, and how the learning rate decays."""

from __future__ import annotations

import math

from gauss2svg.errors import InputError, quoted

ROUNDS = 6  # 4 to 20 end within 0.1 dB of each other
# All Gaussians have been added after this share of the iterations (docs/decisions/fit.md).
GROWTH_SHARE = 0.3
# The learning rate is constant up to here, then decays to a fiftieth by a cosine.
DECAY_START = 0.75
_LAST_RATE = 0.02
# From here on exponents and colours are those of the file; earlier costs PSNR
# (docs/decisions/fit.md), unless shapes are skewed (docs/decisions/skew.md).
QUANTIZED_FROM, SKEWS_QUANTIZED_FROM = 0.85, 0.8
# The target of a round is reduced as long as each Gaussian keeps this many pixels: a fifth fewer
# pixel-Gaussian pairs at no loss of PSNR (docs/decisions/fit.md).
_PIXELS_PER_GAUSSIAN = 36
LARGEST_REDUCTION = 8
# Refinement of few Gaussians runs on half the picture up to the first progress, on a quarter up to
# the second, as long as each Gaussian keeps as many pixels (docs/decisions/few.md, also for the
# next two).
FULL_FROM = 0.55, 0.45
_SMALLEST_REFINED_SIDE = 128  # on smaller pictures a step costs little anyway
# Share of the steps of refinement until the full picture, and of the time where that ends the fit;
# and how many times a preset's steps a fit takes where they are reduced.
REDUCED_STEPS, REDUCED_TIME = 0.72, 0.4
_EXTENDED = 2
# Relocation, docs/decisions/fit.md: progress between which it happens, iterations between two; and
# where a long fit relocates no more often than a short one, the share of its iterations between.
_RELOCATION, _RELOCATION_EVERY, _RELOCATION_SHARE = (0.2, 0.75), 10, 0.05
_SMALLEST_SIDE = 32


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
    """The factor by which width and height are divided in a round of so many Gaussians."""
    factor = 1
    while (
        factor < LARGEST_REDUCTION
        and width * height / (4 * factor**2 * gaussians) >= _PIXELS_PER_GAUSSIAN
        and min(width, height) / (2 * factor) >= _SMALLEST_SIDE
    ):
        factor *= 2
    return factor


def refinement_reduction(done: float, gaussians: int, width: int, height: int) -> int:
    """The factor by which width and height are divided in refinement at progress `done` in 0..1.

    Each of FULL_FROM that is still ahead halves the picture once more, as long as each Gaussian
    keeps 36 pixels.
    """
    factor = 1
    for until in FULL_FROM:
        pixels = width * height / (4 * factor**2 * max(gaussians, 1))
        fits = min(width, height) / (2 * factor) >= _SMALLEST_REFINED_SIDE
        if done < until and pixels >= _PIXELS_PER_GAUSSIAN and fits:
            factor *= 2
    return factor


def steps_of(iterations: int, gaussians: int, width: int, height: int) -> int:
    """Optimiser steps of a preset with so many iterations: twice those where most are reduced."""
    reduced = refinement_reduction(GROWTH_SHARE, gaussians, width, height) > 1
    return iterations * _EXTENDED if reduced and gaussians else iterations


def relocates(done: float, iteration: int, sparsely: bool = False) -> bool:
    """Whether Gaussians are relocated before this step, at progress `done` in 0..1.

    sparsely  no more often in a long fit than in a short one
    """
    first, last = _RELOCATION
    every = _RELOCATION_EVERY
    if sparsely and done > first:
        every = max(every, int(_RELOCATION_SHARE * iteration / done))
    return first < done < last and iteration % every == 0


def rate(done: float) -> float:
    """Learning rate at progress `done` in 0..1, as a share in 0.02..1 of the full one."""
    if done < DECAY_START:
        return 1.0
    fall = 0.5 * (1 + math.cos(math.pi * (done - DECAY_START) / (1 - DECAY_START)))
    return max(_LAST_RATE, fall)
