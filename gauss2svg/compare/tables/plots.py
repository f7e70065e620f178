"""Plots of a benchmark's summary as SVG: each score over CPU seconds and over gzipped bytes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from gauss2svg.compare import numbers
from gauss2svg.compare.chart import Point, scatter, template_environment
from gauss2svg.compare.peers import PEERS
from gauss2svg.compare.records import TOOL
from gauss2svg.compare.tables.columns import BYTES, SECONDS, front
from gauss2svg.measure.scores import SCORES, Score
from gauss2svg.pipeline.presets import PRESETS

# (cost, its axis, its least value: a cost of 0 has no place on a logarithmic axis, its text in a
# tooltip, its text at a tick)
_COSTS = {
    "seconds": (
        SECONDS, "CPU seconds, after a warm-up", 1e-4, numbers.seconds, numbers.short_seconds,
    ),
    "bytes": (BYTES, "bytes, gzipped", 1.0, numbers.size, numbers.short_size),
}  # fmt: skip
NAMES = tuple(f"{axis.slug}_{cost}.svg" for axis in SCORES for cost in _COSTS)
# A series keeps its mark whichever others a plot has.
_SERIES = (*PRESETS, "other settings", *PEERS)


def plots_of(summary: Sequence[dict[str, Any]]) -> dict[str, str]:
    """The plots as SVG, by the names of their files; settings without a finite score are left out.

    Each tool, each preset and all other settings are a series; a line joins the Pareto front of
    gauss2svg. The label and the numbers of a point are its tooltip.
    """
    return {
        f"{axis.slug}_{cost}.svg": _plot(summary, axis, *_COSTS[cost])
        for axis in SCORES
        for cost in _COSTS
    }


def _plot(
    summary: Sequence[dict[str, Any]],
    axis: Score,
    cost: str,
    cost_title: str,
    least: float,
    in_tooltip: Callable[[float | None], str],
    at_tick: Callable[[float], str],
) -> str:
    rows = [row for row in summary if row[axis.key] is not None]
    own = [row for row in rows if row["tool"] == TOOL]
    used = {_series(row) for row in rows}
    best = front([axis.sign * row[axis.key] for row in own], [row[cost] for row in own])
    on_front = [own[at] for at in best] if len(best) > 1 else []
    points = [
        Point(
            cost=max(row[cost], least),
            score=row[axis.key],
            series=_series(row),
            group=0 if row in on_front else None,
            text=f"{row['label']}: {axis.text(row[axis.key])}, {in_tooltip(row[cost])}",
        )
        for row in rows
    ]
    return (
        template_environment("gauss2svg.compare.tables")
        .get_template("plot.svg.jinja")
        .render(
            chart=scatter(points, at_tick, axis),
            score=axis.name,
            cost=cost_title,
            key=[(at, name) for at, name in enumerate(_SERIES) if at in used],
        )
    )


def _series(row: dict[str, Any]) -> int:
    name = row["tool"] if row["tool"] != TOOL else row["preset"] or "other settings"
    return _SERIES.index(name)
