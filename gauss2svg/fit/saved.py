"""What a checkpoint has of the objects of a fit: some of their attributes, by name.

A class says in `SAVED` which attributes, and what each may be when it comes back; `state_dict` and
`load_state_dict` follow from that.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, brief, number_within, whole_number

# From an attribute's name and the saved value to the attribute; raises InputError for another.
Check = Callable[[str, Any], Any]


def checks(**by_name: Check) -> Mapping[str, Check]:
    """What is saved of a class."""
    return by_name


def whole(least: int, most: int) -> Check:
    """Whole numbers in least..most."""
    return lambda name, value: whole_number(name, value, least, most)


def number(least: float, most: float) -> Check:
    """Numbers in least..most."""
    return lambda name, value: number_within(name, value, least, most)


def as_saved(name: str, value: Any) -> Any:
    """A check that allows any value."""
    return value


def optional(check: Check) -> Check:
    """A check that allows None, and what `check` allows."""
    return lambda name, value: None if value is None else check(name, value)


def part(name: str, value: Any) -> Any:
    """A check of attributes that are `Saved` themselves: they load what was saved of them."""
    raise AssertionError(f"{name} loads itself")


class Saved:
    """An object whose attributes in SAVED a checkpoint has, without their leading underscore.

    Saved values are numbers, text, None, arrays, and lists and dictionaries of these.
    """

    SAVED: ClassVar[Mapping[str, Check]] = checks()

    def state_dict(self) -> dict[str, Any]:
        """The saved attributes by name."""
        return {name.lstrip("_"): _plain(getattr(self, name)) for name in self.SAVED}

    def load_state_dict(self, saved: Mapping[str, Any]) -> None:
        """Restore saved attributes; raises InputError for values out of range."""
        for name, check in self.SAVED.items():
            key = name.lstrip("_")
            if check is part:
                getattr(self, name).load_state_dict(saved[key])
            else:
                setattr(self, name, check(key, saved[key]))


def rows(name: str, arrays: Mapping[str, Any], usual: Mapping[str, NDArray[Any]]) -> None:
    """Raise InputError unless arrays are finite and, save for their number of rows, like usual."""
    count = len(np.atleast_1d(arrays.get(next(iter(usual)), [])))
    for key, like in usual.items():
        array, shape = arrays.get(key), (count, *like.shape[1:])
        if not isinstance(array, np.ndarray):
            raise damaged(f"{key} of {name}", f"an array {shape}", type(array).__name__)
        if array.shape != shape or array.dtype != like.dtype:
            got = f"{array.dtype} {array.shape}"
            raise damaged(f"{key} of {name}", f"{like.dtype} {shape}", got)
        if not np.isfinite(array).all():
            raise damaged(f"{key} of {name}", "finite", "infinite or undefined numbers")


def damaged(name: str, needed: str, got: str) -> InputError:
    """The error about a value that no fit has saved."""
    return InputError(f"{name} must be {needed}; got {brief(got)}. Try starting the fit again")


def _plain(value: Any) -> Any:
    if hasattr(value, "state_dict"):
        return value.state_dict()
    if dataclasses.is_dataclass(value):
        return dict(vars(value))
    return list(value) if isinstance(value, (deque, tuple)) else value
