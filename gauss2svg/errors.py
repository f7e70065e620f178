"""Exceptions, whose messages are one line that says what to try."""

from __future__ import annotations

import decimal
import math
import numbers
import operator
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


def on_one_line(text: str) -> str:
    """Text for a terminal: one line, its control characters escaped."""
    plain = (" " if c.isspace() else c for c in text)
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in plain)


def error_line(text: str) -> str:
    """The text of an error in a record: on one line, at most 400 characters of it."""
    return " ".join(text.split())[:400]


def quoted(value: Any) -> str:
    """A value in the sentence of an error: as Python writes it, on one line, not at length."""
    try:
        return brief(" ".join(repr(plain_scalar(value)).split()))
    except Exception:  # of the value's own methods: the error is about the value all the same
        return type(value).__name__


def brief(text: Any) -> str:
    """Text of any length in the sentence of an error: at most 200 characters of it."""
    text = str(text)
    return text if len(text) <= _MOST_SHOWN else text[:_MOST_SHOWN] + "..."


def plain_scalar(value: Any) -> Any:
    """A NumPy scalar as the Python value that it holds; any other value as it is."""
    item = getattr(value, "item", None)
    return item() if item is not None and getattr(value, "ndim", 1) == 0 else value


def instance(value: _Kind | None, name: str, kind: type[_Kind]) -> _Kind:
    """Value if it is of the kind, the kind's default if it is None; raises InputError else."""
    return kind() if value is None else required(value, name, kind)


def required(value: Any, name: str, kind: type[_Kind]) -> _Kind:
    """Value if it is of the kind; raises InputError that names it else."""
    if not isinstance(value, kind):
        raise InputError(f"{name} must be a {kind.__name__}; got {type(value).__name__}")
    return value


def whole_number(name: str, value: Any, least: int, most: int) -> int:
    """Value as an int in least..most; raises InputError that names it."""
    try:
        number = None if isinstance(value, bool) else operator.index(value)
    except Exception:  # of the value's own methods
        number = None
    if number is None or not least <= number <= most:
        raise InputError(f"{name} must be a whole number in {least}..{most}; got {quoted(value)}")
    return number


def _is_number(value: Any) -> bool:
    """Whether a value is a number and no truth value, text or bytes, which float() takes too."""
    return isinstance(value, (numbers.Number, decimal.Decimal)) and not isinstance(value, bool)


def number_within(
    name: str, value: Any, least: float, most: float, advice: str = "", needed: str = ""
) -> float:
    """Value as a float in least..most; raises InputError that names it."""
    try:
        plain = plain_scalar(value)
        number = float(plain) if _is_number(plain) else math.nan
    except Exception:  # of the value's own methods
        number = math.nan
    if not least <= number <= most:
        needed = needed or f"in {least:g}..{most:g}"
        advice = f". Try {advice}" if advice else ""
        raise InputError(f"{name} must be a number {needed}; got {quoted(value)}{advice}")
    return number
