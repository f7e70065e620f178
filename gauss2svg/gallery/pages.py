"""The pages: what is known of a gallery, through templates, into files."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from gauss2svg.bench.rows import csv_text, json_text
from gauss2svg.errors import OutputError
from gauss2svg.files import write_all_atomically
from gauss2svg.gallery import numbers
from gauss2svg.gallery.chart import Point, scatter
from gauss2svg.gallery.crops import SIDE
from gauss2svg.gallery.records import Failure, Made, Row, Shown, rows_of, summary_of
from gauss2svg.gallery.variants import Variant, main_variant
from gauss2svg.gallery.work import ERRORS, OUTLINES, PICTURE, THUMBNAIL, THUMBNAIL_PX
from gauss2svg.measure.heatmap import MOST, colors_of
from gauss2svg.version import __version__

INDEX, TRADE_OFF, HOW = "index.html", "trade-off.html", "how.html"
DATA, TABLE = "gallery.json", "gallery.csv"
ASSETS = "assets"
OUTPUTS = (INDEX, TRADE_OFF, HOW, DATA, TABLE)
_STATIC = (
    "gallery.css", "gallery.js", "img-comparison-slider.js", "img-comparison-slider.LICENSE.txt",
)  # fmt: skip
_LEGEND_COLORS = 9  # of the heat map, in a gradient
# Of a report, in words, as a number of a page and as that of an axis.
_COSTS = (
    ("svg_bytes", "bytes", numbers.size, numbers.short_size),
    ("total_s", "seconds", numbers.seconds, numbers.short_seconds),
)


@dataclass(frozen=True)
class Provenance:
    """How a gallery was made; see `build_gallery`."""

    title: str
    command: str
    date: str
    seed: int
    photo_size: int | None
    absent: tuple[str, ...]
    missing: int = 0  # SVGs that an interruption left to be made


def write_pages(
    root: Path,
    story: Provenance,
    variants: Sequence[Variant],
    shown: Sequence[Shown],
    failures: Sequence[Failure],
) -> None:
    """Write every page, the data and what pages share; whole or not at all.

    Raises OutputError where something cannot be written.
    """
    rows = rows_of(shown)
    summary = summary_of(rows, variants)
    shared = {
        "story": story,
        "version": __version__,
        "variants": variants,
        "main": main_variant(variants),
        "shown": shown,
        "failures": failures,
        "rows": rows,
        "renderers": _renderers(rows),
        "summary": summary,
        "legend": _legend(),
        "most_levels": MOST,
        "crop_side": SIDE,
    }
    environment = _environment()

    def page(template: str, root_path: str, **more: Any) -> bytes:
        text = environment.get_template(f"{template}.html.jinja").render(
            **shared, root=root_path, page=template, **more
        )
        return text.encode()

    # The data first: by them a folder is known as a gallery's.
    written: dict[str | os.PathLike[str], bytes] = {
        root / DATA: json_text(_document(story, summary, rows, failures)).encode(),
        root / TABLE: csv_text(rows).encode(),
        root / INDEX: page("index", "", cards=[_card(one) for one in shown]),
        root / TRADE_OFF: page("trade-off", "", charts=_charts(shown, variants)),
        root / HOW: page("how", "", versions=_versions(shown), origins=_origins(shown)),
    }
    for at, one in enumerate(shown):
        neighbours = {
            "previous": shown[at - 1] if at else None,
            "next": shown[at + 1] if at + 1 < len(shown) else None,
        }
        viewer = _viewer(one)
        chosen = [made for made in viewer if made["slug"] == shared["main"].slug] or viewer
        first = chosen[0] if chosen else None
        path = root / one.folder / INDEX
        written[path] = page("photo", "../../", one=one, viewer=viewer, first=first, **neighbours)
    static = files("gauss2svg.gallery") / "static"
    for name in _STATIC:
        written[root / ASSETS / name] = (static / name).read_bytes()
    write_all_atomically(written)


def _renderers(rows: Iterable[Row]) -> list[str]:
    """What drew the SVGs to be measured, by their reports."""
    return sorted({row["renderer"] for row in rows})


def is_gallery(data: Path) -> bool:
    """Whether a gallery has written this file of data."""
    try:
        document = json.loads(data.read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(document, dict) and document.keys() >= {"gauss2svg", "rows", "failures"}


def _document(
    story: Provenance,
    summary: Sequence[Row],
    rows: Sequence[Row],
    failures: Iterable[Failure],
) -> dict[str, Any]:
    return {
        "gauss2svg": __version__,
        "title": story.title,
        "command": story.command,
        "date": story.date,
        "seed": story.seed,
        "photo_size": story.photo_size,
        "renderers": _renderers(rows),
        "missing": story.missing,
        "peers_absent": list(story.absent),
        "summary": summary,
        "rows": rows,
        "failures": [
            {
                "photo": failure.photo.name,
                "variant": failure.variant.name if failure.variant else None,
                "error": failure.error,
            }
            for failure in failures
        ],
    }


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("gauss2svg.gallery"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    for tell in (
        numbers.whole, numbers.size, numbers.seconds, numbers.decibels, numbers.ratio,
    ):  # fmt: skip
        environment.filters[tell.__name__] = tell
    environment.globals["thumbnail_size"] = _thumbnail_size
    return environment


def _thumbnail_size(one: Shown) -> tuple[int, int]:
    """Width and height in px of a photo's thumbnails."""
    scale = min(1.0, THUMBNAIL_PX / max(one.width, one.height))
    return max(1, round(one.width * scale)), max(1, round(one.height * scale))


def _card(one: Shown) -> dict[str, Any]:
    """What the index's script needs of a photo to sort, filter and change it."""
    return {
        made.variant.slug: {
            "name": made.variant.name,
            "gaussians": made.report.get("gaussians"),
            "elements": made.report.get("elements"),
            "svg_bytes": made.report["svg_bytes"],
            "total_s": made.report["total_s"],
            "psnr_svg": made.report["psnr_svg"],
            "ssim_svg": made.report["ssim_svg"],
            "texts": {
                "shapes": _shapes(made),
                "svg_bytes": numbers.size(made.report["svg_bytes"]),
                "total_s": numbers.seconds(made.report["total_s"]),
                "psnr_svg": numbers.decibels(made.report["psnr_svg"]),
                "ssim_svg": numbers.ratio(made.report["ssim_svg"]),
            },
            "thumbnail": f"{made.folder}/{THUMBNAIL}",
            "picture": f"{made.folder}/{PICTURE}",
        }
        for made in one.made
    }


def _shapes(made: Made) -> str:
    if made.variant.is_own:
        return numbers.whole(made.report["gaussians"])
    return f"{numbers.whole(made.report['elements'])} elements"


def _viewer(one: Shown) -> list[dict[str, Any]]:
    """What the photo page's script needs of every variant; paths are relative to that page."""
    found = []
    for made in one.made:
        slug, own = made.variant.slug, made.variant.is_own
        found.append(
            {
                "slug": slug,
                "name": made.variant.name,
                "picture": f"{slug}/{PICTURE}",
                "errors": f"{slug}/{ERRORS}",
                "outlines": f"{slug}/{OUTLINES}" if own else None,
                "rounds": made.rounds,
                "worst": made.worst,
                "typical": made.typical,
            }
        )
    return found


def _charts(shown: Sequence[Shown], variants: Sequence[Variant]) -> list[dict[str, Any]]:
    """PSNR over bytes and over seconds, each point a link to its page."""
    series = {variant.slug: at for at, variant in enumerate(variants)}
    found = []
    for name, word, tell, tell_tick in _COSTS:
        points = [
            Point(
                cost=made.report[name],
                psnr=made.report["psnr_svg"],
                series=series[made.variant.slug],
                group=at if made.variant.is_own else None,
                href=f"{one.folder}/{INDEX}#{made.variant.slug}",
                text=(
                    f"{one.photo.name}, {made.variant.name}: "
                    f"{numbers.decibels(made.report['psnr_svg'])}, {tell(made.report[name])}"
                ),
            )
            for at, one in enumerate(shown)
            for made in one.made
        ]
        found.append({"word": word, "chart": scatter(points, tell_tick)})
    return found


def _versions(shown: Iterable[Shown]) -> list[tuple[str, str]]:
    """Of everything that any report names, each once."""
    found: dict[tuple[str, str], None] = {}
    for one in shown:
        for made in one.made:
            if not made.variant.is_own:
                found[made.variant.tool, made.variant.version] = None
            for name, version in made.report.get("versions", {}).items():
                found[name, version] = None
    return sorted(found)


def _origins(shown: Iterable[Shown]) -> list[tuple[str, dict[str, Any], int]]:
    """Dates, how, and how many SVGs were made so: kept ones may be of another day or machine."""
    found: dict[str, list[Made]] = {}
    for one in shown:
        for made in one.made:
            how = {name: value for name, value in made.origin.items() if name != "date"}
            found.setdefault(json.dumps(how, sort_keys=True), []).append(made)
    told = []
    for group in found.values():
        dates = sorted({made.origin["date"] for made in group})
        when = dates[0] if len(dates) == 1 else f"{dates[0]} to {dates[-1]}"
        told.append((when, group[0].origin, len(group)))
    return told


def _legend() -> list[str]:
    """Colours of the heat map at even steps, from no error to the largest."""
    levels = np.linspace(0, MOST, _LEGEND_COLORS)
    return ["#" + bytes(color).hex() for color in colors_of(levels)]


def make_folder(folder: Path) -> None:
    """Make it and those above it; raises OutputError where that cannot be done."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise OutputError(f"cannot make {folder}: {reason}; choose another folder") from error
