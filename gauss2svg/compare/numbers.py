"""Numbers as pages and plots show them."""

from __future__ import annotations

from collections.abc import Callable
from decimal import ROUND_HALF_UP, Decimal

from gauss2svg.measure.scores import NONE, SPACE


def whole(value: float | None) -> str:
    """A whole number with thousands separated."""
    return NONE if value is None else f"{round(value):,}".replace(",", SPACE)


def size(count: float | None) -> str:
    """Bytes to three digits: 940 B, 58.3 kB, 1.68 MB."""
    return NONE if count is None else _in_bytes(count, _three_digits, "{:.0f}".format)


def short_size(count: float) -> str:
    """Bytes at a tick: 5 kB, 20 kB, 0.5 B."""
    return _in_bytes(count, "{:g}".format, "{:g}".format)


def _in_bytes(count: float, large: Callable[[float], str], small: Callable[[float], str]) -> str:
    for unit, name in ((1e6, "MB"), (1e3, "kB")):
        if count >= 0.9995 * unit:
            return f"{large(count / unit)}{SPACE}{name}"
    return f"{small(count)}{SPACE}B"


def short_seconds(value: float) -> str:
    """Seconds at a tick: 0.5 s, 20 s."""
    return f"{value:g}{SPACE}s"


def seconds(value: float | None) -> str:
    """Seconds to at most three digits: 0.84 s, 12.3 s, 401 s."""
    return NONE if value is None else f"{_three_digits(value)}{SPACE}s"


def _three_digits(value: float) -> str:
    decimals = 2 if value < 9.995 else 1 if value < 99.95 else 0
    # Ties are rounded up, as by the scripts of pages: 2625 B are 2.63 kB.
    rounded = Decimal(float(value)).quantize(Decimal(1).scaleb(-decimals), ROUND_HALF_UP)
    return f"{rounded:,}".replace(",", SPACE)
