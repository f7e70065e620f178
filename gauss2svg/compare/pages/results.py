"""The results of a gallery: its photos and SVGs, the rows of its data, their medians."""

from __future__ import annotations

import json
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gauss2svg.compare.grid import Place, Record
from gauss2svg.compare.pages.artifacts import OUTLINES, PICTURE, REPORT, SCENE, folder_of
from gauss2svg.compare.records import Row
from gauss2svg.compare.variants import Variant
from gauss2svg.errors import OutputError
from gauss2svg.measure.scores import SCORES
from gauss2svg.pipeline.listing import ListedPhoto

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
