"""Parameters that several commands share, such as the photos, the output and the options of a run.

The module also has the functions that read these parameters.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from difflib import get_close_matches
from typing import Annotated, Any

from cyclopts import App, ArgumentCollection, Group, Parameter

from gauss2svg.errors import InputError, refusal
from gauss2svg.files import STANDARD_STREAM, reading
from gauss2svg.pipeline.options import GROUPS, Options

STATUS_SOME_FAILED = 1  # exit status of a command if some photos or runs failed
OPTIONS_FILE = "--options"
_PHOTOS = (
    "Photos, folders, patterns such as photos/*.jpg, or lists of them (.txt, or - for standard "
    "input)."
)
Photos = Annotated[list[str], Parameter(negative="", allow_leading_hyphen=True, help=_PHOTOS)]
Output = Annotated[str, Parameter(name=["--output", "-o"], allow_leading_hyphen=True)]
Quiet = Annotated[bool, Parameter(negative="", help="Show neither progress nor summary.")]


def read_options_file(app: App, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Add the options of the TOML file that --options names to `arguments`.

    An option of the command line overrides the one in the file. The parser calls this function.
    Raise InputError if the file is not TOML or has an invalid option.
    """
    tokens = [token for one in arguments if OPTIONS_FILE in one.names for token in one.tokens]
    if not tokens:
        return
    import tomllib

    from cyclopts.config import Toml

    path = tokens[0].value
    with reading(path, "a TOML file") as file:
        try:
            keys = tomllib.load(file)
            Options.from_flat({key.replace("-", "_"): value for key, value in keys.items()})
        except (ValueError, RecursionError) as error:
            raise InputError(f"cannot take the options of {path}: {error}") from error
    Toml(path, use_commands_as_keys=False)(app, commands, arguments)


def refuse_options(_app: App, _commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Raise InputError for a file name that was probably meant as an option.

    The value "-" stands for a standard stream. So that a parameter can take this value, the parser
    lets it take any word that begins with a dash. The misspelt option --treads would therefore
    become the name of a photo, and --quiet after -o would become the name of the output. The parser
    calls this function.
    """
    files = [one for one in arguments if one.parameter.allow_leading_hyphen]
    for keyword, name in [(token.keyword, token.value) for one in files for token in one.tokens]:
        if not name.startswith("-") or name == STANDARD_STREAM:
            continue
        if keyword is not None:
            got = f"{name}, which reads like an option"
            raise refusal("file", "a name that does not begin with -", got, f"./{name}")
        options = [option for one in arguments for option in one.names]
        # With a lower cutoff, the error for an unknown option --colors would suggest --scores.
        close = [*get_close_matches(name, options, 1, cutoff=0.8), "--help"][0]
        advice = f"{close}, or ./{name} for a file of that name"
        raise refusal(name, "an option", "an unknown one", advice)


def words(text: str) -> list[str]:
    """Return the items of a text that are separated by commas, without empty items."""
    return [word.strip() for word in text.split(",") if word.strip()]


def options_of(groups: Mapping[str, Group]) -> type[Options]:
    """Return a dataclass that the parser fills. It is like `Options`, but has only these groups.

    Options(**vars(parsed)) turns an instance `parsed` of this dataclass into `Options`. The groups
    that the dataclass lacks then have their default values.

    groups  {key of a group in GROUPS: section of the help that lists the group's options}
    """
    fields = []
    for key, group in groups.items():
        # The group densify has a flag that is on by default, so users need --no-NAME to turn it
        # off.
        negatable: dict[str, Any] = {"negative_bool": "no-", "negative": None}
        parameter = Parameter(name="*", group=group, **(negatable if key == "densify" else {}))
        default = dataclasses.field(default=GROUPS[key]())
        fields.append((key, Annotated[GROUPS[key], parameter], default))
    # Without this, the module of the class would be `types`, and the parser would take the class
    # for a builtin type.
    namespace = {"__module__": __name__}
    return dataclasses.make_dataclass("ParsedOptions", fields, namespace=namespace, kw_only=True)
