"""The benchmark: every photo is vectorised with every setting. Tables and plots show the results.

Runs are made one at a time, each in its own process. A table has a row for each setting, with means
over the photos: the cost, the scores, and the distance below the Pareto fronts. For each score
there are two plots, which are SVGs: the score over CPU seconds, and the score over gzipped bytes.
"""

from __future__ import annotations

import itertools
import operator
import os
import statistics
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gauss2svg.batch.inputs import ListedPhoto, listed_photos
from gauss2svg.compare import BenchOptions
from gauss2svg.compare.chart import Cost, machine_text, scatter, template_environment
from gauss2svg.compare.grid import FOLDER, Grid, Task, csv_text
from gauss2svg.compare.records import COUNTS, TOOL, Row
from gauss2svg.compare.run import measure_run
from gauss2svg.compare.variants import GRIDS, Variant, entries_of, peer_variants, settings_of
from gauss2svg.files import as_json, write_all_atomically
from gauss2svg.measure import PSNR, SCORES, Score
from gauss2svg.options import file_name
from gauss2svg.photo import DEFAULT_MAX_PIXELS
from gauss2svg.photo.load import load_image
from gauss2svg.pipeline.plan import PRESETS
from gauss2svg.pipeline.run import thread_count
from gauss2svg.pool import Pool
from gauss2svg.version import __version__

# {name of a Pareto front: keys of the costs that count for this front}. Each front has a column in
# the table. For example, the column of the front "both" is below_both_dB.
_BELOW = {"seconds": ("cpu_s",), "bytes": ("svgz_bytes",), "both": ("cpu_s", "svgz_bytes")}
# Columns of the table in summary.md: heading, key in a row, number format, and the factor by which
# the number is multiplied.
_COLUMNS = (
    *((axis.title, axis.key, axis.form, 1) for axis in SCORES),
    ("hue error, largest", "hue_error_svg", ".1f", 1),
    ("hue error, 99.9 %", "hue_error_999_svg", ".1f", 1),
    ("CPU s", "cpu_s", ".3g", 1),
    ("wall s", "total_s", ".3g", 1),
    ("kB raw", "svg_bytes", ".1f", 1e-3),
    ("kB gzipped", "svgz_bytes", ".1f", 1e-3),
    ("peak MB", "peak_bytes", ".0f", 1e-6),
    *((name, key, ".1f", 1) for key, name in COUNTS.items()),
    *((f"below by {word}, dB", f"below_{word}_dB", ".2f", 1) for word in _BELOW),
)
_COSTS = (
    Cost("cpu_s", "seconds", "CPU seconds"),
    # Files are compared by their gzipped sizes, because web servers send SVGs gzipped. This is fair
    # to raster images too, because gzip hardly changes their sizes.
    Cost("svgz_bytes", "bytes", "bytes, gzipped"),
)
_PLOT_NAMES = {f"{axis.slug}_{cost.unit}.svg" for axis in SCORES for cost in _COSTS}


def summarise(rows: Iterable[Row], images: int) -> list[Row]:
    """Return one row for each setting that has finished for all photos.

    If another tool has failed for some photos, its row is about the other photos.

    rows    records, in which all records of a setting follow one another
    images  number of photos

    The numbers of a row are means over the photos, except for peak_bytes, which is the maximum. If
    a value of one photo is None, the mean is None. The mean PSNR of each row leaves out the photos
    of `exact_photos`.

    The entries below_*_dB say how many dB the mean PSNR of a setting is below a Pareto front. At
    this setting, the front is the best mean PSNR of those settings of gauss2svg that do not cost
    more than this one. There are three fronts: for the cost in CPU seconds, for the cost in gzipped
    bytes, and for both costs together. The entries are None for other tools, and for a setting
    whose mean PSNR is None.
    """
    rows, summary = list(rows), []
    exact = exact_photos(rows, images)
    keys = [key for _, key, *_ in _COLUMNS if not key.startswith(("below", "peak"))]
    for _, group in itertools.groupby(rows, operator.itemgetter("label")):
        records = list(group)
        runs = [row for row in records if "error" not in row]
        least = images if records[0]["tool"] == TOOL else 1
        if len(records) < images or len(runs) < least:
            continue
        values: dict[str, list[Any]] = {name: [row.get(name) for row in runs] for name in keys}
        others = [row for row in runs if row["image"] not in exact]
        values["psnr_svg"] = [row.get("psnr_svg") for row in others] or [None]
        names = ("label", "tool", "tool_version", "settings")
        mean = {
            **{name: runs[0][name] for name in names},
            "images": len(runs),
            **{n: None if None in v else statistics.fmean(v) for n, v in values.items()},
            "peak_bytes": max(filter(None, (row["peak_bytes"] for row in runs)), default=None),
            **{f"below_{word}_dB": None for word in _BELOW},
        }
        summary.append(mean)
    # A row whose mean PSNR is infinite cannot be compared, so it is left out.
    own = [row for row in summary if row["tool"] == TOOL and row["psnr_svg"] is not None]
    for row in own:
        row |= {f"below_{word}_dB": below(row, own, PSNR, *costs) for word, costs in _BELOW.items()}
    return summary


def exact_photos(rows: Iterable[Row], images: int) -> set[str]:
    """Return the names of the photos that at least one setting of ours draws exactly.

    Return none if these are all photos, whose number is `images`.
    """
    names = {row["image"] for row in rows if row["tool"] == TOOL and is_exact(row)}
    return names if len(names) < images else set()


def is_exact(row: Row) -> bool:
    """Return whether a record is of a measured file that equals its photo.

    JSON has no infinity, so its PSNR is None.
    """
    return row.get("psnr_svg", 0) is None and bool(row.get("renderer"))


def below(row: Row, rows: Iterable[Row], axis: Score, *costs: str) -> float:
    """Return how much worse (>= 0) the score of `row` is than the best score at the same cost.

    This best score is the best one among those `rows` that do not cost more than `row`. A row costs
    more if at least one of its `costs` is larger.
    """
    affordable = [other for other in rows if all(other[cost] <= row[cost] for cost in costs)]
    return max(axis.sign * (other[axis.key] - row[axis.key]) for other in affordable)


def plots_of(summary: Sequence[Row]) -> dict[str, str]:
    """Return {file name: plot as SVG text}.

    A plot shows one score over one cost. It has a point for each setting, except for settings whose
    score is missing or infinite, or whose cost is missing. A plot without points is not made. A
    line joins the points on the Pareto front of gauss2svg. The tooltip of a point shows its label
    and its numbers.

    Each point belongs to a series. The points of a series have the same colour and shape. Each
    preset is a series, and so is each tool other than gauss2svg. Any other setting of gauss2svg is
    a series too. But if there are more than eight of these, they form one series together.
    """
    names = {row["label"]: row["label" if row["tool"] == TOOL else "tool"] for row in summary}
    others = [label for label, name in names.items() if label == name and name not in PRESETS]
    names |= dict.fromkeys(others, "other settings") if len(others) > 8 else {}
    series = list(dict.fromkeys(names.values()))
    template = template_environment().get_template("plot.svg.jinja")
    plots = {}
    for axis in SCORES:
        scored = [row for row in summary if row[axis.key] is not None]
        own = [row for row in scored if row["tool"] == TOOL]
        for cost in _COSTS if scored else ():
            # If several settings have the same score, only the cheapest of them is on the front.
            # After the sort, the cheapest comes last. So of these settings, only the cheapest stays
            # in the dict.
            own.sort(key=operator.itemgetter(cost.key), reverse=True)
            cheapest = {row[axis.key]: row for row in own}.values()
            front = [row["label"] for row in cheapest if not below(row, own, axis, cost.key)]
            points = [
                {
                    "cost": (price := row[cost.key]),
                    "score": (score := row[axis.key]),
                    "series": series.index(names[row["label"]]),
                    "group": 0 if row["label"] in front and len(front) > 1 else None,
                    "text": f"{row['label']}: {axis.text(score)}, {cost.text(price)}, "
                    f"photos: {row['images']}",
                }
                for row in scored
                if row[cost.key] is not None
            ]
            if points:
                plots[f"{axis.slug}_{cost.unit}.svg"] = template.render(
                    chart=scatter(points, cost, axis), score=axis.name, series=series
                )
    return plots


def run_bench(
    images: Sequence[str | os.PathLike[str]],
    directory: str | os.PathLike[str],
    *,
    axes: Mapping[str, Sequence[Any]] | None = None,
    peers: Iterable[str] = (),
    options: BenchOptions = BenchOptions(),
    progress: bool = False,
) -> list[Row]:
    """Vectorise every photo with all settings, each in its own process. Return the rows.

    images        paths of photos
    directory     folder of the tables and plots. It is created if it does not exist.
    axes          the values of each option of `vectorize` that is varied. Every combination is run,
                  with the other options at their defaults. If it is None, the settings are
                  gauss2svg.compare.variants.GRIDS. If it is empty, only peers are measured.
    peers         other tools, by their names in compare.records.PEERS. Tools that are not
                  installed are skipped. "mine=FOLDER" stands for the files of another method,
                  and "theirs=NUMBERS.csv" for its published numbers.
    options       limit of the runs of other tools and the number of threads
    progress      whether to show a bar on a terminal or in a notebook

    rows.jsonl, bench.json, bench.csv, summary.md and the plots are written after every run. The
    same call continues an interrupted benchmark. A row without an error is kept if its photo, its
    settings and the code have not changed. If a run fails, its row has an "error". Raise InputError
    for bad arguments and photos, and OutputError if the folder cannot be written, both before the
    first run.
    """
    thread_count(options.threads)
    others, absent = peer_variants(peers)
    own = settings_of(*(GRIDS if axes is None else [axes]))
    variants = [*map(Variant, own), *others]
    photos = listed_photos(images, "images")
    for photo in photos:
        load_image(photo.path)  # raises the error of a bad photo now and not after hours of runs
    entries = {variant: entries_of(variant.files, photos) for variant in variants}
    of_runs = {"threads": options.threads, "max_pixels": DEFAULT_MAX_PIXELS}

    def task_of(photo: ListedPhoto, variant: Variant) -> Task:
        # Other tools do not use the number of threads.
        dependencies = (options.threads if variant.is_own else None,)
        parameters = {"options": of_runs, "peer_timeout": options.peer_timeout}
        entry = entries[variant].get(photo, {})
        return Task(photo, variant, parameters, dependencies, {}, entry)

    plan = [task_of(photo, variant) for variant in variants for photo in photos]
    folder = Path(file_name("directory", directory, FOLDER))
    grid = Grid(folder / "rows.jsonl", plan, progress)
    # Each run has its own process, so that its memory can be measured.
    with Pool(1, reuses=False) as pool:
        for _ in grid.run(plan, pool, measure_run):
            _write_tables(folder, grid, absent)
    # If an earlier benchmark has left the records of all runs, the loop makes no run and writes no
    # tables. So the tables are also written here.
    return _write_tables(folder, grid, absent)


def _write_tables(folder: Path, grid: Grid, absent: Sequence[str]) -> list[Row]:
    """Write the tables and plots of the finished runs, and return the records of these runs."""
    images = list(dict.fromkeys(task.photo.name for task in grid.records))
    rows = [record for record in grid.records.values() if record]
    summary = summarise(rows, len(images))
    document = {
        "gauss2svg": __version__, "images": images, "peers_absent": absent,
        "summary": summary, "rows": rows,
    }  # fmt: skip
    cells = [row | ({"psnr_svg": "inf"} if is_exact(row) else {}) for row in rows]
    template = template_environment().overlay(autoescape=False).get_template("summary.md.jinja")
    text = template.render(
        **document,
        machines=dict.fromkeys(machine_text(row["machine"]) for row in rows),
        left_out=sorted(exact_photos(rows, len(images))),
        columns=_COLUMNS,
        tolerance=0.1,  # dB below the Pareto front up to which a setting counts as being on it
        exact={row["label"] for row in cells if row.get("psnr_svg") == "inf"},
    )
    plots = plots_of(summary)
    texts = {"bench.csv": csv_text(cells), "summary.md": text, **plots}
    tables = {"bench.json": as_json(document)} | {name: t.encode() for name, t in texts.items()}
    write_all_atomically({folder / name: data for name, data in tables.items()})
    # An earlier benchmark may have left plots that this one does not have. They are removed.
    for name in _PLOT_NAMES - plots.keys():
        (folder / name).unlink(missing_ok=True)
    return rows
