"""The command `gauss2svg batch`, imported only when it is run."""

from __future__ import annotations

import json
import sys
from contextlib import closing
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Group, Parameter

from gauss2svg import files
from gauss2svg.batch import BatchOptions
from gauss2svg.cli import parameters, terminal
from gauss2svg.cli.parameters import Output, Quiet
from gauss2svg.cli.terminal import say
from gauss2svg.pipeline.options import GROUP_TITLES, Options

_Parsed = parameters.options_of(
    {key: Group(title, sort_key=at) for at, (key, title) in enumerate(GROUP_TITLES.items(), 1)}
)
_DEFAULTS, _GROUP = _Parsed(), Group("Batch", sort_key=0)


def batch_command(
    photos: Annotated[list[str], Parameter(negative="", allow_leading_hyphen=True)],
    *,
    output: Output,
    batch: Annotated[BatchOptions, Parameter(name="*", group=_GROUP)] = BatchOptions(),
    options: Annotated[Path | None, Parameter(name=parameters.OPTIONS_FILE)] = None,
    parsed: Annotated[_Parsed, Parameter(name="*")] = _DEFAULTS,  # pyright: ignore[reportInvalidTypeForm]
    log: Literal["json"] | None = None,
    quiet: Quiet = False,
) -> int:
    """Vectorise many photos, on the cores of this machine or the workers of a Dask cluster.

    Parameters
    ----------
    photos
        Photos, folders, patterns such as photos/*.jpg, lists of them (.txt, or - for standard
        input), or URLs of any of these.
    output
        Folder or URL for the SVGs. The same command continues an interrupted batch, skips the
        photos that are done, and retries those that changed or failed. The exit status is 1 if some
        failed.
    options
        TOML file of options, such as quality = "draft". An option of the command line replaces the
        one in the file.
    log
        Print a line of JSON on standard output for each finished photo, with the columns of the
        table.
    batch, parsed
        Options.
    quiet
        Show neither progress nor summary.

    """
    from gauss2svg.batch.many import Batch
    from gauss2svg.batch.table import Summary

    if log == "json":
        # If standard output is closed, this raises an error before any work is done.
        files.standard_stream(sys.stdout, "output")
    job = Batch(photos, output, Options(**vars(parsed)), batch)
    summary, count = Summary(), job.count
    try:
        with (
            terminal.counting_bar(quiet) as update,
            closing(job.run()) as records,
        ):
            update("", 0, count)
            for record in records:
                summary.add(record)
                if log == "json":
                    files.write_output(json.dumps(record._asdict()).encode() + b"\n")
                update(summary.progress_text(count), summary.total, count)
    except KeyboardInterrupt:
        job.finish()
        say(f"see {', '.join(job.tables)}")
        raise
    if not quiet:
        for line in summary.lines():
            say(line)
        say(f"see {', '.join(job.tables)}")
    elif summary.failed:
        say(f"{summary.failed:,} failed; see {job.tables[0]}")
    return parameters.STATUS_SOME_FAILED if summary.failed else 0
