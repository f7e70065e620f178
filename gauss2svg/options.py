"""Option classes: what a field may hold is said once, by its annotation.

    @dataclass(frozen=True, kw_only=True)
    class FitOptions(OptionGroup):
        learning_rate: Annotated[float, Number(1e-6, 1e6)] = 1.0
        '''Learning-rate multiplier'''

The Python call, the command line (cyclopts reads annotations, defaults and the texts under the
fields), the axes of the benchmark and the report are all derived from such classes.
"""

from __future__ import annotations

import dataclasses
import math
import operator
import os
import re
import types
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from gauss2svg.errors import InputError, number_within, plain_scalar, quoted, whole_number

Check = Callable[[str, Any], Any]
Renderer = Literal["resvg", "cairo", "chromium", "librsvg", "firefox", "inkscape"]
_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9}
_SIZE = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*([kmg]?)b?", re.IGNORECASE)


@dataclass(frozen=True)
class Whole:
    """A whole number in least..most."""

    least: int
    most: int = 2**31 - 1

    def __call__(self, name: str, value: Any) -> int:
        """The number; raises InputError that names it."""
        return whole_number(name, value, self.least, self.most)

    def parse(self, text: str) -> int:
        """What a text stands for; raises ValueError or KeyError for any other."""
        # No int(): it also takes " 1_0".
        if not text.isdecimal():
            raise ValueError(text)
        return int(text)


@dataclass(frozen=True)
class Number:
    """A number in least..most, or where `above` is True greater than least."""

    least: float
    most: float
    above: bool = False
    advice: str = ""

    def __call__(self, name: str, value: Any) -> float:
        """The number; raises InputError that names it."""
        least = math.nextafter(self.least, math.inf) if self.above else self.least
        needed = f"above {self.least:g} and at most {self.most:g}" if self.above else ""
        return number_within(name, value, least, self.most, self.advice, needed)

    def parse(self, text: str) -> float:
        """What a text stands for; raises ValueError or KeyError for any other."""
        return float(text)


@dataclass(frozen=True)
class Flag:
    """True or False."""

    known = (False, True)

    def __call__(self, name: str, value: Any) -> bool:
        """The value; raises InputError that names it."""
        value = plain_scalar(value)
        if not isinstance(value, bool):
            raise InputError(f"{name} must be True or False; got {quoted(value)}")
        return value

    def parse(self, text: str) -> bool:
        """What a text stands for; raises ValueError or KeyError for any other."""
        return {"True": True, "False": False, "true": True, "false": False}[text]


@dataclass(frozen=True)
class OneOf:
    """One of a few values."""

    known: tuple[Any, ...]

    def __call__(self, name: str, value: Any) -> Any:
        """The value; raises InputError that names it."""
        value = plain_scalar(value)
        for one in self.known:
            if type(one) is type(value) and one == value:
                return one
        raise InputError(
            f"{name} must be one of {', '.join(map(str, self.known))}; got {quoted(value)}"
        )

    def parse(self, text: str) -> Any:
        """What a text stands for; raises ValueError or KeyError for any other."""
        return {str(one): one for one in self.known}[text]


@dataclass(frozen=True)
class Field:
    """One option: its group, and how a value is checked and normalised.

    checks   in order, each from the value of the one before
    words    that stand beside numbers, such as "auto"
    """

    name: str
    group: type[OptionGroup]
    checks: tuple[Check, ...]
    words: tuple[Any, ...]
    may_be_none: bool

    def normalized(self, value: Any) -> Any:
        """The value as it is stored; raises InputError that names the option."""
        if value is None and self.may_be_none:
            return None
        if isinstance(value, str) and value in self.words:
            return str(value)
        given = value
        for check in self.checks:
            try:
                value = check(self.name, value)
            except InputError as error:
                if not self.words:
                    raise
                words = " or ".join(map(str, self.words))
                raise InputError(str(error).replace("; got", f" or {words}; got", 1)) from error
            except Exception as error:  # of the value's own methods
                raise InputError(
                    f"{self.name} must be a plain value; got {type(given).__name__}, which "
                    f"raises {type(error).__name__}"
                ) from error
        return value

    @property
    def choices(self) -> tuple[Any, ...]:
        """All values of the option, where there are only a few; else none."""
        for check in self.checks:
            if isinstance(check, (Flag, OneOf)):
                return check.known
        return ()

    def parsed(self, text: str) -> Any:
        """The value that a text stands for; raises InputError for one that is not valid."""
        if text in self.words:
            return text
        value: Any = text
        for check in self.checks:
            if isinstance(check, (Whole, Number, Flag, OneOf)):
                with suppress(ValueError, KeyError):  # such text is refused just below
                    value = check.parse(text)
        return self.normalized(value)


class OptionGroup:
    """Base of frozen, keyword-only dataclasses of options: checks and normalises every field."""

    def __post_init__(self) -> None:
        for field in fields_of(type(self)):
            object.__setattr__(self, field.name, field.normalized(getattr(self, field.name)))


@cache
def fields_of(group: type[OptionGroup]) -> tuple[Field, ...]:
    """The options of a group, in order."""
    hints = get_type_hints(group, include_extras=True)
    names = [f.name for f in dataclasses.fields(group)]  # pyright: ignore[reportArgumentType]
    return tuple(_field(group, name, hints[name]) for name in names)


def _field(group: type[OptionGroup], name: str, hint: Any) -> Field:
    checks: list[Check] = []
    if get_origin(hint) is Annotated:
        hint, *metadata = get_args(hint)
        checks = [check for check in metadata if callable(check)]
    members = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    words = [w for member in members if get_origin(member) is Literal for w in get_args(member)]
    if words and not checks:
        checks = [OneOf(tuple(words))]
        words = []
    if bool in members and not checks:
        checks = [Flag()]
    return Field(name, group, tuple(checks), tuple(words), type(None) in members)


def byte_size(name: str, value: Any) -> int:
    """Bytes of a size: 150000, "150000", "150k", "1.5M", "150 kB"; k, M and G are decimal.

    Raises InputError that names it for anything else, and for less than one byte.
    """
    size = 0.0
    if isinstance(value, str):
        match = _SIZE.fullmatch(value.strip())
        size = float(match[1]) * _UNITS[match[2].lower()] if match else 0.0
    elif not isinstance(value, bool):
        with suppress(Exception):  # of the value's own methods
            size = operator.index(value)
    if not 1 <= size < 2**63:
        raise InputError(
            f"{name} must be a size of at least 1 byte; got {quoted(value)}. Try 150k or 1.5M"
        )
    return int(size)


def file_name(name: str, value: Any, needed: str = "the path of a file") -> str:
    """A path as text; raises InputError that names it."""
    path = ""
    if isinstance(value, (str, os.PathLike)):
        with suppress(Exception):  # of a __fspath__ that returns something else, or raises
            path = str(os.fsdecode(value))
    if not path:
        raise InputError(f"{name} must be {needed}; got {quoted(value)}")
    return path
