"""The command `gauss2svg batch`, imported only where it is run."""

from __future__ import annotations

import json
import sys
from contextlib import closing
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Group, Parameter

from gauss2svg.batch.options import BatchOptions
from gauss2svg.cli import parameters, streams
from gauss2svg.cli.parameters import Output, Quiet
from gauss2svg.cli.streams import say
from gauss2svg.pipeline.options import GROUP_TITLES, Options

_Parsed = parameters.options_of({key: Group(title) for key, title in GROUP_TITLES.items()})
_DEFAULTS = _Parsed()


def batch_command(
    photos: Annotated[list[str], Parameter(negative="", allow_leading_hyphen=True)],
    *,
    output: Output,
    batch: Annotated[BatchOptions, Parameter(name="*", group="Batch")] = BatchOptions(),
    options: Annotated[Path | None, Parameter(name=parameters.OPTIONS_FILE)] = None,
    given: Annotated[_Parsed, Parameter(name="*")] = _DEFAULTS,  # pyright: ignore[reportInvalidTypeForm]
    log: Literal["json"] | None = None,
    quiet: Quiet = False,
) -> int:
    """Vectorise many photos, by the cores of this machine or the workers of a Dask cluster.

    Parameters
    ----------
    photos
        Folders, globs, photos, lists (.txt, - for standard input), or URLs of these.
    output
        Folder or URL for the SVGs. Run the command again to continue: what is done is skipped.
    options
        TOML file of options, such as quality = "draft"; those given here count first.
    log
        Write a line of JSON for each photo, as it is known, on standard output: the columns of the
        table.
    batch, given
        Options.
    quiet
        Show neither progress nor summary.

    """
    from gauss2svg.batch.many import Batch
    from gauss2svg.batch.table import Summary

    if log == "json":
        streams.standard_stream(sys.stdout, "output")  # is refused now, not at the first record
    with Batch(photos, output, Options(**vars(given)), batch) as made:
        summary, count = Summary(), made.index.count
        try:
            with (
                streams.counting_bar(quiet) as update,
                closing(made.run(say=(lambda _: None) if quiet else say)) as records,
            ):
                update("", 0, count)
                for record in records:
                    summary.add(record)
                    if log == "json":
                        line = {**record.line(), "skipped": record.skipped}
                        streams.write_output(json.dumps(line).encode() + b"\n")
                    update(summary.state(count), summary.total, count)
        except KeyboardInterrupt:
            say(f"see {', '.join(made.finish())}")  # of what is done
            raise
        tables = made.finish()
    if not quiet:
        for line in summary.lines():
            say(line)
        say(f"see {', '.join(tables)}")
    elif summary.failed:
        say(f"{summary.failures}; see {tables[0]}")
    return parameters.STATUS_SOME_FAILED if summary.failed else 0
