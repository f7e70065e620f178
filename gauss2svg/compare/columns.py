"""Means over the photos: cost and quality of each setting, and its distance below the fronts."""

from __future__ import annotations

import json
import math
import operator
import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from gauss2svg.compare.records import TOOL, Row, finite
from gauss2svg.measure.scores import SCORES

TOLERANCE = 0.1  # dB below a Pareto front that still count as on it
SECONDS = "cpu_s"
BYTES = "svgz_bytes"  # what a web server sends; a raster image has no smaller form
_MEANS = (
    *(axis.key for axis in SCORES), "psnr_svg_enlarged", "psnr_model", "cpu_s", "total_s",
    "svg_bytes", "svgz_bytes", "gaussians",
)  # fmt: skip
_DISTURBED = 0.1  # share of the CPU used by other programs, above which a run is reported
_LEAST_DISTURBANCE_S = 0.1
_DISTANCES = {
    "below_seconds_dB": (SECONDS,),
    "below_bytes_dB": (BYTES,),
    "below_both_dB": (SECONDS, BYTES),
}


def summarise(rows: Iterable[Row], images: int) -> list[Row]:
    """One row per setting that has finished for all photos.

    Values are means over the photos; peak_bytes is the largest. below_*_dB is how far the mean
    PSNR is below the best setting of gauss2svg that costs no more in CPU seconds, in gzipped
    bytes, and in both at once; None for peers, which have no front.
    """
    groups: dict[str, list[Row]] = {}
    for row in rows:
        if "error" not in row:
            name = json.dumps([row["tool"], row["tool_version"], row["settings"]], sort_keys=True)
            groups.setdefault(name, []).append(row)
    summary = [_mean(group) for group in groups.values() if len(group) == images]
    # With one exact result the mean PSNR is infinite and says nothing.
    own = [row for row in summary if row["tool"] == TOOL and row["psnr_svg"] is not None]
    for name, costs in _DISTANCES.items():
        columns = [[row[cost] for row in own] for cost in costs]
        distances = distance_below([row["psnr_svg"] for row in own], *columns)
        for row, distance in zip(own, distances, strict=True):
            row[name] = finite(distance)
    return summary


def _mean(group: Sequence[Row]) -> Row:
    first = group[0]
    peaks = [row["peak_bytes"] for row in group if row["peak_bytes"] is not None]
    return {
        **{name: first[name] for name in ("label", "tool", "tool_version", "preset", "settings")},
        "images": len(group),
        **{name: _mean_of([row.get(name) for row in group]) for name in _MEANS},
        "peak_bytes": max(peaks, default=None),
        **dict.fromkeys(_DISTANCES),
    }


def _mean_of(values: Sequence[float | None]) -> float | None:
    # None among the values, an infinite PSNR or one that a peer lacks, makes the mean None.
    known = [value for value in values if value is not None]
    return statistics.fmean(known) if len(known) == len(values) else None


_ENLARGED = "PSNR enlarged, dB"
_COLUMNS: dict[str, tuple[str, str, float]] = {
    **{axis.title: (axis.key, axis.form, 1) for axis in SCORES},
    _ENLARGED: ("psnr_svg_enlarged", ".2f", 1),
    "CPU s": ("cpu_s", ".3g", 1),
    "wall s": ("total_s", ".3g", 1),
    "kB raw": ("svg_bytes", ".1f", 1e-3),
    "kB gzipped": ("svgz_bytes", ".1f", 1e-3),
    "peak MB": ("peak_bytes", ".0f", 1e-6),
    "below by seconds, dB": ("below_seconds_dB", ".2f", 1),
    "below by bytes, dB": ("below_bytes_dB", ".2f", 1),
    "below by both, dB": ("below_both_dB", ".2f", 1),
}


def markdown(summary: Sequence[Row], rows: Sequence[Row], images: Sequence[str]) -> str:
    """The summary as a Markdown table, with the photos, the machines and the failed runs."""
    columns = dict(_COLUMNS)
    if all(row.get("psnr_svg_enlarged") is None for row in summary):  # no source was given
        del columns[_ENLARGED]
    lines = [
        "# Benchmark",
        "",
        f"Means over {_count(len(images), 'photo')}: {', '.join(images)}. Measured on",
        "; ".join(dict.fromkeys(_machine(row["machine"]) for row in rows)) + ".",
        "",
        "| settings | " + " | ".join(columns) + " |",
        "|---" * (len(columns) + 1) + "|",
    ]
    for row in summary:
        label = row["label"]
        on_front = row["below_both_dB"] is not None and row["below_both_dB"] <= TOLERANCE
        cells = [f"**{label}**" if on_front else label]
        cells += [_cell(row[name], form, scale) for name, form, scale in columns.values()]
        lines.append(f"| {' | '.join(cells)} |")
    lines += [
        "",
        f"Rows in bold are within {TOLERANCE} dB of the Pareto front: no other setting of",
        "gauss2svg takes as few CPU seconds and gzipped bytes and has a PSNR higher by more.",
    ]
    disturbed = sum(_disturbed(row) for row in rows)
    if disturbed:
        lines += [
            "",
            f"During {disturbed} of {_count(len(rows), 'run')} other programs used over "
            f"{_DISTURBED:.0%} of the CPU (other_cpu_s in bench.csv),",
            "so their times are too long. Delete their lines from rows.jsonl and run again to "
            "repeat them.",
        ]
    failed = [row for row in rows if "error" in row]
    if failed:
        lines += ["", "Failed:", ""]
        lines += [f"- {row['label']} on {row['image']}: {row['error']}" for row in failed]
    return "\n".join(lines) + "\n"


def _disturbed(row: Row) -> bool:
    others = row.get("other_cpu_s")
    # Counted in hundredths of a second: too coarse for very short runs.
    if others is None or others < _LEAST_DISTURBANCE_S:
        return False
    return others > _DISTURBED * row["total_s"] * row["machine"]["cores"]


def _cell(value: float | None, form: str, scale: float) -> str:
    return "" if value is None else format(value * scale, form)


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" + ("" if number == 1 else "s")


def _machine(machine: Mapping[str, Any]) -> str:
    return f"{machine['cpu']}, {_count(machine['cores'], 'core')}, {machine['platform']}"


def front(psnr: Sequence[float], cost: Sequence[float]) -> list[int]:
    """The Pareto front as indices, from the cheapest on; of equal entries the first."""
    best, found = -math.inf, []
    for index in sorted(range(len(psnr)), key=lambda i: (cost[i], -psnr[i], i)):
        if psnr[index] > best:
            best = psnr[index]
            found.append(index)
    return found


def distance_below(psnr: Sequence[float], *costs: Sequence[float]) -> list[float]:
    """Distance (dB, >= 0) of each below the best that costs no more in any respect."""
    known = list(zip(psnr, zip(*costs, strict=True), strict=True))
    found = []
    for mine, own in known:
        best = max(p for p, price in known if all(map(operator.le, price, own)))
        found.append(0.0 if best == mine else best - mine)  # infinite PSNRs have no difference
    return found
