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
from gauss2svg.svg.document import MINIMAL

_STOPPED = {
    "iterations": "all iterations done",
    "gaussians": "requested number of Gaussians reached",
    "gain": "more Gaussians would improve it too little for their size",
    "enough": "the preset's PSNR reached",
    "cap": "the preset's maximum number of Gaussians reached",
    **{score.option: f"target {score.name} reached" for score in TARGETS},
    "max_bytes": "the closest file within the limit of bytes",
    "time_limit": "time limit reached",
    "interrupted": "interrupted",
}
# The same where a limit alone was given, which no preset caps.
_NOTHING_TO_GAIN = {
    "gain": "nothing to gain: more Gaussians would bring it no closer, not even enlarged",
    "enough": "nothing to gain: more Gaussians would not show",
    "cap": "nothing to gain: as many Gaussians as the picture has room for",
}
_WELL_USED = 0.985  # share of a limit of bytes
_FEW = 60  # Gaussians, of which each is a large part of a file
_MOST_TAGS = 6  # of a checked SVG, the most frequent


def print_summary(report: dict[str, Any], output: str) -> None:
    """Print what was written, its size, how closely it matches the photo, and the time."""
    r = report
    measured = r["measured_width"], r["measured_height"]
    at = "" if measured == (r["width"], r["height"]) else f" at {measured[0]}x{measured[1]} px"
    rows = {
        "file": f"{output}, {r['width']}x{r['height']} px",
        "size": f"{r['svg_bytes']:,} bytes, {r['svgz_bytes']:,} gzipped; gradients are "
        f"{r['bytes_by_part']['gradients'] / r['svg_bytes']:.0%} of it",
        "Gaussians": f"{r['gaussians']:,}, fitted in {r['iterations']} iterations",
        "match": f"{_match(r)}{at}, rasterised by {r['renderer']}",
        "transparency": _alpha(r),
        "inks": (r["inks"] or "").replace(",", ", "),
        "scores": _scores(r),
        "fit": f"PSNR {decibels(r['psnr_model'])} before writing; the SVG against it: "
        f"{decibels(r['psnr_roundtrip'])}, {r['bias_roundtrip']:+.2f} of 255 on average",
        "time": f"{r['total_s']:.1f} s, of which {r['fit_s']:.1f} s for the fit"
        + _compilation(r["compile_s"]),
        "in a page": _page(r),
        "limit": _limit(r),
        "finished": _finished(r),
    }
    _print_table(rows, [("not reached", line) for line in r["unreached"]], r["notes"])


def print_check(report: dict[str, Any], svg: str) -> None:
    """Print what an SVG contains, how large it is, and how closely it matches the photo."""
    r = report
    tags = [f"{count:,} {tag.rpartition('}')[2]}" for tag, count in r["elements_by_tag"].items()]
    others = f", {len(tags) - _MOST_TAGS} other tags" if len(tags) > _MOST_TAGS else ""
    rows = {
        "file": f"{svg}, {r['svg_width']:g}x{r['svg_height']:g} px",
        "size": f"{r['svg_bytes']:,} bytes, {r['svgz_bytes']:,} gzipped",
        "elements": f"{r['elements']:,}: {', '.join(tags[:_MOST_TAGS])}{others}",
        "match": f"{_match(r)}, MS-SSIM {_ssim(r['ms_ssim_svg'], 176)}, rasterised by "
        f"{r['renderer']} at {r['width']}x{r['height']} px",
        "enlarged": _enlarged(r),
        "transparency": _alpha(r),
        "scores": _scores(r),
        "errors": f"{r['largest_error_svg']:.0f} of 255 at most, {r['bias_svg']:+.2f} of 255 on "
        "average",
    }
    _print_table(rows, [], r["notes"])


def _compilation(seconds: float) -> str:
    """Return what the time of a compilation was for; "" where there was none, as below."""
    from gauss2svg.kernel_cache import are_kept

    if seconds <= COMPILED_S:
        return ""
    again = "only once" if are_kept() else "in each run: set NUMBA_CACHE_DIR to a folder to keep it"
    return f" and {seconds:.0f} s for a compilation, {again}"


def _enlarged(report: dict[str, Any]) -> str:
    """Return the match against the reference."""
    scale = report["reference_scale"]
    if scale is None:
        return ""
    score, ssim = decibels(report["psnr_svg_enlarged"]), _ssim(report["ssim_svg_enlarged"])
    return f"PSNR {score}, SSIM {ssim} against the reference at {scale:g} times the size"


def _match(report: dict[str, Any]) -> str:
    score, ssim = decibels(report["psnr_svg"]), _ssim(report["ssim_svg"])
    return f"PSNR {score}, SSIM {ssim} against the photo"


def _scores(report: dict[str, Any]) -> str:
    """Return the perceptual scores that were asked for, and why one is missing."""
    found = [one for one in ON_REQUEST if one.has(report[one.key])]
    known = ", ".join(f"{one.name} {one.text(report[one.key])}" for one in found)
    return "; ".join(filter(None, [known, *report["scores_missing"]]))


def _finished(report: dict[str, Any]) -> str:
    reason = report["stop_reason"]
    alone = _NOTHING_TO_GAIN if report["quality"] is None else {}
    return alone.get(reason, _STOPPED[reason])


def _limit(report: dict[str, Any]) -> str:
    """Return how much of a limit of bytes is used, and why no more."""
    limit, why = report["max_bytes"], _finished(report)
    if limit is None or not report["gaussians"]:
        return ""
    counted = report["gzip"] or report["count_gzipped"]
    size = report["svgz_bytes" if counted else "svg_bytes"]
    text = f"{size:,} of {limit:,} {'gzipped ' * counted}bytes, {size / limit:.1%}"
    if report["stop_reason"] == "max_bytes":
        why = "no larger one within the limit is closer"
        if report["gaussians"] < _FEW:
            why = "one Gaussian more would not fit"
    return text if size >= _WELL_USED * limit else f"{text}: {why}"


def _page(report: dict[str, Any]) -> str:
    """Return how heavy the file is for a web page, where it is."""
    spent = report["paint_ms"]
    if spent is None or spent < HEAVY_MS:
        return ""
    lighter = "--markup editable" if report["markup"] == MINIMAL else "fewer Gaussians"
    return (
        f"about {spent / 1000:.1f} s for a browser to paint it "
        f"{report['paint_width']:.0f} px wide, and again at each repaint; lighter with {lighter}"
    )


def _alpha(report: dict[str, Any]) -> str:
    """Return the match of a transparent photo, whose match elsewhere is that over white."""
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
