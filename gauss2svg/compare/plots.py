"""Plots of a benchmark's summary as SVG: each score over CPU seconds and over gzipped bytes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from gauss2svg.compare import chart
from gauss2svg.compare.chart import Point, scatter, template_environment
from gauss2svg.compare.columns import BYTES, SECONDS, front
from gauss2svg.compare.peers import PEERS
from gauss2svg.compare.records import TOOL
from gauss2svg.measure.scores import SCORES, Score
from gauss2svg.pipeline.presets import PRESETS

# (cost, its axis, its least value: a cost of 0 has no place on a logarithmic axis, its text in a
# tooltip, its text at a tick)
_COSTS = {
    "seconds": (
        SECONDS, "CPU seconds, after a warm-up", 1e-4, chart.seconds, chart.short_seconds,
    ),
    "bytes": (BYTES, "bytes, gzipped", 1.0, chart.size, chart.short_size),
}  # fmt: skip
NAMES = tuple(f"{axis.slug}_{cost}.svg" for axis in SCORES for cost in _COSTS)
# A series keeps its mark whichever others a plot has.
_OTHERS = "other settings"
_SERIES = (*PRESETS, _OTHERS, *PEERS)
_COLORS = 8  # of the template
_FIRST = -(-len(_SERIES) // _COLORS) * _COLORS  # of further series, each of a colour of its own


def plots_of(summary: Sequence[dict[str, Any]]) -> dict[str, str]:
    """The plots as SVG, by the names of their files; settings without a finite score are left out.

    A score that no setting has gets no plot. Each tool and each preset is a series, and each other
    setting where these are no more than there are colours; a line joins the Pareto front of
    gauss2svg. The label and the numbers of a point are its tooltip.
    """
    return {
        f"{axis.slug}_{cost}.svg": _plot(summary, axis, *_COSTS[cost])
        for axis in SCORES
        if any(row[axis.key] is not None for row in summary)
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
    names = _series_of(summary)
    used = {names[_name(row)] for row in rows}
    best = front([axis.sign * row[axis.key] for row in own], [row[cost] for row in own])
    on_front = [own[at] for at in best] if len(best) > 1 else []
    points = [
        Point(
            cost=max(row[cost], least),
            score=row[axis.key],
            series=names[_name(row)],
            group=0 if row in on_front else None,
            text=f"{row['label']}: {axis.text(row[axis.key])}, {in_tooltip(row[cost])}",
        )
        for row in rows
    ]
    return (
        template_environment()
        .get_template("plot.svg.jinja")
        .render(
            chart=scatter(points, at_tick, axis),
            score=axis.name,
            cost=cost_title,
            key=sorted({at: name for name, at in names.items() if at in used}.items()),
        )
    )


def _series_of(summary: Sequence[dict[str, Any]]) -> dict[str, int]:
    """The series of each name, by its number; all other settings are one if there are many."""
    labels = dict.fromkeys(_name(row) for row in summary if _name(row) not in _SERIES)
    series = {name: at for at, name in enumerate(_SERIES)}
    if len(labels) > _COLORS:
        return dict.fromkeys(labels, series[_OTHERS]) | series
    return series | {label: _FIRST + at for at, label in enumerate(labels)}


def _name(row: dict[str, Any]) -> str:
    return row["tool"] if row["tool"] != TOOL else row["preset"] or row["label"]
