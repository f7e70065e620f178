"""What several commands do with lines: those they print, and lists in an argument."""

import sys

from gauss2svg.errors import on_one_line


def say(line: str) -> None:
    """Print a line of the program on standard error."""
    print(f"gauss2svg: {on_one_line(line)}", file=sys.stderr)


def words(text: str) -> list[str]:
    """The words of a list that is separated by commas."""
    return [word.strip() for word in text.split(",") if word.strip()]
