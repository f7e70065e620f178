"""The program `gauss2svg`: its commands, exit status and error lines."""

from __future__ import annotations

import logging
import re
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from typing import get_args

import cyclopts
from cyclopts import App, CycloptsError, Group, Parameter

from gauss2svg.cli.parameters import read_options_file, refuse_options
from gauss2svg.cli.terminal import (
    Terminated,
    drop_output,
    handling,
    hold_closed_descriptors,
    ignore_signals,
    print_utf8,
    say,
    status_of,
)
from gauss2svg.cli.vectorize import HELP, vectorize_command
from gauss2svg.errors import Gauss2SvgError
from gauss2svg.options import Renderer
from gauss2svg.pipeline.options import OPTIONS
from gauss2svg.version import __version__

STATUS_BAD_INPUT = 2

# Number of characters after which --version breaks a line. Few terminals are narrower.
_WIDTH = 79
# --version prints the versions of these packages, and also those of the renderers.
_PACKAGES = (
    "numpy", "scipy", "numba", "scikit-image", "pillow", "pyvips", "pi-heif", "svgwrite", "torch",
    "ssimulacra2", "flip-evaluator",
)  # fmt: skip
_HELP_ALL = "--help-all"
_COMMANDS = {
    "check": "Measure how closely any SVG matches a photo.",
    "bench": "Compare settings and other tools in tables and plots.",
    "batch": "Vectorise many photos, on one machine or a cluster.",
    "gallery": "Write web pages that compare results for photos.",
    "studio": "Vectorise photos in the browser, on this machine.",
    "placeholder": "Write SVGs of about a kilobyte to show while photos load.",
}
# If a command line of the main command has no other options than these, the parser is built with
# only the options of the short help, which takes less time.
_SHORT = {"--help", "-h", "--version", "--output", "-o"}
_SHORT |= {f"--{name.replace('_', '-')}" for name, group in OPTIONS.items() if group == "goal"}


def build_app(everything: bool = False, short: bool = False) -> App:
    """Return the parser of the command line.

    everything  True if the help lists all options, and not only those used most
    short       True if the main command is called with no other options than the short help has
    """
    app = App(
        name="gauss2svg",
        version=_versions,
        version_flags=["--version"],
        help_flags=[_HELP_ALL] if everything else ["--help", "-h"],
        help=HELP,
        # The short help needs no Markdown, whose parser would take a seventh of the time. In longer
        # help texts, Markdown joins the lines of a paragraph.
        help_format="plaintext" if short else "markdown",
        version_format="plaintext",
        usage="Usage: gauss2svg PHOTO [-o OUT.svg] [OPTIONS]   (--help-all lists all options)",
        default_parameter=Parameter(
            negative=(), show_default=lambda value: None if value is False or value == "" else value
        ),
        group_commands=Group("Commands, each with its own --help", sort_key=9),
        # The parser must not catch a Ctrl-C, because main() handles it and prints a message.
        suppress_keyboard_interrupt=False,
        result_action="return_value",
        config=(read_options_file, refuse_options),
    )
    app.default(vectorize_command(everything, short))
    # Commands are registered by name, so that their modules are imported only when they run.
    for name, help_line in _COMMANDS.items():
        app.command(f"gauss2svg.cli.{name}:{name}_command", name=name, help=help_line)
    return app


def main(arguments: list[str] | None = None) -> int:
    """Run the command and return its exit status.

    0    success
    1    some runs of a benchmark, batch, gallery or placeholder command failed, or a check found a
         PSNR below --min-psnr
    2    an error, printed as one line on standard error
    130  ended by Ctrl-C, even if the best result so far was written
    143  ended by SIGTERM or Ctrl-Break, even if the best result so far was written
    """
    hold_closed_descriptors()
    # Warnings and log messages of libraries are not printed, because standard error is for messages
    # of this program. Python prints log messages if there is no handler, so a handler that does
    # nothing is added. The logger of concurrent.futures has a handler of its own that prints, so
    # the level of this logger is raised above all messages.
    warnings.filterwarnings("ignore", module="PIL|distributed")
    logging.getLogger().addHandler(logging.NullHandler())
    logging.getLogger("concurrent.futures").setLevel(logging.CRITICAL + 1)
    words = sys.argv[1:] if arguments is None else arguments
    try:
        short = all(word.partition("=")[0] in _SHORT for word in words if word[:1] == "-")
        short = short and not _COMMANDS.keys() & words[:1]
        app = build_app(everything=_HELP_ALL in words, short=short)
        with handling():
            status = app(words or ["--help"], exit_on_error=False, print_error=False)
    except CycloptsError as error:
        return _refuse(_with_dashes(_error_line(error), words))
    except Gauss2SvgError as error:
        return _refuse(_with_dashes(str(error), words))
    except MemoryError as error:
        return _refuse(f"out of memory ({error}). Try a smaller photo or fewer --gaussians")
    except OSError as error:
        # This is an error of a standard stream. An error of any other file would be a
        # Gauss2SvgError.
        drop_output()
        return _refuse(f"{error.strerror or error}; nothing more was written")
    except (KeyboardInterrupt, SystemError) as error:
        # If a Ctrl-C comes inside a kernel, numba raises a SystemError. The KeyboardInterrupt is
        # then the cause or the context of this error.
        causes = error, error.__cause__, error.__context__
        interrupt = next((cause for cause in causes if isinstance(cause, KeyboardInterrupt)), None)
        if interrupt is None:
            raise
        say("interrupted; every file is whole or untouched")
        return status_of(signal.SIGTERM if isinstance(interrupt, Terminated) else signal.SIGINT)
    return status if isinstance(status, int) else 0


def run() -> None:
    """Run the command and exit with its status."""
    print_utf8()
    status = main()
    ignore_signals()
    # When numba compiles, it runs strings of code by exec(). If a Ctrl-C interrupts such code,
    # `python -m` will end with SIGINT and not with our exit status, even though the
    # KeyboardInterrupt was caught. Another exec(), of an empty string, prevents this.
    exec("")
    sys.exit(status)


def _versions() -> str:
    """Return the lines that --version prints, which users copy into bug reports.

    The lines describe the machine. They list the versions of gauss2svg, of the renderers and of
    some packages. If a renderer cannot be loaded, the lines say why, because that may be the cause
    of the bug.
    """
    import platform
    import textwrap
    from importlib.metadata import distributions

    renderers = (_or_reason(name, _renderer) for name in get_args(Renderer))
    installed = {dist.name.lower().replace("_", "-"): dist.version for dist in distributions()}
    packages = (f"{name} {installed[name]}" for name in _PACKAGES if name in installed)
    lines = [
        f"gauss2svg {__version__}",
        f"system: {platform.platform()}, Python {platform.python_version()}",
        _or_reason("CPU", _machine),
        f"renderers: {', '.join(renderers)}",
        f"packages: {', '.join(packages)}",
    ]
    return "\n".join(textwrap.fill(line, _WIDTH, subsequent_indent="  ") for line in lines)


def _or_reason(name: str, describe: Callable[[str], str]) -> str:
    """Return describe(name). If it raises an error, return the name and the reason of the error.

    The advice in the error message is left out.
    """
    try:
        return describe(name)
    except Exception as error:  # a package that is missing or broken may raise any exception
        return f"{name}: {re.split(r'; got |[.] Try ', str(error))[0]}"


def _machine(name: str) -> str:
    from gauss2svg.compare.records import machine

    about = machine()
    return f"{name}: {about['cpu']}, {about['cores']} cores"


def _renderer(name: str) -> str:
    from gauss2svg.raster import renderer_version

    return renderer_version(name)


def _error_line(error: CycloptsError) -> str:
    """Return the error line for a command line that the parser refuses."""
    command = " ".join(("gauss2svg", *(error.command_chain or ())))
    advice = f"Try {command} {'--help' if error.command_chain else _HELP_ALL}"
    if isinstance(error, cyclopts.MissingArgumentError) and error.argument is not None:
        name = error.keyword or error.argument.name
        name = name.lstrip("-").upper() if error.argument.field_info.is_positional else name
        return f"{name} must be given{' with a value' * bool(error.keyword)}; got none. {advice}"
    if isinstance(error, cyclopts.CoercionError) and error.token and error.argument:
        choices = error.argument.get_choices(force=True) or ()
        kinds = {int: "a whole number", float: "a number"}
        numbers = [kinds[kind] for kind in get_args(error.argument.hint) if kind in kinds]
        several = [f"one of {', '.join(choices)}"] if len(choices) > 1 else choices
        needed = " or ".join([*numbers, *several]) or kinds.get(error.target_type, "valid")
        return f"{error.token.keyword} must be {needed}; got {error.token.value!r}. {advice}"
    line = " ".join(str(error).split()).rstrip(".").removeprefix("Parameter ")
    return f"{line}. {advice}"


def _with_dashes(line: str, words: Sequence[str]) -> str:
    """Return an error line with options as they are typed: --max-bytes in place of max_bytes.

    A line that does not begin with the name of an option is returned unchanged.

    words  the command line. The names of its options are replaced too, because OPTIONS lacks the
           options that only one command has.
    """
    typed = {word.partition("=")[0][2:].replace("-", "_") for word in words if word[:2] == "--"}
    names = typed | set(OPTIONS)
    if line.partition(" ")[0] not in names:
        return line
    option = re.compile(rf"(^|\b(?:with|got|if) )({'|'.join(map(re.escape, names))})(?=[ ,;.])")
    return option.sub(lambda match: f"{match[1]}--{match[2].replace('_', '-')}", line)


def _refuse(message: str) -> int:
    say(" ".join(message.split()))
    return STATUS_BAD_INPUT
