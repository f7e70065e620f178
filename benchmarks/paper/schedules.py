"""Figures 1 to 3: the course of a progressive fit, and whether it needs fewer Gaussians."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gauss2svg.measure import metrics

from .claims import deviation_of
from .engine import AT_ONCE, EXPONENTIAL, PAPER, SCHEDULES, WAYS, Trace, Way, fit, rendered
from .photos import Pixels
from .settings import Settings

_CURVE_POINTS = 60
_SHARES = (0.02, 0.1, 0.25, 0.5, 0.75, 1.0)  # of the iterations, shown in figure 2


@dataclass(frozen=True)
class Score:
    """PSNR in dB of one fit of one photo."""

    photo: str
    way: str
    schedule: str
    gaussians: int
    seed: int
    psnr: float
    seconds: float


@dataclass(frozen=True)
class Summary:
    """One schedule of one procedure, over photos and seeds.

    mean     PSNR in dB; spread: standard deviation over the seeds, mean over the photos
    gain     mean gain over all at once, photo by photo and seed by seed
    scatter  standard deviation of the gains
    """

    way: str
    schedule: str
    mean: float
    spread: float
    gain: float
    scatter: float


def progressive(pixels: Pixels, settings: Settings) -> Trace:
    """The paper's fit of one photo, with snapshots."""
    points = min(_CURVE_POINTS, settings.iterations)
    watched = {round(settings.iterations * (k + 1) / points) for k in range(points)}
    watched.update(shown_iterations(settings))
    count, rounds = settings.gaussians, settings.rounds
    return fit(pixels, PAPER, EXPONENTIAL, count, rounds, settings.iterations, watched=watched)


def shown_iterations(settings: Settings) -> list[int]:
    """Iterations at which figure 2 shows the image."""
    return sorted({max(1, round(settings.iterations * share)) for share in _SHARES})


def curve(trace: Trace, pixels: Pixels) -> list[tuple[int, float]]:
    """(iteration, PSNR in dB) of the snapshots of a fit."""
    return [(i, metrics.psnr(rendered(s), pixels)) for i, s in sorted(trace.snapshots.items())]


def compared(photos: dict[str, Pixels], settings: Settings) -> list[Score]:
    """Every schedule, procedure, photo and seed at the same count and iterations."""
    return [
        _scored(name, pixels, way, schedule, settings.gaussians, seed, settings)
        for way in WAYS
        for schedule in SCHEDULES
        for name, pixels in photos.items()
        for seed in settings.seeds
    ]


def at_more(photos: dict[str, Pixels], settings: Settings) -> list[Score]:
    """All at once with more and more Gaussians."""
    return [
        _scored(name, pixels, way, AT_ONCE, count, seed, settings)
        for way in WAYS
        for count in settings.more
        for name, pixels in photos.items()
        for seed in settings.more_seeds
    ]


def _scored(
    name: str,
    pixels: Pixels,
    way: Way,
    schedule: str,
    gaussians: int,
    seed: int,
    settings: Settings,
) -> Score:
    trace = fit(
        shifted(pixels, seed), way, schedule, gaussians, settings.rounds, settings.iterations, seed
    )
    return Score(name, way.name, schedule, gaussians, seed, trace.psnr, trace.seconds)


def shifted(pixels: Pixels, seed: int) -> Pixels:
    """The photo without two rows and columns per seed: selective placement has no other noise."""
    return np.ascontiguousarray(pixels[2 * seed :, 2 * seed :])


def differences(scores: Sequence[Score], way: str, schedule: str = EXPONENTIAL) -> list[float]:
    """Gain in dB of a schedule over all at once, photo by photo and seed by seed."""
    psnr = {(s.photo, s.schedule, s.seed): s.psnr for s in scores if s.way == way}
    pairs = [(photo, seed) for photo, kind, seed in psnr if kind == schedule]
    return [psnr[photo, schedule, seed] - psnr[photo, AT_ONCE, seed] for photo, seed in pairs]


def summaries(scores: Sequence[Score]) -> list[Summary]:
    """A line for each procedure and schedule."""
    lines = []
    for way in dict.fromkeys(score.way for score in scores):
        for schedule in SCHEDULES:
            own = [s for s in scores if (s.way, s.schedule) == (way, schedule)]
            by_photo: dict[str, list[float]] = {}
            for score in own:
                by_photo.setdefault(score.photo, []).append(score.psnr)
            gains = differences(scores, way, schedule)
            mean = statistics.fmean(s.psnr for s in own)
            spread = statistics.fmean(map(deviation_of, by_photo.values()))
            lines.append(
                Summary(way, schedule, mean, spread, statistics.fmean(gains), deviation_of(gains))
            )
    return lines


def reached(scores: Sequence[Score], way: str, schedule: str, seeds: Sequence[int]) -> float:
    """Mean PSNR in dB of a schedule over these seeds."""
    own = [s for s in scores if (s.way, s.schedule) == (way, schedule) and s.seed in seeds]
    return statistics.fmean(s.psnr for s in own)


def mean_by_count(scores: Sequence[Score], way: str) -> list[tuple[int, float]]:
    """(count, mean PSNR in dB) of the scores of a procedure."""
    by_count: dict[int, list[float]] = {}
    for score in scores:
        if score.way == way:
            by_count.setdefault(score.gaussians, []).append(score.psnr)
    return [(count, statistics.fmean(values)) for count, values in sorted(by_count.items())]


def count_for(psnr: float, by_count: Sequence[tuple[int, float]]) -> float:
    """Count at which a rising line through (count, dB), linear in log count, reaches psnr.

    The first count if that reaches it already, infinity if none does.
    """
    if by_count[0][1] >= psnr:
        return by_count[0][0]
    for (few, low), (many, high) in pairwise(by_count):
        if low < psnr <= high:
            share = (psnr - low) / (high - low)
            return few * math.exp(share * math.log(many / few))
    return math.inf
