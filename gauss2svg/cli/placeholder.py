"""The command `gauss2svg placeholder`, imported only when it is run."""

from dataclasses import dataclass
from typing import Any

from gauss2svg.batch.inputs import local_photos
from gauss2svg.batch.placeholders import PlaceholderList, PlaceholderOptions
from gauss2svg.cli.parser import STATUS_SOME_FAILED
from gauss2svg.cli.terminal import say
from gauss2svg.errors import Gauss2SvgError
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
    try:
        with counting(command.quiet) as update:
            for done, photo in enumerate(entries.photos):
                update(photo.name, done, len(entries.photos))
                entries.add(photo)
    except BaseException:
        # BaseException is caught because of Ctrl-C: it raises a KeyboardInterrupt, or a SystemError
        # if it interrupts a kernel.
        _write_so_far(entries, output)
        raise
    kept = entries.kept if entries.count else 0
    if entries.count and output == STANDARD_STREAM:
        write_output(entries.files()[output])
    elif entries.count:
        write_all_atomically(entries.files())
    if entries.copies:
        say(f"{entries.copies} of {len(paths)} photos were given more than once")
    for photo, placeholder in entries.new.items():
        if not placeholder.gaussians and not placeholder.areas:
            say(f"{photo.name}: it is one colour, because no Gaussian fits or none is needed")
    for line in entries.failures:
        say(line)
    if not command.quiet:
        where = f" in {'standard output' if output == STANDARD_STREAM else output}"
        unchanged = f", {entries.unchanged} of them unchanged" if entries.unchanged else ""
        say(
            f"{entries.count} placeholder{'s' * (entries.count != 1)}{where * bool(entries.count)}"
            f"{unchanged}; {len(entries.failures)} failed"
            f"{'' if entries.count else ', and nothing was written'}"
            + (f"; {kept} of them kept from before" if kept else "")
        )
    return STATUS_SOME_FAILED if entries.failures else 0


def _write_so_far(entries: PlaceholderList, output: str) -> None:
    """Print the failures, and write the finished placeholders, because the run was interrupted.

    If the output is standard output, no placeholder is written.
    """
    for line in entries.failures:
        say(line)
    if entries.new and output != STANDARD_STREAM:
        try:
            write_all_atomically(entries.files())
            share = f"{len(entries.new)} of {len(entries.photos)} placeholders"
            say(f"wrote what was made so far: {share}")
        except Gauss2SvgError as error:
            say(str(error))
