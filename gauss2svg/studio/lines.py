"""The command and the Python call that make the same file."""

from __future__ import annotations

from pathlib import PurePath
from typing import Any

from gauss2svg.options import fields_of
from gauss2svg.pipeline.options import GROUPS, Options
from gauss2svg.processes import command_line
from gauss2svg.studio.options import flag_of


def lines_of(name: str, options: Options) -> dict[str, str]:
    """{"command": .., "python": ..} of a photo of that name, with what differs from defaults."""
    changed = _changed(options)
    stem = PurePath(name).stem
    output = f"{stem}.{'svgz' if options.svg.gzip else 'svg'}"
    words = ["gauss2svg", _not_an_option(name), "-o", _not_an_option(output)]
    for given in changed.values():
        for option, value in given.items():
            if isinstance(value, bool):
                words.append(flag_of(option if value else f"no_{option}"))
            elif str(value).startswith("-"):
                words.append(f"{flag_of(option)}={value}")
            else:
                words.extend([flag_of(option), str(value)])
    goal = [f"{option}={value!r}" for option, value in changed["goal"].items()]
    groups = [
        f"{key}={GROUPS[key].__name__}("
        + ", ".join(f"{option}={value!r}" for option, value in given.items())
        + ")"
        for key, given in changed.items()
        if given and key != "goal"
    ]
    classes = [GROUPS[key].__name__ for key, given in changed.items() if given and key != "goal"]
    call = ", ".join([repr(name), *goal, *groups])
    imports = ", ".join(sorted([*classes, "vectorize"]))
    python = f"from gauss2svg import {imports}\n\nvectorize({call}).save({output!r})"
    return {"command": command_line(words), "python": python}


def _changed(options: Options) -> dict[str, dict[str, Any]]:
    """Values that are not defaults, by group and name."""
    defaults = Options()
    return {
        key: {
            field.name: value
            for field in fields_of(group)
            if (value := getattr(getattr(options, key), field.name))
            != getattr(getattr(defaults, key), field.name)
        }
        for key, group in GROUPS.items()
    }


def _not_an_option(name: str) -> str:
    return f"./{name}" if name.startswith("-") else name
