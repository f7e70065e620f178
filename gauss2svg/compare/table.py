"""The benchmark: each run in a process of its own, one at a time, with tables and plots after each.

Its rows are means over the photos: the cost and quality of each setting, and its distance below the
fronts. Plots are SVG: each score over CPU seconds and over gzipped bytes.
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

from gauss2svg.compare.chart import Cost, machine_text, scatter, template_environment
from gauss2svg.compare.grid import Grid, Progress, Task, csv_text, output_folder
from gauss2svg.compare.records import TOOL, Row
from gauss2svg.compare.run import measured_alone
from gauss2svg.compare.variants import Variant, of_peers, settings_of
from gauss2svg.errors import refusal
from gauss2svg.files import as_json, write_all_atomically
from gauss2svg.measure.scores import PSNR, SCORES, Score
from gauss2svg.options import Field
from gauss2svg.photo.formats import DEFAULT_MAX_PIXELS
from gauss2svg.photo.load import load_image
from gauss2svg.pipeline.listing import ListedPhoto, listed_photos
from gauss2svg.pipeline.run import thread_count
from gauss2svg.pool import Pool
from gauss2svg.version import __version__

TOLERANCE = 0.1  # dB below a Pareto front that still count as on it
_MEANS = (
    *(axis.key for axis in SCORES), "psnr_svg_enlarged", "psnr_model", "cpu_s", "total_s",
    "svg_bytes", "svgz_bytes", "gaussians",
)  # fmt: skip
_BELOW = {"seconds": ("cpu_s",), "bytes": ("svgz_bytes",), "both": ("cpu_s", "svgz_bytes")}
# (heading, key, format, factor)
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
    # What a web server sends; a raster image has no smaller form.
    Cost("svgz_bytes", "bytes", "bytes, gzipped"),
)
_LEAST_COST = 1e-4  # drawn on the logarithmic axis, which has no 0
NAMES = tuple(f"{axis.slug}_{cost.unit}.svg" for axis in SCORES for cost in _COSTS)
_MOST_SERIES = 8  # of other settings, each with a name and a colour of its own


def summarise(rows: Iterable[Row], images: int) -> list[Row]:
    """Return one row per setting that has finished for all photos; its rows stand together.

    Values are means over the photos, None where one of them is None: an infinite PSNR, or one that
    a peer lacks. peak_bytes is the largest. below_*_dB is how far the mean PSNR is below the best
    setting of gauss2svg that costs no more in CPU seconds, in gzipped bytes, and in both at once;
    None for peers, which have no front.
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
    # With one exact result the mean PSNR is infinite and says nothing.
    own = [row for row in summary if row["tool"] == TOOL and row["psnr_svg"] is not None]
    for row in own:
        row |= {f"below_{word}_dB": below(row, own, PSNR, *costs) for word, costs in _BELOW.items()}
    return summary


def below(row: Row, rows: Iterable[Row], axis: Score, *costs: str) -> float:
    """Return how far (>= 0) a row is below the best of rows that cost no more in any respect."""
    affordable = [one for one in rows if all(one[cost] <= row[cost] for cost in costs)]
    return max(axis.sign * (one[axis.key] - row[axis.key]) for one in affordable)


def plots_of(summary: Sequence[Row]) -> dict[str, str]:
    """Return the plots as SVG, by the names of their files.

    Settings without a finite score are left out, and a score that no setting has has no plot.
    Each tool and each preset is a series, and each other setting where these are few. A line joins
    the Pareto front of gauss2svg. The label and the numbers of a point are its tooltip.
    """
    plain = [row["label"] for row in summary if row["tool"] == TOOL and not row["preset"]]
    names = {row["label"]: row["label" if row["tool"] == TOOL else "tool"] for row in summary}
    names |= dict.fromkeys(plain, "other settings") if len(plain) > _MOST_SERIES else {}
    series = list(dict.fromkeys(names.values()))
    template = template_environment().get_template("plot.svg.jinja")
    plots = {}
    for axis in SCORES:
        known = [row for row in summary if row[axis.key] is not None]
        own = [row for row in known if row["tool"] == TOOL]
        for cost in _COSTS if known else ():
            # Of settings with one score, the cheapest.
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
                for row in known
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
    Field("seed", int, 0, 2**63 - 1).checked(seed)
    thread_count(threads)
    # The system's calls take no more than 24 days.
    Field("peer_timeout", float, 1e-3, 1e6).checked(peer_timeout)
    Field("reference_scale", float, 1e-3, 1000.0).checked(reference_scale)
    others, absent = of_peers(peers)
    variants = [*map(Variant, settings_of(axes)), *others]
    photos = listed_photos(images, "images")
    for photo in photos:
        load_image(photo.path)  # a bad photo is reported now, not after hours of runs
    sources = {} if references is None else _sources(photos, Path(references))
    versions = {"gauss2svg": __version__, "python": platform.python_version()}

    options = {"seed": seed, "threads": threads, "max_pixels": DEFAULT_MAX_PIXELS}

    def task_of(photo: ListedPhoto, variant: Variant) -> Task:
        # Other tools are given neither seed nor threads.
        others = [seed, threads] if variant.is_own else []
        request = {"options": options, "peer_timeout": peer_timeout}
        if source := sources.get(photo):
            request["reference"] = source, reference_scale
            others += [hashlib.sha256(source.read_bytes()).hexdigest(), reference_scale]
        about = {"seed": seed, "versions": versions | {variant.tool: variant.version}}
        return Task(photo, variant, request, tuple(others), about)

    plan = [task_of(photo, variant) for variant in variants for photo in photos]
    folder = output_folder(directory, _OUTPUTS)
    grid = Grid(folder / _ROWS, plan, progress)
    with Pool(1) as pool:
        for _ in grid.run(plan, pool, measured_alone):
            _write_tables(folder, grid, absent)
    return _write_tables(folder, grid, absent)  # of a plan whose runs are all kept


def _sources(photos: Sequence[ListedPhoto], folder: Path) -> dict[ListedPhoto, Path]:
    """Return the SVG of each photo in a folder; raise InputError where one is missing."""
    sources = {photo: folder / f"{Path(photo.path).stem}.svg" for photo in photos}
    for source in sources.values():
        if not source.is_file():
            needed = "a folder with an SVG for each photo"
            raise refusal("references", needed, f"no {source}", "another folder")
    return sources


def _write_tables(folder: Path, grid: Grid, absent: Sequence[str]) -> list[Row]:
    """Write the tables and plots of the runs that have ended, and return their rows."""
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
        columns=[one for one in _COLUMNS if enlarged or one[1] != "psnr_svg_enlarged"],
        tolerance=TOLERANCE,
    )
    plots = plots_of(summary)
    texts = {"bench.csv": csv_text(rows), "summary.md": text, **plots}
    tables = {"bench.json": as_json(document)} | {name: t.encode() for name, t in texts.items()}
    write_all_atomically({folder / name: data for name, data in tables.items()})
    for name in set(NAMES) - plots.keys():  # of an earlier benchmark that had this score
        (folder / name).unlink(missing_ok=True)
    return rows
