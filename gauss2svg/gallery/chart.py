"""Scatter plots as numbers: where points, ticks and lines go, for a template to draw."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

WIDTH, HEIGHT = 720, 440  # user units
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 20, 34, 46
_ROOM = 1.25  # by which the cost axis reaches beyond the outermost points, either way
_MOST_DECADES_WITH_ALL_STEPS = 2.5


@dataclass(frozen=True)
class Point:
    """A value to be plotted.

    cost > 0, psnr in dB, None where the pictures are equal; series: number of its variant;
    group: points of one group are joined by a line, by cost, None: by none; href, text:
    its link
    """

    cost: float
    psnr: float | None
    series: int
    group: int | None
    href: str
    text: str


@dataclass(frozen=True)
class Placed:
    """A point on the page."""

    x: float
    y: float
    point: Point


@dataclass(frozen=True)
class Chart:
    """What a template draws: ticks are (place, text); lines are points of SVG polylines."""

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


def scatter(points: Sequence[Point], tell_cost: Callable[[float], str]) -> Chart | None:
    """A chart of PSNR over cost, on a logarithmic axis; None without a point.

    Pictures that are equal to their photo, of no finite PSNR, are drawn on a line of their own
    at the top.
    """
    if not points:
        return None
    costs = [point.cost for point in points]
    low, high = min(costs) / _ROOM, max(costs) * _ROOM
    finite = [point.psnr for point in points if point.psnr is not None] or [0.0]
    some_equal = any(point.psnr is None for point in points)
    step = _step(max(finite) - min(finite))
    bottom = math.floor(min(finite) / step) * step
    # The highest mark stays clear of the frame.
    top = math.ceil((max(finite) + step / 5) / step) * step
    ceiling = top + step if some_equal else top

    def across(cost: float) -> float:
        share = math.log(cost / low) / math.log(high / low)
        return round(_LEFT + share * (WIDTH - _RIGHT - _LEFT), 1)

    def up(psnr: float | None) -> float:
        share = ((ceiling if psnr is None else psnr) - bottom) / (ceiling - bottom)
        return round(HEIGHT - _BOTTOM - share * (HEIGHT - _BOTTOM - _TOP), 1)

    placed = [Placed(across(point.cost), up(point.psnr), point) for point in points]
    groups: dict[int, list[Placed]] = {}
    for one in placed:
        if one.point.group is not None:
            groups.setdefault(one.point.group, []).append(one)
    count = round((top - bottom) / step)
    return Chart(
        x_ticks=[(across(value), tell_cost(value)) for value in _ticks(low, high)],
        y_ticks=[(up(bottom + k * step), f"{bottom + k * step:g}") for k in range(count + 1)],
        lines=[
            " ".join(f"{one.x},{one.y}" for one in group)
            for group in map(_by_cost, groups.values())
        ],
        points=placed,
        equal_y=up(None) if some_equal else None,
    )


def _by_cost(group: list[Placed]) -> list[Placed]:
    return sorted(group, key=lambda one: one.x)


def _step(span: float) -> float:
    """Of dB between ticks, for six ticks or fewer."""
    return next(step for step in (1, 2, 5, 10, 20, 50, 1000) if span / step <= 6)


def _ticks(low: float, high: float) -> list[float]:
    """1, 2, 5 of every power of ten in between; powers alone where there are many, more if few."""
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)

    def between(*steps: float) -> list[float]:
        found = [step * 10.0**exponent for exponent in exponents for step in steps]
        return [value for value in found if low <= value <= high]

    if math.log10(high / low) > _MOST_DECADES_WITH_ALL_STEPS:
        return between(1)
    usual = between(1, 2, 5)
    # Of these no two neighbours are as far apart as the ends of the shortest axis.
    return usual if len(usual) > 1 else between(1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9)
