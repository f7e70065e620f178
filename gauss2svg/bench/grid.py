"""What a benchmark varies: any options of `vectorize`, and the settings that they span."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from gauss2svg.bench.rows import TOOL
from gauss2svg.errors import Gauss2SvgError, InputError, must_be
from gauss2svg.options import Field, fields_of
from gauss2svg.pipeline.options import GROUPS, Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.presets import PRESETS
from gauss2svg.version import __version__

Settings = tuple[tuple[str, Any], ...]  # options of `vectorize` and values, sorted by name

_VARIED = ("goal", "fit", "densify", "svg")  # groups all of whose options may be varied
_ALSO = ("renderer", "max_size")
_OWN_OPTIONS = ("seed",)  # of the command itself
AXES: dict[str, Field] = {
    field.name: field
    for key, group in GROUPS.items()
    for field in fields_of(group)
    if (key in _VARIED or field.name in _ALSO) and field.name not in _OWN_OPTIONS
}
# What is tried where no values are given, of options that are not one of a few.
VALUES: dict[str, tuple[Any, ...]] = {
    "gaussians": (500, 1000, 2000, 4000, 8000),
    "iterations": (50, 100, 200, 400),
    "learning_rate": (0.5, 1.0, 2.0),
    "per_round": (16, 64, 256),
    "round_iterations": (10, 20),
    "ssim_weight": (0.1, 0.2, 0.4),
    "precision": (0.01, 0.02, 0.05, 0.1),
    "palette": (64, 256, 1024, 0),
    "max_size": (256, 512, 1024),
    "max_bytes": (20_000, 100_000, 500_000),
    "target_psnr": (28.0, 32.0, 36.0),
    "form": ("gradient",),  # the default renderer draws no other
    "renderer": ("resvg", "cairo"),  # the others may be missing
}

# Without any axis: the presets, then counts by iterations at the default preset. About a
# minute a photo of half a megapixel on two cores.
DEFAULT_GRID: tuple[dict[str, tuple[Any, ...]], ...] = (
    {"quality": tuple(PRESETS)},
    {"gaussians": (500, 2000, 8000), "iterations": (100, 300)},
)


def values_of(axis: Field) -> tuple[Any, ...]:
    """What an axis tries where no values are given; raises InputError where these are needed."""
    values = VALUES.get(axis.name, axis.choices)
    if not values:
        raise InputError(
            f"axis {axis.name} must have values; got none. Try --axis {axis.name}=VALUE,VALUE"
        )
    return values


def parse_axis(text: str) -> tuple[str, tuple[Any, ...]]:
    """Option and values of NAME or NAME=v1,v2; raises InputError for an unknown one."""
    name, given, values = text.partition("=")
    axis = _axis(name.strip())
    if not given:
        return axis.name, values_of(axis)
    return axis.name, tuple(_parsed(axis, value.strip()) for value in values.split(","))


def parse_axes(texts: Iterable[str]) -> dict[str, tuple[Any, ...]]:
    """The axes of a command line, by option; raises InputError for one given twice."""
    axes: dict[str, tuple[Any, ...]] = {}
    for text in texts:
        name, values = parse_axis(text)
        if name in axes:
            raise InputError(f"axis {name} must be given once; got it twice. Try all values in one")
        axes[name] = values
    return axes


def settings_of(axes: Mapping[str, Sequence[Any]] | None) -> list[Settings]:
    """Every combination of the values of the axes, each once; DEFAULT_GRID if there are none.

    Raises InputError for an unknown axis, an impossible value or no value, and for options that
    exclude each other.
    """
    found: dict[Settings, None] = {}  # a set that keeps the order
    for grid in [axes] if axes else DEFAULT_GRID:
        columns = []
        for name, values in grid.items():
            axis = _axis(name)
            if isinstance(values, str) or not values:
                raise InputError(must_be(f"axis {name}", "a sequence of values", values))
            columns.append([(axis.name, _parsed(axis, str(value))) for value in values])
        found |= {tuple(sorted(pairs)): None for pairs in itertools.product(*columns)}
    for settings in found:
        try:
            Plan(Options.from_flat(dict(settings)))
        except Gauss2SvgError as error:  # every run would fail
            raise InputError(f"axes: {error}") from error
    return list(found)


def _parsed(axis: Field, text: str) -> Any:
    try:
        return axis.parsed(text)
    except InputError as error:
        raise InputError(f"axis {error}") from error


def _axis(name: str) -> Field:
    option = name.replace("-", "_")
    if option not in AXES:
        raise InputError(must_be("axis", f"one of {', '.join(AXES)}", name))
    return AXES[option]


@cache
def code_digest() -> str:
    """SHA-256 of the package's source files: a row of other code is no row of this one."""
    package = Path(__file__).parent.parent
    digest = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        digest.update(str(source.relative_to(package)).encode() + source.read_bytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class BenchRun:
    """One row to be: a picture, what makes an SVG of it, and how.

    image     path; name: what tables call it; digest: SHA-256 of the file's bytes
    tool      gauss2svg or a peer; version: of the tool
    settings  keywords and values, sorted
    seed, threads  of gauss2svg; None threads: one a core
    """

    image: str
    name: str
    digest: str
    settings: Settings
    tool: str = TOOL
    version: str = __version__
    seed: int = 0
    threads: int | None = None

    @property
    def key(self) -> str:
        """The same for the same work by the same code, whatever the picture's path."""
        work = [self.digest, self.tool, self.version, code_digest(), self.settings]
        work += [self.seed, self.threads]
        return hashlib.sha256(json.dumps(work).encode()).hexdigest()[:24]

    @property
    def label(self) -> str:
        """The settings in a few words."""
        return label_of(self.tool, dict(self.settings))


def label_of(tool: str, settings: Mapping[str, Any]) -> str:
    """Settings in a few words: a preset by its name, a peer by its own and its settings."""
    if tool == TOOL and settings.keys() == {"quality"}:
        return str(settings["quality"])
    if tool != TOOL:
        return " ".join([tool, *(str(value) for value in settings.values())])
    return ", ".join(f"{keyword} {value}" for keyword, value in settings.items())
