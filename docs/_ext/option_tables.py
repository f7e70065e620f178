"""Directives that list what the code has: `{options}` of a command, `{statuses}` of the studio."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.util.docutils import SphinxDirective

from gauss2svg.cli.main import build_app
from gauss2svg.options import Field, Number, OptionGroup, Whole, fields_of
from gauss2svg.studio.answers import ERRORS

_OPTION = re.compile(r"(?<![\w-])(--[a-z][a-z0-9-]*|-)(?![\w-])")
_SPECIAL = re.compile(r"([\\`*_<>#|\[\]{}])")


def _markdown(text: str) -> str:
    plain = _SPECIAL.sub(r"\\\1", " ".join(text.split()))
    return _OPTION.sub(r"`\1`", plain)


def _number(value: float) -> str:
    if value == int(value) and value < 10**6:
        return str(int(value))
    powers = {2**31 - 1: "2^31 - 1", 2**63 - 1: "2^63 - 1", 10**9: "10^9", 2**24: "16 777 216"}
    if value in powers:
        return powers[value]
    if isinstance(value, int):
        return f"{value:,}".replace(",", " ")
    digits, _, power = f"{value:g}".partition("e")
    return f"{digits} 10^{int(power)}".removeprefix("1 ") if power else digits


def allowed(field: Field) -> str:
    """What an option may hold, where its annotation states a range."""
    for check in field.checks:
        if isinstance(check, Whole):
            return f"A whole number from {_number(check.least)} to {_number(check.most)}."
        if isinstance(check, Number):
            least = "above" if check.above else "from"
            least = f"{least} {_number(check.least)}" + " and up" * check.above
            return f"A number {least} to {_number(check.most)}{_advised(check)}."
    return ""


def _advised(check: Number) -> str:
    return f", such as {check.advice}" if check.advice else ""


class Options(SphinxDirective):
    """The options of a command, or of one group of them, by `{options} COMMAND`."""

    required_arguments = 1
    option_spec = {"group": directives.unchanged}  # noqa: RUF012 (docutils reads it so)

    def run(self) -> list[nodes.Node]:
        """The nodes."""
        app = build_app(True)
        name = self.arguments[0]
        command = app if name == "gauss2svg" else app[name]
        program = name if command is app else f"gauss2svg {name}"
        lines = [f":::{{program}} {program}", ":::", ""]
        fields: dict[str, Field] = {}
        for argument in command.assemble_argument_collection(parse_docstring=True):
            hint = argument.hint
            if argument.names == ("*",):
                known = isinstance(hint, type) and issubclass(hint, OptionGroup)
                fields = {f.name: f for f in fields_of(hint)} if known else {}
            elif self.options.get("group") in (None, _group(argument)):
                lines += _entry(argument, fields)
        return self.parse_text_to_nodes("\n".join(lines))


def _group(argument: Any) -> str:
    (group,) = argument.parameter.group
    return getattr(group, "_name", group)


def _entry(argument: Any, fields: dict[str, Field]) -> Iterator[str]:
    field = fields.get(argument.names[0].removeprefix("--").replace("-", "_"))
    choices = [] if field is None else [c for c in field.choices if not isinstance(c, bool)]
    positional = argument.index is not None
    names = [argument.names[0].lstrip("-").upper()] if positional else _names(argument)
    yield f"::::{{option}} {', '.join(names)}"
    text = [] if argument.parameter.help is None else [_markdown(argument.parameter.help)]
    if choices:
        text.append(f"One of {', '.join(f'`{choice}`' for choice in choices)}.")
    elif field is not None:
        text.append(allowed(field))
    if argument.required and not positional:
        text.append("Required.")
    default = argument.field_info.default
    if default is True and len(names) > 1:
        text.append("On by default.")
    if isinstance(default, (int, float, str)) and not isinstance(default, bool) and default != "":
        shown = _number(default) if isinstance(default, (int, float)) else default
        text.append(f"Default: `{shown}`.")
    yield " ".join(part for part in text if part)
    yield "::::"
    yield ""


def _names(argument: Any) -> list[str]:
    """Its names; of a flag that is off by default not its opposite."""
    names = list(argument.names)
    if argument.field_info.default is True:
        return names
    opposites = {f"--no-{name.removeprefix('--')}" for name in names}
    return [name for name in names if name not in opposites]


class Statuses(SphinxDirective):
    """The statuses with which the studio refuses a request."""

    def run(self) -> list[nodes.Node]:
        """The nodes."""
        rows = [f"| {status} | {said['description']} |" for status, said in ERRORS.items()]
        return self.parse_text_to_nodes("\n".join(["| status | meaning |", "|---|---|", *rows]))


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_directive("options", Options)
    app.add_directive("statuses", Statuses)
    return {"parallel_read_safe": True}
