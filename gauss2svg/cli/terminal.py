"""What a person sees at the terminal: a progress bar, then a summary; on standard error."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, SpinnerColumn, TextColumn
from rich.progress import Progress as Bar
from rich.table import Table
from rich.text import Text

from gauss2svg.errors import on_one_line
from gauss2svg.pipeline.report import decibels
from gauss2svg.pipeline.result import Progress, ProgressCallback

_PHASES = {
    "read": "reading the photo",
    "compile": "preparing kernels (compiled on the first run, about 10 s)",
    "fit": "fitting",
    "write": "writing the SVG",
    "measure": "rasterising and measuring the SVG",
}
_NAMED = {
    "additive": "fitting additively",
    "correct": "correcting",
}  # with numbers as a fit has them


_STOPPED = {
    "iterations": "iterations done",
    "gaussians": "no Gaussians were asked for",
    "gain": "more would improve it too little for their bytes",
    "enough": "quality target reached",
    "cap": "the preset's maximum count reached",
    "target_psnr": "target PSNR reached",
    "max_bytes": "maximum file size reached",
    "time_limit": "time limit reached",
    "interrupted": "interrupted",
}
_MOST_TAGS = 6  # of a checked SVG, the commonest


@contextmanager
def show_progress(quiet: bool) -> Iterator[ProgressCallback | None]:
    """A callback for `vectorize` that keeps a progress bar; None if quiet or no terminal."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        TextColumn("{task.fields[state]}"),
    )
    with Bar(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting", total=None, state="")

        def update(progress: Progress) -> None:
            now = progress.fit
            if now is None:
                bar.update(task, description=_PHASES[progress.phase], total=None, state="")
                return
            bar.update(
                task,
                description=_NAMED.get(progress.phase, f"round {now.round}"),
                completed=now.done,
                total=1.0,
                state=(
                    f"{now.gaussians} Gaussians, {now.psnr:.2f} dB, {now.remaining_s:.0f} s left"
                ),
            )

        yield update


def print_summary(report: dict[str, Any], output: str | None) -> None:
    """A few lines: what was written, how large it is, how closely it matches, how long it took."""
    rows = {
        "SVG": f"{output or 'standard output'}, {report['width']}x{report['height']} px",
        "Gaussians": f"{report['gaussians']} in {report['rounds']} rounds, "
        f"{report['iterations']} iterations; {_STOPPED[report['stop_reason']]}",
        "bytes": f"{report['svg_bytes']:,} raw, {report['svgz_bytes']:,} gzipped; "
        f"{report['bytes_by_part']['gradients'] / report['svg_bytes']:.0%} for gradients",
        "seconds": f"{report['fit_s']:.1f} to fit, {report['total_s']:.1f} in all"
        + (f", {report['compile_s']:.0f} to compile once" if report["compile_s"] > 2 else ""),
        "against photo": f"PSNR {decibels(report['psnr_svg'])}, SSIM {_ssim(report['ssim_svg'])}, "
        f"rasterised by {report['renderer']}",
        **_of_alpha(report),
        "against model": f"PSNR {decibels(report['psnr_roundtrip'])}, "
        f"bias {report['bias_roundtrip']:+.2f} of 255; "
        f"the model itself has {decibels(report['psnr_model'])}",
    }
    lines = [*rows.items(), *(("not reached", line) for line in report["unreached"])]
    _print_table([*lines, *(("note", note) for note in report["notes"])])


def print_check(report: dict[str, Any], svg: str | None) -> None:
    """A few lines: what an SVG has, how large it is, how closely it matches."""
    tags = [
        f"{count:,} {tag.rpartition('}')[2]}" for tag, count in report["elements_by_tag"].items()
    ]
    others = f", {len(tags) - _MOST_TAGS} other tags" if len(tags) > _MOST_TAGS else ""
    rows = {
        "SVG": f"{svg or 'standard input'}, {report['svg_width']:g}x{report['svg_height']:g} px",
        "elements": f"{report['elements']:,}: {', '.join(tags[:_MOST_TAGS])}{others}",
        "bytes": f"{report['svg_bytes']:,} raw, {report['svgz_bytes']:,} gzipped",
        "against photo": f"PSNR {decibels(report['psnr_svg'])}, SSIM {_ssim(report['ssim_svg'])}, "
        f"MS-SSIM {_ssim(report['ms_ssim_svg'], 176)}, rasterised by {report['renderer']} at "
        f"{report['width']}x{report['height']} px",
        **_of_alpha(report),
        "errors": f"largest {report['largest_error_svg']:.0f}, "
        f"bias {report['bias_svg']:+.2f} of 255",
    }
    _print_table([*rows.items(), *(("note", note) for note in report["notes"])])


def _of_alpha(report: dict[str, Any]) -> dict[str, str]:
    """A line for a transparent photo: the PSNR above is over white."""
    if not report["transparent"]:
        return {}
    return {
        "transparent": f"PSNR {decibels(report['psnr_svg'])} over white, "
        f"{decibels(report['psnr_svg_black'])} over black, "
        f"{decibels(report['psnr_svg_alpha'])} of alpha"
    }


def _print_table(rows: list[tuple[str, str]]) -> None:
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim")
    table.add_column()
    for name, text in rows:
        # No markup, and no escapes: a file name may look like either.
        table.add_row(name, Text(on_one_line(text)))
    Console(stderr=True, highlight=False).print(table)


def _ssim(value: float | None, least_side: int = 3) -> str:
    return f"not defined under {least_side} px" if value is None else f"{value:.3f}"
