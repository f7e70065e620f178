"""Make scatter charts of a score over a cost, and format numbers for pages and plots."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from decimal import ROUND_HALF_UP, Decimal
from itertools import count
from types import SimpleNamespace as Frame
from typing import Any, NamedTuple

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from gauss2svg.errors import several
from gauss2svg.measure import NONE, PSNR, SPACE, Score


def whole(value: float | None) -> str:
    """Return a number rounded to an integer, as text with a space between thousands."""
    return NONE if value is None else f"{round(value):,}".replace(",", SPACE)


def size(number: float | None) -> str:
    """Return a size in bytes as text with three digits and a unit: 940 B, 58.3 kB, 1.68 MB."""
    if number is None:
        return NONE
    value, unit = _in_bytes(number)
    return f"{value:.0f}{SPACE}B" if unit == "B" else f"{_three_digits(value)}{SPACE}{unit}"


def seconds(value: float | None) -> str:
    """Return seconds as text with three digits and the unit: 0.84 s, 12.3 s, 401 s."""
    return NONE if value is None else f"{_three_digits(value)}{SPACE}s"


def tick(value: float, unit: str) -> str:
    """Return the label of a tick: 5 kB or 0.5 B if the unit is "bytes", 20 s if it is "seconds"."""
    value, name = _in_bytes(value) if unit == "bytes" else (value, "s")
    return f"{value:g}{SPACE}{name}"


def _in_bytes(number: float) -> tuple[float, str]:
    for factor, name in ((1e6, "MB"), (1e3, "kB")):
        if number >= 0.9995 * factor:
            return number / factor, name
    return number, "B"


def _three_digits(value: float) -> str:
    decimals = 2 if value < 9.995 else 1 if value < 99.95 else 0
    # A value halfway between two numbers is rounded up, as in the scripts of the pages: 2625 B
    # becomes 2.63 kB.
    rounded = Decimal(float(value)).quantize(Decimal(1).scaleb(-decimals), ROUND_HALF_UP)
    return f"{rounded:,}".replace(",", SPACE)


def machine_text(machine: Mapping[str, Any]) -> str:
    """Return the description of a machine on one line."""
    cores = several(machine["cores"], "core")
    return f"{machine['cpu']}, {cores}, {machine['platform']}"


class Cost(NamedTuple):
    """A cost that a chart can show.

    key    key of the cost in a record
    unit   "bytes" or "seconds"
    title  title of the chart's axis
    """

    key: str
    unit: str
    title: str

    def text(self, value: float) -> str:
        """Return text for a value of this cost, with the unit: 58.3 kB or 12.3 s."""
        return size(value) if self.unit == "bytes" else seconds(value)


COSTS = (
    Cost("svg_bytes", "bytes", "size of the SVG"),
    Cost("total_s", "seconds", "time, photo to measured SVG"),
)


# Sizes of charts and positions of their axes, in user units of SVG. A narrow chart has fewer ticks.
WIDE = Frame(width=720, height=440, left=52, right=700, top=34, bottom=394, is_narrow=False)
NARROW = Frame(width=340, height=270, left=42, right=326, top=30, bottom=226, is_narrow=True)


def scatter(
    points: Sequence[Mapping[str, Any]], cost: Cost, axis: Score = PSNR, frame: Frame = WIDE
) -> dict[str, Any] | None:
    """Return the chart of a score over the logarithm of a cost, as data for chart.jinja.

    points  a mapping for each point, with these keys:
            cost    the cost, >= 0
            score   the score, or None if the PSNR is infinite
            series  index that decides the colour and the shape of the point
            group   a line joins all points of the same group. A point of the group None has no line
            text    tooltip of the point
            href    address that a click on the point opens. This key may be missing

    The result has the frame, the titles of the axes, the ticks as (position, text), and the points
    with their positions x and y. Points of exact SVGs, whose PSNR is infinite, lie in a row at the
    top, at the height equal_y. A point with a better score is always higher on the chart. So if a
    lower score is better, the numbers on the axis increase downwards. Return None if there are no
    points.
    """
    if not points:
        return None
    scores = [point["score"] for point in points]
    # A logarithmic axis has no 0, but a cost may be 0 s on a machine whose clock has coarse steps.
    costs = [max(point["cost"], 1e-4) for point in points]
    low, high = min(costs) / 1.25, max(costs) * 1.25  # so that no point lies at an end
    finite = [axis.sign * score for score in scores if score is not None] or [0.0]
    some_equal = None in scores
    step = _step(max(finite) - min(finite), axis.least_step)
    bottom = math.floor(min(finite) / step) * step
    # `step` is the distance between two ticks. The axis ends at the first tick that is at least a
    # fifth of this distance above the highest point.
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
        # round() removes digits that come from rounding errors. Adding 0.0 turns -0.0 into 0.0.
        "y_ticks": [(y_of(y), f"{round(y, 6) + 0.0:g}") for y in levels if axis.sign * y < best],
        "points": [
            {**p, "x": x_of(at), "y": y_of(p["score"])} for p, at in zip(points, costs, strict=True)
        ],
        "equal_y": y_of(None) if some_equal else None,
    }


def template_environment(*packages: str) -> Environment:
    """Return a Jinja environment that escapes text for HTML and SVG.

    It has the templates of gauss2svg.compare and of the given packages.
    """
    loader = ChoiceLoader([PackageLoader(name) for name in ("gauss2svg.compare", *packages)])
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters |= {"whole": whole, "size": size, "seconds": seconds}
    return environment


def _step(span: float, least: float) -> float:
    """Return the distance between two ticks of an axis whose values have a range of `span`.

    The distance may be `least` times 1, 2, 5, 10, 20 and so on. It is the smallest of these that
    divides `span` into at most 6 parts.
    """
    steps = (least * factor * 10**power for power in count() for factor in (1, 2, 5))
    return next(step for step in steps if span / step <= 6)


def _ticks(low: float, high: float, is_narrow: bool) -> list[float]:
    """Return the values at which a cost axis has ticks, usually 1, 2, 5, 10, 20 and so on.

    The ticks are as many as fit: at most 4 on a narrow chart and 9 on a wide one.
    """
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ticks: list[float] = []
    for steps in ((1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9), (1, 2, 5), (1, 3), (1,)):
        values = [step * 10.0**exponent for exponent in exponents for step in steps]
        ticks = [value for value in values if low <= value <= high]
        if len(ticks) <= (4 if is_narrow else 9):
            break
    return ticks
