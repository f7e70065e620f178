"""The command `gauss2svg batch`, imported only where it is run."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Group, Parameter

from gauss2svg.batch.options import BatchOptions
from gauss2svg.cli.parameters import (
    STATUS_SOME_FAILED,
    Quiet,
    options_of,
    refuse_unknown_options,
)
from gauss2svg.cli.streams import counting_bar, say, standard_stream, write_output
from gauss2svg.errors import InputError, brief, quoted
from gauss2svg.files import reading, refuse_option_like
from gauss2svg.pipeline.options import GROUP_TITLES, Options, option_names

_SHOW_S = 0.2  # between two states of the bar
_OPTIONS_FILE = "--options"
_Parsed = options_of({key: Group(title) for key, title in GROUP_TITLES.items()})
_DEFAULTS = _Parsed()


def batch_command(
    photos: Annotated[
        list[str],
        Parameter(
            negative="",
            allow_leading_hyphen=True,
            help="Folders, globs, photos, lists (.txt, - for standard input), or URLs of these.",
        ),
    ],
    *,
    output: Annotated[
        str,
        Parameter(
            name=["--output", "-o"],
            allow_leading_hyphen=True,
            help="Folder or URL for the SVGs. Run the command again to continue: what is done is "
            "skipped.",
        ),
    ],
    batch: Annotated[BatchOptions, Parameter(name="*", group="Batch")] = BatchOptions(),
    options: Annotated[
        Path | None,
        Parameter(
            name=_OPTIONS_FILE,
            help='TOML file of options, such as quality = "draft"; those given here count first.',
        ),
    ] = None,
    given: Annotated[_Parsed, Parameter(name="*")] = _DEFAULTS,  # pyright: ignore[reportInvalidTypeForm]
    log: Annotated[
        Literal["json"] | None,
        Parameter(
            help="Write a line of JSON for each photo, as it is known, on standard output: the "
            "columns of the table."
        ),
    ] = None,
    quiet: Quiet = False,
) -> int:
    """Vectorise many photos, by the cores of this machine or the workers of a Dask cluster."""
    from gauss2svg.batch.many import Batch
    from gauss2svg.batch.table import Summary

    own = ["output", "options", "log", "quiet", *vars(batch)]
    refuse_unknown_options(photos, own + option_names())
    refuse_option_like(output)
    if log == "json":
        standard_stream(sys.stdout, "output")  # is refused now, not at the first record
    with Batch(photos, output, Options(**vars(given)), batch) as made:
        with counting_bar(quiet) as update:
            summary, count = Summary(), made.index.count
            update("", 0, count)
            shown, has_waited = 0.0, False

            def waiting() -> None:
                nonlocal has_waited
                # A worker of this machine that died is being started again.
                if not (has_waited or quiet) and batch.scheduler is not None:
                    say(f"no workers at {batch.scheduler} yet; waiting for them")
                has_waited = True

            def add(records: Iterable[Any]) -> None:
                nonlocal shown
                begun, before = summary.seconds, summary.worked
                for record in records:
                    summary.add(record)
                    if log == "json":
                        line = {**record.line(), "skipped": record.skipped}
                        write_output(json.dumps(line).encode() + b"\n")
                    if summary.seconds - shown > _SHOW_S:
                        shown = summary.seconds
                        rate = (summary.worked - before) / max(shown - begun, _SHOW_S)
                        update(_state(summary, rate, count), summary.total, count)

            add(made.unchanged())
            if made.index.left:
                try:
                    with made.connected() as client:
                        if not quiet and find_spec("bokeh"):  # which draws it
                            say(f"Dask's dashboard: {client.dashboard_link}")
                        add(made.records(client, waiting))
                except KeyboardInterrupt:
                    tables = made.finish()  # of the shards that are done
                    say(f"see {', '.join(made.store.path(name) for name in tables)}")
                    raise
        tables = made.finish()
    if not quiet:
        for line in summary.lines():
            say(line)
        say(f"see {', '.join(made.store.path(name) for name in tables)}")
    elif summary.failed:
        say(f"{summary.failures}; see {made.store.path(tables[0])}")
    return STATUS_SOME_FAILED if summary.failed else 0


def _state(summary: Any, rate: float, count: int) -> str:
    """Photos a second, failures and time left."""
    left = (count - summary.total) / rate if rate else 0.0
    hours, minutes = divmod(round(left / 60), 60)
    time_left = f"{hours} h {minutes} min" if hours else f"{minutes} min"
    time_left = time_left if left >= 90 else f"{left:.0f} s"
    return f"{rate:.3g} photos/s, {summary.failures}, {time_left} left"


def options_of_file(app: Any, commands: tuple[str, ...], arguments: Any) -> None:
    """Take the options of a TOML file that --options names, where they are not given as well.

    A hook of the parser's. Raises InputError for a file that is no TOML, and for unknown keys.
    """
    import tomllib

    from cyclopts.config import Toml

    given = [a.tokens for a in arguments if _OPTIONS_FILE in a.names and a.tokens]
    if not given:
        return
    path = given[0][0].value
    with reading(path, "a TOML file") as file:
        try:
            keys = tomllib.load(file)
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path} must be a TOML file; got {brief(error)}") from error
    names = option_names()
    for key, value in keys.items():
        if key.replace("-", "_") not in names:
            raise InputError(f"key of {path} must be one of {', '.join(names)}; got {quoted(key)}")
        if isinstance(value, (dict, list)):
            raise InputError(f"{key} of {path} must be a plain value; got {quoted(value)}")
    Toml(path, use_commands_as_keys=False)(app, commands, arguments)
