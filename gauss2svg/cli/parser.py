"""The parser of a command line. It makes arguments from the fields of the classes of options."""

from __future__ import annotations

import argparse
import dataclasses
import re
import shutil
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from gauss2svg.errors import InputError, brief, nearest, refusal
from gauss2svg.files import STANDARD_STREAM, reading, text_of
from gauss2svg.options import Field, OptionGroup, byte_size, fields_of, file_path, flag_of, texts_of
from gauss2svg.pipeline.options import GROUPS, Options

STATUS_SOME_FAILED = 1  # exit status of a command if some photos or runs failed
_FILES = ("photos", "photo", "svg", "folder")  # fields that are files without an option before them

# What options of other tools are here. Advice that begins with an option is only for the commands
# that have this option.
_OTHER_TOOLS = {
    "colors colours color-count palette-size": "--inks 4 for a picture in four colours",
    "width height resize scale": "--size 300px for the width of the SVG, which sets its height",
    "dpi paper page": "--size 210mm for the width on paper",
    "shapes count number num n splats primitives": "--gaussians 1000 for that number of shapes",
    "steps epochs": "--iterations 400 for that number of steps",
    "filesize file-size target-size": "--max-bytes 150k for the largest size of the file",
    "psnr": "--target-psnr 35 for that PSNR",
    "preset mode": "--quality high, or another preset",
    "outfile": "--output FILE",
    "force replace yes": "--overwrite",
    "background bg": "--matte white for the colour behind a transparent photo",
    "mask": "--focus MASK.png for the places that matter",
    "minify optimize optimise compress": "--markup minimal, or --gzip",
    "json": "--report FILE.json",
    "workers jobs": "--threads 2 for the number of CPU threads",
    "input i": "the name of the photo alone, without an option",
}


class Parser(argparse.ArgumentParser):
    """The parser of one command.

    groups    the classes of options that were added
    has_help  whether the help will be printed. The texts of the options are only then read, because
              this takes time.
    """

    def __init__(self, command: str, usage: str, about: str, has_help: bool) -> None:
        name = f"gauss2svg {command}".rstrip()
        width = min(shutil.get_terminal_size().columns, 100)  # longer lines are hard to read
        super().__init__(
            prog=name, usage=f"{name} {usage}", description=about,
            formatter_class=partial(
                argparse.RawDescriptionHelpFormatter, max_help_position=28, width=width
            ),
            argument_default=argparse.SUPPRESS,  # only what was given is among the values
            add_help=False, allow_abbrev=False, exit_on_error=False,
        )  # fmt: skip
        self.groups: list[type[OptionGroup]] = []
        self.has_help = has_help
        self._advice = f"{name} {'--help' if command else '--help-all'}"

    def add_group(self, title: str, group: type[OptionGroup], shown: bool = True) -> None:
        """Add an argument for each field of a class, in a section of the help.

        shown  whether the help lists the arguments
        """
        self.groups.append(group)
        section = self.add_argument_group(title)
        texts = texts_of(group) if self.has_help and shown else {}
        for field in fields_of(group):
            text = _help(field, texts[field.name]) if texts else argparse.SUPPRESS
            names, properties = _argument(field)
            section.add_argument(*names, help=text, **properties)

    def read(self, words: list[str]) -> dict[str, Any]:
        """Return the words of the command line by the names of fields.

        Arguments that were not given are left out. Raise InputError for a word that is no option
        of the command, and if an argument is missing.
        """
        # Versions of argparse differ in what they do with "--", so it is not passed to argparse.
        cut = words.index("--") if "--" in words else len(words)
        dashed = {word for word in words[cut + 1 :] if word.startswith("-")} - {STANDARD_STREAM}
        files = [f"./{word}" if word in dashed else word for word in words[cut + 1 :]]
        # --max_bytes=1k is read as --max-bytes=1k.
        dashes = partial(re.sub, "^--[^=]*", lambda match: match[0].replace("_", "-"))
        options = [dashes(word) for word in words[:cut]]
        try:
            known, unknown = self.parse_known_intermixed_args([*options, *files])
        except argparse.ArgumentError as error:
            # This is all names of the argument, such as -o/--output.
            typed = {word.partition("=")[0] for word in words}
            names = (error.argument_name or "").split("/")
            name = next((name for name in names if name in typed), names[-1])
            _, has_value, value = error.message.partition("ignored explicit argument ")
            needed, got = ("without", value) if has_value else ("with", "none")
            advice = self._advice if has_value else self._example(name)
            raise refusal(name, f"given {needed} a value", got, advice) from error
        if unknown:
            raise self._not_taken(unknown[0])
        given = vars(known)
        for field in chain.from_iterable(map(fields_of, self.groups)):
            if field.default is dataclasses.MISSING and field.name not in given:
                name = field.name.upper() if field.name in _FILES else flag_of(field.name)
                raise refusal(name, "given", "none", self._advice)
        return given

    def _example(self, name: str) -> str:
        """Return an option with the value that its text gives as an example, or how to get help."""
        for group in self.groups:
            for field in fields_of(group):
                text = texts_of(group)[field.name] if flag_of(field.name) == name else ""
                if match := re.search(r"such as ('[^']+'|[\w.]*\w)(?= *[,.]| or )", text):
                    return f"{name} {match[1]}"
        return self._advice

    def _not_taken(self, word: str) -> InputError:
        """Return the error for a word that is neither an option nor a file that is expected.

        It may be a misspelt option, or the name of a file that begins with a dash.
        """
        if not word.startswith("-"):
            return refusal(word, "left out", "a file too many", self._advice)
        name = word.partition("=")[0]
        names = [name for action in self._actions for name in action.option_strings]
        advice = f"{nearest(name, names) or '--help'}, or ./{word} for a file of that name"
        for others, ours in _OTHER_TOOLS.items():
            is_here = not ours.startswith("--") or ours.replace(",", "").split()[0] in names
            if is_here and name.lstrip("-") in others.split():
                advice = ours
        return refusal(name, "an option", "an unknown one", advice)


def options_of_file(path: Path) -> dict[str, Any]:
    """Return the options in a TOML file. Raise InputError if it is not TOML or one is invalid."""
    import tomllib

    name = str(path)
    with reading(path, "a TOML file") as file:
        text = text_of(file.read(), name)
    try:
        given = {key.replace("-", "_"): value for key, value in tomllib.loads(text).items()}
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        # The reason says "(at line 2, column 13)" or "(at end of document)".
        reason, _, place = str(error).partition(" (at ")
        number = re.match(r"line ([0-9]+)", place)
        lines = text.rstrip().split("\n")
        at = min(int(number[1]), len(lines)) if number else len(lines)
        got = f"{brief(lines[at - 1].strip())} in line {at} ({reason})"
        needed, advice = 'TOML, such as quality = "draft"', "'quotes' around texts and paths"
        raise refusal(name, needed, got, advice) from error
    if tables := [key for key, value in given.items() if isinstance(value, dict)]:
        got, advice = f"the table [{brief(tables[0])}]", "the options in it without its name"
        raise refusal(name, "options without tables", got, advice)
    try:
        Options.from_flat(given)
    except ValueError as error:
        raise InputError(f"cannot take the options of {path}: {error}") from error
    return given


def run_options(given: dict[str, Any]) -> Options:
    """Return the options of a run from the words of a command line."""
    groups: dict[str, Any] = {key: group.of(given) for key, group in GROUPS.items()}
    return Options(**groups)


def words(text: str) -> list[str]:
    """Return the items of a text that are separated by commas, without empty items."""
    return [word.strip() for word in text.split(",") if word.strip()]


def _argument(field: Field) -> tuple[list[str], dict[str, Any]]:
    """Return the names and the properties of an argument for argparse."""
    if field.name in _FILES:
        several = field.name == "photos" or field.default == ()
        return [field.name], {"nargs": "*" if several else "?", "metavar": field.name.upper()}
    names = ["-o"] * (field.name == "output") + [flag_of(field.name)]
    if field.kind is bool:
        on_by_default = argparse.BooleanOptionalAction
        return names, {"action": on_by_default if field.default is True else "store_true"}
    action = "append" if field.default == () else "store"
    return names, {"action": action, "metavar": _metavar(field), "dest": field.name}


def _metavar(field: Field) -> str:
    """Return the word that stands for the value of an option in the help."""
    if field.name == "output":
        return "OUT"
    if field.kind is None:
        checked = {file_path: "PATH", byte_size: "SIZE"}
        return "CHOICE" if field.words else checked.get(field.check, "TEXT")
    return "|".join([field.kind.__name__.upper(), *map(str, field.words)])


def _help(field: Field, text: str) -> str:
    """Return the text of an option for the help, with its choices and its default."""
    if field.kind is None and field.words:
        text += f" [{', '.join(map(str, field.words))}]"
    is_flag = field.kind is bool or field.default in ("", STANDARD_STREAM)
    if isinstance(field.default, (int, float, str)) and not is_flag:
        text += f" [default: {field.default}]"
    return text.replace("%", "%%")
