"""Benchmarks: many settings on many photos, each in its own process, as tables and plots."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gauss2svg.bench.grid import DEFAULT_GRID
    from gauss2svg.bench.runner import BenchProgress, run_bench

_HOMES = {"BenchProgress": "runner", "DEFAULT_GRID": "grid", "run_bench": "runner"}

__all__ = ["DEFAULT_GRID", "BenchProgress", "run_bench"]


def __getattr__(name: str) -> Any:
    # On first use: the workers import this package, and their memory is what is measured.
    if name not in _HOMES:
        raise AttributeError(f"module 'gauss2svg.bench' has no attribute {name!r}")
    return getattr(import_module(f"gauss2svg.bench.{_HOMES[name]}"), name)
