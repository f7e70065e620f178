"""The command `gauss2svg gallery`, imported only when it is run."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from gauss2svg.cli.parser import STATUS_SOME_FAILED, words
from gauss2svg.cli.terminal import say
from gauss2svg.compare.pages import GalleryOptions
from gauss2svg.errors import of_file, refusal
from gauss2svg.files import check_folder
from gauss2svg.fit import MOST_GAUSSIANS
from gauss2svg.options import Field, OptionGroup, file_path
from gauss2svg.pipeline.progress_display import counting
from gauss2svg.processes import command_line


@dataclass(frozen=True, kw_only=True)
class GalleryCommand(OptionGroup):
    """Arguments of the command alone."""

    photos: tuple[str, ...] = ()
    """Photos, folders, patterns such as photos/*.jpg, or lists of them (.txt, or - for standard
    input)."""

    output: Annotated[Path, file_path]
    """Folder for the pages, which begin with index.html. The same command continues an interrupted
    gallery. A command with more photos or variants adds these. Finished SVGs are kept."""

    variants: str | None = None
    """Presets to compare, separated by commas: draft, fast, balanced, high, max. Without --counts
    or --axis the default is draft,balanced,high."""

    counts: str | None = None
    """Numbers of Gaussians to compare, separated by commas: 500,2000,8000."""

    axis: tuple[str, ...] = ()
    """Option to vary, as NAME=VALUE,VALUE, or as NAME for all values of an option that has only a
    few: areas=auto,never. Several axes give all combinations."""

    peers: str = ""
    """Other tools to compare if they are installed, separated by commas: vtracer, jpeg, webp, avif.
    Another setting follows a colon, such as vtracer:detailed. LABEL=FOLDER is any other method: its
    SVGs or pictures by the names of the photos, and if there is a table.csv in the folder, its
    seconds."""

    from_: Annotated[Path | None, file_path] = None
    """Output folder of gauss2svg batch. Its SVGs are shown as they are, without another
    fit. Without --variants, --counts
    and --axis nothing else is."""

    quiet: bool = False
    """Show neither progress nor summary."""


SECTIONS = {"Parameters": GalleryCommand, "Gallery": GalleryOptions}


def run(given: dict[str, Any]) -> int:
    """Run the command with the values that were given, and return its exit status."""
    from gauss2svg.compare.pages import build_gallery
    from gauss2svg.compare.variants import parse_axes, photos_and_peers
    from gauss2svg.measure import packages_missing

    command = GalleryCommand.of(given)
    check_folder(command.output)
    paths, made = photos_and_peers(command.photos, command.from_, "gallery")
    output = command.output
    count = Field("each of --counts", int, 0, MOST_GAUSSIANS, advice="500,2000")
    counts = None if command.counts is None else [*map(count.parsed, words(command.counts))]
    variants = "" if made and command.variants is None else command.variants
    for source in command.photos:
        if output.resolve().is_relative_to(Path(source).resolve()):
            got = f"{output}, which is in {source}"
            raise refusal("output", "outside of the inputs", got, "another folder")
    with counting(command.quiet) as update:
        gallery = build_gallery(
            paths,
            output,
            variants=None if variants is None else words(variants),
            counts=counts,
            peers=[*made, *words(command.peers)],
            axes=parse_axes(command.axis),
            options=GalleryOptions.of(given),
            command=command_line(["gauss2svg", *sys.argv[1:]]),
            progress=lambda state: update("; ".join(state.now), state.done, state.total),
        )
    for line in packages_missing():
        say(line)
    if gallery.absent:
        say(f"skipped, not installed: {', '.join(gallery.absent)}")
    for failure in gallery.failures:
        photo, variant, error = (failure[key] for key in ("photo", "variant", "error"))
        say(f"failed: {f'{photo}, {variant}: {error}' if variant else of_file(photo, error)}")
    if not command.quiet:
        count = len(gallery.rows)
        kept = f", {gallery.kept} of them kept from before" if gallery.kept else ""
        failed = f"{len(gallery.failures)} failed"
        say(f"{count} SVG{'s' * (count != 1)}{kept}; {failed}; open {gallery.index}")
    return STATUS_SOME_FAILED if gallery.failures else 0
