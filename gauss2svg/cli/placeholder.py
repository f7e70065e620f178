"""The command `gauss2svg placeholder`, imported only when it is run."""

from dataclasses import dataclass
from typing import Any

from gauss2svg.batch.inputs import local_photos
from gauss2svg.batch.placeholders import PlaceholderList, PlaceholderOptions
from gauss2svg.cli.parser import STATUS_SOME_FAILED
from gauss2svg.cli.terminal import say
from gauss2svg.errors import several
from gauss2svg.files import STANDARD_STREAM, write_all_atomically, write_output
from gauss2svg.options import OptionGroup
from gauss2svg.pipeline.progress_display import counting


@dataclass(frozen=True, kw_only=True)
class PlaceholderCommand(OptionGroup):
    """Arguments of the command alone."""

    photos: list[str]
    """Photos, folders, patterns such as photos/*.jpg, or lists of them (.txt, or - for standard
    input)."""

    output: str = STANDARD_STREAM
    """List, SVG or folder of SVGs to write, or - for standard output. An existing list keeps the
    entries of unchanged photos, and loses those of photos that are not given."""

    quiet: bool = False
    """Show neither progress nor summary."""


SECTIONS = {"Parameters": PlaceholderCommand, "Placeholders": PlaceholderOptions}


def run(given: dict[str, Any]) -> int:
    """Run the command with the values that were given, and return its exit status."""
    command = PlaceholderCommand.of(given)
    paths, output = local_photos(command.photos), command.output
    entries = PlaceholderList(paths, output, PlaceholderOptions.of(given))
    is_whole = False
    try:
        with counting(command.quiet) as update:
            for done, photo in enumerate(entries.photos):
                update(photo.name, done, len(entries.photos))
                entries.add(photo)
        is_whole = True
    finally:  # after Ctrl-C, what was made so far is written, but not to standard output
        for line in entries.failures:
            say(line)
        if output != STANDARD_STREAM and entries.count:
            write_all_atomically(entries.files())
        elif is_whole and entries.count:
            write_output(entries.files()[output])
    if not command.quiet:
        where = "standard output" if output == STANDARD_STREAM else output
        counts = f"{entries.unchanged} unchanged; {len(entries.failures)} failed"
        say(f"{several(entries.count, 'placeholder')} in {where}, {counts}")
    return STATUS_SOME_FAILED if entries.failures else 0
