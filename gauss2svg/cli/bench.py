"""The command `gauss2svg bench`, imported only when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from gauss2svg.cli.parser import STATUS_SOME_FAILED, words
from gauss2svg.cli.terminal import say
from gauss2svg.compare import BenchOptions
from gauss2svg.files import check_folder
from gauss2svg.options import OptionGroup, file_path
from gauss2svg.pipeline.progress_display import counting

if TYPE_CHECKING:
    from gauss2svg.compare.grid import Progress


@dataclass(frozen=True, kw_only=True)
class BenchCommand(OptionGroup):
    """Arguments of the command alone."""

    photos: tuple[str, ...] = ()
    """Photos, folders, patterns such as photos/*.jpg, or lists of them (.txt, or - for standard
    input)."""

    output: Annotated[Path, file_path]
    """Folder for rows.jsonl, bench.json, bench.csv, summary.md and the plots. The same command
    continues an interrupted benchmark and keeps the finished runs."""

    axis: tuple[str, ...] = ()
    """Option to vary, as NAME=VALUE,VALUE, or as NAME for all values of an option that has only a
    few. NAME is an option of the main command that changes the file, such as gaussians, iterations,
    quality, loss or palette. Several axes give all combinations. Without any, the presets and some
    counts are run. Separate lists of inks by semicolons: "inks=6;#f7c306,#17324d"."""

    peers: str = ""
    """Other tools to measure if they are installed, separated by commas: vtracer, jpeg, webp, avif.
    One setting of a tool follows a colon, such as jpeg:30. LABEL=FOLDER is any other method: its
    SVGs or pictures by the names of the photos, and if there is a table.csv in the folder, its
    seconds. LABEL=TABLE.csv has published numbers, by the names of the report. SVGs are rasterised
    by resvg."""

    from_: Annotated[Path | None, file_path] = None
    """Output folder of gauss2svg batch. Its SVGs are measured as they are, without another fit.
    Without --axis nothing else is."""

    quiet: bool = False
    """Show neither progress nor summary."""


SECTIONS = {"Parameters": BenchCommand, "Benchmark": BenchOptions}


def run(given: dict[str, Any]) -> int:
    """Run the command with the values that were given, and return its exit status."""
    from gauss2svg.compare.table import run_bench
    from gauss2svg.compare.variants import parse_axes, peer_variants, photos_and_peers
    from gauss2svg.measure import packages_missing

    command = BenchCommand.of(given)
    check_folder(command.output)
    photos, made = photos_and_peers(command.photos, command.from_, "bench")
    names, axes = [*made, *words(command.peers)], parse_axes(command.axis)
    if absent := peer_variants(names)[1]:
        say(f"skipped, not installed: {', '.join(absent)}")
    for line in packages_missing():
        say(line)
    kept = 0
    with counting(command.quiet) as update:

        def progress(state: Progress) -> None:
            nonlocal kept
            kept = state.kept
            update("; ".join(state.now), state.done, state.total)

        rows = run_bench(
            photos,
            command.output,
            axes=axes or ({} if made else None),
            peers=names,
            options=BenchOptions.of(given),
            progress=progress,
        )
    failed = [row for row in rows if "error" in row]
    if not command.quiet:
        from_before = f", {kept} of them kept from before" if kept else ""
        summary = command.output / "summary.md"
        say(f"{len(rows)} runs{from_before}; {len(failed)} failed; see {summary}")
    for row in failed:
        say(f"failed: {row['label']} on {row['image']}: {row['error']}")
    return STATUS_SOME_FAILED if failed else 0
