"""The command `gauss2svg gallery`, imported only when it is run."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from gauss2svg.cli.bench import Comparison
from gauss2svg.cli.parser import words
from gauss2svg.compare import GalleryOptions
from gauss2svg.errors import of_file, refusal
from gauss2svg.options import OptionGroup, file_path
from gauss2svg.processes import command_line


@dataclass(frozen=True, kw_only=True)
class GalleryCommand(OptionGroup):
    """Arguments of the command alone."""

    output: Annotated[Path, file_path]
    """Folder for the pages, which begin with index.html. The same command continues an interrupted
    gallery. A command with more photos or variants adds these. Finished SVGs are kept."""

    variants: str | None = None
    """Presets to compare, separated by commas: draft, fast, balanced, high, max. Without --counts
    or --axis the default is draft,balanced,high."""

    counts: str | None = None
    """Numbers of Gaussians to compare, separated by commas: 500,2000,8000."""


SECTIONS = {"Parameters": Comparison, "Output": GalleryCommand, "Gallery": GalleryOptions}


def run(given: dict[str, Any]) -> int:
    """Run the command with the values that were given, and return its exit status."""
    from gauss2svg.compare.pages import build_gallery
    from gauss2svg.compare.variants import parse_axes

    shared, command = Comparison.of(given), GalleryCommand.of(given)
    photos, peers, axes = shared.inputs("gallery", command.output)
    for source in shared.photos:
        if command.output.resolve().is_relative_to(Path(source).resolve()):
            got = f"{command.output}, which is in {source}"
            raise refusal("output", "outside of the inputs", got, "another folder")
    counts = parse_axes([f"gaussians={command.counts}"]) if command.counts else {}
    variants = "" if shared.from_ and command.variants is None else command.variants
    gallery = build_gallery(
        photos, command.output, variants=None if variants is None else words(variants),
        counts=counts.get("gaussians"), peers=peers, axes=axes, options=GalleryOptions.of(given),
        command=command_line(["gauss2svg", *sys.argv[1:]]), progress=not shared.quiet,
    )  # fmt: skip
    failures = [
        f"{row['photo']}, {row['variant']}: {row['error']}"
        if row["variant"]
        else of_file(row["photo"], row["error"])
        for row in gallery["failures"]
    ]
    return shared.end(len(gallery["rows"]), failures, command.output / "index.html")
