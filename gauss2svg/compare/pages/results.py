"""The results of a gallery: its photos and SVGs, the rows of its data, their medians."""

from __future__ import annotations

import json
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gauss2svg.compare.pages.artifacts import OUTLINES, PICTURE, REPORT, SCENE
from gauss2svg.compare.variants import Variant
from gauss2svg.errors import OutputError
from gauss2svg.measure.scores import SCORES
from gauss2svg.photo.listing import ListedPhoto

Row = dict[str, Any]

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

    folder          relative to the gallery, with /
    report          as the command line writes it
    worst, typical  crops: x, y, width, height in px and PSNR in dB
    rounds          [round, shapes up to it] of the SVG's groups; empty for a peer
    cpu_s           CPU time of all cores
    origin          date, machine, jobs and threads with which it was made
    """

    variant: Variant
    folder: str
    report: dict[str, Any]
    worst: dict[str, Any]
    typical: dict[str, Any]
    rounds: list[list[int]]
    cpu_s: float
    origin: dict[str, Any]

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


def svg_result(root: Path, folder: str, variant: Variant, record: Mapping[str, Any]) -> SvgResult:
    """The SVG in a finished folder; raises OutputError where its report cannot be read."""
    path = root / folder / REPORT
    try:
        report = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise OutputError(f"cannot read {path}: {error}. Try deleting its folder") from error
    return SvgResult(
        variant, folder, report, record["worst"], record["typical"], record.get("rounds", []),
        record["cpu_s"], record["origin"],
    )  # fmt: skip


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
            "cpu_s": svg.cpu_s,
            "renderer": svg.report["renderer"],
            "seed": svg.report.get("seed"),
            **svg.origin,
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
