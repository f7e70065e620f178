"""Parameters that several commands have: photos, output, --quiet, lists, the options of a run."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from difflib import get_close_matches
from typing import Annotated, Any

from cyclopts import App, ArgumentCollection, Group, Parameter

from gauss2svg.errors import InputError, refusal
from gauss2svg.files import STANDARD_STREAM, reading
from gauss2svg.pipeline.options import GROUPS, Options

STATUS_SOME_FAILED = 1
OPTIONS_FILE = "--options"
_PHOTOS = (
    "Photos, folders, patterns such as photos/*.jpg, or lists of them (.txt, or - for standard "
    "input)."
)
Photos = Annotated[list[str], Parameter(negative="", allow_leading_hyphen=True, help=_PHOTOS)]
Output = Annotated[str, Parameter(name=["--output", "-o"], allow_leading_hyphen=True)]
Quiet = Annotated[bool, Parameter(negative="", help="Show neither progress nor summary.")]


def read_options_file(app: App, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Take the options of a TOML file that --options names, where they are not given as well.

    A hook of the parser's. Raise InputError for a file that is no TOML, or has no valid options.
    """
    given = [token for one in arguments if OPTIONS_FILE in one.names for token in one.tokens]
    if not given:
        return
    import tomllib

    from cyclopts.config import Toml

    path = given[0].value
    with reading(path, "a TOML file") as file:
        try:
            keys = tomllib.load(file)
            Options.from_flat({key.replace("-", "_"): value for key, value in keys.items()})
        except (ValueError, RecursionError) as error:
            raise InputError(f"cannot take the options of {path}: {error}") from error
    Toml(path, use_commands_as_keys=False)(app, commands, arguments)


def refuse_options(_app: App, _commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Raise InputError for names of files that are meant as options; a hook of the parser's.

    Where - may be given, for a standard stream, the parser takes what is no option for a name, such
    as --treads, and what follows an option, as in -o --quiet.
    """
    files = [one for one in arguments if one.parameter.allow_leading_hyphen]
    for keyword, name in [(token.keyword, token.value) for one in files for token in one.tokens]:
        if not name.startswith("-") or name == STANDARD_STREAM:
            continue
        if keyword is not None:
            got = f"{name}, which reads like an option"
            raise refusal("file", "a name that does not begin with -", got, f"./{name}")
        options = [option for one in arguments for option in one.names]
        # At less --colors is like --scores.
        close = [*get_close_matches(name, options, 1, cutoff=0.8), "--help"][0]
        advice = f"{close}, or ./{name} for a file of that name"
        raise refusal(name, "an option", "an unknown one", advice)


def words(text: str) -> list[str]:
    """Return the words of a list that is separated by commas."""
    return [word.strip() for word in text.split(",") if word.strip()]


def options_of(groups: Mapping[str, Group]) -> type[Options]:
    """Return a class with some groups of `Options` as the parser takes them.

    groups  titles under which help lists the options of a group, by the keys of GROUPS
    `Options(**vars(parsed))` has the defaults of the others.
    """
    fields = []
    for key, group in groups.items():
        # The group with a flag that is on by default, which --no-NAME turns off.
        negated: dict[str, Any] = {"negative_bool": "no-", "negative": None}
        parameter = Parameter(name="*", group=group, **(negated if key == "densify" else {}))
        default = dataclasses.field(default=GROUPS[key]())
        fields.append((key, Annotated[GROUPS[key], parameter], default))
    # The parser takes classes of the module `types` for builtins.
    namespace = {"__module__": __name__}
    return dataclasses.make_dataclass("ParsedOptions", fields, namespace=namespace, kw_only=True)
