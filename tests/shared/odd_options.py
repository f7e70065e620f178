"""Odd values of options, and random combinations of options."""

from __future__ import annotations

import math
import os
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from gauss2svg.options import Field, byte_size, fields_of
from gauss2svg.pipeline.options import GROUPS

PIXELS = np.random.default_rng(0).integers(0, 256, (16, 16, 3), np.uint8)
SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"/>'
_QUICK = {"quality": "draft", "gaussians": 4, "iterations": 3, "max_memory": "400M"}
_SLOW = ("chromium", "firefox", "inkscape")  # renderers that start programs for seconds
_FILES = ("fit", "new/fit", ".", "", "fit\0", "fit\ud800", "/dev/null", "photo.png", "other.svg")


class Rude:
    """Raises wherever it is asked for a number, a path or a truth."""

    def _raise(self, *_: Any) -> Any:
        raise RuntimeError("rude")

    __eq__ = __hash__ = __bool__ = __len__ = __iter__ = _raise  # type: ignore
    __index__ = __float__ = __int__ = __fspath__ = item = _raise


class Pathless(os.PathLike):
    """A path that is not one."""

    def __fspath__(self) -> Any:
        return 5


class Named:
    """Its repr has several lines, and no end."""

    def __repr__(self) -> str:
        return "a\nb\x1b[31m" * 1000


def odd_values() -> list[Any]:
    """Values that most options refuse, and some that they take."""
    return [
        None, True, False, 0, 1, -1, 5, 2**31, 2**63 - 1, 2**63, 2**64, 10**400, -(10**400),
        0.0, -0.0, 0.5, 1e-320, 1e308, math.inf, -math.inf, math.nan, 1j,
        "", " ", "5", "30", " 5", "0.5", "1e3", "1_0", "\u0663", "\u00b2", "auto", "None", "nan",
        "True", "a\nb", "\0", "\ud800", "x" * 5000, "9" * 5000, "-", "--gzip", "<svg/>",
        b"", b"5", b"fit", b"\xff", bytearray(b"5"), memoryview(b"5"),
        [], [5], [[]], (), (5,), {}, {"a": 1}, {5}, range(3), iter([5]), slice(1),
        Decimal("0.5"), Decimal("5"), Decimal("NaN"), Decimal("sNaN"), Decimal("1e999999"),
        Fraction(1, 2), Fraction(10**400), object(), type, len, print, Rude(), Pathless(), Named(),
        np.int8(5), np.uint64(2**64 - 1), np.float16(0.5), np.float32("nan"), np.float64(1e300),
        np.finfo(np.longdouble).max, np.bool_(True), np.str_("over"), np.str_("5"), np.bytes_(b"5"),
        np.array(5), np.array(0.5), np.array([5]), np.array([0.5]), np.array([]), np.zeros((3, 0)),
        np.zeros((16, 16)), np.zeros((16, 16), np.uint8), np.zeros((16, 16), bool),
        np.full((16, 16), -1), np.array(["a"]), np.array("over"), np.array(None), np.array(Rude()),
        np.datetime64("2020"), np.ma.masked, np.ma.masked_array([5], [True]), np.void(b"5"),
        Path("fit"), Path(), *(Path(name) for name in _FILES), *_FILES,
    ]  # fmt: skip


def _valid_values(field: Field) -> list[Any]:
    """Return values that an option takes, and both sides of the ends of its range."""
    found: list[Any] = [one for one in (*field.choices, *field.words) if one not in _SLOW]
    if field.kind in (int, float):
        for end in (field.least, field.most):
            beside = [math.nextafter(end, -math.inf), math.nextafter(end, math.inf)]
            found += [end, end - 1, end + 1] if field.kind is int else [end, *beside]
        found += [max(field.least, 1), np.int64(max(field.least, 1)), min(field.most, 30)]
    elif field.check is byte_size:
        found += [300_000_000, "300M", "1k", "1.5 kB", "0.1", "1e9", 1, 0, "9" * 30 + "G"]
    elif field.check is not None and not field.words:  # each of them has its own words
        found += ["white", "#fa0", "#ffaa00", "photo", "120mm", "5in", "1e9mm", "0px", "none"]
        found += ["xMidYMid slice", "xMidYMid", "A title", "30", 30, 10_000, 10_001]
    return found


def flat_options(rng: Random) -> dict[str, Any]:
    """Return options of a quick run and up to four others, more often valid ones than not."""
    fields = [field for group in GROUPS.values() for field in fields_of(group)]
    return _QUICK | {
        field.name: rng.choice((rng.random() < 0.7 and _valid_values(field)) or odd_values())
        for field in rng.sample(fields, rng.randint(0, 4))
    }


def as_words(options: dict[str, Any]) -> list[str]:
    """Return options as words of a command, or as a process can be given them."""
    words = []
    for key, value in options.items():
        name = f"--{key.replace('_', '-')}"
        if isinstance(value, bool):
            words.append(name if value else name.replace("--", "--no-", 1))
        elif isinstance(value, str | int | float):
            words.append(f"{name}={value}".replace("\0", "").replace("\ud800", ""))
    return words
