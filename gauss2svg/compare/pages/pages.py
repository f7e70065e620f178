"""The web pages of a gallery, and its data as JSON and CSV."""

from __future__ import annotations

import os
import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from gauss2svg.compare import chart
from gauss2svg.compare.chart import COSTS, Point, machine_text, scatter, template_environment
from gauss2svg.compare.grid import Grid
from gauss2svg.compare.pages.artifacts import (
    OUTLINES,
    PICTURE,
    REPORT,
    SCENE,
    SIDE,
    thumbnail_size,
)  # fmt: skip
from gauss2svg.compare.records import TOOL, Row, csv_text
from gauss2svg.compare.variants import Variant, main_variant
from gauss2svg.files import as_json, write_all_atomically
from gauss2svg.measure.heatmap import MOST, legend
from gauss2svg.measure.scores import ON_REQUEST, PSNR, SCORES, Score
from gauss2svg.pipeline.listing import ListedPhoto
from gauss2svg.version import __version__

# Keys of a report; a peer's report lacks some.
NUMBERS = (
    "gaussians", "elements", "svg_bytes", "svgz_bytes", "total_s", "fit_s",
    *(score.key for score in SCORES), "psnr_model", "psnr_roundtrip",
)  # fmt: skip
_MEDIANS = ("gaussians", "svg_bytes", "svgz_bytes", "total_s", *(score.key for score in SCORES))
_TOTALS = ("svg_bytes", "total_s")

INDEX, TRADE_OFF, HOW = "index.html", "trade-off.html", "how.html"
DATA, TABLE = "gallery.json", "gallery.csv"
OUTPUTS = (INDEX, TRADE_OFF, HOW, DATA, TABLE)
PHOTOS, ASSETS = "photos", "assets"
_STATIC = (
    "gallery.css", "gallery.js", "viewer.js",
    "img-comparison-slider.js", "img-comparison-slider.LICENSE.txt",
)  # fmt: skip


def folder_of(photo: ListedPhoto, variant: Variant | None = None) -> str:
    """Return the folder of a photo, or of an SVG of it, relative to the gallery, with /."""
    return f"{PHOTOS}/{photo.slug}" + (f"/{variant.slug}" if variant else "")


def write_pages(
    root: Path, made: Mapping[str, Any], variants: Sequence[Variant], grid: Grid
) -> dict[str, Any]:
    """Write all pages, the data and the static files, or none of them; return the data.

    made  how the gallery was made
    Raise OutputError where a file cannot be written.
    """
    results = results_of(grid)
    rows = rows_of(results)
    ended = [(task, grid.records[task]) for task in grid.tasks if task in grid.records]
    failures = [(task, record["error"]) for task, record in ended if "error" in record]
    bad = {task.photo for task, _ in failures if task.variant is None}
    document = {
        "gauss2svg": __version__,
        **made,
        "renderers": sorted({row["renderer"] for row in rows}),
        "missing": sum(  # by an interruption
            task.variant is not None and task.photo not in bad and task not in grid.records
            for task in grid.tasks
        ),
        "summary": summary_of(rows, variants),
        "rows": rows,
        "failures": [
            {
                "photo": task.photo.name,
                "variant": task.variant.name if task.variant else None,
                "error": error,
            }
            for task, error in failures
        ],
    }
    reports = [svg["report"] for one in results for svg in one["svgs"]]
    scores = [
        axis for axis in SCORES if axis.always or any(row[axis.key] is not None for row in rows)
    ]
    environment = template_environment("gauss2svg.compare.pages")
    environment.filters |= {"whole": chart.whole, "size": chart.size, "seconds": chart.seconds}
    unscored = [line for one in reports for line in one.get("scores_missing", ())]
    versions = {version for one in reports for version in one.get("versions", {}).items()}
    versions |= {(row["tool"], row["tool_version"]) for row in rows if row["tool"] != TOOL}
    origins = [
        (row["date"], machine_text(row["machine"]), row["jobs"], row["threads"]) for row in rows
    ]
    environment.globals |= {
        **document,
        "provenance": document,
        "variants": variants,
        "main": main_variant(variants),
        "results": results,
        "charts": [
            {"score": score, "cost": cost, "chart": chart_of(results, variants, score, cost)}
            for score in scores
            for cost in COSTS
        ],
        "scores": scores,
        "explained": ON_REQUEST if len(scores) > 2 else (),
        "unscored": list(dict.fromkeys(unscored)),
        "scored": any(report.get("scores") for report in reports),
        "versions": sorted(versions),
        "origins": Counter(origins),
        "legend": legend(),
        "most_levels": MOST,
        "crop_side": SIDE,
        "thumbnail_size": thumbnail_size,
    }

    def page(template: str, folder: str = "", **more: Any) -> bytes:
        found = environment.get_template(f"{template}.html.jinja")
        return found.render(page=template, root=folder, **more).encode()

    written: dict[str | os.PathLike[str], bytes] = {
        root / DATA: as_json(document),
        root / TABLE: csv_text(rows).encode(),
        **{root / f"{name}.html": page(name) for name in ("index", "trade-off", "how")},
    }
    for before, one, after in zip([None, *results], results, [*results[1:], None], strict=False):
        path = root / one["folder"] / INDEX
        written[path] = page("photo", "../../", result=one, previous=before, next=after)
    static = files("gauss2svg.compare.pages") / "static"
    for name in _STATIC:
        written[root / ASSETS / name] = (static / name).read_bytes()
    write_all_atomically(written)
    return document


def results_of(grid: Grid) -> list[Row]:
    """Return the records of prepared photos, each with those of its finished SVGs as `svgs`."""
    results: dict[ListedPhoto, Row] = {}
    for task in grid.tasks:  # photos come first
        record, variant = grid.records.get(task, {"error": "not run yet"}), task.variant
        if "error" in record:
            continue
        if variant is None:
            results[task.photo] = {**record, "photo": task.photo, "svgs": []}
        elif task.photo in results:
            results[task.photo]["svgs"].append(_svg(record, variant))
    return list(results.values())


def _svg(record: Row, variant: Variant) -> Row:
    """Return the record of an SVG with its files to download, and what scripts need of it."""
    report, own = record["report"], variant.is_own
    kinds = {"SVG": PICTURE, "report": REPORT}
    if own:
        kinds |= {"scene": SCENE, "outlines": OUTLINES}
    shapes = chart.whole(report["gaussians" if own else "elements"])
    texts = {
        "shapes": shapes if own else f"{shapes} elements",
        "svg_bytes": chart.size(report["svg_bytes"]),
        "total_s": chart.seconds(report["total_s"]),
        **{axis.key: axis.text(report.get(axis.key)) for axis in SCORES},
    }
    script = {
        "slug": variant.slug,
        "name": variant.name,
        "folder": record["folder"],
        "isOwn": own,
        **{name: report.get(name) for name in NUMBERS},
        "texts": texts,
        "rounds": [(number, chart.whole(count)) for number, count in record["rounds"]],
        **{k: crop | {"psnr": PSNR.text(crop["psnr"])} for k, crop in record["crops"].items()},
    }
    return record | {
        "variant": variant,
        "files": {kind: f"{record['folder']}/{name}" for kind, name in kinds.items()},
        "remarks": [*report.get("unreached", ()), *report["notes"]],
        "script": script,
    }


def rows_of(results: Iterable[Row]) -> list[Row]:
    """Return one row per SVG: photo, variant, numbers and files."""
    return [
        {
            "photo": one["photo"].name,
            "page": f"{one['folder']}/{INDEX}",
            "variant": svg["variant"].name,
            "tool": svg["tool"],
            "tool_version": svg["tool_version"],
            "width": one["width"],
            "height": one["height"],
            **{name: svg["report"].get(name) for name in NUMBERS},
            "cpu_s": svg["cpu_s"],
            "renderer": svg["report"]["renderer"],
            "seed": svg["report"].get("seed"),
            "date": svg["date"][:10],
            **{name: svg[name] for name in ("machine", "jobs", "threads", "files")},
        }
        for one in results
        for svg in one["svgs"]
    ]


def summary_of(rows: Sequence[Row], variants: Iterable[Variant]) -> list[Row]:
    """Return one row per variant: number of photos, medians and totals.

    Missing numbers, the infinite PSNR of an exact SVG among them, do not count.
    """
    summary = []
    for variant in variants:
        own = [row for row in rows if row["variant"] == variant.name]
        known = {name: [row[name] for row in own if row[name] is not None] for name in _MEDIANS}
        row: Row = {"variant": variant.name, "photos": len(own)}
        for name, values in known.items():
            row[f"median_{name}"] = statistics.median(values) if values else None
        summary += [row | {f"total_{name}": sum(known[name]) for name in _TOTALS}] * bool(own)
    return summary


def chart_of(
    results: Sequence[Row], variants: Sequence[Variant], axis: Score, cost: tuple[Any, ...]
) -> chart.Chart | None:
    """Return a score over bytes or seconds; each point links to its page."""
    name, _, _, format_cost, format_tick = cost
    points = [
        Point(
            cost=svg["report"][name],
            score=score,
            series=variants.index(svg["variant"]),
            group=at if svg["variant"].is_own else None,
            href=f"{one['folder']}/{INDEX}#{svg['variant'].slug}",
            text=(
                f"{one['photo'].name}, {svg['variant'].name}: {axis.text(score)}, "
                f"{format_cost(svg['report'][name])}"
            ),
        )
        for at, one in enumerate(results)
        for svg in one["svgs"]
        if axis.has(score := svg["report"].get(axis.key))
    ]
    return scatter(points, format_tick, axis)
