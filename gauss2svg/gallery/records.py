"""What is known of a gallery when all is made: its rows, their medians, and both as files."""

from __future__ import annotations

import json
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gauss2svg.errors import OutputError
from gauss2svg.gallery.photos import GalleryPhoto
from gauss2svg.gallery.variants import Variant
from gauss2svg.gallery.work import OUTLINES, PICTURE, REPORT, SCENE

Row = dict[str, Any]

# Of a report, as they are called there; a peer's report lacks some.
NUMBERS = (
    "gaussians", "elements", "svg_bytes", "svgz_bytes", "total_s", "fit_s", "psnr_svg",
    "ssim_svg", "psnr_model", "psnr_roundtrip",
)  # fmt: skip
_MEDIANS = ("gaussians", "svg_bytes", "svgz_bytes", "total_s", "psnr_svg", "ssim_svg")
_TOTALS = ("svg_bytes", "total_s")


@dataclass(frozen=True)
class Made:
    """One SVG of a photo that is there.

    folder  relative to the gallery, with /; report: as the command line writes it
    worst, typical  where to look: x, y, width, height in px and PSNR in dB
    rounds          [round, shapes up to it] of the groups of the SVG; none of a peer's
    cpu_s           seconds that all cores together took
    origin          date, machine, jobs and threads of its making, which may be long ago
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
        """What the report has to say beside its numbers."""
        return [*self.report.get("unreached", ()), *self.report["notes"]]

    @property
    def files(self) -> dict[str, str]:
        """What can be downloaded, by what it is."""
        named = {"SVG": PICTURE, "report": REPORT}
        if self.variant.is_own:
            named |= {"scene": SCENE, "outlines": OUTLINES}
        return {what: f"{self.folder}/{name}" for what, name in named.items()}


@dataclass(frozen=True)
class Shown:
    """A photo that is there, with what was made of it, in the order of the variants."""

    photo: GalleryPhoto
    folder: str
    picture: str
    width: int
    height: int
    notes: tuple[str, ...]
    made: tuple[Made, ...]


@dataclass(frozen=True)
class Failure:
    """What could not be made; variant is None where it is the photo that cannot be read."""

    photo: GalleryPhoto
    variant: Variant | None
    error: str


def made_of(root: Path, folder: str, variant: Variant, record: Mapping[str, Any]) -> Made:
    """What a finished folder holds; raises OutputError where its report has become unreadable."""
    path = root / folder / REPORT
    try:
        report = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise OutputError(f"cannot read {path}: {error}; delete its folder and go on") from error
    return Made(
        variant, folder, report, record["worst"], record["typical"], record.get("rounds", []),
        record["cpu_s"], record["origin"],
    )  # fmt: skip


def rows_of(shown: Iterable[Shown]) -> list[Row]:
    """One row an SVG: which photo, which variant, its numbers, its files."""
    return [
        {
            "photo": one.photo.name,
            "page": f"{one.folder}/index.html",
            "variant": made.variant.name,
            "tool": made.variant.tool,
            "tool_version": made.variant.version,
            "width": one.width,
            "height": one.height,
            **{name: made.report.get(name) for name in NUMBERS},
            "cpu_s": made.cpu_s,
            "renderer": made.report["renderer"],
            "seed": made.report.get("seed"),
            **made.origin,
            "files": made.files,
        }
        for one in shown
        for made in one.made
    ]


def summary_of(rows: Sequence[Row], variants: Iterable[Variant]) -> list[Row]:
    """One row a variant: how many photos, medians, totals.

    A median is of those that have the number: an infinite PSNR, of equal pictures, is none.
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
