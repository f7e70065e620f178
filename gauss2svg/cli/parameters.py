"""Parameters that several commands have: photos, --quiet, the options of a run."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any

from cyclopts import Group, Parameter

from gauss2svg.pipeline.options import GROUPS, Options

Photos = Annotated[list[str], Parameter(negative="", help="Photos.")]
Quiet = Annotated[bool, Parameter(negative="", help="Show neither progress nor summary.")]
# Groups with a flag that is on by default, which --no-NAME turns off.
_NEGATED: dict[str, Any] = {"densify": {"negative_bool": "no-", "negative": None}}


def options_of(shown: Mapping[str, Group]) -> Any:
    """The type of a parameter that holds `Options`: the fields of its groups are options.

    shown  the groups by their keys of GROUPS, with the titles under which help lists them; one that
           is left out has its defaults
    """
    fields = [
        (
            key,
            Annotated[GROUPS[key], Parameter(name="*", group=group, **_NEGATED.get(key, {}))],
            dataclasses.field(default=GROUPS[key]()),
        )
        for key, group in shown.items()
    ]
    # The parser reads the fields of this class, and gets what it makes: plain Options.
    made = {"__new__": lambda _, **groups: Options(**groups), "__module__": __name__}
    parsed = dataclasses.make_dataclass("Options", fields, namespace=made, kw_only=True)
    return Annotated[parsed, Parameter(name="*")]
