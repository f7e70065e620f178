"""The benchmark: every photo is run with every setting, and tables and plots show the results.

Runs are made one at a time, each in its own process. A table has a row for each setting, with means
over the photos: cost, scores, and the distance below the Pareto fronts. Two plots (SVG) show each
score over CPU seconds and over gzipped bytes.
"""

from __future__ import annotations

import hashlib
import itertools
import operator
import os
import platform
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gauss2svg.batch.listing import ListedPhoto, listed_photos
from gauss2svg.compare.chart import Cost, machine_text, scatter, template_environment
from gauss2svg.compare.grid import Grid, Progress, Task, csv_text, output_folder
from gauss2svg.compare.records import TOOL, Row
from gauss2svg.compare.run import measure_alone
from gauss2svg.compare.variants import Variant, peer_variants, settings_of
from gauss2svg.errors import refusal
from gauss2svg.files import as_json, write_all_atomically
from gauss2svg.measure import PSNR, SCORES, Score
from gauss2svg.options import Field
from gauss2svg.photo import DEFAULT_MAX_PIXELS
from gauss2svg.photo.load import load_image
from gauss2svg.pipeline.run import thread_count
from gauss2svg.pool import Pool
from gauss2svg.version import __version__

TOLERANCE = 0.1  # largest distance (dB) below a Pareto front that counts as on the front
# Columns that are averaged over the photos.
_MEANS = (
    *(axis.key for axis in SCORES), "psnr_svg_enlarged", "psnr_model", "cpu_s", "total_s",
    "svg_bytes", "svgz_bytes", "gaussians",
)  # fmt: skip
# Name of a Pareto front in columns such as below_both_dB -> keys of the costs of that front.
_BELOW = {"seconds": ("cpu_s",), "bytes": ("svgz_bytes",), "both": ("cpu_s", "svgz_bytes")}
# Columns of the table in summary.md: heading, key in a row, format, factor.
_COLUMNS = (
    *((axis.title, axis.key, axis.form, 1) for axis in SCORES),
    ("PSNR enlarged, dB", "psnr_svg_enlarged", ".2f", 1),
    ("CPU s", "cpu_s", ".3g", 1),
    ("wall s", "total_s", ".3g", 1),
    ("kB raw", "svg_bytes", ".1f", 1e-3),
    ("kB gzipped", "svgz_bytes", ".1f", 1e-3),
    ("peak MB", "peak_bytes", ".0f", 1e-6),
    *((f"below by {word}, dB", f"below_{word}_dB", ".2f", 1) for word in _BELOW),
)
_COSTS = (
    Cost("cpu_s", "seconds", "CPU seconds, after a warm-up"),
    # Web servers send SVGs gzipped. Raster images do not become smaller by gzip.
    Cost("svgz_bytes", "bytes", "bytes, gzipped"),
)
_LEAST_COST = 1e-4  # smallest cost in a plot, because a logarithmic axis has no 0
NAMES = tuple(f"{axis.slug}_{cost.unit}.svg" for axis in SCORES for cost in _COSTS)
_MOST_SERIES = 8  # number of settings without a preset above which they share one colour in plots


def summarise(rows: Iterable[Row], images: int) -> list[Row]:
    """Return one row for each setting that has finished for all photos.

    rows    records. All records of a setting follow one another
    images  number of photos

    Values are means over the photos. A mean is None if one of its values is None, such as an
    infinite PSNR. peak_bytes is the maximum. below_*_dB is how far the mean PSNR is below that of
    the best setting of gauss2svg that costs no more: in CPU seconds, in gzipped bytes, or in both.
    It is None for peers, which have no front, and if the mean PSNR is None.
    """
    finished = (row for row in rows if "error" not in row)
    summary = []
    for _, group in itertools.groupby(finished, operator.itemgetter("label")):
        runs = list(group)
        values: dict[str, list[Any]] = {name: [row.get(name) for row in runs] for name in _MEANS}
        names = ("label", "tool", "tool_version", "preset", "settings")
        mean = {
            **{name: runs[0][name] for name in names},
            "images": len(runs),
            **{n: None if None in v else statistics.fmean(v) for n, v in values.items()},
            "peak_bytes": max(filter(None, (row["peak_bytes"] for row in runs)), default=None),
            **{f"below_{word}_dB": None for word in _BELOW},
        }
        summary += [mean] * (len(runs) == images)
    # A mean PSNR of None, which includes an infinite one, cannot be compared.
    own = [row for row in summary if row["tool"] == TOOL and row["psnr_svg"] is not None]
    for row in own:
        row |= {f"below_{word}_dB": below(row, own, PSNR, *costs) for word, costs in _BELOW.items()}
    return summary


def below(row: Row, rows: Iterable[Row], axis: Score, *costs: str) -> float:
    """Return how far (>= 0) the score of `row` is below the best in `rows` that cost no more."""
    affordable = [other for other in rows if all(other[cost] <= row[cost] for cost in costs)]
    return max(axis.sign * (other[axis.key] - row[axis.key]) for other in affordable)


def plots_of(summary: Sequence[Row]) -> dict[str, str]:
    """Return the plots as SVG text, by file name.

    A plot leaves out settings without a finite score. A score that no setting has gets no plot.
    Each tool and each preset is a series. The other settings are a series each, or together one if
    they are more than _MOST_SERIES. A line joins the Pareto front of gauss2svg. The tooltip of a
    point has its label and its numbers.
    """
    others = [row["label"] for row in summary if row["tool"] == TOOL and not row["preset"]]
    names = {row["label"]: row["label" if row["tool"] == TOOL else "tool"] for row in summary}
    names |= dict.fromkeys(others, "other settings") if len(others) > _MOST_SERIES else {}
    series = list(dict.fromkeys(names.values()))
    template = template_environment().get_template("plot.svg.jinja")
    plots = {}
    for axis in SCORES:
        scored = [row for row in summary if row[axis.key] is not None]
        own = [row for row in scored if row["tool"] == TOOL]
        for cost in _COSTS if scored else ():
            # If settings have equal scores, only the cheapest is on the front.
            own.sort(key=operator.itemgetter(cost.key), reverse=True)
            cheapest = {row[axis.key]: row for row in own}.values()
            front = [row["label"] for row in cheapest if not below(row, own, axis, cost.key)]
            points = [
                {
                    "cost": max(price := row[cost.key], _LEAST_COST),
                    "score": (score := row[axis.key]),
                    "series": series.index(names[row["label"]]),
                    "group": 0 if row["label"] in front and len(front) > 1 else None,
                    "text": f"{row['label']}: {axis.text(score)}, {cost.text(price)}",
                }
                for row in scored
            ]
            plots[f"{axis.slug}_{cost.unit}.svg"] = template.render(
                chart=scatter(points, cost, axis), score=axis.name, series=series
            )
    return plots


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
    """Vectorise every photo with all settings, each in its own process. Return the rows.

    images        paths of photos
    directory     folder of the tables and plots, created if missing
    axes          values for each option of `vectorize` to vary. Every combination is run, with the
                  other options at their defaults. None: gauss2svg.compare.variants.DEFAULT_GRID
    peers         names from gauss2svg.compare.peers.PEERS. Those not installed are skipped.
    threads       CPU threads of gauss2svg; None: one for each core
    peer_timeout  maximum time (s) that a peer may take for a photo
    references    folder with the SVG that each photo was made from: logo.svg for logo.png
    reference_scale  factor by which SVGs are enlarged to be compared with their references
    progress      called with a Progress when a run begins or ends

    rows.jsonl, bench.json, bench.csv, summary.md and the plots are written after every run. The
    same call continues an interrupted benchmark: it keeps rows of the same photo, settings and code
    that have no error. A run that fails is a row with "error". Raise InputError for bad arguments
    and photos, and OutputError if the folder cannot be written, both before the first run.
    """
    Field("seed", int, 0, 2**63 - 1).checked(seed)
    thread_count(threads)
    # System calls refuse a timeout of more than 24 days.
    Field("peer_timeout", float, 1e-3, 1e6).checked(peer_timeout)
    Field("reference_scale", float, 1e-3, 1000.0).checked(reference_scale)
    others, absent = peer_variants(peers)
    variants = [*map(Variant, settings_of(axes)), *others]
    photos = listed_photos(images, "images")
    for photo in photos:
        load_image(photo.path)  # report a bad photo now, not after hours of runs
    sources = {} if references is None else _references(photos, Path(references))
    versions = {"gauss2svg": __version__, "python": platform.python_version()}

    options = {"seed": seed, "threads": threads, "max_pixels": DEFAULT_MAX_PIXELS}

    def task_of(photo: ListedPhoto, variant: Variant) -> Task:
        # Other tools take neither a seed nor a number of threads.
        dependencies = [seed, threads] if variant.is_own else []
        parameters = {"options": options, "peer_timeout": peer_timeout}
        if source := sources.get(photo):
            parameters["reference"] = source, reference_scale
            dependencies += [hashlib.sha256(source.read_bytes()).hexdigest(), reference_scale]
        columns = {"seed": seed, "versions": versions | {variant.tool: variant.version}}
        return Task(photo, variant, parameters, tuple(dependencies), columns)

    plan = [task_of(photo, variant) for variant in variants for photo in photos]
    folder = output_folder(directory, _OUTPUTS)
    grid = Grid(folder / _ROWS, plan, progress)
    with Pool(1) as pool:
        for _ in grid.run(plan, pool, measure_alone):
            _write_tables(folder, grid, absent)
    return _write_tables(folder, grid, absent)  # the loop is empty if all runs are kept


def _references(photos: Sequence[ListedPhoto], folder: Path) -> dict[ListedPhoto, Path]:
    """Return the path of each photo's reference. Raise InputError if one is missing."""
    sources = {photo: folder / f"{Path(photo.path).stem}.svg" for photo in photos}
    for source in sources.values():
        if not source.is_file():
            needed = "a folder with an SVG for each photo"
            raise refusal("references", needed, f"no {source}", "another folder")
    return sources


def _write_tables(folder: Path, grid: Grid, absent: Sequence[str]) -> list[Row]:
    """Write the tables and plots of the finished runs, and return their rows."""
    images = list(dict.fromkeys(task.photo.name for task in grid.records))
    rows = [record for record in grid.records.values() if record]
    summary = summarise(rows, len(images))
    document = {
        "gauss2svg": __version__, "images": images, "peers_absent": absent,
        "summary": summary, "rows": rows,
    }  # fmt: skip
    template = template_environment().overlay(autoescape=False).get_template("summary.md.jinja")
    enlarged = any(row["psnr_svg_enlarged"] is not None for row in summary)
    text = template.render(
        **document,
        machines=dict.fromkeys(machine_text(row["machine"]) for row in rows),
        columns=[column for column in _COLUMNS if enlarged or column[1] != "psnr_svg_enlarged"],
        tolerance=TOLERANCE,
    )
    plots = plots_of(summary)
    texts = {"bench.csv": csv_text(rows), "summary.md": text, **plots}
    tables = {"bench.json": as_json(document)} | {name: t.encode() for name, t in texts.items()}
    write_all_atomically({folder / name: data for name, data in tables.items()})
    for name in set(NAMES) - plots.keys():  # plots that an earlier benchmark may have left
        (folder / name).unlink(missing_ok=True)
    return rows
