"""Option classes: what a field may hold is said once, by its annotation.

    @dataclass(frozen=True, kw_only=True)
    class FitOptions(OptionGroup):
        learning_rate: Annotated[float, Interval(ge=1e-6, le=1e6)] = 1.0
        '''Factor by which every learning rate is multiplied.'''

An annotation is bool, int, float or a Literal, or several of them, and None where an option may be
left out. Beside it stand a range by annotated_types, a text that says which values to try, or, for
any other kind of value, a function of name and value that returns what is stored. The Python call,
the command line (cyclopts reads annotations, defaults and the texts under the fields), the form and
the requests of the studio, the axes of the benchmark, the report and the reference follow.
"""

from __future__ import annotations

import dataclasses
import decimal
import math
import numbers
import operator
import os
import re
import types
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from annotated_types import Interval

from gauss2svg.errors import InputError, plain_scalar, quoted, refusal

Renderer = Literal["resvg", "cairo", "chromium", "librsvg", "firefox", "inkscape"]
Seed = Annotated[int, Interval(ge=0, le=2**63 - 1)]
_MOST = 2**31 - 1  # of a whole number without a largest one
_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9}
_SIZE = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*([kmg]?)b?", re.IGNORECASE)
_NUMBERS: Any = (numbers.Number, decimal.Decimal)
_BOOLS = {"True": True, "False": False, "true": True, "false": False}


@dataclass(frozen=True)
class Field:
    """What an option or another argument may hold.

    name         as errors have it
    kind         bool, int, float, or None where other rules say it all
    least, most  range of an int or a float
    is_above     whether it must be larger than `least`
    words        values that are taken too, such as "auto"
    check        returns what is stored for any other value; raises InputError
    is_optional  whether None is taken
    advice       values to try
    """

    name: str
    kind: type | None = None
    least: float = -math.inf
    most: float = math.inf
    is_above: bool = False
    words: tuple[Any, ...] = ()
    check: Callable[[str, Any], Any] | None = None
    is_optional: bool = False
    advice: str = ""
    default: Any = None

    def checked(self, value: Any) -> Any:
        """Return the value as it is stored. Raise InputError that names the option."""
        if value is None and self.is_optional:
            return None
        taken = None
        try:
            taken = self._taken(plain_scalar(value))
        except InputError:
            raise
        except Exception:
            pass
        if taken is None:
            raise refusal(self.name, self._needed, quoted(value), self.advice)
        return taken

    def parsed(self, text: str) -> Any:
        """Return the value that a text stands for. Raise InputError for one that is not valid."""
        value: Any = {str(word): word for word in self.words}.get(text, text)
        with suppress(ValueError):  # which `checked` refuses
            if self.kind is bool:
                value = _BOOLS.get(text, text)
            elif self.kind is int and text.isdecimal():  # int() takes " 1_0" too
                value = int(text)
            elif self.kind is float:
                value = float(text)
        return self.checked(value)

    @property
    def choices(self) -> tuple[Any, ...]:
        """All values of the option, where there are only a few; else none."""
        return (False, True) if self.kind is bool else self.words if self.kind is None else ()

    def _taken(self, value: Any) -> Any:
        """Return the value as it is stored, None for one that is refused."""
        for word in self.words:
            if type(word) is type(value) and word == value:
                return word
        if self.check is not None:
            return self.check(self.name, value)
        if self.kind is None:
            return None if self.words else value
        if self.kind is bool or isinstance(value, bool):
            return value if self.kind is bool and isinstance(value, bool) else None
        if self.kind is int:
            number = operator.index(value)
        else:  # float() takes texts too
            number = float(value) if isinstance(value, _NUMBERS) else math.nan
        is_over = self.least < number if self.is_above else self.least <= number
        return number if is_over and number <= self.most else None

    @property
    def _needed(self) -> str:
        if self.kind is bool:
            return "True or False"
        if self.kind is None:
            return f"one of {', '.join(map(str, self.words))}" if self.words else "a plain value"
        if self.kind is int:
            needed = f"a whole number in {self.least}..{self.most}"
        elif self.is_above:
            needed = f"a number above {self.least:g} and at most {self.most:g}"
        else:
            needed = f"a number in {self.least:g}..{self.most:g}"
        return " or ".join([needed, *map(str, self.words)])


class OptionGroup:
    """Base of frozen, keyword-only dataclasses of options: checks every field."""

    def __post_init__(self) -> None:
        for field in fields_of(type(self)):
            object.__setattr__(self, field.name, field.checked(getattr(self, field.name)))


@cache
def fields_of(group: type[OptionGroup]) -> tuple[Field, ...]:
    """The options of a group, in order."""
    hints = get_type_hints(group, include_extras=True)
    fields = dataclasses.fields(group)  # pyright: ignore[reportArgumentType]
    return tuple(field_of(one.name, hints[one.name], one.default) for one in fields)


def field_of(name: str, hint: Any, default: Any = None) -> Field:
    """Return the option of an annotation."""
    members, beside = _parts_of(hint)
    check = next((one for one in beside if callable(one)), None)
    kinds = [kind for kind in (bool, int, float) if kind in members and check is None]
    kind = kinds[0] if kinds else None
    limits: Any = next((one for one in beside if isinstance(one, Interval)), Interval())
    most = _MOST if kind is int else math.inf
    return Field(
        name=name,
        kind=kind,
        least=next((one for one in (limits.ge, limits.gt) if one is not None), -math.inf),
        most=most if limits.le is None else limits.le,
        is_above=limits.gt is not None,
        words=tuple(w for one in members if get_origin(one) is Literal for w in get_args(one)),
        check=check,
        is_optional=type(None) in members,
        advice=next((one for one in beside if isinstance(one, str)), ""),
        default=default,
    )


def _parts_of(hint: Any) -> tuple[list[Any], list[Any]]:
    """Return the types of an annotation, and what stands beside them."""
    if get_origin(hint) is Annotated:
        members, beside = _parts_of(get_args(hint)[0])
        return members, [*beside, *hint.__metadata__]
    if get_origin(hint) not in (Union, types.UnionType):
        return [hint], []
    parts = [_parts_of(one) for one in get_args(hint)]
    return [one for ones, _ in parts for one in ones], [one for _, ones in parts for one in ones]


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
