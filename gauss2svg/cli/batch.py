"""The command `gauss2svg batch`, imported only where it is run."""

from __future__ import annotations

import json
import sys
import tomllib
from contextlib import closing
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, ArgumentCollection, Group, Parameter
from cyclopts.config import Toml

from gauss2svg.batch.options import BatchOptions
from gauss2svg.cli import parameters, streams
from gauss2svg.cli.parameters import Output, Quiet
from gauss2svg.cli.streams import say
from gauss2svg.errors import InputError
from gauss2svg.files import reading
from gauss2svg.pipeline.options import GROUP_TITLES, Options

_SHOW_S = 0.2  # between two states of the bar
_OPTIONS_FILE = "--options"
_Parsed = parameters.options_of({key: Group(title) for key, title in GROUP_TITLES.items()})
_DEFAULTS = _Parsed()


def batch_command(
    photos: Annotated[list[str], Parameter(negative="", allow_leading_hyphen=True)],
    *,
    output: Output,
    batch: Annotated[BatchOptions, Parameter(name="*", group="Batch")] = BatchOptions(),
    options: Annotated[Path | None, Parameter(name=_OPTIONS_FILE)] = None,
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

    parameters.refuse_options(batch_command, photos, output)
    if log == "json":
        streams.standard_stream(sys.stdout, "output")  # is refused now, not at the first record
    made = Batch(photos, output, Options(**vars(given)), batch)
    summary, count, shown_s = Summary(), made.count, 0.0
    try:
        with (
            streams.counting_bar(quiet) as update,
            closing(made.run(say=(lambda _: None) if quiet else say)) as records,
        ):
            update("", 0, count)
            for record in records:
                summary.add(record)
                if log == "json":
                    streams.write_output(json.dumps(record._asdict()).encode() + b"\n")
                if summary.seconds - shown_s > _SHOW_S:
                    shown_s = summary.seconds
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


def take_options_of_file(
    app: App, commands: tuple[str, ...], arguments: ArgumentCollection
) -> None:
    """Take the options of a TOML file that --options names, where they are not given as well.

    A hook of the parser's. Raise InputError for a file that is no TOML, or has no valid options.
    """
    given = [token for one in arguments if _OPTIONS_FILE in one.names for token in one.tokens]
    if not given:
        return
    path = given[0].value
    with reading(path, "a TOML file") as file:
        try:
            keys = tomllib.load(file)
            Options.from_flat({key.replace("-", "_"): value for key, value in keys.items()})
        except (ValueError, RecursionError) as error:
            raise InputError(f"cannot take the options of {path}: {error}") from error
    Toml(path, use_commands_as_keys=False)(app, commands, arguments)
