"""Parameters that several commands have: photos, output, --quiet, lists, the options of a run."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from difflib import get_close_matches
from typing import Annotated, Any

from cyclopts import Group, Parameter

from gauss2svg.batch.inputs import local_photos
from gauss2svg.errors import refusal
from gauss2svg.files import STANDARD_STREAM
from gauss2svg.pipeline.options import GROUPS, Options

STATUS_SOME_FAILED = 1
Photos = Annotated[
    list[str],
    Parameter(
        negative="",
        allow_leading_hyphen=True,
        help="Photos, folders, patterns such as photos/*.jpg, or lists of them (.txt, or - for "
        "standard input).",
    ),
]
Output = Annotated[str, Parameter(name=["--output", "-o"], allow_leading_hyphen=True)]
Quiet = Annotated[bool, Parameter(negative="", help="Show neither progress nor summary.")]


def photos_given(names: list[str], command: Callable[..., int], output: str = "") -> list[str]:
    """Return the paths that `Photos` of a command stand for, or raise InputError as below."""
    refuse_options(command, names, output)
    return local_photos(names)


def refuse_options(command: Callable[..., int], names: Iterable[str], other: str = "") -> None:
    """Raise InputError for names that are meant as options.

    names  of photos, among which the parser leaves what is no option, such as --treads
    other  name that followed an option, as in -o --quiet
    """
    for name in names:
        if name.startswith("-") and name != STANDARD_STREAM:
            parameters = inspect.signature(command).parameters.values()
            options = [one for p in parameters for one in _option_names(p.name, p.default)]
            # At less --colors is like --scores.
            close = [*get_close_matches(name, options, 1, cutoff=0.8), "--help"][0]
            advice = f"{close}, or ./{name} for a file of that name"
            raise refusal(name, "an option", "an unknown one", advice)
    if other.startswith("-") and other != STANDARD_STREAM:
        got = f"{other}, which reads like an option"
        raise refusal("file", "a name that does not begin with -", got, f"./{other}")


def _option_names(name: str, default: Any) -> Iterator[str]:
    """Return the options of a parameter: of a group of options those of its fields."""
    if dataclasses.is_dataclass(default):
        for field in dataclasses.fields(default):
            yield from _option_names(field.name, getattr(default, field.name))
    else:
        yield f"--{name.replace('_', '-')}"


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
