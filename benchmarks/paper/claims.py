"""The abstract's claims: a verdict for each from numbers alone.

A difference counts if its mean exceeds the standard deviation of the paired differences.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

HOLDS, IN_PART, NOT, UNTESTED = "holds", "holds in part", "does not hold", "not tested"
WORDS = (HOLDS, IN_PART, NOT, UNTESTED)

_VISIBLE = 1.0  # levels of 255: the least step of an 8-bit picture
# dB and SSIM by which losses must differ.
_SIGNIFICANT_PSNR, _SIGNIFICANT_SSIM = 0.05, 0.002
_ENOUGH = 3  # pairs: fewer do not give a spread


@dataclass(frozen=True)
class Verdict:
    """A claim of the abstract, one of WORDS, and the numbers behind it."""

    key: str
    claim: str
    word: str
    numbers: str


def _word(tests: Sequence[bool | None]) -> str:
    """Holds if all tests do, in part if some do; not tested without tests, or if one is None."""
    if not tests or None in tests:
        return UNTESTED
    return HOLDS if all(tests) else IN_PART if any(tests) else NOT


def deviation_of(values: Sequence[float]) -> float:
    """Standard deviation of a sample, 0 of a single value."""
    return statistics.stdev(values) if len(values) > 1 else 0.0


def _beyond(values: Sequence[float]) -> bool | None:
    """Whether the mean exceeds the spread; None for too few values."""
    if len(values) < _ENOUGH:
        return None
    return statistics.fmean(values) > deviation_of(values)


def _signed(values: Sequence[float]) -> str:
    return f"{statistics.fmean(values):+.2f} ± {deviation_of(values):.2f} dB"


def fewer_gaussians(
    gains: Mapping[str, Sequence[float]], needed: Mapping[str, float], gaussians: int, most: int
) -> Verdict:
    """Progressive addition reaches a quality with fewer Gaussians than all at once.

    gains   by procedure and schedule: gain in dB over all at once, pair by pair
    needed  by procedure and schedule: Gaussians that all at once needs for the same mean PSNR, inf
            above `most`
    """
    numbers = []
    for way, values in gains.items():
        counts = f", {_needed(needed[way], gaussians, most)}" if _beyond(values) else ""
        numbers.append(f"{way} {_signed(values)}{counts}")
    return Verdict(
        "a",
        "Adding Gaussians progressively gives better quality with fewer of them.",
        _word([_beyond(values) for values in gains.values()]),
        f"gain over all at once: {'; '.join(numbers)}.",
    )


def _needed(count: float, gaussians: int, most: int) -> str:
    needs = f"{count:.0f}" if math.isfinite(count) else f"more than {most}"
    return f"for which all at once needs {needs} instead of {gaussians}"


def trade_off(psnr: Mapping[str, Sequence[tuple[float, float]]]) -> Verdict:
    """Fewer Gaussians, lower quality: psnr by kind is (count, dB), counts ascending."""
    steps = {k: [b - a for (_, a), (_, b) in pairwise(line)] for k, line in psnr.items()}
    rising = [step > 0 for line in steps.values() for step in line]
    ends = [(line[0], line[-1]) for line in psnr.values()]
    first = statistics.fmean(a[1] for a, _ in ends)
    last = statistics.fmean(b[1] for _, b in ends)
    return Verdict(
        "b",
        "Compression and quality trade off: fewer Gaussians, a worse image.",
        _word(rising),
        f"{sum(rising)} of {len(rising)} steps to more Gaussians raise the mean PSNR of the "
        f"rasterised SVG; from {ends[0][0][0]:g} to {ends[0][1][0]:g} it rises from {first:.2f} to "
        f"{last:.2f} dB, mean of {len(psnr)} kinds of files.",
    )


def faster_than_shapes(by_iterations: Sequence[float], by_seconds: Sequence[float]) -> Verdict:
    """Gains over crisp ellipses in dB, pair by pair, at equal iterations and seconds."""
    return Verdict(
        "c",
        "Gaussians are optimised faster than uniformly coloured shapes (tested on crisp ellipses "
        "in the same engine).",
        _word([_beyond(by_iterations), _beyond(by_seconds)]),
        f"Gaussians against ellipses: {_signed(by_iterations)} after the same iterations, "
        f"{_signed(by_seconds)} after the same seconds.",
    )


def faster_than_live() -> Verdict:
    """The verdict on LIVE and DiffVG, which are not run."""
    return Verdict(
        "c, LIVE",
        "Gaussians are optimised faster than the Bézier shapes of DiffVG and LIVE.",
        UNTESTED,
        "LIVE needs diffvg, which is not run here; the line above is on shapes of one colour.",
    )


def smoother_than_shapes(
    error: Mapping[str, Sequence[tuple[float, float]]],
    edges: Mapping[str, Sequence[tuple[float, float]]],
) -> Verdict:
    """Over the photos' smooth areas, by rival: pairs of Gaussians and rival, less is smoother.

    error  root of the mean squared error in levels; edges  share of the area with false edges.
    Holds against a rival where both are lower beyond the spread.
    """
    claim = "Gaussians give smoother gradients within objects than uniformly coloured shapes."
    if not any(error.values()):
        return Verdict("d", claim, UNTESTED, "no shapes to compare with.")
    tests, numbers = [], []
    for rival, pairs in error.items():
        if not pairs:
            numbers.append(f"{rival}: none to compare with")
            continue
        own, other = (statistics.fmean(side) for side in zip(*pairs, strict=True))
        own_edges, other_edges = (statistics.fmean(s) for s in zip(*edges[rival], strict=True))
        tests += [_beyond([b - a for a, b in p]) for p in (pairs, edges[rival])]
        numbers.append(
            f"against {rival} an error of {own:.2f} instead of {other:.2f} levels, false edges "
            f"on {100 * own_edges:.2f} instead of {100 * other_edges:.2f} %"
        )
    return Verdict("d", claim, _word(tests), f"over smooth areas {'; '.join(numbers)}.")


def crop_cured(
    fixed_jump: float, adaptive_jump: float, fixed_psnr: float, adaptive_psnr: float
) -> Verdict:
    """The fixed kernel crops and the adaptive one does not: jumps in levels, dB to no window.

    Holds if no visible jump is left, in part if the jump is smaller and the PSNR higher.
    """
    claim = "The fixed kernel crops Gaussians visibly, and the adaptive one cures it."
    numbers = (
        f"largest jump at a window's edge {fixed_jump:.1f} levels fixed, {adaptive_jump:.1f} "
        f"adaptive; against the image without windows {fixed_psnr:.1f} and {adaptive_psnr:.1f} dB."
    )
    better = adaptive_jump < fixed_jump and adaptive_psnr > fixed_psnr
    if fixed_jump < _VISIBLE or not better:
        word = NOT
    else:
        word = HOLDS if adaptive_jump < _VISIBLE else IN_PART
    return Verdict("e", claim, word, numbers)


def losses_differ(scores: Mapping[str, tuple[float, float]]) -> Verdict:
    """The strength of each loss: (PSNR in dB, SSIM) by loss.

    Holds where one loss leads in PSNR and another in SSIM, each by a significant margin over the
    other; in part where the losses differ but one leads in both.
    """
    best = max(scores, key=lambda loss: scores[loss][0])
    similar = max(scores, key=lambda loss: scores[loss][1])
    lost_psnr = scores[best][0] - scores[similar][0]
    lost_ssim = scores[similar][1] - scores[best][1]
    wide, wide_ssim = (max(side) - min(side) for side in zip(*scores.values(), strict=True))
    if lost_psnr > _SIGNIFICANT_PSNR and lost_ssim > _SIGNIFICANT_SSIM:
        word = HOLDS
    else:
        word = IN_PART if wide > _SIGNIFICANT_PSNR or wide_ssim > _SIGNIFICANT_SSIM else NOT
    lost = (
        f"{similar} loses {lost_psnr:.2f} dB to {best}, which loses {lost_ssim:.4f} SSIM to it"
        if best != similar
        else f"the same loss leads in both; the losses lie {wide:.2f} dB apart"
    )
    return Verdict(
        "f",
        "The reconstruction loss decides what is kept.",
        word,
        f"best PSNR by {best}, {scores[best][0]:.2f} dB; best SSIM by {similar}, "
        f"{scores[similar][1]:.4f}; {lost}. Losses differ from {_SIGNIFICANT_PSNR} dB or an "
        f"SSIM of {_SIGNIFICANT_SSIM} on.",
    )
