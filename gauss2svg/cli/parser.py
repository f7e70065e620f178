"""The parser of a command line. It makes options from the fields of the classes of options."""

from __future__ import annotations

import argparse
import shutil
from functools import partial
from pathlib import Path
from typing import Any

from gauss2svg.errors import InputError, refusal
from gauss2svg.files import STANDARD_STREAM, reading
from gauss2svg.options import Field, OptionGroup, byte_size, fields_of, file_path, flag_of, texts_of
from gauss2svg.pipeline.options import GROUPS, Options

STATUS_SOME_FAILED = 1  # exit status of a command if some photos or runs failed
PHOTOS = (
    "Photos, folders, patterns such as photos/*.jpg, or lists of them (.txt, or - for standard "
    "input)."
)
_MOST_COLUMNS = 100  # longer lines of a help are hard to read
_TEXT_COLUMN = 28  # column at which the texts of a help begin
# Words that stand for the values of an option in the help.
_KINDS = {int: "INT", float: "FLOAT"}
_CHECKED = {file_path: "FILE", byte_size: "SIZE"}


class Parser(argparse.ArgumentParser):
    """The parser of one command.

    groups      the classes of options that were added
    parameters  first section of the help
    required    {parameter that must be given: its name in error messages}
    has_help    whether the help will be printed. The texts of the options are only then read,
                because this takes time.
    lists_all   whether the help lists all options, and not only those used most
    """

    def __init__(
        self, command: str, usage: str, about: str, *, has_help: bool, lists_all: bool
    ) -> None:
        name = f"gauss2svg {command}".rstrip()
        width = min(shutil.get_terminal_size().columns, _MOST_COLUMNS)
        super().__init__(
            prog=name, usage=f"{name} {usage}", description=about,
            formatter_class=partial(
                argparse.RawDescriptionHelpFormatter, max_help_position=_TEXT_COLUMN, width=width
            ),
            argument_default=argparse.SUPPRESS,  # only what was given is among the values
            add_help=False, allow_abbrev=False, exit_on_error=False,
        )  # fmt: skip
        self.groups: list[type[OptionGroup]] = []
        self.parameters = self.add_argument_group("Parameters")
        self.required: dict[str, str] = {}
        self.has_help, self.lists_all = has_help, lists_all
        self._advice = f"{name} {'--help' if command else '--help-all'}"

    def add_file(self, name: str, text: str, nargs: str = "?") -> None:
        """Add a file that must be given, or several files if `nargs` is "*"."""
        self.parameters.add_argument(name, nargs=nargs, metavar=name.upper(), help=text)
        self.required[name] = name.upper()

    def add_output(self, metavar: str, text: str, required: bool = False) -> None:
        """Add the option that names the output."""
        self.parameters.add_argument("-o", "--output", metavar=metavar, help=text)
        if required:
            self.required["output"] = "--output"

    def add_group(
        self, group: type[OptionGroup], title: str | None = None, shown: bool = True
    ) -> None:
        """Add an option for each field of a class.

        title  title of a section of the help for them, or None to add them to `parameters`
        shown  whether the help lists the options
        """
        self.groups.append(group)
        section = self.parameters if title is None else self.add_argument_group(title)
        texts = texts_of(group) if self.has_help and shown else {}
        for field in fields_of(group):
            flag: Any = "store_true" if field.default is False else argparse.BooleanOptionalAction
            kind: dict[str, Any] = (
                {"action": flag} if field.kind is bool else {"metavar": _metavar(field)}
            )
            text = _help(field, texts[field.name]) if texts else argparse.SUPPRESS
            section.add_argument(flag_of(field.name), help=text, **kind)

    def read(self, words: list[str]) -> dict[str, Any]:
        """Return the words of the command line by the names of options and parameters.

        What was not given is not in the dictionary. Raise InputError for a word that is no option
        of the command, and for what must be given and is not.
        """
        try:
            known, unknown = self.parse_known_intermixed_args(words)
        except argparse.ArgumentError as error:
            name = (error.argument_name or "").rpartition("/")[2]  # the last of -o/--output
            _, has_value, value = error.message.partition("ignored explicit argument ")
            needed, got = ("without", value) if has_value else ("with", "none")
            raise refusal(name, f"given {needed} a value", got, self._advice) from error
        if unknown:
            raise self._not_taken(unknown[0])
        given = vars(known)
        for name, shown in self.required.items():
            if name not in given:
                raise refusal(shown, "given", "none", self._advice)
        return given

    def _not_taken(self, word: str) -> InputError:
        """Return the error for a word that is neither an option nor a file that is expected.

        It may be a misspelt option, or the name of a file that begins with a dash.
        """
        from difflib import get_close_matches

        if not word.startswith("-"):
            return refusal(word, "left out", "a file too many", self._advice)
        name = word.partition("=")[0]
        names = [name for action in self._actions for name in action.option_strings]
        # With a lower cutoff, the error for an unknown option --colors would suggest --scores.
        close = [*get_close_matches(name, names, 1, cutoff=0.8), "--help"][0]
        advice = f"{close}, or ./{word} for a file of that name"
        return refusal(name, "an option", "an unknown one", advice)


def options_of_file(path: Path) -> dict[str, Any]:
    """Return the options in a TOML file. Raise InputError if it is not TOML or one is invalid."""
    import tomllib

    with reading(path, "a TOML file") as file:
        try:
            given = {key.replace("-", "_"): value for key, value in tomllib.load(file).items()}
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


def _metavar(field: Field) -> str:
    """Return the word that stands for the value of an option in the help."""
    if field.kind is None:
        return "CHOICE" if field.words else _CHECKED.get(field.check, "TEXT")
    return "|".join([_KINDS[field.kind], *map(str, field.words)])


def _help(field: Field, text: str) -> str:
    """Return the text of an option for the help, with its choices and its default."""
    if field.kind is None and field.words:
        text += f" [{', '.join(map(str, field.words))}]"
    if not isinstance(field.default, bool) and field.default not in (None, "", STANDARD_STREAM):
        text += f" [default: {field.default}]"
    return text.replace("%", "%%")
