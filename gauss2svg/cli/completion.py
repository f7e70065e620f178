"""Print the completion of a shell, which shtab makes: python -m gauss2svg.cli.completion bash."""

from argparse import ArgumentParser

try:
    import shtab  # pyright: ignore[reportMissingImports]
except ImportError as error:
    raise SystemExit("error: completion needs shtab. Try `pip install shtab`") from error

from gauss2svg.cli.main import command_of
from gauss2svg.cli.parser import COMMANDS, Parser
from gauss2svg.cli.terminal import drop_output
from gauss2svg.options import fields_of


def completion(shell: str) -> str:
    """Return the script of bash, zsh or fish that completes commands, options and choices."""
    whole = _completed(command_of(["--help-all"])[1])
    # The first word is a photo or a command. shtab takes one of them.
    whole._actions[:] = [action for action in whole._actions if action.option_strings]
    commands = whole.add_subparsers(parser_class=ArgumentParser)
    for name, (about, _) in COMMANDS.items():
        part = _completed(command_of([name, "--help"])[1])
        commands.add_parser(name, parents=[part], add_help=False, help=about)
    script = shtab.complete(whole, shell)
    if shell == "bash":  # photos are completed where shtab knows only commands
        script += "\ncomplete -o default -o filenames -F _shtab_gauss2svg gauss2svg"
    return script


def _completed(part: Parser) -> Parser:
    """Tell a parser which arguments are files, and the choices of the others."""
    choices = {f.name: f.choices for group in part.groups for f in fields_of(group) if f.words}
    for action in part._actions:
        action.choices = choices.get(action.dest) or None
        if action.metavar in ("PATH", "OUT") or not action.option_strings:
            action.complete = shtab.FILE  # pyright: ignore[reportAttributeAccessIssue]
    return part


if __name__ == "__main__":
    own = ArgumentParser("python -m gauss2svg.cli.completion", description=__doc__)
    own.add_argument("shell", choices=("bash", "zsh", "fish"))
    try:
        print(completion(own.parse_args().shell), flush=True)
    except BrokenPipeError:  # the reader of a pipe, such as head, has ended
        drop_output()
