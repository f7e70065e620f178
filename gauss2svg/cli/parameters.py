"""Parameters that several commands have: photos, --quiet, lists, the options of a run."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any

from cyclopts import Group, Parameter

from gauss2svg.pipeline.options import GROUPS

Photos = Annotated[list[str], Parameter(negative="", help="Photos.")]
Quiet = Annotated[bool, Parameter(negative="", help="Show neither progress nor summary.")]
# Groups with a flag that is on by default, which --no-NAME turns off.
_NEGATED: dict[str, Any] = {"densify": {"negative_bool": "no-", "negative": None}}


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
