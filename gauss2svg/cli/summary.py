"""Print the summary of a run or of a check on standard error."""

import sys
import textwrap
from typing import Any

from gauss2svg.errors import on_one_line, several
from gauss2svg.measure import ON_REQUEST, TARGETS, decibels
from gauss2svg.measure.roundtrip import HEAVY_MS
from gauss2svg.pipeline.progress_display import columns
from gauss2svg.scene.areas import AreaCounts
from gauss2svg.svg import MINIMAL

# Text that the summary prints after the number of shapes, for each stop_reason of a report.
STOPPED = {
    "iterations": "set by --gaussians",
    "gaussians": "set by --gaussians",
    "gain": "more would improve it too little for their bytes",
    "enough": "more would hardly be seen at this quality",
    "cap": "the maximum of this quality",
    "start": "as many as in the scene of --start",
    **{score.option: f"the target {score.name} is reached" for score in TARGETS},
    "max_bytes": "the closest file within the size limit",
    "time_limit": "the time limit is reached",
    "interrupted": "interrupted",
}


def print_summary(report: dict[str, Any], output: str) -> None:
    """Print the name and size of the file, how closely it matches the photo, and the run's time."""
    r = report
    measured = r["measured_width"], r["measured_height"]
    at = "" if measured == (r["width"], r["height"]) else f", at {measured[0]}x{measured[1]} px"
    scale = "30 is soft, 35 good, 40 hard to tell apart"
    if r["inks"] is not None:
        scale = "few inks are far in dB: judge by eye"
    counts = AreaCounts(r["area_count"], r["line_count"], r["node_count"])
    shapes = several(r["gaussians"], "shape")
    if any(counts):
        shapes = f"{counts}, {shapes}" if r["gaussians"] else str(counts)
    rows = {
        "file": f"{output}, {r['width']}x{r['height']} px, {_size(r)}",
        "shapes": f"{shapes}: {STOPPED[r['stop_reason']]}",
        "match": f"{_match(r)}{at} ({scale})",
        "focus": _psnrs(r, {"_inside": "inside of the mask", "_outside": "outside"})
        if r["focus_strength"] is not None
        else "",
        "transparency": _transparency(r),
        "inks": (r["inks"] or "") + f" on paper of {r['paper']}" * (r["paper"] is not None),
        "scores": _scores(r),
        "time": f"{r['total_s']:.1f} s",
    }
    if r["paint_ms"] is not None and r["paint_ms"] >= HEAVY_MS:
        lighter = "--markup editable" if r["markup"] == MINIMAL else "fewer shapes"
        rows["browser"] = (
            f"needs about {r['paint_ms'] / 1000:.1f} s to paint it; less with {lighter}"
        )
    _print_table(rows, [("missed", line) for line in r["unreached"]], r["notes"])


def print_check(report: dict[str, Any], svg: str) -> None:
    """Print what elements an SVG has, how large it is, and how closely it matches the photo."""
    r = report
    tags = [f"{count:,} {tag.rpartition('}')[2]}" for tag, count in r["elements_by_tag"].items()]
    x, y = r["hue_error_at"]
    rows = {
        "file": f"{svg}, {r['svg_width']:g}x{r['svg_height']:g} px",
        "size": _size(r),
        "elements": f"{r['elements']:,}: {', '.join(tags[:6])}{', ..' * (len(tags) > 6)}",
        "match": f"{_match(r)}, at {r['width']}x{r['height']} px by {r['renderer']}",
        "transparency": _transparency(r),
        "scores": _scores(r),
        # A local error of hue is seen from 10 on (docs/decisions/metrics.md).
        "errors": f"at most {r['largest_error_svg']:.0f} of 255 levels in any colour channel, "
        f"{r['bias_svg']:+.2f} levels on average; hue off by at most "
        f"{r['hue_error_svg']:.1f} units of CIELAB at x = {x}, y = {y} px, which one sees from 10",
    }
    _print_table(rows, [], r["notes"])


def _match(report: dict[str, Any]) -> str:
    ssim = report["ssim_svg"]
    text = "not defined for so small a picture" if ssim is None else f"{ssim:.3f}"
    return f"PSNR {decibels(report['psnr_svg'])}, SSIM {text}"


def _size(report: dict[str, Any]) -> str:
    return f"{report['svg_bytes']:,} bytes, {report['svgz_bytes']:,} gzipped"


def _scores(report: dict[str, Any]) -> str:
    """Return text with the perceptual scores of a report, and the reasons for missing ones."""
    scores = [score for score in ON_REQUEST if score.can_show(report[score.key])]
    text = ", ".join(f"{score.name} {score.text(report[score.key])}" for score in scores)
    return "; ".join(filter(None, [text, *report["scores_missing"]]))


def _transparency(report: dict[str, Any]) -> str:
    """Return text with the PSNRs of a transparent photo, or "" for an opaque one."""
    if not report["transparent"]:
        return ""
    return _psnrs(report, {"": "over white", "_black": "over black", "_alpha": "of alpha"})


def _psnrs(report: dict[str, Any], parts: dict[str, str]) -> str:
    """Return text with the PSNR of each part of the picture, whose names are given in words."""
    psnrs = {words: report[f"psnr_svg{part}"] for part, words in parts.items()}
    return "PSNR " + ", ".join(f"{decibels(psnr)} {words}" for words, psnr in psnrs.items())


def _print_table(rows: dict[str, str], further: list[tuple[str, str]], notes: list[str]) -> None:
    lines = [(name, text) for name, text in rows.items() if text]
    lines += [*further, *(("note", note) for note in notes)]
    indent = max(len(name) for name, _ in lines) + 2
    for name, text in lines:
        paragraph = textwrap.fill(
            f"{name:{indent}}{on_one_line(text)}", max(columns(), 2 * indent),
            subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False,
        )  # fmt: skip
        print(paragraph, file=sys.stderr)
