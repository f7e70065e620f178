"""Directives that list what the code has.

`{options}` of a command, `{formats}` of photos, `{features}` that
renderers draw wrongly, `{forms}` that they draw, `{scores}`, `{record}` of a photo of a
batch.
"""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import re
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.util.docutils import SphinxDirective

from gauss2svg.batch.worker import PhotoRecord
from gauss2svg.cli.main import command_of
from gauss2svg.measure import SCORES
from gauss2svg.options import Field, fields_of, texts_of
from gauss2svg.photo import FORMATS
from gauss2svg.raster import (
    CANNOT_DRAW,
    DRAW_BLENDS,
    DRAW_MINIMAL,
    DRAW_ROTATED_BLURS,
    RENDERERS,
    Feature,
)

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
    """Return what an option may hold, where its annotation states a range."""
    if field.kind not in (int, float):
        return ""
    least, most = _number(field.least), _number(field.most)
    if field.kind is int:
        return f"A whole number from {least} to {most}."
    least = f"above {least} and up" if field.is_above else f"from {least}"
    advised = f", such as {field.advice}" if field.advice else ""
    return f"A number {least} to {most}{advised}."


class Options(SphinxDirective):
    """The options of a command, or of one group of them, by `{options} COMMAND`."""

    required_arguments = 1
    option_spec = {"group": directives.unchanged}  # noqa: RUF012 (docutils reads it so)

    def run(self) -> list[nodes.Node]:
        """Return the nodes."""
        name = self.arguments[0]
        parser = command_of([*(() if name == "gauss2svg" else (name,)), "--help-all"])[1]
        fields = {
            field.name: (field, texts_of(group)[field.name])
            for group in parser.groups
            for field in fields_of(group)
        }
        lines = [f":::{{program}} {parser.prog}", ":::", ""]
        for section in parser._action_groups:
            if self.options.get("group", section.title) == section.title != "About":
                for action in section._group_actions:
                    lines += _entry(action, *fields[action.dest])
        return self.parse_text_to_nodes("\n".join(lines))


def _entry(action: argparse.Action, field: Field, text: str) -> Iterator[str]:
    names = action.option_strings or [action.metavar]
    yield f"::::{{option}} {', '.join(names)}"
    words = [_markdown(text)]
    if field.default is dataclasses.MISSING and action.option_strings:
        words.append("Required.")
    choices = ", ".join(f"`{choice}`" for choice in field.choices if not isinstance(choice, bool))
    words.append(f"One of {choices}." if choices else allowed(field))
    if field.default is True:
        words.append("On by default.")
    elif isinstance(field.default, (int, float)) and field.default is not False:
        words.append(f"Default: `{_number(field.default)}`.")
    elif isinstance(field.default, str) and field.default:
        words.append(f"Default: `{field.default}`.")
    yield " ".join(word for word in words if word)
    yield "::::"
    yield ""


def _table(head: str, rows: Iterable[str]) -> str:
    return "\n".join([head, "|---" * (head.count("|") - 1) + "|", *rows])


def formats_table() -> str:
    """Return the formats of photos, and the names that are taken for them in a folder."""
    rows = [
        f"| {one.name} | {', '.join(f'`{suffix}`' for suffix in one.suffixes)} |"
        for one in FORMATS.values()
    ]
    return _table("| format | names |", rows)


def features_table() -> str:
    """Return the features of SVG that some renderers draw wrongly, and what is known of it."""
    rows = []
    for feature in Feature:
        said = [
            f"{name} ({known})" if known else name
            for name in RENDERERS
            if (known := CANNOT_DRAW[name].get(feature)) is not None
        ]
        rows.append(f"| {_markdown(feature)} | {'; '.join(said)} |")
    return _table("| what a file uses | not drawn by |", rows)


_FORMS = {
    "`gradient` (default)": RENDERERS,
    "`--form blur`": DRAW_ROTATED_BLURS,
    "`--markup minimal`": DRAW_MINIMAL,
    "`--blend add`": DRAW_BLENDS,
    "`--blend add --portable`": RENDERERS,
}


def forms_table() -> str:
    """Return the forms of files, and the renderers that draw them."""
    rows = [
        f"| {form} | " + " | ".join("yes" if n in names else "refused" for n in RENDERERS) + " |"
        for form, names in _FORMS.items()
    ]
    return _table(f"| form | {' | '.join(RENDERERS)} |", rows)


def scores_table() -> str:
    """Return the scores, where they are best, and the options that make them targets."""
    rows = []
    for score in SCORES:
        best = "infinite" if score.best is None else f"{score.best:g}"
        option = f"`--{score.option.replace('_', '-')}`" if score.search else ""
        rows.append(f"| {score.name} | `{score.key}` | {best} | {score.package} | {option} |")
    return _table("| score | in a report | of equal pictures | package | target |", rows)


def record_table() -> str:
    """Return the fields of the record of a photo, and what they hold."""
    lines = inspect.cleandoc(PhotoRecord.__doc__ or "").splitlines()
    found = (line.partition("  ") for line in lines if "  " in line)
    rows = [f"| `{'`, `'.join(names.split(', '))}` | {text.strip()} |" for names, _, text in found]
    return _table("| field | what it holds |", rows)


def _directive(table: Callable[[], str]) -> type[SphinxDirective]:
    class Table(SphinxDirective):
        def run(self) -> list[nodes.Node]:
            return self.parse_text_to_nodes(table())

    return Table


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_directive("options", Options)
    tables = (formats_table, features_table, forms_table, scores_table, record_table)
    for table in tables:
        app.add_directive(table.__name__.removesuffix("_table"), _directive(table))
    return {"parallel_read_safe": True}
