"""What is varied: the axes as one table, and the settings that a choice of them spans."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from gauss2svg.bench.worker import TOOL
from gauss2svg.errors import InputError
from gauss2svg.fit.losses import LOSSES
from gauss2svg.fit.options import DTYPES, MOST_GAUSSIANS
from gauss2svg.fit.placement import PLACEMENTS
from gauss2svg.fit.schedule import SCHEDULES
from gauss2svg.pipeline.presets import QUALITIES
from gauss2svg.raster import DEFAULT_RENDERER, DRAW_BLENDS, DRAW_TURNED_BLURS, RENDERERS
from gauss2svg.scene import ADD, BLENDS
from gauss2svg.scene.falloff import FALLOFFS, GAUSSIAN
from gauss2svg.svg.blur import FORMS, GRADIENT
from gauss2svg.svg.options import LEAST_PRECISION, MOST_PRECISION
from gauss2svg.svg.stops import STOP_COUNTS
from gauss2svg.version import __version__

Settings = tuple[tuple[str, Any], ...]  # keywords of `vectorize` and values, sorted by keyword


@dataclass(frozen=True)
class Axis:
    """One thing to vary.

    keyword  of `vectorize`
    values   what is tried where the command line names none
    parse    a value from its text; raises ValueError for what it is not
    """

    keyword: str
    values: tuple[Any, ...]
    parse: Callable[[str], Any]


def _whole(least: int, most: int = 2**31 - 1) -> Callable[[str], int]:
    def parse(text: str) -> int:
        # No int(): it also takes " 1_0".
        if not text.isdecimal() or not least <= int(text) <= most:
            raise ValueError(f"needed is a whole number in {least}..{most}")
        return int(text)

    return parse


def _px(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not LEAST_PRECISION <= value <= MOST_PRECISION:
        raise ValueError(f"needed is a number in {LEAST_PRECISION:g}..{MOST_PRECISION:g}")
    return value


def _share(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 <= value <= 1:
        raise ValueError("needed is a number in 0..1")
    return value


def _count(text: str) -> int | str:
    return text if text == "auto" else _whole(0, MOST_GAUSSIANS)(text)


def _one_of(*known: Any) -> Callable[[str], Any]:
    by_text = {str(value): value for value in known}

    def parse(text: str) -> Any:
        if text not in by_text:
            raise ValueError(f"needed is one of {', '.join(by_text)}")
        return by_text[text]

    return parse


def _words(keyword: str, known: Iterable[Any]) -> Axis:
    return Axis(keyword, tuple(known), _one_of(*known))


AXES: dict[str, Axis] = {
    axis.keyword: axis
    for axis in (
        Axis("gaussians", (500, 1000, 2000, 4000, 8000), _count),
        Axis("iterations", (50, 100, 200, 400), _whole(1)),
        _words("quality", tuple(QUALITIES)),
        _words("init", PLACEMENTS),
        _words("schedule", tuple(SCHEDULES)),
        _words("loss", LOSSES),
        _words("falloff", FALLOFFS),
        _words("dtype", DTYPES),
        Axis("form", ("gradient",), _one_of(*FORMS)),  # the default renderer draws no other
        _words("stops", STOP_COUNTS),
        Axis("precision", (0.01, 0.02, 0.05, 0.1), _px),
        Axis("palette", (64, 256, 1024, 0), _whole(0, 2**24)),
        _words("blend", BLENDS),
        Axis("portable", (False, True), _one_of(False, True)),  # of blend add
        Axis("per_round", (16, 64, 256), _whole(1)),
        Axis("round_iterations", (10, 20), _whole(1)),
        Axis("ssim_weight", (0.1, 0.2, 0.4), _share),  # of the losses with ssim
        Axis("relocate", (False, True), _one_of(False, True)),
        Axis("renderer", ("resvg", "cairo"), _one_of(*RENDERERS)),  # the others may be missing
        Axis("max_size", (256, 512, 1024), _whole(1)),
    )
}

# Without any axis: the presets, then counts by iterations at the default quality. About a
# minute a photo of half a megapixel on two cores.
DEFAULT_GRID: tuple[dict[str, tuple[Any, ...]], ...] = (
    {"quality": tuple(QUALITIES)},
    {"gaussians": (500, 2000, 8000), "iterations": (100, 300)},
)


def parse_axis(text: str) -> tuple[str, tuple[Any, ...]]:
    """Keyword and values of NAME or NAME=v1,v2; raises InputError for an unknown one."""
    name, given, values = text.partition("=")
    axis = _axis(name.strip())
    if not given:
        return axis.keyword, axis.values
    return axis.keyword, tuple(_checked(axis, value.strip()) for value in values.split(","))


def parse_axes(texts: Iterable[str]) -> dict[str, tuple[Any, ...]]:
    """The axes of a command line, by keyword; raises InputError for one given twice."""
    axes: dict[str, tuple[Any, ...]] = {}
    for text in texts:
        keyword, values = parse_axis(text)
        if keyword in axes:
            raise InputError(f"axis {keyword} is given twice; give all its values in one")
        axes[keyword] = values
    return axes


def settings_of(axes: Mapping[str, Sequence[Any]] | None) -> list[Settings]:
    """Every combination of the values of the axes, each once; DEFAULT_GRID if there are none.

    Raises InputError for an unknown axis, an impossible value or no value, and for a form with
    a renderer that does not draw it.
    """
    found: dict[Settings, None] = {}  # a set that keeps the order
    for grid in [axes] if axes else DEFAULT_GRID:
        columns = []
        for name, values in grid.items():
            axis = _axis(name)
            if isinstance(values, str) or not values:
                raise InputError(f"axis {name} got {values!r}; needed is a sequence of values")
            columns.append([(axis.keyword, _checked(axis, str(value))) for value in values])
        found |= {tuple(sorted(pairs)): None for pairs in itertools.product(*columns)}
    for settings in found:
        _check_drawn(dict(settings))
    return list(found)


def _check_drawn(settings: Mapping[str, Any]) -> None:
    """Raise InputError for what the renderer does not draw, or a sum cannot have.

    Every run would fail.
    """
    form = settings.get("form", GRADIENT)
    renderer = settings.get("renderer", DEFAULT_RENDERER)
    if form != GRADIENT and renderer not in DRAW_TURNED_BLURS:
        raise InputError(
            f"axes have form {form} drawn by {renderer}, which does not draw it; needed is one of "
            f"{', '.join(DRAW_TURNED_BLURS)}: add --axis renderer={DRAW_TURNED_BLURS[0]}, or leave "
            "the form out"
        )
    if settings.get("blend") != ADD or settings.get("portable"):
        return
    if renderer not in DRAW_BLENDS:
        raise InputError(
            f"axes have blend {ADD} drawn by {renderer}, which does not draw it; needed is one of "
            f"{', '.join(DRAW_BLENDS)}"
        )
    if form != GRADIENT or settings.get("falloff", GAUSSIAN) != GAUSSIAN:
        raise InputError(
            f"axes have blend {ADD} with another form than {GRADIENT} or another falloff than "
            f"{GAUSSIAN}, which sums do not have; leave one axis out"
        )


def _checked(axis: Axis, text: str) -> Any:
    try:
        return axis.parse(text)
    except ValueError as error:
        raise InputError(f"axis {axis.keyword} got {text!r}; {error}") from error


def _axis(name: str) -> Axis:
    keyword = name.replace("-", "_")
    if keyword not in AXES:
        raise InputError(f"axis is {name!r}; needed is one of {', '.join(AXES)}")
    return AXES[keyword]


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
