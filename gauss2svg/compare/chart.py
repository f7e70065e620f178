"""Scatter charts of a score over a cost as SVG, and numbers as pages and plots show them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_HALF_UP, Decimal
from itertools import count
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from gauss2svg.measure.scores import NONE, PSNR, SPACE, Score


def whole(value: float | None) -> str:
    """A whole number with thousands separated."""
    return NONE if value is None else f"{round(value):,}".replace(",", SPACE)


def size(count: float | None) -> str:
    """Bytes to three digits: 940 B, 58.3 kB, 1.68 MB."""
    return NONE if count is None else _in_bytes(count, _three_digits, "{:.0f}".format)


def short_size(count: float) -> str:
    """Bytes at a tick: 5 kB, 20 kB, 0.5 B."""
    return _in_bytes(count, "{:g}".format, "{:g}".format)


def _in_bytes(count: float, large: Callable[[float], str], small: Callable[[float], str]) -> str:
    for unit, name in ((1e6, "MB"), (1e3, "kB")):
        if count >= 0.9995 * unit:
            return f"{large(count / unit)}{SPACE}{name}"
    return f"{small(count)}{SPACE}B"


def short_seconds(value: float) -> str:
    """Seconds at a tick: 0.5 s, 20 s."""
    return f"{value:g}{SPACE}s"


def seconds(value: float | None) -> str:
    """Seconds to at most three digits: 0.84 s, 12.3 s, 401 s."""
    return NONE if value is None else f"{_three_digits(value)}{SPACE}s"


def _three_digits(value: float) -> str:
    decimals = 2 if value < 9.995 else 1 if value < 99.95 else 0
    # Ties are rounded up, as by the scripts of pages: 2625 B are 2.63 kB.
    rounded = Decimal(float(value)).quantize(Decimal(1).scaleb(-decimals), ROUND_HALF_UP)
    return f"{rounded:,}".replace(",", SPACE)


def counted(number: int, thing: str) -> str:
    """A number of things: 1 core, 2 cores."""
    return f"{number} {thing}" + ("" if number == 1 else "s")


def machine_text(machine: Mapping[str, Any]) -> str:
    """A machine on one line."""
    return f"{machine['cpu']}, {counted(machine['cores'], 'core')}, {machine['platform']}"


# (key of a report, unit, title of the axis, its text on a page, its text at a tick)
COSTS = (
    ("svg_bytes", "bytes", "size of the SVG", size, short_size),
    ("total_s", "seconds", "time, photo to measured SVG", seconds, short_seconds),
)
_MARGIN = 1.25  # factor by which the cost axis extends beyond the outermost points
_MOST_DECADES = 2.5  # of the cost axis; a longer one has ticks at powers of ten alone


@dataclass(frozen=True)
class Frame:
    """Where the axes of a chart lie, in user units; a narrow one has fewer ticks."""

    width: float
    height: float
    left: float
    right: float
    top: float
    bottom: float
    is_narrow: bool = False


PAGE = Frame(720, 440, left=52, right=700, top=34, bottom=394)
BESIDE = Frame(340, 270, left=42, right=326, top=30, bottom=226, is_narrow=True)  # a picture


@dataclass(frozen=True)
class Point:
    """A point of a chart.

    cost    > 0
    score   of the chart's axis; None where the PSNR is infinite
    series  index of its series, which decides its colour and shape
    group   the points of a group are joined by a line, in order of cost; None: not joined
    text    tooltip
    href    address that a click opens; "": none
    """

    cost: float
    score: float | None
    series: int
    group: int | None
    text: str
    href: str = ""


@dataclass(frozen=True)
class Placed:
    """A point and its place in the chart."""

    x: float
    y: float
    point: Point


@dataclass(frozen=True)
class Chart:
    """What the template draws, in user units.

    x_ticks, y_ticks  (place, text)
    lines             the points attribute of each polyline
    equal_y           where points of exact SVGs lie; None without such points
    score             title of the vertical axis
    """

    x_ticks: list[tuple[float, str]]
    y_ticks: list[tuple[float, str]]
    lines: list[str]
    points: list[Placed]
    equal_y: float | None
    score: str
    frame: Frame


def scatter(
    points: Sequence[Point],
    format_cost: Callable[[float], str],
    axis: Score = PSNR,
    frame: Frame = PAGE,
) -> Chart | None:
    """A chart of a score over cost, on a logarithmic axis; None without points.

    Better is higher: an axis of scores that fall is upside down. SVGs that equal their photo have
    an infinite PSNR and get a row of their own at the top.
    """
    if not points:
        return None
    costs = [point.cost for point in points]
    low, high = min(costs) / _MARGIN, max(costs) * _MARGIN
    sign = axis.sign
    finite = [sign * point.score for point in points if point.score is not None] or [0.0]
    some_equal = any(point.score is None for point in points)
    step = _step(max(finite) - min(finite), axis.least_step)
    bottom = math.floor(min(finite) / step) * step
    # The highest mark stays clear of the frame.
    top = math.ceil((max(finite) + step / 5) / step) * step
    ceiling = top + step if some_equal else top

    def x_of(cost: float) -> float:
        share = math.log(cost / low) / math.log(high / low)
        return round(frame.left + share * (frame.right - frame.left), 1)

    def y_of(height: float) -> float:
        share = (height - bottom) / (ceiling - bottom)
        return round(frame.bottom - share * (frame.bottom - frame.top), 1)

    placed = [
        Placed(
            x_of(point.cost), y_of(ceiling if point.score is None else sign * point.score), point
        )
        for point in points
    ]
    groups: dict[int, list[Placed]] = {}
    for one in placed:
        if one.point.group is not None:
            groups.setdefault(one.point.group, []).append(one)
    heights = [bottom + k * step for k in range(round((top - bottom) / step) + 1)]
    highest = math.inf if axis.best is None else sign * axis.best + step / 2
    return Chart(
        x_ticks=[(x_of(value), format_cost(value)) for value in _ticks(low, high, frame.is_narrow)],
        y_ticks=[(y_of(at), _tick(sign * at)) for at in heights if at < highest],
        lines=[
            " ".join(f"{one.x},{one.y}" for one in sorted(group, key=lambda one: one.x))
            for group in groups.values()
        ],
        points=placed,
        equal_y=y_of(ceiling) if some_equal else None,
        score=axis.title,
        frame=frame,
    )


def template_environment(*packages: str) -> Environment:
    """The templates of charts and of further packages; text is escaped."""
    return Environment(
        loader=ChoiceLoader([PackageLoader(name) for name in ("gauss2svg.compare", *packages)]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def _step(span: float, least: float) -> float:
    """Distance of ticks, for six ticks or fewer: least, or 2, 5, 10, 20, .. times as much."""
    steps = (least * factor * 10**power for power in count() for factor in (1, 2, 5))
    return next(step for step in steps if span / step <= 6)


def _tick(value: float) -> str:
    """A tick's number, without the digits and the sign that rounding adds to zero."""
    return f"{round(value, 6) + 0.0:g}"


def _ticks(low: float, high: float, is_narrow: bool) -> list[float]:
    """Ticks at 1, 2 and 5 of each power of ten; fewer on a long axis, more on a short."""
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)

    def between(*steps: float) -> list[float]:
        found = [step * 10.0**exponent for exponent in exponents for step in steps]
        return [value for value in found if low <= value <= high]

    decades = math.log10(high / low)
    if decades > _MOST_DECADES:
        return between(1)
    if is_narrow and decades > _MOST_DECADES / 2:
        return between(1, 3)
    usual = between(1, 2, 5)
    # Of these no two neighbours are as far apart as the ends of the shortest axis.
    found = usual if len(usual) > 1 else between(1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9)
    return found[::2] if is_narrow and len(found) > 4 else found
