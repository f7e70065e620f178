"""Exceptions, whose messages are one line that says what to try."""

from __future__ import annotations

from typing import Any, TypeVar

_Kind = TypeVar("_Kind")
_MOST_SHOWN = 200  # characters of a value in an error


class Gauss2SvgError(Exception):
    """Base of every error that gauss2svg raises on purpose; its message is one line."""

    def __init__(self, message: str) -> None:
        super().__init__(on_one_line(message))  # names of files may have several


class InputError(Gauss2SvgError, ValueError):
    """An image, array, file or option that cannot be used as given."""


class SceneError(Gauss2SvgError, ValueError):
    """A scene whose arrays disagree in shape or leave their ranges."""


class RendererError(Gauss2SvgError, RuntimeError):
    """A renderer that is missing, or that failed."""


class PeerError(Gauss2SvgError, RuntimeError):
    """Another tool that failed in a benchmark."""


class OutputError(Gauss2SvgError, OSError):
    """An output that cannot be written."""


class ClusterError(Gauss2SvgError, RuntimeError):
    """A scheduler that does not answer or went away, or workers that cannot do the work."""


def refusal(name: str, needed: str, got: str, advice: str = "") -> InputError:
    """Return the error of a value that cannot be used: what is needed, what was given, what to try.

    "NAME must be NEEDED; got GOT. Try ADVICE". Texts of users go through `quoted` or `brief`.
    """
    return InputError(f"{name} must be {needed}; got {got}" + (f". Try {advice}" if advice else ""))


def on_one_line(text: str) -> str:
    """Return text for a terminal: one line, its control characters escaped."""
    if text.isprintable():
        return text
    plain = (" " if c.isspace() else c for c in text)
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in plain)


def error_line(text: str) -> str:
    """Return the text of an error for a record: one line of at most 400 characters."""
    return " ".join(text.split())[:400]


def quoted(value: Any) -> str:
    """Return a value for the sentence of an error, as Python writes it: one line, not at length."""
    try:
        return brief(" ".join(repr(plain_scalar(value)).split()))
    except Exception:  # of the value's own methods: the error is about the value all the same
        return type(value).__name__


def brief(text: Any) -> str:
    """Return text for the sentence of an error: at most 200 characters of it."""
    text = str(text)
    return text if len(text) <= _MOST_SHOWN else text[:_MOST_SHOWN] + "..."


def plain_scalar(value: Any) -> Any:
    """Return the Python value that a NumPy scalar holds; any other value as it is."""
    item = getattr(value, "item", None)
    return item() if item is not None and getattr(value, "ndim", 1) == 0 else value


def instance(value: _Kind | None, name: str, kind: type[_Kind]) -> _Kind:
    """Return `value`, or `kind()` if it is None. Raise InputError if it is not a `kind`."""
    return kind() if value is None else required(value, name, kind)


def required(value: Any, name: str, kind: type[_Kind]) -> _Kind:
    """Return `value`. Raise InputError that names it if it is not a `kind`."""
    if not isinstance(value, kind):
        raise refusal(name, f"a {kind.__name__}", type(value).__name__)
    return value
