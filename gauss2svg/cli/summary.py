"""The summary of a run, on standard error."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from gauss2svg.errors import on_one_line
from gauss2svg.measure.scores import ON_REQUEST, TARGETS
from gauss2svg.pipeline.report import HEAVY_MS, decibels
from gauss2svg.pipeline.run import COMPILED_S
from gauss2svg.svg.document import MINIMAL, RESPONSIVE

# Sentences that follow the number of shapes, by the report's stop_reason.
_STOPPED = {
    "iterations": "all {iterations} optimiser steps are done",
    "gaussians": "as many as you asked for",
    "gain": "more would improve it too little for --quality {quality}",
    "enough": "enough for --quality {quality}",
    "cap": "the maximum of --quality {quality}",
    **{score.option: f"the target {score.name} is reached" for score in TARGETS},
    "max_bytes": "the closest file within the size limit",
    "time_limit": "the time limit is reached",
    "interrupted": "interrupted",
}
# The same for a run that has a limit and no preset.
_NOTHING_TO_GAIN = {
    "gain": "more would bring it no closer, even if you enlarge it",
    "enough": "more would make no visible difference",
    "cap": "as many as the picture has room for",
}
_SCALE = " (30 is soft, 35 good, 40 hard to tell apart)"
_SCALE_OF_INKS = " (few inks are far in dB: judge by eye)"
_FEW = 60  # shapes, of which each is a large part of a file
_MOST_TAGS = 6  # of a checked SVG, the most frequent


def print_summary(report: dict[str, Any], output: str) -> None:
    """Print what was written, its size, how closely it matches the photo, and the time."""
    r = report
    measured = r["measured_width"], r["measured_height"]
    at = "" if measured == (r["width"], r["height"]) else f", at {measured[0]}x{measured[1]} px"
    rows = {
        "file": f"{output}, {r['width']}x{r['height']} px{_shown(r)}, {_size(r)}",
        "shapes": f"{r['gaussians']:,}: {_finished(r)}",
        "match": f"{_match(r, _SCALE if r['inks'] is None else _SCALE_OF_INKS)}{at}",
        "transparency": _alpha(r),
        "inks": (r["inks"] or "").replace(",", ", "),
        "scores": _scores(r),
        "page": _page(r),
        "time": f"{r['total_s']:.1f} s{_compilation(r['compile_s'])}",
    }
    _print_table(rows, [("missed", line) for line in r["unreached"]], r["notes"])


def print_check(report: dict[str, Any], svg: str) -> None:
    """Print what an SVG contains, how large it is, and how closely it matches the photo."""
    r = report
    tags = [f"{count:,} {tag.rpartition('}')[2]}" for tag, count in r["elements_by_tag"].items()]
    others = f", {len(tags) - _MOST_TAGS} other tags" if len(tags) > _MOST_TAGS else ""
    rows = {
        "file": f"{svg}, {r['svg_width']:g}x{r['svg_height']:g} px",
        "size": _size(r),
        "elements": f"{r['elements']:,}: {', '.join(tags[:_MOST_TAGS])}{others}",
        "match": f"{_match(r)}, MS-SSIM {_ssim(r['ms_ssim_svg'], 176)}, "
        f"at {r['width']}x{r['height']} px by {r['renderer']}",
        "enlarged": _enlarged(r),
        "transparency": _alpha(r),
        "scores": _scores(r),
        "errors": f"at most {r['largest_error_svg']:.0f} of 255 levels in any colour channel, "
        f"{r['bias_svg']:+.2f} levels on average",
    }
    _print_table(rows, [], r["notes"])


def _compilation(seconds: float) -> str:
    """Return what the time of a compilation was for, or "" if there was none."""
    from gauss2svg.kernel_cache import are_kept

    if seconds <= COMPILED_S:
        return ""
    again = "only in the first run" if are_kept() else "set NUMBA_CACHE_DIR to a folder to keep it"
    return f", of which {seconds:.0f} s compiled the program ({again})"


def _enlarged(report: dict[str, Any]) -> str:
    """Return the match against the reference."""
    scale = report["reference_scale"]
    if scale is None:
        return ""
    score, ssim = decibels(report["psnr_svg_enlarged"]), _ssim(report["ssim_svg_enlarged"])
    return f"PSNR {score}, SSIM {ssim} against the reference, at {scale:g} times the size"


def _match(report: dict[str, Any], scale: str = "") -> str:
    score, ssim = decibels(report["psnr_svg"]), _ssim(report["ssim_svg"])
    return f"PSNR {score}{scale}, SSIM {ssim}"


def _size(report: dict[str, Any]) -> str:
    return f"{report['svg_bytes']:,} bytes, {report['svgz_bytes']:,} gzipped"


def _shown(report: dict[str, Any]) -> str:
    """Return the size that was asked for, in which the picture is shown, or "" if none was."""
    size = report["size"]
    if size is None:
        return ""
    return ", shown as wide as its place" if size == RESPONSIVE else f", shown {size} wide"


def _scores(report: dict[str, Any]) -> str:
    """Return the perceptual scores that were asked for, and why one is missing."""
    found = [one for one in ON_REQUEST if one.has(report[one.key])]
    known = ", ".join(f"{one.name} {one.text(report[one.key])}" for one in found)
    return "; ".join(filter(None, [known, *report["scores_missing"]]))


def _finished(report: dict[str, Any]) -> str:
    """Return why the file has as many shapes as it has."""
    reason, limit = report["stop_reason"], report["max_bytes"]
    if reason == "max_bytes" and report["gaussians"]:
        gzipped = report["gzip"] or report["count_gzipped"]
        more = report["svgz_bytes" if gzipped else "svg_bytes"] < 0.97 * limit
        why = "one more would not fit" if report["gaussians"] < _FEW else "more would not be closer"
        return f"limited by {limit:,} {'gzipped ' * gzipped}bytes{f'; {why}' * more}"
    alone = _NOTHING_TO_GAIN if report["quality"] is None else {}
    return alone.get(reason, _STOPPED[reason]).format(**report)


def _page(report: dict[str, Any]) -> str:
    """Return how long a browser takes to paint the file, or "" if that is not noticeable."""
    spent = report["paint_ms"]
    if spent is None or spent < HEAVY_MS:
        return ""
    lighter = "--markup editable" if report["markup"] == MINIMAL else "fewer shapes"
    return (
        f"about {spent / 1000:.1f} s of CPU time for a browser to paint it, "
        f"{report['paint_width']:.0f} px wide; less with {lighter}"
    )


def _alpha(report: dict[str, Any]) -> str:
    """Return how a transparent photo is matched. The row "match" has its match over white."""
    if not report["transparent"]:
        return ""
    white, black, alpha = (decibels(report[f"psnr_svg{over}"]) for over in ("", "_black", "_alpha"))
    return f"PSNR {white} over white, {black} over black, {alpha} of alpha"


def _print_table(rows: dict[str, str], further: list[tuple[str, str]], notes: list[str]) -> None:
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim")
    table.add_column()
    for name, text in (*rows.items(), *further, *(("note", note) for note in notes)):
        if text:
            # Text without markup or escapes, which a file name may contain.
            table.add_row(name, Text(on_one_line(text)))
    Console(stderr=True, highlight=False).print(table)


def _ssim(value: float | None, least_side: int = 3) -> str:
    return f"not defined under {least_side} px" if value is None else f"{value:.3f}"
