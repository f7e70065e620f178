"""Checks of option values that several option groups share."""

import operator
from typing import Any

from gauss2svg.errors import InputError


def whole_number(name: str, value: Any, least: int, most: int) -> int:
    """Value as an int in least..most; raises InputError that names it."""
    try:
        number = None if isinstance(value, bool) else operator.index(value)
    except TypeError:
        number = None
    if number is None or not least <= number <= most:
        raise InputError(f"{name} is {value!r}; needed is a whole number in {least}..{most}")
    return number
