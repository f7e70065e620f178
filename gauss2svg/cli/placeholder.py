"""The command `gauss2svg placeholder`, imported only when it is run."""

from typing import Annotated

from cyclopts import Parameter

from gauss2svg.batch.inputs import local_photos
from gauss2svg.batch.placeholders import PlaceholderList, PlaceholderOptions
from gauss2svg.cli.parameters import STATUS_SOME_FAILED, Output, Photos, Quiet
from gauss2svg.cli.terminal import counting_bar, say
from gauss2svg.errors import Gauss2SvgError
from gauss2svg.files import STANDARD_STREAM, write_all_atomically, write_output

_DEFAULTS = PlaceholderOptions()


def placeholder_command(
    photos: Photos,
    *,
    output: Output = STANDARD_STREAM,
    options: Annotated[PlaceholderOptions, Parameter(name="*", group="Placeholders")] = _DEFAULTS,
    quiet: Quiet = False,
) -> int:
    """Write SVGs of about a kilobyte, which a web page shows until its photos have loaded.

    Parameters
    ----------
    photos
        Photos.
    output
        File to write, or - for standard output. With --format svg a folder. Entries of an existing
        list are kept if their photo is unchanged, and removed if it is not given.
    options
        Options.
    quiet
        Show neither progress nor summary.

    """
    paths = local_photos(photos)
    listed = PlaceholderList(paths, output, options)
    with counting_bar(quiet) as update:
        try:
            for done, photo in enumerate(listed.photos):
                update(photo.name, done, len(listed.photos))
                listed.add(photo)
        except BaseException:  # a signal inside a kernel arrives as another exception
            _write_so_far(listed, output)
            raise
    kept = listed.kept if listed.count else 0
    if listed.count:
        _write(listed, output)
    if listed.copies:
        say(f"{listed.copies} of {len(paths)} photos were given more than once")
    for photo, placeholder in listed.made.items():
        if not placeholder.gaussians:
            say(f"{photo.name}: it has no Gaussians, because none fits or none is needed")
    for line in listed.failures:
        say(line)
    if not quiet:
        where = f" in {'standard output' if output == STANDARD_STREAM else output}"
        unchanged = f", {listed.unchanged} of them unchanged" if listed.unchanged else ""
        say(
            f"{listed.count} placeholder{'s' * (listed.count != 1)}{where * bool(listed.count)}"
            f"{unchanged}; {len(listed.failures)} failed"
            f"{'' if listed.count else ', and nothing was written'}"
            + (f"; {kept} of them kept from before" if kept else "")
        )
    return STATUS_SOME_FAILED if listed.failures else 0


def _write(listed: PlaceholderList, output: str) -> None:
    files = listed.files()
    if output == STANDARD_STREAM:
        write_output(files[output])
    else:
        write_all_atomically(files)


def _write_so_far(listed: PlaceholderList, output: str) -> None:
    """Write the finished placeholders, but not to standard output, where they would look final."""
    for line in listed.failures:
        say(line)
    if listed.made and output != STANDARD_STREAM:
        try:
            _write(listed, output)
            share = f"{len(listed.made)} of {len(listed.photos)} placeholders"
            say(f"wrote what was made so far: {share}")
        except Gauss2SvgError as error:
            say(str(error))
