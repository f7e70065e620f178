"""Numbers as pages and plots show them."""

from __future__ import annotations

_SPACE = "\N{NARROW NO-BREAK SPACE}"
_NONE = "\N{EN DASH}"


def whole(value: float | None) -> str:
    """A whole number with thousands separated."""
    return _NONE if value is None else f"{round(value):,}".replace(",", _SPACE)


def size(count: float | None) -> str:
    """Bytes to three digits: 940 B, 58.3 kB, 1.68 MB."""
    if count is None:
        return _NONE
    for unit, name in ((1e6, "MB"), (1e3, "kB")):
        if count >= 0.9995 * unit:
            return f"{_three_digits(count / unit)}{_SPACE}{name}"
    return f"{round(count)}{_SPACE}B"


def short_size(count: float) -> str:
    """Bytes at a tick: 5 kB, 20 kB, 0.5 B."""
    for unit, name in ((1e6, "MB"), (1e3, "kB")):
        if count >= 0.9995 * unit:
            return f"{count / unit:g}{_SPACE}{name}"
    return f"{count:g}{_SPACE}B"


def short_seconds(value: float) -> str:
    """Seconds at a tick: 0.5 s, 20 s."""
    return f"{value:g}{_SPACE}s"


def seconds(value: float | None) -> str:
    """Seconds to at most three digits: 0.84 s, 12.3 s, 401 s."""
    return _NONE if value is None else f"{_three_digits(value)}{_SPACE}s"


def decibels(value: float | None) -> str:
    """A PSNR; "equal" for None, which stands for the infinite PSNR of an exact SVG."""
    return "equal" if value is None else f"{value:.2f}{_SPACE}dB"


def ratio(value: float | None) -> str:
    """An SSIM."""
    return _NONE if value is None else f"{value:.3f}"


def tenths(value: float | None) -> str:
    """A SSIMULACRA2."""
    return _NONE if value is None else f"{value:.1f}"


def ten_thousandths(value: float | None) -> str:
    """A FLIP."""
    return _NONE if value is None else f"{value:.4f}"


def _three_digits(value: float) -> str:
    decimals = 2 if value < 9.995 else 1 if value < 99.95 else 0
    text = f"{value:.{decimals}f}"
    return text if decimals else f"{round(value):,}".replace(",", _SPACE)
