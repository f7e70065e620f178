"""The summary of a run, on standard error."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from gauss2svg.errors import on_one_line
from gauss2svg.measure.paint import HEAVY_MS
from gauss2svg.measure.scores import ON_REQUEST, TARGETS
from gauss2svg.pipeline.kernels import COMPILED_S
from gauss2svg.pipeline.report import decibels
from gauss2svg.svg.format import MINIMAL

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


def _compilation(seconds: float) -> str:
    """What the time of a compilation was for, where there was one."""
    from gauss2svg.kernel_cache import are_kept

    if seconds <= COMPILED_S:
        return ""
    again = "only once" if are_kept() else "in each run: set NUMBA_CACHE_DIR to a folder to keep it"
    return f" and {seconds:.0f} s for a compilation, {again}"


def print_summary(report: dict[str, Any], output: str | None) -> None:
    """What was written, how large it is, how closely it matches the photo, how long it took."""
    rows = {
        "file": f"{output or 'standard output'}, {report['width']}x{report['height']} px",
        "size": f"{report['svg_bytes']:,} bytes, {report['svgz_bytes']:,} gzipped; gradients are "
        f"{report['bytes_by_part']['gradients'] / report['svg_bytes']:.0%} of it",
        "Gaussians": f"{report['gaussians']:,}, fitted in {report['iterations']} iterations",
        "match": f"{_match(report)}{_at(report)}, rasterised by {report['renderer']}",
        **_of_alpha(report),
        **_of_inks(report),
        **_scores(report),
        "fit": f"PSNR {decibels(report['psnr_model'])} before writing; the SVG against it: "
        f"{decibels(report['psnr_roundtrip'])}, {report['bias_roundtrip']:+.2f} of 255 on average",
        "time": f"{report['total_s']:.1f} s, of which {report['fit_s']:.1f} s for the fit"
        + _compilation(report["compile_s"]),
        **_of_page(report),
        **_of_limit(report),
        "finished": _finished(report),
    }
    missed = [("not reached", line) for line in report["unreached"]]
    _print_table([*rows.items(), *missed, *_notes(report)])


def print_check(report: dict[str, Any], svg: str | None) -> None:
    """What an SVG contains, how large it is, how closely it matches the photo."""
    tags = [
        f"{count:,} {tag.rpartition('}')[2]}" for tag, count in report["elements_by_tag"].items()
    ]
    others = f", {len(tags) - _MOST_TAGS} other tags" if len(tags) > _MOST_TAGS else ""
    rows = {
        "file": f"{svg or 'standard input'}, {report['svg_width']:g}x{report['svg_height']:g} px",
        "size": f"{report['svg_bytes']:,} bytes, {report['svgz_bytes']:,} gzipped",
        "elements": f"{report['elements']:,}: {', '.join(tags[:_MOST_TAGS])}{others}",
        "match": f"{_match(report)}, MS-SSIM {_ssim(report['ms_ssim_svg'], 176)}, rasterised by "
        f"{report['renderer']} at {report['width']}x{report['height']} px",
        **_of_enlargement(report),
        **_of_alpha(report),
        **_scores(report),
        "errors": f"{report['largest_error_svg']:.0f} of 255 at most, "
        f"{report['bias_svg']:+.2f} of 255 on average",
    }
    _print_table([*rows.items(), *_notes(report)])


def _of_enlargement(report: dict[str, Any]) -> dict[str, str]:
    """A row for the match against the reference, none without one."""
    scale = report["reference_scale"]
    if scale is None:
        return {}
    score, ssim = decibels(report["psnr_svg_enlarged"]), _ssim(report["ssim_svg_enlarged"])
    return {
        "enlarged": f"PSNR {score}, SSIM {ssim} against the reference at {scale:g} times the size"
    }


def _at(report: dict[str, Any]) -> str:
    """The size at which a run was measured, where that is not the photo's."""
    measured = report["measured_width"], report["measured_height"]
    if measured == (report["width"], report["height"]):
        return ""
    return f" at {measured[0]}x{measured[1]} px"


def _match(report: dict[str, Any]) -> str:
    return (
        f"PSNR {decibels(report['psnr_svg'])}, SSIM {_ssim(report['ssim_svg'])} against the photo"
    )


def _scores(report: dict[str, Any]) -> dict[str, str]:
    """A row for the perceptual scores, and why one is missing; none where they were not asked."""
    parts = [
        f"{axis.name} {axis.text(report[axis.key])}"
        for axis in ON_REQUEST
        if axis.has(report[axis.key])
    ]
    text = "; ".join([*([", ".join(parts)] if parts else []), *report["scores_missing"]])
    return {"scores": text} if text else {}


def _notes(report: dict[str, Any]) -> list[tuple[str, str]]:
    return [("note", note) for note in report["notes"]]


def _finished(report: dict[str, Any]) -> str:
    reason = report["stop_reason"]
    alone = _NOTHING_TO_GAIN if report["quality"] is None else {}
    return alone.get(reason, _STOPPED[reason])


def _of_limit(report: dict[str, Any]) -> dict[str, str]:
    """A row for how much of a limit of bytes is used, and why no more."""
    limit, reason = report["max_bytes"], report["stop_reason"]
    if limit is None or not report["gaussians"]:
        return {}
    counted = report["gzip"] or report["count_gzipped"]
    size = report["svgz_bytes" if counted else "svg_bytes"]
    text = f"{size:,} of {limit:,} {'gzipped ' * counted}bytes, {size / limit:.1%}"
    if size >= _WELL_USED * limit:
        return {"limit": text}
    why = _finished(report)
    if reason == "max_bytes":
        why = "no larger one within the limit is closer"
        if report["gaussians"] < _FEW:
            why = "one Gaussian more would not fit"
    return {"limit": f"{text}: {why}"}


def _of_page(report: dict[str, Any]) -> dict[str, str]:
    """A row for a file that is heavy for a web page."""
    spent = report["paint_ms"]
    if spent is None or spent < HEAVY_MS:
        return {}
    lighter = "--markup editable" if report["markup"] == MINIMAL else "fewer Gaussians"
    return {
        "in a page": f"about {spent / 1000:.1f} s for a browser to paint it "
        f"{report['paint_width']:.0f} px wide, and again at each repaint; lighter with {lighter}"
    }


def _of_alpha(report: dict[str, Any]) -> dict[str, str]:
    """A row for a transparent photo, whose match is that over white."""
    if not report["transparent"]:
        return {}
    return {
        "transparency": f"PSNR {decibels(report['psnr_svg'])} over white, "
        f"{decibels(report['psnr_svg_black'])} over black, "
        f"{decibels(report['psnr_svg_alpha'])} of alpha"
    }


def _of_inks(report: dict[str, Any]) -> dict[str, str]:
    """A row for the inks, which may have been chosen."""
    return {"inks": report["inks"].replace(",", ", ")} if report["inks"] else {}


def _print_table(rows: list[tuple[str, str]]) -> None:
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim")
    table.add_column()
    for name, text in rows:
        # Text without markup or escapes, which a file name may contain.
        table.add_row(name, Text(on_one_line(text)))
    Console(stderr=True, highlight=False).print(table)


def _ssim(value: float | None, least_side: int = 3) -> str:
    return f"not defined under {least_side} px" if value is None else f"{value:.3f}"
