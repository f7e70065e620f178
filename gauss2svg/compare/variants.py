"""The variants of a comparison: presets, numbers of Gaussians, other tools, and axes.

An axis is an option of `vectorize`, or a constant of a module, as MODULE.NAME:
`--axis pipeline.search.correction.FULL=0.97,0.985` varies FULL of
gauss2svg.pipeline.search.correction. Axes span the settings of a grid.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from typing import Any, NamedTuple

from gauss2svg.compare.peers import PEERS
from gauss2svg.compare.records import TOOL
from gauss2svg.errors import Gauss2SvgError, InputError, quoted, refusal
from gauss2svg.fit.options import MOST_GAUSSIANS
from gauss2svg.options import Field, fields_of
from gauss2svg.pipeline.options import GROUPS, Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.presets import DEFAULT_PRESET, PRESETS
from gauss2svg.version import __version__

Settings = tuple[tuple[str, Any], ...]  # names and values, sorted by name


class Variant(NamedTuple):
    """One way to make a file of a photo.

    settings  options and values of `vectorize` or of another tool, sorted by name
    tool      gauss2svg or a peer
    version   of the tool
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
        only = dict(self.settings) if self.is_own and len(self.settings) == 1 else {}
        return only.get("quality")

    @property
    def label(self) -> str:
        """All settings in short, as tables have them: "draft", "gaussians 500", "jpeg 30"."""
        if not self.is_own:
            return " ".join([self.tool, *(str(value) for _, value in self.settings)])
        return self.preset or ", ".join(f"{name} {value}" for name, value in self.settings)

    @property
    def name(self) -> str:
        """The variant in words, as pages have it: "draft", "500 Gaussians", "vtracer"."""
        count = dict(self.settings).get("gaussians") if len(self.settings) == 1 else None
        name = f"{count} Gaussian{'s' * (count != 1)}"
        return self.label.removesuffix(" default") if count is None else name

    @property
    def slug(self) -> str:
        """The name of its folder: "draft", "gaussians-500", "vtracer"."""
        return (self.label if self.is_own else self.name).replace(" ", "-")

    @property
    def columns(self) -> dict[str, Any]:
        """The variant in a record."""
        about = {"label": self.label, "preset": self.preset, "tool": self.tool}
        return about | {"tool_version": self.version, "settings": dict(self.settings)}


def of_peers(
    texts: Iterable[str], most: int | None = None, suffixes: str = ""
) -> tuple[list[Variant], list[str]]:
    """Return variants of other tools, each once, and the names of tools that are not installed.

    texts     "vtracer" for its settings, or "vtracer:detailed" for one of them
    most      how many settings "vtracer" stands for, None: all
    suffixes  end of the name of the files that a tool must write to be named, "" for any
    Raise InputError for another text.
    """
    known: dict[str, list[Variant]] = {}
    for tool, peer in PEERS.items():
        for settings in peer.settings if peer.suffix.endswith(suffixes) else ():
            one = Variant(tuple(sorted(settings.items())), tool)
            known.setdefault(tool, []).append(one)
            known[one.label.replace(" ", ":")] = [one]
    names = [Field("peer", words=tuple(known)).checked(text) for text in _sequence("peers", texts)]
    wanted = dict.fromkeys(one for name in names for one in known[name][:most])
    versions = {tool: PEERS[tool].version() for tool in dict.fromkeys(one.tool for one in wanted)}
    made = [one._replace(version=version) for one in wanted if (version := versions[one.tool])]
    return made, [tool for tool, version in versions.items() if not version]


def variants_of(
    presets: Iterable[str] | None = None,
    counts: Iterable[int] | None = None,
    peers: Iterable[str] = (),
) -> tuple[list[Variant], list[str]]:
    """Return the variants, each once and in this order, and the peers that are not installed.

    presets  names of PRESETS
    counts   numbers of Gaussians, 0..MOST_GAUSSIANS; if neither is given: draft, balanced and high
    peers    tools that write SVGs: "vtracer" for its first style in gauss2svg.compare.peers,
             "vtracer:detailed" for another
    Raise InputError for anything else.
    """
    if presets is None and counts is None:
        presets = ("draft", "balanced", "high")
    preset = Field("variant", words=tuple(PRESETS))
    count = Field("count", int, 0, MOST_GAUSSIANS)
    own = [("quality", preset.checked(one)) for one in _sequence("variants", presets)]
    own += [("gaussians", count.checked(one)) for one in _sequence("counts", counts)]
    others, absent = of_peers(peers, 1, ".svg")
    variants = [*(Variant((setting,)) for setting in dict.fromkeys(own)), *others]
    if not variants:
        got = f"only peers that are not installed: {', '.join(absent)}" if absent else "none"
        raise InputError(f"variants must be at least one preset, count or peer; got {got}")
    return variants, absent


def main_variant(variants: Sequence[Variant]) -> Variant:
    """Return what pages show first: the default preset, or the middle variant of our own."""
    own = [variant for variant in variants if variant.is_own] or variants
    return next((v for v in own if v.preset == DEFAULT_PRESET), own[len(own) // 2])


def _sequence(name: str, values: Any) -> list[Any]:
    """Return the values of an argument, none of None. Raise InputError for what is no sequence."""
    if isinstance(values, (str, bytes)) or not isinstance(values, Iterable | None):
        raise refusal(name, "a sequence", quoted(values), f"[{quoted(values)}]")
    return [] if values is None else list(values)


# All options of four groups but the seed, which is one of the command itself, and two of others.
AXES: dict[str, Field] = {
    field.name: replace(field, name=f"axis {field.name}")  # as errors have it
    for key, group in GROUPS.items()
    for field in fields_of(group)
    if (key in ("goal", "fit", "densify", "svg") and field.name != "seed")
    or field.name in ("renderer", "max_size")
}

# Values of an axis without any: those that need no other program or renderer.
_USUAL = {"form": ("gradient",), "renderer": ("resvg", "cairo")}

# Without any axis: the presets, then counts and iterations with the default preset. It takes
# about a minute for a photo of half a megapixel on two cores.
DEFAULT_GRID: tuple[dict[str, tuple[Any, ...]], ...] = (
    {"quality": tuple(PRESETS)},
    {"gaussians": (500, 2000, 8000), "iterations": (100, 300)},
)


# What a constant of a module may be replaced by, by its type.
_CONSTANTS = {int: (0, 2**63 - 1), float: (-1e300, 1e300)}


def options_in(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings that are options."""
    return {name: value for name, value in settings.items() if "." not in name}


def apply_constants(settings: Mapping[str, Any]) -> None:
    """Replace the constants among the settings in this process, which makes no other run.

    The modules read them whenever they need them. What is compiled into kernels, a default value of
    a parameter, or imported by name keeps its value.
    """
    for name in settings.keys() - options_in(settings):
        module, _, constant = name.rpartition(".")
        setattr(import_module(f"gauss2svg.{module}"), constant, settings[name])


def parse_axes(texts: Iterable[str]) -> dict[str, tuple[Any, ...]]:
    """Return values by option, of the texts NAME or NAME=v1,v2 of a command line.

    Values that have commas themselves, as lists of inks, stand alone or between semicolons. Raise
    InputError for an unknown axis. One that is repeated has the values of all.
    """
    axes: dict[str, tuple[Any, ...]] = {}
    for text in texts:
        name, given, listed = text.partition("=")
        axis = _axis(name := name.strip().replace("-", "_"))
        values = _parsed(axis, listed) if given else _USUAL.get(name, axis.choices)
        axes[name] = axes.get(name, ()) + values
    return axes


def _parsed(axis: Field, text: str) -> tuple[Any, ...]:
    try:
        return (axis.parsed(text.strip()),)
    except InputError:  # it is not one list of inks
        values = text.split(";" if ";" in text else ",")
        return tuple(axis.parsed(value.strip()) for value in values)


def settings_of(axes: Mapping[str, Sequence[Any]] | None) -> list[Settings]:
    """Return every combination of the axes' values, each once; of DEFAULT_GRID without axes.

    Raise InputError for an unknown axis, an invalid value, an axis without values, and options
    that exclude each other.
    """
    combinations: dict[Settings, None] = {}  # an ordered set
    for grid in [axes] if axes else DEFAULT_GRID:
        columns = []
        for name, values in grid.items():
            axis = _axis(name := name.replace("-", "_"))
            columns.append([(name, axis.checked(one)) for one in _sequence(axis.name, values)])
            if not columns[-1]:
                raise refusal(axis.name, "given with values", "none", f"--axis {name}=VALUE,VALUE")
        combinations |= {tuple(sorted(pairs)): None for pairs in itertools.product(*columns)}
    for settings in combinations:
        try:
            Plan(Options.from_flat(options_in(dict(settings))))
        except Gauss2SvgError as error:  # as every run with them would
            # An axis has its value after an equals sign.
            line = re.sub(r"(--[\w-]+) (?!and\b|or\b|without\b)(?=\w)", r"\1=", str(error))
            raise InputError(f"axes: {line.replace('--', '--axis ')}") from error
    return list(combinations)


def _axis(name: str) -> Field:
    """Return an option, or a constant as one. Raise InputError for another name."""
    if "." not in name:
        if name not in AXES:
            raise InputError(f"axis must be one of {', '.join(AXES)}; got {quoted(name)}")
        return AXES[name]
    module, _, constant = name.rpartition(".")
    try:
        kind = type(vars(import_module(f"gauss2svg.{module}"))[constant])
    except (ImportError, KeyError):
        kind = None
    if kind not in _CONSTANTS or not constant.isupper():
        needed = "an option, or a number that a module has in capitals"
        raise refusal("axis", needed, quoted(name), "pipeline.search.correction.FULL")
    return Field(f"axis {name}", kind, *_CONSTANTS[kind])
