"""Plots of a benchmark's summary as SVG: PSNR over CPU seconds and over gzipped bytes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gauss2svg.bench import numbers
from gauss2svg.bench.chart import Point, scatter, template_environment
from gauss2svg.bench.front import front
from gauss2svg.bench.peers import PEERS
from gauss2svg.bench.rows import TOOL
from gauss2svg.bench.summary import BYTES, SECONDS
from gauss2svg.pipeline.presets import PRESETS

# (cost, its axis, its least value: a cost of 0 has no place on a logarithmic axis, its text in a
# tooltip, its text at a tick)
_PLOTS = {
    "psnr_seconds.svg": (
        SECONDS, "CPU seconds, after a warm-up", 1e-4, numbers.seconds, numbers.short_seconds,
    ),
    "psnr_bytes.svg": (BYTES, "bytes, gzipped", 1.0, numbers.size, numbers.short_size),
}  # fmt: skip
NAMES = tuple(_PLOTS)
# A series keeps its mark whichever others a plot has.
_SERIES = (*PRESETS, "other settings", *PEERS)


def plots_of(summary: Sequence[dict[str, Any]]) -> dict[str, str]:
    """The plots as SVG, by the names of their files; settings without a finite PSNR are left out.

    Each tool, each preset and all other settings are a series; a line joins the Pareto front of
    gauss2svg. The label and the numbers of a point are its tooltip.
    """
    rows = [row for row in summary if row["psnr_svg"] is not None]
    own = [row for row in rows if row["tool"] == TOOL]
    used = {_series(row) for row in rows}
    key = [(at, name) for at, name in enumerate(_SERIES) if at in used]
    template = template_environment().get_template("plot.svg.jinja")
    found = {}
    for name, (cost, axis, least, in_tooltip, at_tick) in _PLOTS.items():
        best = front([row["psnr_svg"] for row in own], [row[cost] for row in own])
        on_front = [own[at] for at in best] if len(best) > 1 else []
        points = [
            Point(
                cost=max(row[cost], least),
                psnr=row["psnr_svg"],
                series=_series(row),
                group=0 if row in on_front else None,
                text=f"{row['label']}: {numbers.decibels(row['psnr_svg'])}, "
                f"{in_tooltip(row[cost])}",
            )
            for row in rows
        ]
        found[name] = template.render(chart=scatter(points, at_tick), cost=axis, key=key)
    return found


def _series(row: dict[str, Any]) -> int:
    name = row["tool"] if row["tool"] != TOOL else row["preset"] or "other settings"
    return _SERIES.index(name)
