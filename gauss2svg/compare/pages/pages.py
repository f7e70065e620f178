"""The web pages of a gallery, and its data as JSON and CSV."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment

from gauss2svg.compare import chart
from gauss2svg.compare.chart import COSTS, Point, scatter, template_environment
from gauss2svg.compare.pages.artifacts import (
    ERRORS,
    OUTLINES,
    PICTURE,
    SIDE,
    THUMBNAIL,
    thumbnail_size,
)
from gauss2svg.compare.pages.results import PhotoResult, Row, SvgResult
from gauss2svg.compare.records import csv_text
from gauss2svg.compare.variants import Variant, main_variant
from gauss2svg.files import as_json, write_all_atomically
from gauss2svg.measure.heatmap import MOST, legend
from gauss2svg.measure.scores import ON_REQUEST, PSNR, SCORES, Score
from gauss2svg.version import __version__

INDEX, TRADE_OFF, HOW = "index.html", "trade-off.html", "how.html"
DATA, TABLE = "gallery.json", "gallery.csv"
ASSETS = "assets"
OUTPUTS = (INDEX, TRADE_OFF, HOW, DATA, TABLE)
_STATIC = (
    "gallery.css", "gallery.js", "viewer.js",
    "img-comparison-slider.js", "img-comparison-slider.LICENSE.txt",
)  # fmt: skip


def write_pages(
    root: Path,
    document: Mapping[str, Any],
    variants: Sequence[Variant],
    results: Sequence[PhotoResult],
) -> None:
    """Write all pages, the data and the static files, or none of them.

    document  the data, as in gallery.json
    Raises OutputError where a file cannot be written.
    """
    rows = document["rows"]
    shown = _shown_scores(rows)
    shared = {
        "provenance": document,
        "version": __version__,
        "variants": variants,
        "main": main_variant(variants),
        "results": results,
        **{name: document[name] for name in ("failures", "rows", "renderers", "summary")},
        "scores": shown,
        "explained": ON_REQUEST if len(shown) > 2 else (),
        "unscored": _unscored(results),
        "scored": any(svg.report.get("scores") for one in results for svg in one.svgs),
        "legend": legend(),
        "most_levels": MOST,
        "crop_side": SIDE,
    }
    environment = _environment()

    def page(template: str, root_path: str = "", **more: Any) -> bytes:
        text = environment.get_template(f"{template}.html.jinja").render(
            **shared, root=root_path, page=template, **more
        )
        return text.encode()

    # The data come first: they mark the folder as a gallery's.
    written: dict[str | os.PathLike[str], bytes] = {
        root / DATA: as_json(document),
        root / TABLE: csv_text(rows).encode(),
        root / INDEX: page("index", cards=[_card(one) for one in results]),
        root / TRADE_OFF: page("trade-off", charts=_charts(results, variants, shown)),
        root / HOW: page("how", versions=_versions(results), origins=_origins(results)),
    }
    for at, one in enumerate(results):
        neighbours = {
            "previous": results[at - 1] if at else None,
            "next": results[at + 1] if at + 1 < len(results) else None,
        }
        viewer = _viewer(one)
        chosen = [svg for svg in viewer if svg["slug"] == shared["main"].slug] or viewer
        first = chosen[0] if chosen else None
        path = root / one.folder / INDEX
        written[path] = page(
            "photo", "../../", result=one, viewer=viewer, first=first, **neighbours
        )
    static = files("gauss2svg.compare.pages") / "static"
    for name in _STATIC:
        written[root / ASSETS / name] = (static / name).read_bytes()
    write_all_atomically(written)


def is_gallery(data: Path) -> bool:
    """Whether this file is the data of a gallery."""
    try:
        document = json.loads(data.read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(document, dict) and document.keys() >= {"gauss2svg", "rows", "failures"}


def _environment() -> Environment:
    environment = template_environment("gauss2svg.compare.pages")
    for show in (chart.whole, chart.size, chart.seconds):
        environment.filters[show.__name__] = show
    environment.filters["decibels"] = PSNR.text
    environment.globals["thumbnail_size"] = thumbnail_size
    return environment


def _card(one: PhotoResult) -> dict[str, Any]:
    """What the script of the first page needs to sort and filter photos and switch variants."""
    return {
        svg.variant.slug: {
            "name": svg.variant.name,
            "gaussians": svg.report.get("gaussians"),
            "elements": svg.report.get("elements"),
            "svg_bytes": svg.report["svg_bytes"],
            "total_s": svg.report["total_s"],
            **{axis.key: svg.report.get(axis.key) for axis in SCORES},
            "texts": {
                "shapes": _shapes(svg),
                "svg_bytes": chart.size(svg.report["svg_bytes"]),
                "total_s": chart.seconds(svg.report["total_s"]),
                **{axis.key: axis.text(svg.report.get(axis.key)) for axis in SCORES},
            },
            "thumbnail": f"{svg.folder}/{THUMBNAIL}",
            "picture": f"{svg.folder}/{PICTURE}",
        }
        for svg in one.svgs
    }


def _shapes(svg: SvgResult) -> str:
    if svg.variant.is_own:
        return chart.whole(svg.report["gaussians"])
    return f"{chart.whole(svg.report['elements'])} elements"


def _viewer(one: PhotoResult) -> list[dict[str, Any]]:
    """What the script of a photo's page needs of each variant; paths are relative to the page."""
    found = []
    for svg in one.svgs:
        slug, own = svg.variant.slug, svg.variant.is_own
        found.append(
            {
                "slug": slug,
                "name": svg.variant.name,
                "picture": f"{slug}/{PICTURE}",
                "errors": f"{slug}/{ERRORS}",
                "outlines": f"{slug}/{OUTLINES}" if own else None,
                "rounds": [
                    (number, chart.whole(count)) for number, count in svg.record.get("rounds", [])
                ],
                **{
                    kind: svg.record[kind] | {"psnr": PSNR.text(svg.record[kind]["psnr"])}
                    for kind in ("worst", "typical")
                },
            }
        )
    return found


def _shown_scores(rows: Iterable[Row]) -> list[Score]:
    """PSNR, and every other score that an SVG has."""
    return [
        axis for axis in SCORES if axis is PSNR or any(row[axis.key] is not None for row in rows)
    ]


def _unscored(results: Iterable[PhotoResult]) -> list[str]:
    """Why some SVGs lack a score, each reason once."""
    lines = (
        line for one in results for svg in one.svgs for line in svg.report.get("scores_missing", ())
    )
    return list(dict.fromkeys(lines))


def _charts(
    results: Sequence[PhotoResult], variants: Sequence[Variant], axes: Iterable[Score]
) -> list[dict[str, Any]]:
    """Each score over bytes and over seconds; each point links to its page."""
    series = {variant.slug: at for at, variant in enumerate(variants)}
    found = []
    for axis in axes:
        for name, word, cost_title, format_cost, format_tick in COSTS:
            points = [
                Point(
                    cost=svg.report[name],
                    score=score,
                    series=series[svg.variant.slug],
                    group=at if svg.variant.is_own else None,
                    href=f"{one.folder}/{INDEX}#{svg.variant.slug}",
                    text=(
                        f"{one.photo.name}, {svg.variant.name}: {axis.text(score)}, "
                        f"{format_cost(svg.report[name])}"
                    ),
                )
                for at, one in enumerate(results)
                for svg in one.svgs
                if axis.has(score := svg.report.get(axis.key))
            ]
            chart = scatter(points, format_tick, axis)
            found.append({"score": axis, "word": word, "axis": cost_title, "chart": chart})
    return found


def _versions(results: Iterable[PhotoResult]) -> list[tuple[str, str]]:
    """(name, version) of everything that a report names, each once."""
    found: dict[tuple[str, str], None] = {}
    for one in results:
        for svg in one.svgs:
            if not svg.variant.is_own:
                found[svg.variant.tool, svg.variant.version] = None
            for name, version in svg.report.get("versions", {}).items():
                found[name, version] = None
    return sorted(found)


def _origins(results: Iterable[PhotoResult]) -> list[tuple[str, dict[str, Any], int]]:
    """(dates, origin, number of SVGs) of each machine and setup that made some of them."""
    found: dict[str, list[SvgResult]] = {}
    for one in results:
        for svg in one.svgs:
            how = {name: value for name, value in svg.record["origin"].items() if name != "date"}
            found.setdefault(json.dumps(how, sort_keys=True), []).append(svg)
    origins = []
    for group in found.values():
        dates = sorted({svg.record["origin"]["date"] for svg in group})
        when = dates[0] if len(dates) == 1 else f"{dates[0]} to {dates[-1]}"
        origins.append((when, group[0].record["origin"], len(group)))
    return origins
