"""What the scenes that were written so far say of the next: how many Gaussians, and which is best.

Targets hold for the drawn SVG, so every attempt was drawn. A search runs at the size that the fit
runs on; what a larger photo has besides is measured once and carried along.
"""

from __future__ import annotations

import math

from gauss2svg.attempt import Attempt
from gauss2svg.fit.rules import FIRST_ROUND, SceneDecides
from gauss2svg.request import Request
from gauss2svg.targets import TOLERANCE

AIM = 0.12  # dB over the target that a correction aims at
FILL = 0.975  # share of the bytes allowed that a fit aims at
FULL = 0.93  # share from which a file counts as full
TOO_GOOD = 0.35  # dB over the target from which Gaussians are taken away again
_TOO_LITTLE = 0.02  # dB under the target from which some are added
_LEAST_LEFT = 0.05  # of an attempt's error, whatever the photo's own size takes off
# dB that a fit may end under and over the quality's PSNR without a correction; over it only
# where there are more than a few Gaussians to take away.
_LESS_THAN_ENOUGH, _FAR_MORE = 0.8, 3.0
_FEW = 100
_SAME = 0.004  # a count that differs by a smaller share is the same
_TELLING = 0.25  # doublings between two attempts that tell a slope
_SLOPES = 1.5, 6.0  # dB a doubling, the flattest and steepest that are believed


class Attempts:
    """Scenes that were written on the way to the targets of a request.

    made    in the order of their making
    detail  squared error of the photo that the working picture has not
    """

    def __init__(self, request: Request) -> None:
        self.made: list[Attempt] = []
        self.detail = 0.0
        self._request = request
        self._targets = request.targets

    def psnr(self, attempt: Attempt) -> float:
        """Of its drawn SVG against the photo, in dB; minus infinity if it was not drawn."""
        if math.isnan(attempt.error):  # nothing is known to be reached
            return -math.inf
        error = attempt.error + self.detail
        # A detail from another attempt may be a little too much to take off.
        error = max(error, attempt.error * _LEAST_LEFT)
        return -10 * math.log10(error) if error > 0 else math.inf

    def correction(self, rule: SceneDecides, count: int, most: tuple[int, str]) -> int | None:
        """Count that the next attempt should have, None where nothing is left to correct.

        count is the present one, most the largest and which bound that is; the rule is told what
        stops it.
        """
        last, (cap, named) = self.made[-1], most
        limit, target = self._targets.max_bytes, self._targets.psnr
        if not count:
            lacking = target is not None and self.psnr(last) < target - TOLERANCE
            room = last.size < (limit or math.inf)
            return min(FIRST_ROUND, cap) if lacking and room and cap else None
        if limit is not None:
            cap = min(cap, int(limit * FILL * count / last.size))
            if last.size > limit:
                rule.stop_reason = "max_bytes"
                return min(cap, count - 1)
        wanted = count
        if target is not None:
            psnr = self.psnr(last)
            if not target - _TOO_LITTLE <= psnr <= target + TOO_GOOD:
                missing = (target + AIM - psnr) / self._slope(rule)
                wanted = min(round(count * 2 ** max(min(missing, 2.0), -2.0)), cap)
        elif rule.stop_reason in ("max_bytes", "enough"):
            wanted = self._enough(rule, count, cap, named)
        return wanted if abs(wanted - count) > _SAME * count else None

    def _enough(self, rule: SceneDecides, count: int, most: int, named: str) -> int:
        """Count that ends at the quality's PSNR, or as near to it as the bytes allow."""
        last = self.made[-1]
        missing = self._request.preset.enough - last.model
        if self._request.count is not None:
            missing = math.inf
        far_more = missing < -_FAR_MORE and count > _FEW
        if missing <= _LESS_THAN_ENOUGH and not far_more:
            return count
        limit = self._targets.max_bytes
        if missing > 0 and limit is not None and last.size > FULL * limit:
            return count
        needed = count * 2 ** max(min(missing / self._slope(rule), 2.0), -2.0)
        rule.stop_reason = "enough" if needed < most else "max_bytes"
        if needed >= most and limit is None:
            rule.stop_reason = named
        return min(math.ceil(needed), most)

    def _slope(self, rule: SceneDecides) -> float:
        """PSNR that a doubling buys: from the last two attempts, or from the growth."""
        if len(self.made) >= 2:
            before, last = self.made[-2:]
            doublings = math.log2(len(last.scene) / max(len(before.scene), 1))
            if abs(doublings) > _TELLING:
                rise = last.model - before.model
                if self._targets.psnr is not None:
                    rise = self.psnr(last) - self.psnr(before)
                slope = rise / doublings
                return min(max(slope, _SLOPES[0]), _SLOPES[1])
        return min(max(rule.slope, _SLOPES[0]), _SLOPES[1])

    def best(self) -> Attempt:
        """The fewest Gaussians that meet every target, or what comes nearest."""
        limit = self._targets.max_bytes or math.inf
        small = [a for a in self.made if a.size <= limit]
        if not small:
            return min(self.made, key=lambda a: a.size)
        target = self._targets.psnr
        if target is None:
            enough = self._request.preset.enough - _LESS_THAN_ENOUGH
            good = [a for a in small if a.model >= enough and self._request.count is None]
            return min(good, key=lambda a: a.size) if good else max(small, key=lambda a: a.model)
        good = [a for a in small if self.psnr(a) >= target - TOLERANCE]
        if good:
            close = [a for a in good if self.psnr(a) <= target + TOO_GOOD]
            return min(close or good, key=lambda a: len(a.scene))
        return max(small, key=self.psnr)
