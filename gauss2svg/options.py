"""Classes of options. The annotation of a field says which values the field may have.

    @dataclass(frozen=True, kw_only=True)
    class FitOptions(OptionGroup):
        learning_rate: Annotated[float, Interval(ge=1e-6, le=1e6)] = 1.0
        '''Factor by which every learning rate is multiplied.'''

The type in an annotation is bool, int, float, a Literal, or a union of these, with None if the
option may be None. `Annotated` may add a range (Interval), and a text with values to try, which
error messages show. For an option of any other type, `Annotated` adds a function (name, value),
which checks a value and returns the value to store.

The Python call, the command line, the studio's form and requests, the axes of the benchmark, the
report and the reference documentation all take the options from these classes.
"""

import dataclasses
import math
import numbers
import os
import re
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self, get_args, get_origin, get_type_hints

from gauss2svg.errors import InputError, nearest, plain_scalar, quoted, refusal


class Interval(NamedTuple):
    """Range of an option's values: values are at least `ge`, and at most `le`."""

    ge: float | None = None
    le: float | None = None


Renderer = Literal["resvg", "cairo", "chromium", "librsvg", "firefox", "inkscape"]
Seed = Annotated[int, Interval(ge=0, le=2**63 - 1)]


@dataclass(frozen=True)
class Field:
    """The rule for the values of an option or another argument.

    name         name in error messages
    kind         bool, int or float. None if only `words` or `check` decide which values are allowed
    least, most  range of an int or a float
    words        values that are also allowed, such as "auto"
    check        function (name, value), which is called for any value that is not in `words`. It
                 returns the value to store, or raises InputError.
    is_optional  whether None is allowed
    advice       values to try, for error messages
    default      default of the option
    """

    name: str
    kind: type | None = None
    least: float = -math.inf
    most: float = math.inf
    words: tuple[Any, ...] = ()
    check: Callable[[str, Any], Any] | None = None
    is_optional: bool = False
    advice: str = ""
    default: Any = None

    def checked(self, value: Any) -> Any:
        """Return `value` as the option stores it. Raise InputError if it is not allowed."""
        if value is None and self.is_optional:
            return None
        accepted = self._accepted(plain_scalar(value))
        if accepted is None:
            close = nearest(value, map(str, self.words)) if isinstance(value, str) else ""
            raise refusal(self.name, self._needed, quoted(value), close or self.advice)
        return accepted

    def parsed(self, text: str) -> Any:
        """Return the value that a text stands for. Raise InputError if it is not valid."""
        value: Any = {str(word): word for word in self.words}.get(text, text)
        # If the text is not a number, `value` stays a text, and `checked` raises the InputError.
        with suppress(ValueError):
            if self.kind is bool:
                value = {"true": True, "false": False}.get(text.lower(), text)
            elif self.kind is not None:
                value = self.kind(text)
        return self.checked(value)

    @property
    def choices(self) -> tuple[Any, ...]:
        """All allowed values of the option, or () if they cannot be listed."""
        return (False, True) if self.kind is bool else self.words if self.kind is None else ()

    def _accepted(self, value: Any) -> Any:
        """Return `value` as the option stores it, or None if it is not allowed."""
        for word in self.words:
            if isinstance(value, type(word)) and word == value:
                return word
        if self.check is not None:
            return self.check(self.name, value)
        if self.kind is None:
            return None if self.words else value
        if self.kind is bool or isinstance(value, bool):
            return value if self.kind is bool and isinstance(value, bool) else None
        numbers_of_kind: Any = numbers.Integral if self.kind is int else numbers.Real
        if not isinstance(value, numbers_of_kind):
            return None
        return self.kind(value) if self.least <= value <= self.most else None

    @property
    def _needed(self) -> str:
        if self.kind is bool:
            return "True or False"
        if self.kind is None:
            return f"one of {', '.join(map(str, self.words))}" if self.words else "a plain value"
        if self.kind is int:
            needed = f"a whole number in {self.least}..{self.most}"
        else:
            needed = f"a number in {self.least:g}..{self.most:g}"
        return " or ".join([needed, *map(str, self.words)])


class OptionGroup:
    """Base class of the dataclasses of options. It checks the values of each new instance.

    The dataclasses are frozen and keyword-only.
    """

    def __post_init__(self) -> None:
        for field in fields_of(type(self)):
            object.__setattr__(self, field.name, field.checked(getattr(self, field.name)))

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """Return options with values by name, which may be texts as typed in a command line.

        Names of other options are left out.
        """
        fields = [(field, given[field.name]) for field in fields_of(cls) if field.name in given]
        return cls(**{f.name: f.parsed(v) if isinstance(v, str) else v for f, v in fields})


@cache
def fields_of(group: type[OptionGroup]) -> tuple[Field, ...]:
    """Return the Field of each option of a group, in the order of the class."""
    hints = get_type_hints(group, include_extras=True)
    fields = dataclasses.fields(group)  # pyright: ignore[reportArgumentType]
    return tuple(field_of(field.name, hints[field.name], field.default) for field in fields)


@cache
def texts_of(group: type[OptionGroup]) -> dict[str, str]:
    """Return the text under each field of a class, which is read from the source of the class."""
    import ast
    import inspect

    module = ast.parse(inspect.getsource(sys.modules[group.__module__]))
    classes = [node for node in module.body if isinstance(node, ast.ClassDef)]
    body = next(node.body for node in classes if node.name == group.__name__)
    return {
        ast.unparse(field.target): " ".join(ast.literal_eval(text.value).split())
        for field, text in pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr)
    }


def flag_of(name: str) -> str:
    """Return the name of an option on the command line."""
    return f"--{name.rstrip('_').replace('_', '-')}"


def field_of(name: str, hint: Any, default: Any = None) -> Field:
    """Return the Field that an annotation describes."""
    members, metadata = _types_and_metadata(hint)
    check = next((item for item in metadata if callable(item)), None)
    kinds = [kind for kind in (bool, int, float) if kind in members and check is None]
    kind = kinds[0] if kinds else None
    limits: Any = next((item for item in metadata if isinstance(item, Interval)), Interval())
    most = 2**31 - 1 if kind is int else math.inf
    return Field(
        name=name,
        kind=kind,
        least=-math.inf if limits.ge is None else limits.ge,
        most=most if limits.le is None else limits.le,
        words=tuple(w for each in members if get_origin(each) is Literal for w in get_args(each)),
        check=check,
        is_optional=type(None) in members,
        advice=next((item for item in metadata if isinstance(item, str)), ""),
        default=default,
    )


def _types_and_metadata(hint: Any) -> tuple[list[Any], list[Any]]:
    """Return the types of an annotation, and the metadata that `Annotated` adds to them."""
    if get_origin(hint) is Annotated:
        members, metadata = _types_and_metadata(get_args(hint)[0])
        return members, [*metadata, *hint.__metadata__]
    if get_origin(hint) in (None, Literal):
        return [hint], []
    pairs = [_types_and_metadata(member) for member in get_args(hint)]
    return [kind for kinds, _ in pairs for kind in kinds], [m for _, ms in pairs for m in ms]


def byte_size(name: str, value: Any) -> int:
    """Return a size as a number of bytes. A kB has 1000 bytes.

    The size is an int or a text: 150000, "150000", "150k", "1.5M", "150 kB". Raise InputError with
    the name of the option for anything else, and for less than one byte.
    """
    size = 0.0
    if isinstance(value, str):
        match = re.fullmatch(r"([0-9]+\.?[0-9]*|\.[0-9]+)\s*([kmg]?)b?", value.strip().lower())
        units = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9}
        size = float(match[1]) * units[match[2]] if match else 0.0
    elif isinstance(value, numbers.Integral) and not isinstance(value, bool):
        size = int(value)
    if not 1 <= size < 2**63:
        raise InputError(
            f"{name} must be a size of at least 1 byte; got {quoted(value)}. Try 150k or 1.5M"
        )
    return int(size)


def hex_of(text: Any) -> str:
    """Return a colour as "#rrggbb", or raise ValueError.

    text  #rgb or #rrggbb, also without the #, or a name of a colour in CSS such as red. The error
          of another text is the name that is nearest to it, or "" if none is near
    """
    from PIL.ImageColor import colormap, getrgb  # imported here because few options need it

    if not isinstance(text, str):
        raise ValueError("")
    word = text.strip().lower()
    if match := re.fullmatch("#?([0-9a-f]{3}|[0-9a-f]{6})", word):
        return "#" + (match[1] if len(match[1]) == 6 else "".join(2 * digit for digit in match[1]))
    if word not in colormap:
        raise ValueError(nearest(word, colormap))
    return "#" + bytes(getrgb(word)).hex()


def check_color(name: str, value: Any) -> str:
    """Return a colour as "#rrggbb". Raise InputError if `value` is no text of `hex_of`."""
    try:
        return hex_of(value)
    except ValueError as error:
        needed = "a colour such as white, #fa0 or #ffaa00"
        raise refusal(name, needed, quoted(value), str(error)) from None


def file_name(name: str, value: Any, needed: str = "the path of a file") -> str:
    """Return the path `value` as text.

    Raise InputError if `value` is not a path. The error message has the option's name.
    """
    path = os.fsdecode(value) if isinstance(value, (str, os.PathLike)) else ""
    if not path:
        raise InputError(f"{name} must be {needed}; got {quoted(value)}")
    return path


def file_path(name: str, value: Any) -> Path:
    """Return `value` as a path. Raise InputError if it is not one."""
    return Path(file_name(name, value))
