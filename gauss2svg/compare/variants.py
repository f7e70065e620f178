"""The variants of a comparison: presets, numbers of Gaussians, other tools, and axes.

An axis is an option of `vectorize`, or a constant of a module, as MODULE.NAME:
`--axis pipeline.search.correction.FULL=0.97,0.985` varies FULL of
gauss2svg.pipeline.search.correction. Axes span the settings of a grid.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Any

from gauss2svg.compare.peers import PEERS, check_peers
from gauss2svg.compare.records import TOOL
from gauss2svg.errors import Gauss2SvgError, InputError, quoted, whole_number
from gauss2svg.fit.options import MOST_GAUSSIANS
from gauss2svg.measure.scores import TARGETS
from gauss2svg.options import Field, fields_of
from gauss2svg.pipeline.options import GROUPS, Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.presets import DEFAULT_PRESET, PRESETS
from gauss2svg.version import __version__

# An option in the advice of an error, and its value, which an axis has after an equals sign.
_ADVISED = re.compile(r"--([\w-]+)(?: (?!and\b|or\b|without\b)(\w[\w+]*))?")

Settings = tuple[tuple[str, Any], ...]  # names and values, sorted by name

DEFAULT_VARIANTS = ("draft", "balanced", "high")
_DEFAULT_STYLE = "default"  # a peer without options
SVG_PEERS = tuple(name for name, peer in PEERS.items() if peer.suffix == ".svg")


@dataclass(frozen=True)
class Variant:
    """One way to make a file of a photo.

    settings  options and values of `vectorize` or of another tool, sorted by name
    tool      gauss2svg or a peer; version: of the tool
    """

    settings: Settings
    tool: str = TOOL
    version: str = __version__

    @property
    def is_own(self) -> bool:
        """Whether gauss2svg makes it: it then has rounds, a scene and outlines."""
        return self.tool == TOOL

    @property
    def preset(self) -> str | None:
        """The preset of a variant that sets nothing else, or None."""
        settings = dict(self.settings)
        return settings["quality"] if self.is_own and settings.keys() == {"quality"} else None

    @property
    def label(self) -> str:
        """All settings in short, as tables have them: "draft", "gaussians 500", "jpeg 30"."""
        if not self.is_own:
            return " ".join([self.tool, *(str(value) for _, value in self.settings)])
        return self.preset or ", ".join(f"{name} {value}" for name, value in self.settings)

    @property
    def name(self) -> str:
        """The variant in words, as pages have it: "draft", "500 Gaussians", "vtracer"."""
        if self.is_own and len(self.settings) == 1 and self.settings[0][0] == "gaussians":
            count = self.settings[0][1]
            return "1 Gaussian" if count == 1 else f"{count} Gaussians"
        return self.label if self.is_own else self.label.removesuffix(f" {_DEFAULT_STYLE}")

    @property
    def slug(self) -> str:
        """The name of its folder: "draft", "gaussians-500", "vtracer"."""
        return (self.label if self.is_own else self.name).replace(" ", "-")


def of_peer(tool: str, settings: dict[str, Any]) -> Variant:
    """A variant of another tool that is installed."""
    return Variant(tuple(sorted(settings.items())), tool, PEERS[tool].version() or "")


def variants_of(
    presets: Iterable[str] | None = None,
    counts: Iterable[int] | None = None,
    peers: Iterable[str] = (),
) -> tuple[list[Variant], list[str]]:
    """The variants, each once and in this order, and the peers that are not installed.

    presets  names of PRESETS
    counts   numbers of Gaussians, 0..MOST_GAUSSIANS; if neither is given: DEFAULT_VARIANTS
    peers    of SVG_PEERS: "vtracer" for its defaults, "vtracer:detailed" for another style of
             gauss2svg.compare.peers
    Raises InputError for anything else.
    """
    if presets is None and counts is None:
        presets = DEFAULT_VARIANTS
    found = [_preset(name) for name in _items("variants", presets)]
    found += [_counted(count) for count in _items("counts", counts)]
    wanted = [_peer(text) for text in _items("peers", peers)]
    absent = check_peers(variant.tool for variant in wanted)[1]
    found += [variant for variant in wanted if variant.tool not in absent]
    if not found:
        got = f"only peers that are not installed: {', '.join(absent)}" if absent else "none"
        raise InputError(f"variants must be at least one preset, count or peer; got {got}")
    return list(dict.fromkeys(found)), absent


def main_variant(variants: Iterable[Variant]) -> Variant:
    """The variant that pages show first: the default preset, or the middle one of our own."""
    known = list(variants)
    own = [variant for variant in known if variant.is_own] or known
    by_name = {variant.name: variant for variant in own}
    return by_name.get(DEFAULT_PRESET, own[len(own) // 2])


def _items(name: str, values: Any) -> list[Any]:
    if isinstance(values, (str, bytes)):
        raise InputError(f"{name} must be a sequence; got {quoted(values)}. Try [{values!r}]")
    try:
        return [] if values is None else list(values)
    except TypeError as error:
        raise InputError(f"{name} must be a sequence; got {quoted(values)}") from error


def _preset(name: Any) -> Variant:
    if not isinstance(name, str) or name not in PRESETS:
        raise InputError(f"variant must be one of {', '.join(PRESETS)}; got {quoted(name)}")
    return Variant((("quality", name),))


def _counted(count: Any) -> Variant:
    return Variant((("gaussians", whole_number("count", count, 0, MOST_GAUSSIANS)),))


def _peer(text: Any) -> Variant:
    tool, named, style = str(text).partition(":")
    if tool not in SVG_PEERS:
        raise InputError(f"peer must be one of {', '.join(SVG_PEERS)}; got {quoted(text)}")
    styles = {str(value): one for one in PEERS[tool].settings for value in one.values()}
    if not named:
        style = _DEFAULT_STYLE if _DEFAULT_STYLE in styles else next(iter(styles))
    if style not in styles:
        known = ", ".join(f"{tool}:{style}" for style in styles)
        raise InputError(f"peer must be {tool}, or one of {known}; got {quoted(text)}")
    return of_peer(tool, styles[style])


# All options of four groups but the seed, which is one of the command itself, and two of others.
AXES: dict[str, Field] = {
    field.name: field
    for key, group in GROUPS.items()
    for field in fields_of(group)
    if (key in ("goal", "fit", "densify", "svg") and field.name != "seed")
    or field.name in ("renderer", "max_size")
}
# Default values of axes other than those with a few choices.
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
    **{score.option: score.targets for score in TARGETS},
    "form": ("gradient",),  # the only one that the default renderer supports
    "renderer": ("resvg", "cairo"),  # the others may not be installed
}

# Without any axis: the presets, then counts and iterations with the default preset. It takes
# about a minute for a photo of half a megapixel on two cores.
DEFAULT_GRID: tuple[dict[str, tuple[Any, ...]], ...] = (
    {"quality": tuple(PRESETS)},
    {"gaussians": (500, 2000, 8000), "iterations": (100, 300)},
)


class Constant:
    """A number that a module has in capitals, as an axis. Raise InputError for another name.

    The modules read it whenever they need it, so it may be replaced. What is compiled into kernels,
    a default value of a parameter, or imported by name keeps its value.
    """

    def __init__(self, name: str) -> None:
        path, _, self.constant = name.rpartition(".")
        try:
            self.module: ModuleType = import_module(f"gauss2svg.{path}")
            self._now = vars(self.module)[self.constant]
            if not self.constant.isupper() or type(self._now) not in (int, float):
                raise KeyError(self.constant)
        except (ImportError, KeyError) as error:
            raise InputError(
                "axis must be an option, or a number that a module has in capitals; got "
                f"{quoted(name)}. Try pipeline.search.correction.FULL"
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
        setattr(self.module, self.constant, value)

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


def values_of(axis: Field | Constant) -> tuple[Any, ...]:
    """The default values of an axis; raises InputError for an axis without."""
    values = VALUES.get(axis.name, axis.choices)
    if not values:
        raise InputError(
            f"axis {axis.name} must be given with values; got none. Try --axis "
            f"{axis.name}=VALUE,VALUE"
        )
    return values


def parse_axis(text: str) -> tuple[str, tuple[Any, ...]]:
    """(option, values) of the text NAME or NAME=v1,v2; raises InputError for an unknown one.

    Values that have commas themselves, as lists of inks, stand alone or between semicolons.
    """
    name, given, text = text.partition("=")
    axis = _axis(name.strip())
    if not given:
        return axis.name, values_of(axis)

    def parsed(texts: list[str]) -> tuple[Any, ...]:
        return tuple(_checked(axis.parsed, value.strip()) for value in texts)

    if ";" in text:
        return axis.name, parsed(text.split(";"))
    try:
        return axis.name, parsed(text.split(","))
    except InputError as error:
        try:
            return axis.name, parsed([text])
        except InputError:
            raise error from None


def parse_axes(texts: Iterable[str]) -> dict[str, tuple[Any, ...]]:
    """Values by option, of the axes of a command line; raises InputError for a repeated one."""
    axes: dict[str, tuple[Any, ...]] = {}
    for text in texts:
        name, values = parse_axis(text)
        if name in axes:
            raise InputError(
                f"axis {name} must be given once; got two. Try --axis {name}=VALUE,VALUE"
            )
        axes[name] = values
    return axes


def settings_of(axes: Mapping[str, Sequence[Any]] | None) -> list[Settings]:
    """Every combination of the axes' values, each once; those of DEFAULT_GRID without axes.

    Raises InputError for an unknown axis, an invalid value, an axis without values, and options
    that exclude each other.
    """
    found: dict[Settings, None] = {}  # an ordered set
    for grid in [axes] if axes else DEFAULT_GRID:
        columns = []
        for name, values in grid.items():
            axis = _axis(name)
            if isinstance(values, str) or not values:
                raise InputError(f"axis {name} must be a sequence of values; got {quoted(values)}")
            columns.append([(axis.name, _checked(axis.normalized, v)) for v in values])
        found |= {tuple(sorted(pairs)): None for pairs in itertools.product(*columns)}
    for settings in found:
        try:
            Plan(Options.from_flat(options_in(dict(settings))))
        except Gauss2SvgError as error:  # as every run with them would
            raise InputError(f"axes: {_ADVISED.sub(_as_axis, str(error))}") from error
    return list(found)


def _as_axis(advised: re.Match[str]) -> str:
    name, value = advised.groups()
    return f"--axis {name}={value}" if value else f"--axis {name}"


def _checked(check: Callable[[Any], Any], value: Any) -> Any:
    try:
        return check(value)
    except InputError as error:
        raise InputError(f"axis {error}") from error


def _axis(name: str) -> Field | Constant:
    if is_constant(name):
        return Constant(name)
    option = name.replace("-", "_")
    if option not in AXES:
        raise InputError(f"axis must be one of {', '.join(AXES)}; got {quoted(name)}")
    return AXES[option]
