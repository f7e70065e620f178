"""Scatter charts of a score over a cost, and numbers as text for pages and plots."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from decimal import ROUND_HALF_UP, Decimal
from itertools import count
from types import SimpleNamespace as Frame
from typing import Any, NamedTuple

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from gauss2svg.measure import NONE, PSNR, SPACE, Score


def whole(value: float | None) -> str:
    """Return a number as text, rounded to a whole one, with spaces between thousands."""
    return NONE if value is None else f"{round(value):,}".replace(",", SPACE)


def size(number: float | None) -> str:
    """Return a size in bytes with three digits: 940 B, 58.3 kB, 1.68 MB."""
    if number is None:
        return NONE
    value, unit = _in_bytes(number)
    return f"{value:.0f}{SPACE}B" if unit == "B" else f"{_three_digits(value)}{SPACE}{unit}"


def seconds(value: float | None) -> str:
    """Return seconds with three digits: 0.84 s, 12.3 s, 401 s."""
    return NONE if value is None else f"{_three_digits(value)}{SPACE}s"


def tick(value: float, unit: str) -> str:
    """Return the text of a tick, for unit "bytes" or "seconds": 5 kB, 0.5 B, 20 s."""
    value, name = _in_bytes(value) if unit == "bytes" else (value, "s")
    return f"{value:g}{SPACE}{name}"


def _in_bytes(number: float) -> tuple[float, str]:
    for factor, name in ((1e6, "MB"), (1e3, "kB")):
        if number >= 0.9995 * factor:
            return number / factor, name
    return number, "B"


def _three_digits(value: float) -> str:
    decimals = 2 if value < 9.995 else 1 if value < 99.95 else 0
    # Ties are rounded up, as the scripts of the pages do: 2625 B is 2.63 kB.
    rounded = Decimal(float(value)).quantize(Decimal(1).scaleb(-decimals), ROUND_HALF_UP)
    return f"{rounded:,}".replace(",", SPACE)


def machine_text(machine: Mapping[str, Any]) -> str:
    """Return the description of a machine on one line."""
    cores = f"{machine['cores']} core{'s' * (machine['cores'] != 1)}"
    return f"{machine['cpu']}, {cores}, {machine['platform']}"


class Cost(NamedTuple):
    """A cost for charts: its key in a record, its unit ("bytes" or "seconds"), its axis title."""

    key: str
    unit: str
    title: str

    def text(self, value: float) -> str:
        """Return a value of this cost with its unit."""
        return size(value) if self.unit == "bytes" else seconds(value)


COSTS = (
    Cost("svg_bytes", "bytes", "size of the SVG"),
    Cost("total_s", "seconds", "time, photo to measured SVG"),
)
_MARGIN = 1.25  # factor by which the cost axis extends beyond the outermost points
_MOST_DECADES = 2.5  # number of decades above which a cost axis has ticks at powers of ten only


# Size of a chart and positions of its axes, in user units. A narrow chart has fewer ticks.
WIDE = Frame(width=720, height=440, left=52, right=700, top=34, bottom=394, is_narrow=False)
NARROW = Frame(width=340, height=270, left=42, right=326, top=30, bottom=226, is_narrow=True)


def scatter(
    points: Sequence[Mapping[str, Any]], cost: Cost, axis: Score = PSNR, frame: Frame = WIDE
) -> dict[str, Any] | None:
    """Return the chart of a score over the logarithm of a cost, as data for chart.jinja.

    points  mappings with cost (> 0), score (None if the PSNR is infinite), series (index that
            decides colour and shape), group (a line joins the points of a group; None for no
            line), text (tooltip), and perhaps href (address that a click opens)

    The chart has its frame, the titles of its axes, ticks as (position, text), and the points with
    positions x and y. Points of exact SVGs, whose PSNR is infinite, lie in a row at the top, at
    equal_y. Better is always higher, so the axis is upside down if lower scores are better. Return
    None if there are no points.
    """
    if not points:
        return None
    scores = [point["score"] for point in points]
    costs = [point["cost"] for point in points]
    low, high = min(costs) / _MARGIN, max(costs) * _MARGIN
    finite = [axis.sign * score for score in scores if score is not None] or [0.0]
    some_equal = None in scores
    step = _step(max(finite) - min(finite), axis.least_step)
    bottom = math.floor(min(finite) / step) * step
    # The axis ends at least a fifth of a step above the highest point.
    top = math.ceil((max(finite) + step / 5) / step) * step
    ceiling = top + step if some_equal else top

    def x_of(cost: float) -> float:
        share = math.log(cost / low) / math.log(high / low)
        return round(frame.left + share * (frame.right - frame.left), 1)

    def y_of(score: float | None) -> float:
        height = ceiling if score is None else axis.sign * score
        share = (height - bottom) / (ceiling - bottom)
        return round(frame.bottom - share * (frame.bottom - frame.top), 1)

    levels = [axis.sign * (bottom + k * step) for k in range(round((top - bottom) / step) + 1)]
    best = math.inf if axis.best is None else axis.sign * axis.best + step / 2
    return {
        "frame": frame,
        "titles": (cost.title, axis.title),
        "x_ticks": [(x_of(at), tick(at, cost.unit)) for at in _ticks(low, high, frame.is_narrow)],
        # round() drops the digits of rounding errors, and + 0.0 the sign of a negative zero.
        "y_ticks": [(y_of(y), f"{round(y, 6) + 0.0:g}") for y in levels if axis.sign * y < best],
        "points": [{**p, "x": x_of(p["cost"]), "y": y_of(p["score"])} for p in points],
        "equal_y": y_of(None) if some_equal else None,
    }


def template_environment(*packages: str) -> Environment:
    """Return a Jinja environment that escapes text, with templates of this and other packages."""
    loader = ChoiceLoader([PackageLoader(name) for name in ("gauss2svg.compare", *packages)])
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
    environment.trim_blocks = environment.lstrip_blocks = True
    environment.keep_trailing_newline = True
    environment.filters |= {"whole": whole, "size": size, "seconds": seconds}
    return environment


def _step(span: float, least: float) -> float:
    """Return the distance of ticks: the first of 1, 2, 5, 10, .. x `least` with <= 6 in `span`."""
    steps = (least * factor * 10**power for power in count() for factor in (1, 2, 5))
    return next(step for step in steps if span / step <= 6)


def _ticks(low: float, high: float, is_narrow: bool) -> list[float]:
    """Return the ticks of a cost axis: 1, 2, 5, 10, 20, .., fewer if it is long, more if short."""
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)

    def between(*steps: float) -> list[float]:
        values = [step * 10.0**exponent for exponent in exponents for step in steps]
        return [value for value in values if low <= value <= high]

    decades = math.log10(high / low)
    if decades > _MOST_DECADES:
        return between(1)
    if is_narrow and decades > _MOST_DECADES / 2:
        return between(1, 3)
    usual = between(1, 2, 5)
    # The longer list has a tick even on the shortest axis, which spans a factor of _MARGIN ** 2.
    ticks = usual if len(usual) > 1 else between(1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9)
    return ticks[::2] if is_narrow and len(ticks) > 4 else ticks
