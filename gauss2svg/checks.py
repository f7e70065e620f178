"""Checks of option values that several option groups share."""

import math
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


def number_within(name: str, value: Any, least: float, most: float) -> float:
    """Value as a float in least..most; raises InputError that names it."""
    try:
        number = math.nan if isinstance(value, (bool, str)) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not least <= number <= most:
        raise InputError(f"{name} is {value!r}; needed is a number in {least:g}..{most:g}")
    return number
