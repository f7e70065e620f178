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
from typing import Any

from gauss2svg.compare.peers import PEERS, check_peers
from gauss2svg.compare.records import TOOL
from gauss2svg.errors import Gauss2SvgError, InputError, quoted, refusal, whole_number
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

    @property
    def columns(self) -> dict[str, Any]:
        """The variant in a record."""
        about = {"label": self.label, "preset": self.preset, "tool": self.tool}
        return about | {"tool_version": self.version, "settings": dict(self.settings)}


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

    choices = ()

    def __init__(self, name: str) -> None:
        path, _, self.constant = name.rpartition(".")
        try:
            self.module, self.name = import_module(f"gauss2svg.{path}"), name
            self._kind = type(vars(self.module)[self.constant])
            if not self.constant.isupper() or self._kind not in (int, float):
                raise KeyError(self.constant)
        except (ImportError, KeyError) as error:
            needed = "an option, or a number that a module has in capitals"
            advice = "pipeline.search.correction.FULL"
            raise refusal("axis", needed, quoted(name), advice) from error

    def parsed(self, value: Any) -> int | float:
        """Return a value, or the value of a text, of the constant's type."""
        try:
            number = float(value)
            if not math.isfinite(number) or self._kind(number) != number:
                raise ValueError(value)
        except (TypeError, ValueError) as error:
            needed = "a whole number" if self._kind is int else "a finite number"
            raise InputError(f"{self.name} must be {needed}; got {value}") from error
        return self._kind(number)

    normalized = parsed


def options_in(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings that are options."""
    return {name: value for name, value in settings.items() if "." not in name}


def apply_constants(settings: Mapping[str, Any]) -> None:
    """Replace the constants among the settings in this process, which makes no other run."""
    for name in settings.keys() - options_in(settings):
        constant = Constant(name)
        setattr(constant.module, constant.constant, settings[name])


def parse_axes(texts: Iterable[str]) -> dict[str, tuple[Any, ...]]:
    """Return values by option, of the texts NAME or NAME=v1,v2 of a command line.

    Values that have commas themselves, as lists of inks, stand alone or between semicolons. Raise
    InputError for an unknown or repeated axis.
    """
    axes: dict[str, tuple[Any, ...]] = {}
    for text in texts:
        name, given, listed = text.partition("=")
        axis = _axis(name.strip())
        advice = f"Try --axis {axis.name}=VALUE,VALUE"
        if axis.name in axes:
            raise InputError(f"axis {axis.name} must be given once; got two. {advice}")
        values = _parsed(axis, listed) if given else VALUES.get(axis.name, axis.choices)
        if not values:
            raise InputError(f"axis {axis.name} must be given with values; got none. {advice}")
        axes[axis.name] = values
    return axes


def _parsed(axis: Field | Constant, text: str) -> tuple[Any, ...]:
    separator = ";" if ";" in text else ","
    try:
        return tuple(_checked(axis.parsed, value.strip()) for value in text.split(separator))
    except InputError as error:
        try:
            return (_checked(axis.parsed, text),)  # one list of inks
        except InputError:
            raise error from None


def settings_of(axes: Mapping[str, Sequence[Any]] | None) -> list[Settings]:
    """Return every combination of the axes' values, each once; of DEFAULT_GRID without axes.

    Raise InputError for an unknown axis, an invalid value, an axis without values, and options
    that exclude each other.
    """
    combinations: dict[Settings, None] = {}  # an ordered set
    for grid in [axes] if axes else DEFAULT_GRID:
        columns = []
        for name, values in grid.items():
            axis = _axis(name)
            if isinstance(values, str) or not values:
                raise InputError(f"axis {name} must be a sequence of values; got {quoted(values)}")
            columns.append([(axis.name, _checked(axis.normalized, v)) for v in values])
        combinations |= {tuple(sorted(pairs)): None for pairs in itertools.product(*columns)}
    for settings in combinations:
        try:
            Plan(Options.from_flat(options_in(dict(settings))))
        except Gauss2SvgError as error:  # as every run with them would
            advised = _ADVISED.sub(
                lambda found: "--axis " + "=".join(filter(None, found.groups())), str(error)
            )
            raise InputError(f"axes: {advised}") from error
    return list(combinations)


def _checked(check: Callable[[Any], Any], value: Any) -> Any:
    try:
        return check(value)
    except InputError as error:
        raise InputError(f"axis {error}") from error


def _axis(name: str) -> Field | Constant:
    if "." in name:
        return Constant(name)
    option = name.replace("-", "_")
    if option not in AXES:
        raise InputError(f"axis must be one of {', '.join(AXES)}; got {quoted(name)}")
    return AXES[option]
