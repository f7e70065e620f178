"""The parser of a command line. It makes arguments from the fields of the classes of options."""

from __future__ import annotations

import argparse
import dataclasses
import shutil
from collections.abc import Collection
from functools import partial
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any

from gauss2svg.errors import InputError, nearest, refusal
from gauss2svg.files import STANDARD_STREAM, reading, text_of
from gauss2svg.options import Field, OptionGroup, byte_size, fields_of, file_path, flag_of, texts_of
from gauss2svg.pipeline.options import GROUPS, Options

STATUS_SOME_FAILED = 1  # exit status of a command if some photos or runs failed
_PHOTO = "gauss2svg PHOTO"  # the command that has no name
_FILES = ("photos", "photo", "svg", "folder")  # fields that are files without an option before them


class Parser(argparse.ArgumentParser):
    """The parser of one command.

    groups    the classes of options that were added
    commands  names of all commands, which a refusal of an option of another command looks through
    has_help  whether the help will be printed. The texts of the options are only then read, because
              this takes time.
    """

    def __init__(
        self,
        command: str,
        usage: str,
        about: str,
        has_help: bool,
        commands: Collection[str] = (),
    ) -> None:
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
        self._commands = commands
        self._own = name if command else _PHOTO

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
        try:
            known, unknown = self.parse_known_intermixed_args(words)
        except argparse.ArgumentError as error:
            raise InputError(f"{error}. Try {self._advice}") from error
        for word in unknown[:1]:
            if not word.startswith("-"):
                raise refusal(word, "left out", "a file too many", self._advice)
            name = word.partition("=")[0]
            if others := _commands_with(name, self._commands):
                needed, got = f"given with {' or '.join(others)}", f"it with {self._own}"
                is_photo = others[0] == _PHOTO
                advice = "gauss2svg --help-all" if is_photo else f"{others[0]} --help"
                raise refusal(name, needed, got, advice)
            names = [name for action in self._actions for name in action.option_strings]
            raise refusal(name, "an option", "an unknown one", nearest(name, names) or self._advice)
        given = vars(known)
        for field in chain.from_iterable(map(fields_of, self.groups)):
            if field.default is dataclasses.MISSING and field.name not in given:
                name = field.name.upper() if field.name in _FILES else flag_of(field.name)
                raise refusal(name, "given", "none", self._advice)
        return given


def _commands_with(option: str, commands: Collection[str]) -> list[str]:
    """Return the commands that have an option, such as "gauss2svg batch" for "--scheduler"."""
    found = []
    for command in ("vectorize", *commands):
        groups = import_module(f"gauss2svg.cli.{command}").SECTIONS.values()
        fields = [field.name for group in groups for field in fields_of(group)]
        if option in [flag_of(name) for name in fields if name not in _FILES]:
            found.append(f"gauss2svg {command}" if command in commands else _PHOTO)
    return found


def options_of_file(path: Path) -> dict[str, Any]:
    """Return the options in a TOML file. Raise InputError if it is not TOML or one is invalid."""
    import tomllib

    with reading(path, "a TOML file") as file:
        text = text_of(file.read(), str(path))
    try:
        given = {key.replace("-", "_"): value for key, value in tomllib.loads(text).items()}
        Options.from_flat(given)
    except (ValueError, RecursionError) as error:
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
