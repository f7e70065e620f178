"""The command `gauss2svg bench`, and what it shares with `gauss2svg gallery`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from gauss2svg.cli.parser import STATUS_SOME_FAILED, words
from gauss2svg.cli.terminal import say
from gauss2svg.compare import BenchOptions
from gauss2svg.errors import refusal
from gauss2svg.files import check_folder
from gauss2svg.options import OptionGroup, file_path


@dataclass(frozen=True, kw_only=True)
class BenchCommand(OptionGroup):
    """Arguments of the command alone."""

    output: Annotated[Path, file_path]
    """Folder for rows.jsonl, bench.json, bench.csv, summary.md and the plots. The same command
    continues an interrupted benchmark and keeps the finished runs."""


@dataclass(frozen=True, kw_only=True)
class Comparison(OptionGroup):
    """Arguments that `bench` and `gallery` share."""

    photos: tuple[str, ...] = ()
    """Photos, folders, patterns such as photos/*.jpg, or lists of them (.txt, or - for standard
    input)."""

    axis: tuple[str, ...] = ()
    """Option to vary, as NAME=VALUE,VALUE, or as NAME for all values of an option that has only a
    few. NAME is an option of the main command that changes the file, such as areas, gaussians,
    quality, loss or palette. Several axes give all combinations. Without any, bench runs the
    presets and some counts. Separate lists of inks by semicolons: "inks=6;#f7c306,#17324d"."""

    peers: tuple[str, ...] = ()
    """Other tools to compare if they are installed, separated by commas: vtracer, jpeg, webp, avif.
    One setting of a tool follows a colon, such as jpeg:30 or vtracer:detailed. LABEL=FOLDER is any
    other method: its SVGs or pictures by the names of the photos, and if there is a table.csv in
    the folder, its seconds. For bench, LABEL=NUMBERS.csv has published numbers, by the names of the
    report. SVGs are rasterised by resvg."""

    from_: Annotated[Path | None, file_path] = None
    """Output folder of gauss2svg batch. Its SVGs are shown and measured as they are, without
    another fit. If there is no other variant, nothing else is."""

    quiet: bool = False
    """Show neither progress nor summary."""

    def inputs(self, command: str, output: Path) -> tuple[list[str], list[str], dict[str, Any]]:
        """Return the photos, the peers and the axes. Print lines about tools that are missing."""
        from gauss2svg.batch.inputs import local_photos
        from gauss2svg.batch.many import TABLE
        from gauss2svg.compare.variants import parse_axes, peer_variants, rows_of
        from gauss2svg.measure import packages_missing

        check_folder(output)
        photos, peers = local_photos(self.photos), words(",".join(self.peers))
        if self.from_ is not None:
            if not (table := self.from_ / TABLE).is_file():
                raise refusal("--from", "the output folder of gauss2svg batch", f"no {table}")
            peers.insert(0, f"batch={self.from_}")
            photos = photos or [row["input"] for _, row in rows_of(table) if not row["error"]]
        elif not photos:
            raise refusal("PHOTOS", "given", "none", f"gauss2svg {command} --help")
        axes = parse_axes(self.axis)
        if absent := peer_variants(peers)[1]:
            say(f"skipped, not installed: {', '.join(absent)}")
        for line in packages_missing():
            say(line)
        return photos, peers, axes

    def end(self, count: int, failures: Sequence[str], path: Path) -> int:
        """Print the failures and a summary of `count` finished runs. Return the exit status."""
        for line in failures:
            say(f"failed: {line}")
        if not self.quiet:
            say(f"{count} done, {len(failures)} failed; see {path}")
        return STATUS_SOME_FAILED if failures else 0


SECTIONS = {"Parameters": Comparison, "Output": BenchCommand, "Benchmark": BenchOptions}


def run(given: dict[str, Any]) -> int:
    """Run the command with the values that were given, and return its exit status."""
    from gauss2svg.compare.table import run_bench

    shared, output = Comparison.of(given), BenchCommand.of(given).output
    photos, peers, axes = shared.inputs("bench", output)
    rows = run_bench(
        photos, output, axes=axes or ({} if shared.from_ else None), peers=peers,
        options=BenchOptions.of(given), progress=not shared.quiet,
    )  # fmt: skip
    failures = [f"{r['label']} on {r['image']}: {r['error']}" for r in rows if "error" in r]
    return shared.end(len(rows) - len(failures), failures, output / "summary.md")
