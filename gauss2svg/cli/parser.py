"""The parser of a command line. It makes arguments from the fields of the classes of options."""

import argparse
import dataclasses
import shutil
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from gauss2svg.errors import InputError, nearest, refusal
from gauss2svg.files import STANDARD_STREAM, in_folder, reading, text_of
from gauss2svg.options import Field, OptionGroup, byte_size, fields_of, file_path, flag_of, texts_of
from gauss2svg.pipeline.options import GROUPS, Options

STATUS_SOME_FAILED = 1  # exit status of a command if some photos or runs failed
_FILES = ("photos", "photo", "svg", "folder")  # fields that are files without an option before them
_OF_PHOTOS = "PHOTOS -o OUT [OPTIONS]"
_OF_SOME = "PHOTOS [-o OUT] [OPTIONS]"
# {command: (what it does, arguments that its help shows)}
COMMANDS = {
    "batch": ("Vectorise many photos, on all cores.", _OF_PHOTOS),
    "bench": ("Compare settings and other tools in tables and plots.", _OF_PHOTOS),
    "check": ("Measure how closely any SVG matches a photo.", "PHOTO SVG [OPTIONS]"),
    "gallery": ("Write web pages that compare results for photos.", _OF_PHOTOS),
    "placeholder": ("Write SVGs of a kilobyte to show until photos load.", _OF_SOME),
    "studio": ("Vectorise photos in the browser, on this machine.", "[FOLDER] [OPTIONS]"),
}


class Parser(argparse.ArgumentParser):
    """The parser of one command, whose name is "" for the command `gauss2svg PHOTO`.

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
        try:
            known, unknown = self.parse_known_intermixed_args(words)
        except argparse.ArgumentError as error:
            raise InputError(f"{error}. Try {self._advice}") from error
        for word in unknown[:1]:
            if not word.startswith("-"):
                raise refusal(word, "left out", "a file too many", self._advice)
            name = word.partition("=")[0]
            names = [name for action in self._actions for name in action.option_strings]
            raise refusal(name, "an option", "an unknown one", nearest(name, names) or self._advice)
        given = vars(known)
        for field in chain.from_iterable(map(fields_of, self.groups)):
            if field.default is dataclasses.MISSING and field.name not in given:
                name = field.name.upper() if field.name in _FILES else flag_of(field.name)
                raise refusal(name, "given", "none", self._advice)
        return given


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


def output_files(
    options: OptionGroup, endings: Mapping[str, Sequence[str]], stem: str
) -> dict[str, Path]:
    """Return {option: path} of the output files that the user gave, without a printed report.

    If the path is a folder, the file is in it, and its name begins with `stem`.

    endings  {option that names an output file: endings that this file may have}
    """
    paths = {}
    for name, allowed in endings.items():
        path = getattr(options, name)
        if path is not None and (name, str(path)) != ("report", STANDARD_STREAM):
            file = f"{stem}-{name.removeprefix('save_')}{allowed[0]}"
            paths[name] = Path(in_folder(path, file))
    return paths


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
