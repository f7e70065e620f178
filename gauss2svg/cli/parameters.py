"""Parameters that several commands have: photos, --quiet, lists, the options of a run."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any

from cyclopts import Group, Parameter

from gauss2svg.batch.inputs import local_photos
from gauss2svg.errors import InputError
from gauss2svg.pipeline.options import GROUPS

Photos = Annotated[
    list[str],
    Parameter(
        negative="",
        allow_leading_hyphen=True,
        help="Photos, folders, patterns such as photos/*.jpg, or lists (.txt, - for standard "
        "input).",
    ),
]
Quiet = Annotated[bool, Parameter(negative="", help="Show neither progress nor summary.")]
STATUS_SOME_FAILED = 1
# Groups with a flag that is on by default, which --no-NAME turns off.
_NEGATED: dict[str, Any] = {"densify": {"negative_bool": "no-", "negative": None}}


def photos_given(names: list[str], known: Iterable[str] = ()) -> list[str]:
    """The paths that `Photos` stand for; raises InputError as refuse_unknown_options."""
    refuse_unknown_options(names, known)
    return local_photos(names)


def refuse_unknown_options(names: Sequence[str], known: Iterable[str] = ()) -> None:
    """Raise InputError for a name such as --treads: what is no option ends up among the photos.

    known  names of the command's own options, as in Python: max_bytes
    """
    from difflib import get_close_matches

    options = [f"--{option.replace('_', '-')}" for option in known]
    for name in names:
        if name.startswith("-") and name != "-":
            # At less --colors is like --scores.
            close = get_close_matches(name, options, 1, cutoff=0.8)
            advice = f"{close[0] if close else '--help'}, or ./{name} for a file of that name"
            raise InputError(f"{name} must be an option; got an unknown one. Try {advice}")


def words(text: str) -> list[str]:
    """The words of a list that is separated by commas."""
    return [word.strip() for word in text.split(",") if word.strip()]


def options_of(shown: Mapping[str, Group]) -> Any:
    """A class with some groups of `Options` as the parser takes them: each field is an option.

    shown  the groups by their keys of GROUPS, with the titles under which help lists them
    `Options(**vars(parsed))` has the defaults of the others.
    """
    fields = [
        (
            key,
            Annotated[GROUPS[key], Parameter(name="*", group=group, **_NEGATED.get(key, {}))],
            dataclasses.field(default=GROUPS[key]()),
        )
        for key, group in shown.items()
    ]
    # The parser takes classes of the module `types` for builtins.
    namespace = {"__module__": __name__}
    return dataclasses.make_dataclass("ParsedOptions", fields, namespace=namespace, kw_only=True)
