"""The program `gauss2svg`: its commands, exit status and error lines."""

from __future__ import annotations

import logging
import re
import signal
import sys
import warnings
from collections.abc import Sequence
from typing import get_args

import cyclopts
from cyclopts import App, CycloptsError, Group, Parameter

from gauss2svg.cli.parameters import read_options_file, refuse_options
from gauss2svg.cli.signals import Terminated, handling, ignore, status_of
from gauss2svg.cli.streams import drop_output, hold_closed_descriptors, say
from gauss2svg.cli.vectorize import HELP, vectorize_command
from gauss2svg.errors import Gauss2SvgError, InputError
from gauss2svg.options import field_of
from gauss2svg.pipeline.options import option_names

STATUS_BAD_INPUT = 2

_HELP_ALL = "--help-all"
# Of which the options that the short help leaves out need not be read.
_SHORT = ([], ["--help"], ["-h"], ["--version"])


def build_app(everything: bool = False, short: bool = False) -> App:
    """Return the command line; its help lists what most people use, or everything.

    short  whether it is only asked for its short help or its version
    """
    app = App(
        name="gauss2svg",
        version=_versions,
        version_flags=["--version"],
        help_flags=[_HELP_ALL] if everything else ["--help", "-h"],
        help=HELP,
        help_format="markdown",
        version_format="plaintext",
        usage="Usage: gauss2svg PHOTO [-o OUT.svg] [OPTIONS]   (--help-all lists all options)",
        default_parameter=Parameter(
            negative=(), show_default=lambda value: None if value is False or value == "" else value
        ),
        group_commands=Group("Commands, each with its own --help", sort_key=9),
        suppress_keyboard_interrupt=False,  # main says what became of the files
        result_action="return_value",
        config=(read_options_file, refuse_options),
    )
    app.default(vectorize_command(everything, short))
    # By name, so that it is loaded only where it is asked for.
    for name, help_line in {
        "check": "Measure how closely any SVG matches a photo.",
        "bench": "Compare settings and other tools in tables and plots.",
        "batch": "Vectorise many photos, on one machine or a cluster.",
        "gallery": "Write web pages that compare results for photos.",
        "studio": "Vectorise photos in the browser, on this machine.",
        "placeholder": "Write SVGs of about a kilobyte to show while photos load.",
    }.items():
        app.command(f"gauss2svg.cli.{name}:{name}_command", name=name, help=help_line)
    return app


def main(arguments: list[str] | None = None) -> int:
    """Run the command and return the exit status: 0, or 2 with one line on standard error.

    130 and 143 are those of Ctrl-C and SIGTERM, also where the best so far was written. 1 is that
    of a benchmark, a batch, a gallery or placeholders of which something failed, and of a check
    under its --min-psnr.
    """
    hold_closed_descriptors()
    # An error is one line, and ours. What matters of these is reported as an error.
    warnings.filterwarnings("ignore", module="PIL|distributed")
    logging.getLogger().addHandler(logging.NullHandler())  # of all that have no handler
    logging.getLogger("concurrent.futures").setLevel(logging.CRITICAL + 1)  # which has one
    given = sys.argv[1:] if arguments is None else arguments
    try:
        app = build_app(everything=_HELP_ALL in given, short=list(given) in _SHORT)
        with handling():
            status = app(given or ["--help"], exit_on_error=False, print_error=False)
    except CycloptsError as error:
        return _refuse(_as_typed(_in_our_words(error), given))
    except Gauss2SvgError as error:
        return _refuse(_as_typed(str(error), given))
    except MemoryError as error:
        return _refuse(f"out of memory ({error}). Try a smaller photo or fewer --gaussians")
    except OSError as error:  # a stream that broke: files are Gauss2SvgErrors already
        drop_output()
        return _refuse(f"{error.strerror or error}; nothing more was written")
    except (KeyboardInterrupt, SystemError) as error:
        # A Ctrl-C inside a kernel arrives wrapped in numba's SystemError.
        causes = error, error.__cause__, error.__context__
        cause = next((one for one in causes if isinstance(one, KeyboardInterrupt)), None)
        if cause is None:
            raise
        say("interrupted; every file is whole or untouched")
        return status_of(signal.SIGTERM if isinstance(cause, Terminated) else signal.SIGINT)
    return status if isinstance(status, int) else 0


def run() -> None:
    """Run the command as a program."""
    status = main()
    ignore()
    # Python run by -m ends by SIGINT if a KeyboardInterrupt, though caught, left the last text that
    # was executed: numba executes some where it compiles.
    exec("")
    sys.exit(status)


def _versions() -> str:
    from gauss2svg.cli.versions import versions  # imports what nothing else needs

    return versions()


def _in_our_words(error: CycloptsError) -> str:
    """Return the line of an error of the parser of the command line."""
    command = " ".join(("gauss2svg", *(error.command_chain or ())))
    advice = f"Try {command} {'--help' if error.command_chain else _HELP_ALL}"
    if isinstance(error, cyclopts.MissingArgumentError) and error.argument is not None:
        name = error.keyword or error.argument.name
        name = name.lstrip("-").upper() if error.argument.field_info.is_positional else name
        return f"{name} must be given{' with a value' * bool(error.keyword)}; got none. {advice}"
    if isinstance(error, cyclopts.ValidationError) and error.argument is not None:
        # Of pydantic, which the parser asks where a package has loaded it.
        name, annotation = error.argument.name.lstrip("-"), error.argument.field_info.annotation
        try:
            field_of(name.replace("-", "_"), annotation).parsed(error.argument.tokens[0].value)
        except InputError as in_our_words:
            return str(in_our_words)
    if isinstance(error, cyclopts.CoercionError) and error.token and error.argument:
        choices = error.argument.get_choices(force=True) or ()
        kinds = {int: "a whole number", float: "a number"}
        numbers = [kinds[one] for one in get_args(error.argument.hint) if one in kinds]
        several = [f"one of {', '.join(choices)}"] if len(choices) > 1 else choices
        needed = " or ".join([*numbers, *several]) or kinds.get(error.target_type, "valid")
        return f"{error.token.keyword} must be {needed}; got {error.token.value!r}. {advice}"
    line = " ".join(str(error).split()).rstrip(".").removeprefix("Parameter ")
    return f"{line}. {advice}"


def _as_typed(line: str, given: Sequence[str]) -> str:
    """Return an error line about an option with the dashes that options have here.

    given  words of the command line, of which options of a command alone are known
    """
    typed = {word.partition("=")[0][2:].replace("-", "_") for word in given if word[:2] == "--"}
    names = typed | set(option_names())
    if line.partition(" ")[0] not in names:
        return line
    found = re.compile(rf"(^|\b(?:with|got|if) )({'|'.join(map(re.escape, names))})(?=[ ,;.])")
    return found.sub(lambda match: f"{match[1]}--{match[2].replace('_', '-')}", line)


def _refuse(message: str) -> int:
    say(" ".join(message.split()))
    return STATUS_BAD_INPUT
