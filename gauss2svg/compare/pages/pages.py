"""The web pages of a gallery, and its data as JSON and CSV."""

from __future__ import annotations

import json
import os
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment

from gauss2svg.compare import chart
from gauss2svg.compare.chart import COSTS, Point, scatter, template_environment
from gauss2svg.compare.grid import Place, Record
from gauss2svg.compare.pages.artifacts import (
    ERRORS,
    OUTLINES,
    PICTURE,
    REPORT,
    SCENE,
    SIDE,
    THUMBNAIL,
    folder_of,
    thumbnail_size,
)
from gauss2svg.compare.records import Row, csv_text
from gauss2svg.compare.variants import Variant, main_variant
from gauss2svg.errors import OutputError
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
_MEDIANS = (
    "gaussians", "svg_bytes", "svgz_bytes", "total_s", *(score.key for score in SCORES),
)  # fmt: skip
_TOTALS = ("svg_bytes", "total_s")


@dataclass(frozen=True)
class SvgResult:
    """A finished SVG of a photo.

    folder  relative to the gallery, with /
    report  as the command line writes it
    record  what else its worker tells: the crops worst and typical (x, y, width, height in px,
            PSNR in dB); rounds, [round, shapes up to it] of the SVG's groups, not of a peer's;
            cpu_s of all cores; origin: date, machine, jobs and threads
    """

    variant: Variant
    folder: str
    report: dict[str, Any]
    record: Record

    @property
    def remarks(self) -> list[str]:
        """The notes of the report, and the targets that it missed."""
        return [*self.report.get("unreached", ()), *self.report["notes"]]

    @property
    def files(self) -> dict[str, str]:
        """Paths of the files to download, by kind."""
        named = {"SVG": PICTURE, "report": REPORT}
        if self.variant.is_own:
            named |= {"scene": SCENE, "outlines": OUTLINES}
        return {what: f"{self.folder}/{name}" for what, name in named.items()}


@dataclass(frozen=True)
class PhotoResult:
    """A prepared photo and its finished SVGs, in the order of the variants."""

    photo: ListedPhoto
    folder: str
    picture: str
    width: int
    height: int
    notes: tuple[str, ...]
    svgs: tuple[SvgResult, ...]


@dataclass(frozen=True)
class Failure:
    """A photo that cannot be read, where variant is None, or an SVG that could not be made."""

    photo: ListedPhoto
    variant: Variant | None
    error: str


def results_of(
    root: Path,
    photos: Iterable[ListedPhoto],
    variants: Sequence[Variant],
    records: Mapping[Place, Record],
) -> list[PhotoResult]:
    """All that is finished; raises OutputError where a report cannot be read."""
    return [
        PhotoResult(
            photo=photo,
            folder=folder_of(photo),
            picture=f"{folder_of(photo)}/{record['photo']}",
            width=record["width"],
            height=record["height"],
            notes=tuple(record["notes"]),
            svgs=tuple(
                SvgResult(variant, folder, read_report(root / folder), records[photo, variant])
                for variant in variants
                if (photo, variant) in records
                for folder in [folder_of(photo, variant)]
            ),
        )
        for photo in photos
        if (record := records.get((photo, None))) is not None
    ]


def read_report(folder: Path) -> dict[str, Any]:
    """The report in a finished folder; raises OutputError where it cannot be read."""
    try:
        return json.loads((folder / REPORT).read_bytes())
    except (OSError, ValueError) as error:
        raise OutputError(
            f"cannot read {folder / REPORT}: {error}. Try deleting its folder"
        ) from error


def rows_of(results: Iterable[PhotoResult]) -> list[Row]:
    """One row per SVG: photo, variant, numbers and files."""
    return [
        {
            "photo": one.photo.name,
            "page": f"{one.folder}/index.html",
            "variant": svg.variant.name,
            "tool": svg.variant.tool,
            "tool_version": svg.variant.version,
            "width": one.width,
            "height": one.height,
            **{name: svg.report.get(name) for name in NUMBERS},
            "cpu_s": svg.record["cpu_s"],
            "renderer": svg.report["renderer"],
            "seed": svg.report.get("seed"),
            **svg.record["origin"],
            "files": svg.files,
        }
        for one in results
        for svg in one.svgs
    ]


def summary_of(rows: Sequence[Row], variants: Iterable[Variant]) -> list[Row]:
    """One row per variant: number of photos, medians and totals.

    Missing numbers, the infinite PSNR of an exact SVG among them, do not count.
    """
    found = []
    for variant in variants:
        own = [row for row in rows if row["variant"] == variant.name]
        if not own:
            continue
        known = {
            name: [row[name] for row in own if row[name] is not None]
            for name in dict.fromkeys(_MEDIANS + _TOTALS)
        }
        medians = {
            f"median_{name}": statistics.median(known[name]) if known[name] else None
            for name in _MEDIANS
        }
        totals = {f"total_{name}": sum(known[name]) for name in _TOTALS}
        found.append({"variant": variant.name, "photos": len(own), **medians, **totals})
    return found


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
