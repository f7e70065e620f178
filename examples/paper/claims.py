"""The abstract's claims: numbers in, verdict out. Nothing is measured and nothing is read here.

A difference counts where its mean lies beyond the standard deviation of the paired differences.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

HOLDS, IN_PART, NOT, UNTESTED = "holds", "holds in part", "does not hold", "not tested"
WORDS = (HOLDS, IN_PART, NOT, UNTESTED)

# Levels of 255: a step of one is the least that an 8-bit picture can show.
_VISIBLE = 1.0
# dB and SSIM by which losses must differ to be told apart.
_TELLING_PSNR, _TELLING_SSIM = 0.05, 0.002
_ENOUGH = 3  # pairs: fewer tell no spread


@dataclass(frozen=True)
class Verdict:
    """A claim of the abstract, one of WORDS, and the numbers that say so."""

    key: str
    claim: str
    word: str
    numbers: str


def _word(tests: Sequence[bool | None]) -> str:
    """Holds if all do, in part if some do; not tested if nothing is, or one test is None."""
    if not tests or None in tests:
        return UNTESTED
    return HOLDS if all(tests) else IN_PART if any(tests) else NOT


def _spread(values: Sequence[float]) -> float:
    return statistics.stdev(values) if len(values) > 1 else 0.0


def _beyond(values: Sequence[float]) -> bool | None:
    """Whether the mean is above 0 by more than the spread; None of too few values."""
    if len(values) < _ENOUGH:
        return None
    return statistics.fmean(values) > _spread(values)


def _signed(values: Sequence[float]) -> str:
    return f"{statistics.fmean(values):+.2f} ± {_spread(values):.2f} dB"


def fewer_gaussians(
    gains: Mapping[str, Sequence[float]], needed: Mapping[str, float], gaussians: int, most: int
) -> Verdict:
    """Progressive addition reaches a quality with fewer Gaussians than all at once.

    gains   by way and schedule: dB over all at once, pair by pair
    needed  by way and schedule: Gaussians that all at once needs for the same mean PSNR, inf above
            `most`
    """
    told = []
    for way, values in gains.items():
        counts = f", {_needed(needed[way], gaussians, most)}" if _beyond(values) else ""
        told.append(f"{way} {_signed(values)}{counts}")
    return Verdict(
        "a",
        "Adding Gaussians progressively gives better quality with fewer of them.",
        _word([_beyond(values) for values in gains.values()]),
        f"more than all at once: {'; '.join(told)}.",
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
        f"{sum(rising)} of {len(rising)} steps to more Gaussians raise the mean PSNR of the drawn "
        f"SVG; from {ends[0][0][0]:g} to {ends[0][1][0]:g} it rises from {first:.2f} to "
        f"{last:.2f} dB, mean of {len(psnr)} ways.",
    )


def faster_than_shapes(by_iterations: Sequence[float], by_seconds: Sequence[float]) -> Verdict:
    """Gaussians less crisp ellipses in dB, pair by pair, at equal iterations and seconds."""
    return Verdict(
        "c",
        "Gaussians are optimised faster than uniformly coloured shapes (tested on crisp ellipses "
        "in the same engine).",
        _word([_beyond(by_iterations), _beyond(by_seconds)]),
        f"Gaussians less ellipses: {_signed(by_iterations)} after the same iterations, "
        f"{_signed(by_seconds)} after the same seconds.",
    )


def faster_than_live() -> Verdict:
    """LIVE and DiffVG themselves are not run."""
    return Verdict(
        "c, LIVE",
        "Gaussians are optimised faster than the Bézier shapes of DiffVG and LIVE.",
        UNTESTED,
        "LIVE needs diffvg, which is not run here; see the line above for shapes of one colour.",
    )


def smoother_than_shapes(
    error: Mapping[str, Sequence[tuple[float, float]]],
    edges: Mapping[str, Sequence[tuple[float, float]]],
) -> Verdict:
    """Over the photos' smooth areas, by rival: pairs of Gaussians and rival, less is smoother.

    error  root of the mean squared error in levels; edges  share with a step that is not in the
    photo. Holds against a rival where both are lower beyond the spread.
    """
    claim = "Gaussians give smoother gradients within objects than uniformly coloured shapes."
    if not any(error.values()):
        return Verdict("d", claim, UNTESTED, "no shapes to compare with.")
    tests, told = [], []
    for rival, pairs in error.items():
        if not pairs:
            told.append(f"{rival}: none to compare with")
            continue
        own, other = (statistics.fmean(side) for side in zip(*pairs, strict=True))
        own_edges, other_edges = (statistics.fmean(s) for s in zip(*edges[rival], strict=True))
        tests += [_beyond([b - a for a, b in p]) for p in (pairs, edges[rival])]
        told.append(
            f"against {rival} an error of {own:.2f} instead of {other:.2f} levels, false edges "
            f"on {100 * own_edges:.2f} instead of {100 * other_edges:.2f} %"
        )
    return Verdict("d", claim, _word(tests), f"over smooth areas {'; '.join(told)}.")


def crop_cured(
    fixed_jump: float, adaptive_jump: float, fixed_psnr: float, adaptive_psnr: float
) -> Verdict:
    """The crop is there and the adaptive kernel takes it away: jumps in levels, dB to the sum.

    Cured where no jump is left that shows; in part where it is less and the image truer.
    """
    claim = "The fixed kernel crops Gaussians visibly, and the adaptive one cures it."
    numbers = (
        f"largest jump at a window's edge {fixed_jump:.1f} levels fixed, {adaptive_jump:.1f} "
        f"adaptive; against the sum without windows {fixed_psnr:.1f} and {adaptive_psnr:.1f} dB."
    )
    better = adaptive_jump < fixed_jump and adaptive_psnr > fixed_psnr
    if fixed_jump < _VISIBLE or not better:
        word = NOT
    else:
        word = HOLDS if adaptive_jump < _VISIBLE else IN_PART
    return Verdict("e", claim, word, numbers)


def losses_differ(scores: Mapping[str, tuple[float, float]]) -> Verdict:
    """What each loss is good for: (PSNR in dB, SSIM) by loss.

    Holds where one loss leads in PSNR and another in SSIM, each by a telling margin over the
    other; in part where the losses differ but one leads in both.
    """
    best = max(scores, key=lambda loss: scores[loss][0])
    similar = max(scores, key=lambda loss: scores[loss][1])
    lost_psnr = scores[best][0] - scores[similar][0]
    lost_ssim = scores[similar][1] - scores[best][1]
    wide, wide_ssim = (max(side) - min(side) for side in zip(*scores.values(), strict=True))
    if lost_psnr > _TELLING_PSNR and lost_ssim > _TELLING_SSIM:
        word = HOLDS
    else:
        word = IN_PART if wide > _TELLING_PSNR or wide_ssim > _TELLING_SSIM else NOT
    lost = (
        f"{similar} loses {lost_psnr:.2f} dB to {best}, which loses {lost_ssim:.4f} SSIM to it"
        if best != similar
        else f"nothing is lost by it; the losses lie {wide:.2f} dB apart"
    )
    return Verdict(
        "f",
        "The reconstruction loss decides what is kept.",
        word,
        f"best PSNR by {best}, {scores[best][0]:.2f} dB; best SSIM by {similar}, "
        f"{scores[similar][1]:.4f}; {lost}. Losses differ from {_TELLING_PSNR} dB or an SSIM of "
        f"{_TELLING_SSIM} on.",
    )
