"""The exceptions of gauss2svg, and functions that put their messages together.

A message is one line. It often ends with advice on what to try.
"""

from collections.abc import Iterable
from typing import Any, TypeVar

_Kind = TypeVar("_Kind")


class Gauss2SvgError(Exception):
    """Base of all errors that gauss2svg raises on purpose. The message is one line."""

    def __init__(self, message: str) -> None:
        super().__init__(on_one_line(message))  # file names may contain line breaks


class InputError(Gauss2SvgError, ValueError):
    """An image, array, file or option that cannot be used as given."""


class SceneError(Gauss2SvgError, ValueError):
    """A scene whose arrays do not have matching shapes, or have values outside of their ranges."""


class RendererError(Gauss2SvgError, RuntimeError):
    """A renderer that is missing, or that failed."""


class OutputError(Gauss2SvgError, OSError):
    """An output that cannot be written."""


def refusal(name: str, needed: str, got: str, advice: str = "") -> InputError:
    """Return the error "NAME must be NEEDED; got GOT. Try ADVICE" for a value that cannot be used.

    If `got` contains text from a user, pass the text through `quoted` or `brief` first.
    """
    return InputError(f"{name} must be {needed}; got {got}" + (f". Try {advice}" if advice else ""))


def nearest(word: str, names: Iterable[str]) -> str:
    """Return the name that a misspelt or shortened word probably stands for, or "" for none."""
    from difflib import get_close_matches  # imported here because only errors need it

    names, word = list(names), word.strip().lower()
    longer = [name for name in names if word and name.startswith(word)]
    return [*longer, *get_close_matches(word, names, 1, cutoff=0.75), ""][0]


def several(count: int, noun: str) -> str:
    """Return a number and what it counts, such as "1 shape" or "1,200 shapes"."""
    return f"{count:,} {noun}{'s' * (count != 1)}"


def of_file(name: str, message: str) -> str:
    """Return an error message after the name of the file, if the message lacks that name."""
    return message if name in message else f"{name}: {message}"


def on_one_line(text: str) -> str:
    """Return text as one line for a terminal, with control characters escaped."""
    if text.isprintable():
        return text
    line = (" " if c.isspace() else c for c in text)
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)


def error_line(error: Exception, advice: str) -> str:
    """Return an error as one line of at most 400 characters, for a record.

    The message of a Gauss2SvgError says enough. For any other exception, the line begins with the
    type of the exception. If memory ran out, `advice` follows "Try".
    """
    line = str(error)
    if isinstance(error, MemoryError):
        line = f"out of memory ({line}). Try {advice}"
    elif not isinstance(error, Gauss2SvgError):
        line = f"{type(error).__name__}: {line}".removesuffix(": ")
    return " ".join(on_one_line(line).split())[:400]


def quoted(value: Any) -> str:
    """Return the repr of a value for an error message, on one line and shortened."""
    return brief(" ".join(repr(plain_scalar(value)).split()))


def brief(text: Any) -> str:
    """Return text for an error message, shortened to 200 characters."""
    text = str(text)
    return text if len(text) <= 200 else text[:200] + "..."


def plain_scalar(value: Any) -> Any:
    """Return the Python value of a NumPy scalar or 0-d array, and any other value unchanged."""
    item = getattr(value, "item", None)
    return item() if item is not None and getattr(value, "ndim", 1) == 0 else value


def instance(value: _Kind | None, name: str, kind: type[_Kind]) -> _Kind:
    """Return `value`, or a new instance of the class `kind` if the value is None.

    Raise InputError if the value is an instance of another class.
    """
    return kind() if value is None else required(value, name, kind)


def required(value: Any, name: str, kind: type[_Kind]) -> _Kind:
    """Return `value`. Raise InputError if it is not an instance of the class `kind`.

    name  name of the value in the error message
    """
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIO" else "a"
        raise refusal(name, f"{article} {kind.__name__}", type(value).__name__)
    return value
