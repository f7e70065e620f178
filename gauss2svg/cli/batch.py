"""The command `gauss2svg batch`, imported only when it is run."""

import json
import sys
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from gauss2svg import files
from gauss2svg.cli.parser import STATUS_SOME_FAILED, options_of_file, run_options
from gauss2svg.cli.terminal import say
from gauss2svg.options import Interval, OptionGroup, file_path
from gauss2svg.pipeline.options import GROUP_TITLES, GROUPS


@dataclass(frozen=True, kw_only=True)
class BatchCommand(OptionGroup):
    """Arguments of the command alone."""

    photos: list[str]
    """Photos, folders, patterns such as photos/*.jpg, lists of them (.txt, or - for standard
    input), or URLs of any of these."""

    output: str
    """Folder or URL for the SVGs. The same command continues an interrupted batch, skips the photos
    that are done, and retries those that changed or failed. The exit status is 1 if some failed."""

    options: Annotated[Path | None, file_path] = None
    """TOML file of options, such as quality = "draft". An option of the command line replaces the
    one in the file."""

    workers: Annotated[int | None, Interval(ge=1, le=1024)] = None
    """Number of worker processes on this machine. The default is one for each core, or as many as
    the memory allows."""

    log: Literal["json"] | None = None
    """Print a line of JSON on standard output for each finished photo, with the columns of the
    table."""

    quiet: bool = False
    """Show neither progress nor summary."""


SECTIONS: dict[str, type[OptionGroup]] = {"Parameters": BatchCommand}
SECTIONS |= {title: GROUPS[key] for key, title in GROUP_TITLES.items()}


def run(given: dict[str, Any]) -> int:
    """Run the command with the values that were given, and return its exit status."""
    from gauss2svg.batch.many import Batch

    command = BatchCommand.of(given)
    files.check_folder(command.output)
    options = run_options((options_of_file(command.options) if command.options else {}) | given)
    if command.log == "json":
        # If standard output is closed, this raises an error before any work is done.
        files.standard_stream(sys.stdout, "output")
    job = Batch(command.photos, command.output, options, command.workers)
    summary = job.summary
    try:
        with closing(job.run(quiet=command.quiet)) as records:
            for record in records:
                if command.log == "json":
                    files.write_output(json.dumps(record._asdict()).encode() + b"\n")
    except KeyboardInterrupt as interrupt:
        say(f"see {job.table}")
        done = f"{summary.done + summary.skipped:,} of {summary.count:,} photos are done"
        interrupt.args = (f"interrupted; {done}, and the same command goes on with the others",)
        raise
    if not command.quiet:
        for line in summary.lines():
            say(line)
        say(f"see {job.table}")
    elif summary.failed:
        say(f"{summary.failed:,} failed; see {job.table}")
    return STATUS_SOME_FAILED if summary.failed else 0
