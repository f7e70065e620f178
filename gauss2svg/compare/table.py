"""The benchmark: each run in a process of its own, one at a time, with tables and plots after each.

Its rows are means over the photos: the cost and quality of each setting, and its distance below the
fronts. Plots are SVG: each score over CPU seconds and over gzipped bytes.
"""

from __future__ import annotations

import hashlib
import json
import math
import operator
import os
import platform
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from gauss2svg.compare import chart
from gauss2svg.compare.chart import Point, counted, machine_text, scatter, template_environment
from gauss2svg.compare.grid import Grid, Progress, Task, output_folder
from gauss2svg.compare.peers import PEERS, check_peers
from gauss2svg.compare.records import TOOL, Row, csv_text, finite
from gauss2svg.compare.run import measured_alone
from gauss2svg.compare.variants import Variant, of_peer, settings_of
from gauss2svg.errors import InputError, number_within, whole_number
from gauss2svg.files import as_json, write_all_atomically
from gauss2svg.measure.scores import SCORES
from gauss2svg.photo.load import load_image
from gauss2svg.pipeline.listing import ListedPhoto, listed_photos
from gauss2svg.pipeline.run import thread_count
from gauss2svg.version import __version__

TOLERANCE = 0.1  # dB below a Pareto front that still count as on it
SECONDS = "cpu_s"
BYTES = "svgz_bytes"  # what a web server sends; a raster image has no smaller form
_MEANS = (
    *(axis.key for axis in SCORES), "psnr_svg_enlarged", "psnr_model", "cpu_s", "total_s",
    "svg_bytes", "svgz_bytes", "gaussians",
)  # fmt: skip
_DISTANCES = {
    "below_seconds_dB": (SECONDS,),
    "below_bytes_dB": (BYTES,),
    "below_both_dB": (SECONDS, BYTES),
}
# (heading, key, format, factor)
_COLUMNS = (
    *((axis.title, axis.key, axis.form, 1) for axis in SCORES),
    ("PSNR enlarged, dB", "psnr_svg_enlarged", ".2f", 1),
    ("CPU s", "cpu_s", ".3g", 1),
    ("wall s", "total_s", ".3g", 1),
    ("kB raw", "svg_bytes", ".1f", 1e-3),
    ("kB gzipped", "svgz_bytes", ".1f", 1e-3),
    ("peak MB", "peak_bytes", ".0f", 1e-6),
    ("below by seconds, dB", "below_seconds_dB", ".2f", 1),
    ("below by bytes, dB", "below_bytes_dB", ".2f", 1),
    ("below by both, dB", "below_both_dB", ".2f", 1),
)
_COSTS = (
    (SECONDS, "seconds", "CPU seconds, after a warm-up", chart.seconds, chart.short_seconds),
    (BYTES, "bytes", "bytes, gzipped", chart.size, chart.short_size),
)
_LEAST_COST = 1e-4  # drawn on the logarithmic axis, which has no 0
NAMES = tuple(f"{axis.slug}_{cost[1]}.svg" for axis in SCORES for cost in _COSTS)
_OTHERS = "other settings"
_MOST_SERIES = 8  # of other settings, each with a name and a colour of its own


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


def markdown(summary: Sequence[Row], rows: Sequence[Row], images: Sequence[str]) -> str:
    """Return the summary as Markdown, with the photos, the machines and the failed runs."""
    enlarged = any(row["psnr_svg_enlarged"] is not None for row in summary)
    template = template_environment().overlay(autoescape=False).get_template("summary.md.jinja")
    return template.render(
        photos=counted(len(images), "photo"),
        images=images,
        machines=dict.fromkeys(machine_text(row["machine"]) for row in rows),
        columns=[one for one in _COLUMNS if enlarged or one[1] != "psnr_svg_enlarged"],
        summary=summary,
        tolerance=TOLERANCE,
        failed=[row for row in rows if "error" in row],
    )


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


def plots_of(summary: Sequence[Row]) -> dict[str, str]:
    """Return the plots as SVG, by the names of their files.

    Settings without a finite score are left out, and a score that no setting has has no plot.
    Each tool and each preset is a series, and each other setting where these are few. A line joins
    the Pareto front of gauss2svg. The label and the numbers of a point are its tooltip.
    """
    plain = {row["label"] for row in summary if _series_name(row) == row["label"] != row["preset"]}
    others = plain if len(plain) > _MOST_SERIES else set()
    names = [_OTHERS if row["label"] in others else _series_name(row) for row in summary]
    series = list(dict.fromkeys(names))
    template = template_environment().get_template("plot.svg.jinja")
    plots = {}
    for axis in SCORES:
        known = [at for at, row in enumerate(summary) if row[axis.key] is not None]
        shown = {names[at] for at in known}
        own = [at for at in known if summary[at]["tool"] == TOOL]
        heights = [axis.sign * summary[at][axis.key] for at in own]
        for key, word, title, in_tooltip, at_tick in _COSTS if known else ():
            best = front(heights, [summary[at][key] for at in own])
            on_front = {own[at] for at in best} if len(best) > 1 else ()
            points = [
                Point(
                    cost=max(row[key], _LEAST_COST),
                    score=row[axis.key],
                    series=series.index(names[at]),
                    group=0 if at in on_front else None,
                    text=f"{row['label']}: {axis.text(row[axis.key])}, {in_tooltip(row[key])}",
                )
                for at in known
                for row in [summary[at]]
            ]
            plots[f"{axis.slug}_{word}.svg"] = template.render(
                chart=scatter(points, at_tick, axis),
                score=axis.name,
                cost=title,
                key=[(at, name) for at, name in enumerate(series) if name in shown],
            )
    return plots


def _series_name(row: Row) -> str:
    return row["tool"] if row["tool"] != TOOL else row["preset"] or row["label"]


_ROWS = "rows.jsonl"
_OUTPUTS = (_ROWS, "bench.json", "bench.csv", "summary.md", *NAMES)


def run_bench(
    images: Sequence[str | os.PathLike[str]],
    directory: str | os.PathLike[str],
    *,
    axes: Mapping[str, Sequence[Any]] | None = None,
    peers: Iterable[str] = (),
    seed: int = 0,
    threads: int | None = None,
    peer_timeout: float = 300.0,
    references: str | os.PathLike[str] | None = None,
    reference_scale: float = 4.0,
    progress: Callable[[Progress], None] | None = None,
) -> list[Row]:
    """Vectorise every photo with all settings, each in its own process; return the rows.

    images        paths of photos
    directory     folder of the tables and plots, created if missing
    axes          values by option of `vectorize`: every combination is run, with the other
                  options at their defaults; None: gauss2svg.compare.variants.DEFAULT_GRID
    peers         names from gauss2svg.compare.peers.PEERS; those not installed are skipped
    threads       CPU threads of gauss2svg; None: one per core
    peer_timeout  time limit (s) of a peer's run
    references    folder with the SVG that each photo was made from, by the photo's name; SVGs are
                  compared with it at reference_scale times the photo's size
    progress      called with a Progress whenever a run begins or ends

    After every run rows.jsonl, bench.json, bench.csv, summary.md and the plots are written, so an
    interrupted benchmark continues: rows without error of the same photo, settings and code are
    kept. A run that fails is a row with "error". Raise InputError for bad arguments and photos
    and OutputError for a folder that cannot be written, both before the first run.
    """
    whole_number("seed", seed, 0, 2**63 - 1)
    thread_count(threads)
    # The system's calls take no more than 24 days.
    number_within("peer_timeout", peer_timeout, 1e-3, 1e6)
    present, absent = check_peers(peers)
    variants = [Variant(settings) for settings in settings_of(axes)]
    variants += [of_peer(peer, settings) for peer in present for settings in PEERS[peer].settings]
    number_within("reference_scale", reference_scale, 1e-3, 1000.0)
    photos = listed_photos(images, "images")
    for photo in photos:
        load_image(photo.path)  # a bad photo is reported now, not after hours of runs
    sources = {} if references is None else _sources(photos, references)
    plan = [
        _task(photo, variant, seed, threads, (sources[photo], reference_scale) if sources else ())
        for variant in variants
        for photo in photos
    ]
    folder = output_folder(directory, _OUTPUTS)
    grid = Grid(folder / _ROWS, plan, progress)

    def alone(task: Task) -> Future[Row]:
        assert task.variant is not None
        request = {
            "source": task.photo.path,
            "tool": task.variant.tool,
            "settings": dict(task.variant.settings),
            "options": {"seed": seed, "threads": threads},
            "peer_timeout": peer_timeout,
            "reference": sources.get(task.photo),
            "reference_scale": reference_scale,
        }
        job = Future[Row]()
        job.set_result(measured_alone(request))
        return job

    for _ in grid.run(plan, alone, 1):
        _write_tables(folder, grid.rows, photos, absent)
    _write_tables(folder, grid.rows, photos, absent)  # of a plan whose runs are all kept
    return grid.rows


def _sources(
    photos: Sequence[ListedPhoto], folder: str | os.PathLike[str]
) -> dict[ListedPhoto, str]:
    """Return the SVG of each photo in a folder; raise InputError where one is missing."""
    sources = {photo: f"{Path(folder) / Path(photo.path).stem}.svg" for photo in photos}
    for source in sources.values():
        if not Path(source).is_file():
            raise InputError(
                f"references must have an SVG for each photo; got no {source}. Try another folder"
            )
    return sources


def _task(
    photo: ListedPhoto, variant: Variant, seed: int, threads: int | None, reference: Sequence[Any]
) -> Task:
    """Return a run; reference: path of the source and scale, or nothing."""
    # Other tools are given neither seed nor threads.
    others: tuple[Any, ...] = (seed, threads) if variant.is_own else ()
    for source, scale in [reference] if reference else []:
        others += hashlib.sha256(Path(source).read_bytes()).hexdigest(), scale
    versions = {"gauss2svg": __version__, "python": platform.python_version()}
    versions |= {variant.tool: variant.version}
    return Task(photo, variant, others, {"seed": seed, "versions": versions})


def _write_tables(
    folder: Path, rows: Sequence[Row], photos: Sequence[ListedPhoto], absent: Sequence[str]
) -> None:
    names = [photo.name for photo in photos]
    summary = summarise(rows, len(names))
    document = {
        "gauss2svg": __version__,
        "images": names,
        "peers_absent": absent,
        "summary": summary,
        "rows": rows,
    }
    plots = plots_of(summary)
    texts = {"bench.csv": csv_text(rows), "summary.md": markdown(summary, rows, names), **plots}
    tables = {"bench.json": as_json(document)} | {name: t.encode() for name, t in texts.items()}
    write_all_atomically({folder / name: data for name, data in tables.items()})
    for name in set(NAMES) - plots.keys():  # of an earlier benchmark that had this score
        (folder / name).unlink(missing_ok=True)
