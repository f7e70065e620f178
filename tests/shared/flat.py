"""Calls with options by their names alone, whatever their groups: shorter to vary in tests."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.compare.pages import GalleryOptions
from gauss2svg.fit import FitConfig, FitOptions
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.target import Target
from gauss2svg.options import fields_of
from gauss2svg.pipeline.options import GROUPS, OPTIONS, Options
from gauss2svg.pipeline.vectorize import Result, vectorize_by

# Options that are valid only beside another one of this value.
BESIDE = {"portable": {"blend": "add"}, "count_gzipped": {"max_bytes": 40_000}}
_OF_A_CALL = ("focus", "start", "progress", "stop", "started")


def vectorize(image: Any, **given: Any) -> Result:
    """`gauss2svg.vectorize` of options by their names."""
    of_call = {name: given.pop(name) for name in _OF_A_CALL if name in given}
    return vectorize_by(Options.from_flat(given), image, **of_call)


def fit_config(gaussians: int = 5000, iterations: int = 200, **given: Any) -> FitConfig:
    """All that a fit goes by, of options by their names."""
    options = {f.name: given.pop(f.name) for f in fields_of(FitOptions) if f.name in given}
    return FitConfig(gaussians=gaussians, iterations=iterations, fit=FitOptions(**options), **given)


def session_of(pixels: NDArray[np.float32], config: FitConfig, *given: Any, **more: Any):
    """A fit of pixels that has not begun."""
    return FitSession(Target(pixels, config.fit.tuned), config, *given, **more)


def choices(name: str) -> tuple[Any, ...]:
    """All values of an option that has only a few."""
    fields = {field.name: field for field in fields_of(GROUPS[OPTIONS[name]])}
    return fields[name].choices


def build_gallery(photos: Any, directory: Any, **given: Any) -> Any:
    """`gauss2svg.build_gallery` of options by their names, whose data and folder it returns."""
    from gauss2svg.compare.pages import build_gallery as build

    names = [field.name for field in fields_of(GalleryOptions)]
    options = GalleryOptions(**{name: given.pop(name) for name in names if name in given})
    data = build(photos, directory, options=options, **given)
    return SimpleNamespace(directory=Path(directory), **data)
