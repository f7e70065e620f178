"""Write the tables of what the code has into the pages: python docs/tables.py.

A table lies between <!-- table: NAME ARGUMENTS --> and <!-- end -->. Each kind has a function here.
"""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import re
from collections.abc import Iterable
from pathlib import Path

from gauss2svg.batch.many import PhotoRecord
from gauss2svg.cli.main import command_of
from gauss2svg.measure import SCORES
from gauss2svg.options import Field, fields_of, texts_of
from gauss2svg.photo import FORMATS
from gauss2svg.raster import (
    DRAW_BLENDS,
    DRAW_MINIMAL,
    DRAW_ROTATED_BLURS,
    FEATURES,
    RENDERERS,
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
    advised = f", such as {field.advice}" if field.advice else ""
    return f"A number from {least} to {most}{advised}."


def options_table(command: str, title: str = "") -> str:
    """Return the options of a command, or those of one section of its help."""
    parser = command_of([*(() if command == "gauss2svg" else (command,)), "--help-all"])[1]
    fields = {
        field.name: (field, texts_of(group)[field.name])
        for group in parser.groups
        for field in fields_of(group)
    }
    rows = [
        _row(action, *fields[action.dest])
        for section in parser._action_groups
        if (title or section.title) == section.title != "About"
        for action in section._group_actions
    ]
    return _table("| option | meaning |", rows)


def _row(action: argparse.Action, field: Field, text: str) -> str:
    names = action.option_strings or [str(action.metavar)]
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
    return f"| {', '.join(f'`{name}`' for name in names)} | {' '.join(filter(None, words))} |"


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
    """Return the features of SVG that some renderers draw wrongly."""
    rows = [f"| {_markdown(one.name)} | {', '.join(one.not_drawn_by)} |" for one in FEATURES]
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


TABLES = {
    "options": options_table, "formats": formats_table, "features": features_table,
    "forms": forms_table, "scores": scores_table, "record": record_table,
}  # fmt: skip
_PLACE = re.compile(
    r"(<!-- table: (\w+)(?: (\w+))?(?:, ([\w ]+))? -->\n).*?(<!-- end -->)", re.DOTALL
)


def updated(text: str) -> str:
    """Return a page with its tables as they are in the code."""

    def filled(match: re.Match[str]) -> str:
        arguments = [word for word in match.group(3, 4) if word]
        return f"{match[1]}\n{TABLES[match[2]](*arguments)}\n\n{match[5]}"

    return _PLACE.sub(filled, text)


if __name__ == "__main__":
    for page in sorted(Path(__file__).parent.rglob("*.md")):
        before = page.read_text(encoding="utf-8")
        if (after := updated(before)) != before:
            page.write_text(after, encoding="utf-8")
            print(page)
