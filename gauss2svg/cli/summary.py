"""Print the summary of a run or of a check on standard error."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Sequence
from typing import Any

from gauss2svg.errors import on_one_line
from gauss2svg.measure import NONE, ON_REQUEST, SCORES, SPACE, TARGETS, decibels
from gauss2svg.measure.roundtrip import HEAVY_MS
from gauss2svg.pipeline.options import ALWAYS
from gauss2svg.pipeline.progress_display import columns
from gauss2svg.scene.areas import AreaCounts
from gauss2svg.svg import MINIMAL, RESPONSIVE

# Text that the summary prints after the number of shapes, for each stop_reason of a report.
_STOPPED = {
    "iterations": "set by --gaussians",
    "gaussians": "set by --gaussians",
    "gain": "more would improve it too little for --quality {quality}",
    "enough": "enough for --quality {quality}",
    "cap": "the maximum of --quality {quality}",
    "start": "as many as in the scene of --start",
    **{score.option: f"the target {score.name} is reached" for score in TARGETS},
    "max_bytes": "the closest file within the size limit",
    "time_limit": "the time limit is reached",
    "interrupted": "interrupted",
}
# Some texts of _STOPPED name the preset. If the run has a limit but no preset, the summary prints
# the texts below in place of those.
_NOTHING_TO_GAIN = {
    "gain": "more would improve it too little for their bytes",
    "enough": "more would make no visible difference",
    "cap": "as many as the picture has room for",
}
_SEEN_HUE = 10  # local error of hue from which one sees it at once (docs/decisions/metrics.md)


def print_summary(report: dict[str, Any], output: str) -> None:
    """Print the name and size of the file, how closely it matches the photo, and the run's time."""
    r = report
    measured = r["measured_width"], r["measured_height"]
    at = "" if measured == (r["width"], r["height"]) else f", at {measured[0]}x{measured[1]} px"
    scale = "30 is soft, 35 good, 40 hard to tell apart"
    if r["inks"] is not None:
        scale = "few inks are far in dB: judge by eye"
    rows = {
        "file": f"{output}, {r['width']}x{r['height']} px{_shown_width(r)}, {_size(r)}",
        "shapes": f"{_shapes(r)}: {_stop_text(r)}",
        "match": f"{_match(r, f' ({scale})')}{_hue(r)}{at}",
        "focus": _focus(r),
        "transparency": _transparency(r),
        "inks": _inks(r),
        "scores": _scores(r),
        "browser": _painting(r),
        "time": f"{r['total_s']:.1f} s",
    }
    _print_table(rows, [("missed", line) for line in r["unreached"]], r["notes"])


def _inks(report: dict[str, Any]) -> str:
    """Return the inks of a picture, and the colour of paper on which they are printed."""
    inks = (report["inks"] or "").replace(",", ", ")
    return f"{inks} on paper of {report['paper']}" if report["paper"] else inks


def print_check(report: dict[str, Any], svg: str) -> None:
    """Print what elements an SVG has, how large it is, and how closely it matches the photo."""
    r = report
    tags = [f"{count:,} {tag.rpartition('}')[2]}" for tag, count in r["elements_by_tag"].items()]
    most = 6  # tags that are listed, namely the most frequent ones
    others = f", {len(tags) - most} other tags" if len(tags) > most else ""
    rows = {
        "file": f"{svg}, {r['svg_width']:g}x{r['svg_height']:g} px",
        "size": _size(r),
        "elements": f"{r['elements']:,}: {', '.join(tags[:most])}{others}",
        "match": f"{_match(r)}, MS-SSIM {_ssim(r['ms_ssim_svg'], 176)}, "
        f"at {r['width']}x{r['height']} px by {r['renderer']}",
        "enlarged": _enlarged(r),
        "transparency": _transparency(r),
        "scores": _scores(r),
        "errors": f"at most {r['largest_error_svg']:.0f} of 255 levels in any colour channel, "
        f"{r['bias_svg']:+.2f} levels on average; hue off by at most "
        f"{_hue_error(r, '.1f')}, which one sees from {_SEEN_HUE}",
    }
    _print_table(rows, [], r["notes"])


def check_table(records: Sequence[dict[str, Any]]) -> str:
    """Return a table of the reports of several SVGs, a line each.

    Scores that no SVG has are left out. An SVG that could not be checked has no numbers.
    """
    done = [record for record in records if "error" not in record]
    sizes = {"bytes": "svg_bytes", "gzipped": "svgz_bytes", "elements": "elements"}
    scores = [score for score in SCORES if any(score.can_show(r[score.key]) for r in done)]
    heads = ["SVG", *sizes, *(f"{score.name} {score.unit}".strip() for score in scores)]
    rows = [heads]
    for r in records:
        is_done = "error" not in r
        cells = [f"{r[key]:,}" if is_done else NONE for key in sizes.values()]
        cells += [score.text(r[score.key]).split(SPACE)[0] if is_done else NONE for score in scores]
        rows.append([on_one_line(r["svg"]), *cells])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]) for row in rows
    )
    return "".join(f"{line}\n" for line in lines)


def _enlarged(report: dict[str, Any]) -> str:
    """Return text on how closely the enlarged SVG matches the reference.

    The text is "" if no reference was given.
    """
    scale = report["reference_scale"]
    if scale is None:
        return ""
    score, ssim = decibels(report["psnr_svg_enlarged"]), _ssim(report["ssim_svg_enlarged"])
    return f"PSNR {score}, SSIM {ssim} against the reference, at {scale:g} times the size"


def _match(report: dict[str, Any], scale: str = "") -> str:
    psnr, ssim = report["psnr_svg"], _ssim(report["ssim_svg"])
    return f"PSNR {decibels(psnr)}{'' if psnr is None else scale}, SSIM {ssim}"


def _hue(report: dict[str, Any]) -> str:
    """Return text on the largest local error of hue, or "" if it would not be seen.

    The text is "" too for a picture in inks, whose hues are those of the inks.
    """
    is_named = report["hue_error_svg"] >= _SEEN_HUE and report["inks"] is None
    return f", hue off by {_hue_error(report, '.0f')}" if is_named else ""


def _hue_error(report: dict[str, Any], form: str) -> str:
    """Return the largest local error of hue as text, with its unit and its place."""
    x, y = report["hue_error_at"]
    return f"{report['hue_error_svg']:{form}} units of CIELAB at x = {x}, y = {y} px"


def _size(report: dict[str, Any]) -> str:
    return f"{report['svg_bytes']:,} bytes, {report['svgz_bytes']:,} gzipped"


def _shown_width(report: dict[str, Any]) -> str:
    """Return text on the width at which a web page shows the picture, or "" without --size."""
    size = report["size"]
    if size is None:
        return ""
    return ", shown as wide as its place" if size == RESPONSIVE else f", shown {size} wide"


def _scores(report: dict[str, Any]) -> str:
    """Return text with the perceptual scores of a report, and the reasons for missing ones."""
    scores = [score for score in ON_REQUEST if score.can_show(report[score.key])]
    text = ", ".join(f"{score.name} {score.text(report[score.key])}" for score in scores)
    return "; ".join(filter(None, [text, *report["scores_missing"]]))


def _shapes(report: dict[str, Any]) -> str:
    """Return text on how many areas, lines and shapes the file has."""
    counts = AreaCounts(report["area_count"], report["line_count"], report["node_count"])
    if not any(counts) and report["areas"] != ALWAYS:
        return f"{report['gaussians']:,}"
    return f"{counts}, {report['gaussians']:,} shapes" if report["gaussians"] else str(counts)


def _stop_text(report: dict[str, Any]) -> str:
    """Return text on why the file does not have more shapes."""
    reason, limit = report["stop_reason"], report["max_bytes"]
    if reason == "max_bytes" and report["gaussians"]:
        gzipped = report["gzip"] or report["count_gzipped"]
        has_space = report["svgz_bytes" if gzipped else "svg_bytes"] < 0.97 * limit
        # Each of a few shapes takes up a large part of the file.
        is_few = report["gaussians"] < 60
        why = "one more would not fit" if is_few else "more would not be closer"
        return f"limited by {limit:,} {'gzipped ' * gzipped}bytes{f'; {why}' * has_space}"
    has_areas = reason == "gain" and report["area_share"]  # they have a price of bytes
    without_preset = _NOTHING_TO_GAIN if has_areas or report["quality"] is None else {}
    return without_preset.get(reason, _STOPPED[reason]).format(**report)


def _painting(report: dict[str, Any]) -> str:
    """Return text on the time that a browser takes to paint the file.

    The text is "" if this time is unknown or less than HEAVY_MS.
    """
    paint_ms = report["paint_ms"]
    if paint_ms is None or paint_ms < HEAVY_MS:
        return ""
    lighter = "--markup editable" if report["markup"] == MINIMAL else "fewer shapes"
    return (
        f"needs about {paint_ms / 1000:.1f} s of CPU time to paint it, "
        f"{report['paint_width']:.0f} px wide; less with {lighter}"
    )


def _transparency(report: dict[str, Any]) -> str:
    """Return text with three PSNRs: over white, over black, and of the alpha channel.

    The text is "" for an opaque photo.
    """
    if not report["transparent"]:
        return ""
    white, black, alpha = (decibels(report[f"psnr_svg{over}"]) for over in ("", "_black", "_alpha"))
    return f"PSNR {white} over white, {black} over black, {alpha} of alpha"


def _focus(report: dict[str, Any]) -> str:
    """Return text with two PSNRs, inside and outside of the mask, or "" if there is no mask."""
    if report["focus_strength"] is None:
        return ""
    inside, outside = (decibels(report[f"psnr_svg_{part}"]) for part in ("inside", "outside"))
    return f"PSNR {inside} inside of the mask, {outside} outside"


def _print_table(rows: dict[str, str], further: list[tuple[str, str]], notes: list[str]) -> None:
    lines = [(name, text) for name, text in rows.items() if text]
    lines += [*further, *(("note", note) for note in notes)]
    indent = max(len(name) for name, _ in lines) + 2
    width = max(columns(), 2 * indent)
    for name, text in lines:
        paragraph = textwrap.fill(
            f"{name:{indent}}{on_one_line(text)}", width, subsequent_indent=" " * indent,
            break_long_words=False, break_on_hyphens=False,
        )  # fmt: skip
        print(paragraph, file=sys.stderr)


def _ssim(value: float | None, least_side: int = 11) -> str:
    return f"not defined under {least_side} px" if value is None else f"{value:.3f}"
