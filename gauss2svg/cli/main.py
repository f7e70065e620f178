"""The program `gauss2svg`: its commands, exit status and error lines."""

import gc
import logging
import os
import re
import signal
import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from typing import Any, get_args

from gauss2svg.cli import terminal
from gauss2svg.cli.parser import COMMANDS, Parser
from gauss2svg.errors import Gauss2SvgError, error_line, nearest, refusal
from gauss2svg.options import Renderer, flag_of
from gauss2svg.pipeline.options import OPTIONS


def command_of(words: Sequence[str]) -> tuple[Any, Parser, list[str]]:
    """Return the module of the command that a command line calls, its parser and its words.

    Raise InputError if the first word is like a command, but neither a command nor a file.
    """
    if words and words[0] in ("help", "version"):
        words = [*words[1:], f"--{words[0]}"]
    name = words[0] if words and words[0] in COMMANDS else ""
    if words and not name and words[0].isalpha() and not os.path.lexists(words[0]):
        close = nearest(words[0], COMMANDS) or "PHOTO -o OUT.svg, or gauss2svg --help"
        raise refusal(words[0], "a photo or a command", "neither", f"gauss2svg {close}")
    # The modules of commands are imported only when they run.
    module = import_module(f"gauss2svg.cli.{name or 'vectorize'}")
    text, usage = COMMANDS[name] if name else (module.ABOUT, module.USAGE)
    has_help = not {"--help", "-h", "--help-all"}.isdisjoint(words)
    parser = Parser(name, usage, text, has_help)
    for title, group in module.SECTIONS.items():
        shown = bool(name) or "--help-all" in words or title in module.COMMON
        parser.add_group(title, group, shown)
    if not name:
        lines = "\n".join(f"{command:13}{line}" for command, (line, _) in COMMANDS.items())
        parser.add_argument_group("Commands, each with its own --help", lines)
    about = parser.add_argument_group("About")
    about.add_argument("-h", "--help", action="store_true", help="Show this help.")
    if not name:
        about.add_argument("--help-all", action="store_true", help="List all options.")
        text = "Show the versions of gauss2svg and of what it uses."
        about.add_argument("--version", action="store_true", help=text)
    return module, parser, list(words[bool(name) :])


def main(arguments: list[str] | None = None) -> int:
    """Run the command and return its exit status.

    0    success
    1    some runs of a benchmark, batch, gallery or placeholder command failed, or a check found a
         PSNR below --min-psnr
    2    an error, printed as one line on standard error
    130  ended by Ctrl-C, even if the best result so far was written
    143  ended by SIGTERM or Ctrl-Break, even if the best result so far was written
    """
    # Warnings and log messages of libraries are not printed, because standard error is for messages
    # of this program. Python prints log messages if there is no handler, so a handler that does
    # nothing is added.
    warnings.filterwarnings("ignore", module="PIL")
    logging.getLogger().addHandler(logging.NullHandler())
    words = sys.argv[1:] if arguments is None else arguments
    try:
        with terminal.handling():
            module, parser, rest = command_of(words or ["--help"])
            if parser.has_help:
                print(parser.format_help(), end="")
                return 0
            given = parser.read(rest)
            if given.pop("version", False):
                print(_versions())
                return 0
            return module.run(given)
    except Gauss2SvgError as error:
        return _refuse(_with_dashes(str(error), words))
    except MemoryError as error:
        return _refuse(error_line(error, "a smaller photo or fewer --gaussians"))
    except OSError as error:
        # This is an error of a standard stream. An error of any other file would be a
        # Gauss2SvgError.
        terminal.drop_output()
        return _refuse(f"{error.strerror or error}; nothing more was written")
    except KeyboardInterrupt as interrupt:
        terminal.say(str(interrupt) or terminal.UNTOUCHED)
        return 143 if isinstance(interrupt, terminal.Terminated) else 130


def run() -> None:
    """Run the command and exit with its status."""
    terminal.prepare_streams()
    # Python searches for garbage each time that it has made 700 more objects. Imports make more
    # than a hundred thousand objects, nearly all of which are kept. Commands for many photos or
    # requests make more garbage, so they keep the usual search.
    if COMMANDS.keys().isdisjoint(sys.argv[1:2]):
        gc.set_threshold(1_000_000)
    status = main()
    # The exit status is already known.
    terminal.set_handlers(dict.fromkeys(terminal.SIGNALS, signal.SIG_IGN))
    sys.exit(status)


def _versions() -> str:
    """Return the lines that --version prints, which users copy into bug reports.

    They describe the machine, and list the versions of gauss2svg, of the renderers and of the
    packages that a file depends on. If a renderer cannot be loaded, they say why, because that may
    cause the bug.
    """
    import platform

    from gauss2svg.compare.records import machine
    from gauss2svg.pipeline.report import versions
    from gauss2svg.raster import renderer_version

    renderers = []
    for renderer in get_args(Renderer):
        try:
            renderers.append(renderer_version(renderer))
        except Exception as error:  # a package that is missing or broken may raise any exception
            # The advice in the error message is left out.
            renderers.append(f"{renderer}: {str(error).split('; got ')[0]}")
    about, packages = machine(), versions()
    lines = [
        f"gauss2svg {packages.pop('gauss2svg')}",
        f"system: {platform.platform()}, Python {packages.pop('python')}",
        f"CPU: {about['cpu']}, {about['cores']} cores",
        f"renderers: {', '.join(renderers)}",
        f"packages: {', '.join(map(' '.join, packages.items()))}",
    ]
    return "\n".join(lines)


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
    option = rf"(^|\b(?:with|got|if) )({'|'.join(map(re.escape, names))})(?=[ ,;.])"
    return re.sub(option, lambda match: match[1] + flag_of(match[2]), line)


def _refuse(message: str) -> int:
    terminal.say(" ".join(message.split()))
    return 2
