"""Constants that ablations chose, as axes of a benchmark: MODULE.NAME, with their module's TUNING.

`--axis pipeline.search.correction.full=0.97,0.985` varies `full` of the frozen class of which
gauss2svg.pipeline.search.correction has an instance, TUNING.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from importlib import import_module
from types import ModuleType
from typing import Any

from gauss2svg.errors import InputError, quoted


class Constant:
    """A field of a TUNING, by its name as an axis; raises InputError for an unknown one."""

    def __init__(self, name: str) -> None:
        path, _, self.field = name.rpartition(".")
        try:
            self.module: ModuleType = import_module(f"gauss2svg.{path}")
            self._now = dataclasses.asdict(self.module.TUNING)[self.field]
        except (ImportError, AttributeError, KeyError) as error:
            raise InputError(
                f"axis must be an option, or a module's constant; got {quoted(name)}. Try "
                "pipeline.search.correction.full"
            ) from error
        self.name, self.choices = name, ()

    def parsed(self, text: str) -> int | float:
        """The value of a text."""
        try:
            return self.normalized(float(text))
        except ValueError as error:
            raise self._refused(text) from error

    def normalized(self, value: Any) -> int | float:
        """A value of the constant's type, which is that of its default."""
        whole = isinstance(self._now, int)
        number = isinstance(value, (int, float)) and math.isfinite(value)
        if not number or (whole and value != int(value)):
            raise self._refused(value)
        return int(value) if whole else float(value)

    def apply(self, value: float) -> None:
        """Replace the constant in this process."""
        changed = dataclasses.replace(self.module.TUNING, **{self.field: value})
        self.module.TUNING = changed  # pyright: ignore[reportAttributeAccessIssue]

    def _refused(self, value: Any) -> InputError:
        kind = "a whole number" if isinstance(self._now, int) else "a finite number"
        return InputError(f"{self.name} must be {kind}; got {value}. Try {self._now}")


def is_constant(name: str) -> bool:
    """Whether the name of an axis is that of a constant, and not of an option."""
    return "." in name


def options_in(settings: Mapping[str, Any]) -> dict[str, Any]:
    """The settings that are options."""
    return {name: value for name, value in settings.items() if not is_constant(name)}


def apply_constants(settings: Mapping[str, Any]) -> None:
    """Replace the constants among the settings in this process, which makes no other run."""
    for name, value in settings.items():
        if is_constant(name):
            Constant(name).apply(value)
