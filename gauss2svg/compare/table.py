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
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from gauss2svg.compare import chart
from gauss2svg.compare.chart import Point, scatter, template_environment
from gauss2svg.compare.grid import Grid, Progress, Task
from gauss2svg.compare.machine import machine
from gauss2svg.compare.peers import PEERS, check_peers
from gauss2svg.compare.records import TOOL, Row, add_row, csv_text, finite, rows_in
from gauss2svg.compare.run import measured_alone
from gauss2svg.compare.variants import Variant, of_peer, settings_of
from gauss2svg.errors import InputError, number_within, whole_number
from gauss2svg.files import as_json, check_writable, make_folder, write_all_atomically
from gauss2svg.measure.scores import SCORES, Score
from gauss2svg.options import file_name
from gauss2svg.photo.load import load_image
from gauss2svg.pipeline.listing import ListedPhoto, listed_photos
from gauss2svg.pipeline.presets import PRESETS
from gauss2svg.pipeline.run import thread_count
from gauss2svg.version import __version__

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
    """Return the summary as Markdown, with the photos, the machines and the failed runs."""
    columns = dict(_COLUMNS)
    if all(row.get("psnr_svg_enlarged") is None for row in summary):  # no source was given
        del columns[_ENLARGED]

    def cells(row: Row) -> Iterator[str]:
        below = row["below_both_dB"]
        yield f"**{row['label']}**" if below is not None and below <= TOLERANCE else row["label"]
        for name, form, scale in columns.values():
            yield "" if row[name] is None else format(row[name] * scale, form)

    template = template_environment().overlay(autoescape=False).get_template("summary.md.jinja")
    return template.render(
        photos=_count(len(images), "photo"),
        images=images,
        machines=dict.fromkeys(_machine(row["machine"]) for row in rows),
        columns=list(columns),
        table=[list(cells(row)) for row in summary],
        tolerance=TOLERANCE,
        disturbed=sum(_disturbed(row) for row in rows),
        runs=_count(len(rows), "run"),
        share=f"{_DISTURBED:.0%}",
        failed=[row for row in rows if "error" in row],
    )


def _disturbed(row: Row) -> bool:
    others = row.get("other_cpu_s") or 0.0
    # Counted in hundredths of a second: too coarse for very short runs.
    least = _DISTURBED * row.get("total_s", 0.0) * row["machine"]["cores"]
    return others >= _LEAST_DISTURBANCE_S and others > least


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
    """Vectorise every photo with all settings, each in its own process; returns the rows.

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
    interrupted benchmark continues: rows without error of the same photo, settings and version
    are kept. A run that fails is a row with "error". Raises InputError for bad arguments and
    photos and OutputError for a folder that cannot be written, both before the first run.
    """
    whole_number("seed", seed, 0, 2**63 - 1)
    thread_count(threads)
    # The system's calls take no more than 24 days.
    number_within("peer_timeout", peer_timeout, 1e-3, 1e6)
    present, absent = check_peers(peers)
    variants = [Variant(settings) for settings in settings_of(axes)]
    variants += [of_peer(peer, settings) for peer in present for settings in PEERS[peer].settings]
    number_within("reference_scale", reference_scale, 1e-3, 1000.0)
    photos = _photos(images)
    sources = {} if references is None else _sources(photos, references)
    given = {"options": {"seed": seed, "threads": threads}, "peer_timeout": peer_timeout}
    given |= {"reference_scale": reference_scale}
    plan = [
        _task(photo, variant, {**given, "reference": sources.get(photo)})
        for variant in variants
        for photo in photos
    ]
    folder = Path(file_name("directory", directory, "the name of a folder"))
    make_folder(folder)
    for name in _OUTPUTS:
        check_writable(folder / name)
    known = rows_in(folder / _ROWS)  # those of other settings and versions are kept as well

    def finished(task: Task) -> Row | None:
        row = known.get(task.key, {"error": "not run yet"})
        return None if "error" in row else row

    grid = Grid(finished, len(plan), progress)

    def write() -> list[Row]:
        # A kept row may have the name that its photo had then.
        found = [task for task in plan if task.place in grid.records]
        rows = [grid.records[task.place] | {"image": task.photo.name} for task in found]
        files = _tables(rows, [photo.name for photo in photos], absent)
        write_all_atomically({folder / name: data for name, data in files.items()})
        for name in set(NAMES) - files.keys():  # of an earlier benchmark that had this score
            (folder / name).unlink(missing_ok=True)
        return rows

    def alone(request: Row) -> Future[Row]:
        job = Future[Row]()
        job.set_result(measured_alone(request))
        return job

    for task, answer in grid.answers(grid.missing(plan), alone, 1):
        grid.records[task.place] = _row(task, seed) | answer
        # Appended, so that a second benchmark into the folder and later versions keep theirs.
        add_row(folder / _ROWS, grid.records[task.place])
        write()
    return write()


def _photos(images: Sequence[str | os.PathLike[str]]) -> list[ListedPhoto]:
    """The photos; raises InputError for one that cannot be read and for copies."""
    photos = listed_photos(images, "images")
    known: dict[str | None, str] = {}
    for photo in photos:
        load_image(photo.path)  # a bad photo is reported now, not after hours of runs
        if photo.digest in known:
            raise InputError(
                f"{photo.path} must not be the same photo as {known[photo.digest]}. "
                "Try giving it once"
            )
        known[photo.digest] = photo.path
    return photos


def _sources(
    photos: Sequence[ListedPhoto], folder: str | os.PathLike[str]
) -> dict[ListedPhoto, str]:
    """The SVG of each photo in a folder; raises InputError where one is missing."""
    sources = {}
    for photo in photos:
        source = Path(folder) / f"{Path(photo.path).stem}.svg"
        if not source.is_file():
            raise InputError(
                f"references must have an SVG for each photo; got no {source}. Try another folder"
            )
        sources[photo] = str(source)
    return sources


def _task(photo: ListedPhoto, variant: Variant, given: Mapping[str, Any]) -> Task:
    request = {
        "source": photo.path,
        "tool": variant.tool,
        "settings": dict(variant.settings),
        **given,
    }
    # Other tools are given neither.
    others: tuple[Any, ...] = tuple(given["options"].values()) if variant.is_own else ()
    if given["reference"] is not None:
        digest = hashlib.sha256(Path(given["reference"]).read_bytes()).hexdigest()
        others += digest, given["reference_scale"]
    return Task(photo, variant, request, others)


def _tables(rows: Sequence[Row], names: Sequence[str], absent: Sequence[str]) -> dict[str, bytes]:
    summary = summarise(rows, len(names))
    document = {
        "gauss2svg": __version__,
        "images": names,
        "peers_absent": absent,
        "summary": summary,
        "rows": rows,
    }
    texts = {
        "bench.csv": csv_text(rows),
        "summary.md": markdown(summary, rows, names),
        **plots_of(summary),
    }
    return {"bench.json": as_json(document)} | {name: t.encode() for name, t in texts.items()}


def _row(task: Task, seed: int) -> Row:
    """What is known of a run beside what its worker answers."""
    variant = task.variant
    assert variant is not None
    versions = {"gauss2svg": __version__, "python": platform.python_version()}
    return {
        "key": task.key,
        "label": variant.label,
        "preset": variant.preset,
        "tool": variant.tool,
        "tool_version": variant.version,
        "image": task.photo.name,
        "image_sha256": task.photo.digest,
        "settings": dict(variant.settings),
        "seed": seed,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": machine(),
        "versions": versions if variant.is_own else {**versions, variant.tool: variant.version},
    }
