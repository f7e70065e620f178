"""Scatter charts of PSNR over a cost: where points, ticks and lines lie, and the SVG of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

WIDTH, HEIGHT = 720, 440  # user units
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 20, 34, 46
_MARGIN = 1.25  # factor by which the cost axis extends beyond the outermost points
_MOST_DECADES_WITH_ALL_STEPS = 2.5


@dataclass(frozen=True)
class Point:
    """A point of a chart.

    cost    > 0
    psnr    dB; None where the SVG equals its photo
    series  index of its series, which decides its colour and shape
    group   the points of a group are joined by a line, in order of cost; None: not joined
    text    tooltip
    href    address that a click opens; "": none
    """

    cost: float
    psnr: float | None
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
    """

    x_ticks: list[tuple[float, str]]
    y_ticks: list[tuple[float, str]]
    lines: list[str]
    points: list[Placed]
    equal_y: float | None
    left: float = _LEFT
    right: float = WIDTH - _RIGHT
    top: float = _TOP
    bottom: float = HEIGHT - _BOTTOM
    width: float = WIDTH
    height: float = HEIGHT


def scatter(points: Sequence[Point], format_cost: Callable[[float], str]) -> Chart | None:
    """A chart of PSNR over cost, on a logarithmic axis; None without points.

    SVGs that equal their photo have an infinite PSNR and get a row of their own at the top.
    """
    if not points:
        return None
    costs = [point.cost for point in points]
    low, high = min(costs) / _MARGIN, max(costs) * _MARGIN
    finite = [point.psnr for point in points if point.psnr is not None] or [0.0]
    some_equal = any(point.psnr is None for point in points)
    step = _step(max(finite) - min(finite))
    bottom = math.floor(min(finite) / step) * step
    # The highest mark stays clear of the frame.
    top = math.ceil((max(finite) + step / 5) / step) * step
    ceiling = top + step if some_equal else top

    def x_of(cost: float) -> float:
        share = math.log(cost / low) / math.log(high / low)
        return round(_LEFT + share * (WIDTH - _RIGHT - _LEFT), 1)

    def y_of(psnr: float | None) -> float:
        share = ((ceiling if psnr is None else psnr) - bottom) / (ceiling - bottom)
        return round(HEIGHT - _BOTTOM - share * (HEIGHT - _BOTTOM - _TOP), 1)

    placed = [Placed(x_of(point.cost), y_of(point.psnr), point) for point in points]
    groups: dict[int, list[Placed]] = {}
    for one in placed:
        if one.point.group is not None:
            groups.setdefault(one.point.group, []).append(one)
    count = round((top - bottom) / step)
    return Chart(
        x_ticks=[(x_of(value), format_cost(value)) for value in _ticks(low, high)],
        y_ticks=[(y_of(bottom + k * step), f"{bottom + k * step:g}") for k in range(count + 1)],
        lines=[
            " ".join(f"{one.x},{one.y}" for one in sorted(group, key=lambda one: one.x))
            for group in groups.values()
        ],
        points=placed,
        equal_y=y_of(None) if some_equal else None,
    )


def template_environment(*packages: str) -> Environment:
    """The templates of charts and of further packages; text is escaped."""
    return Environment(
        loader=ChoiceLoader([PackageLoader(name) for name in ("gauss2svg.bench", *packages)]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def _step(span: float) -> float:
    """Distance (dB) of ticks, for six ticks or fewer."""
    return next(step for step in (1, 2, 5, 10, 20, 50, 1000) if span / step <= 6)


def _ticks(low: float, high: float) -> list[float]:
    """Ticks at 1, 2 and 5 of each power of ten; powers alone on a long axis, more on a short."""
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)

    def between(*steps: float) -> list[float]:
        found = [step * 10.0**exponent for exponent in exponents for step in steps]
        return [value for value in found if low <= value <= high]

    if math.log10(high / low) > _MOST_DECADES_WITH_ALL_STEPS:
        return between(1)
    usual = between(1, 2, 5)
    # Of these no two neighbours are as far apart as the ends of the shortest axis.
    return usual if len(usual) > 1 else between(1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9)
