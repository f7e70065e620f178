"""The variants of a comparison: presets, numbers of Gaussians, other tools, and axes.

An axis is an option of `vectorize`, or a constant of a module as MODULE.NAME. For example,
`--axis pipeline.limits.FULL=0.97,0.985` varies FULL of gauss2svg.pipeline.limits. The benchmark
runs every combination of the axes' values.
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
from gauss2svg.fit import MOST_GAUSSIANS
from gauss2svg.options import Field, fields_of
from gauss2svg.pipeline.options import GROUPS, Options
from gauss2svg.pipeline.plan import DEFAULT_PRESET, PRESETS, Plan
from gauss2svg.version import __version__

Settings = tuple[tuple[str, Any], ...]  # names and values, sorted by name


class Variant(NamedTuple):
    """A way to make a file of a photo.

    settings  (name, value) of options of gauss2svg or of another tool, sorted by name
    tool      "gauss2svg" or the name of a peer
    version   version of the tool
    """

    settings: Settings
    tool: str = TOOL
    version: str = __version__

    @property
    def is_own(self) -> bool:
        """Whether gauss2svg makes the file. Other files have no rounds, scene and outlines."""
        return self.tool == TOOL

    @property
    def preset(self) -> str | None:
        """Preset, if the variant sets only this, or None."""
        only = dict(self.settings) if self.is_own and len(self.settings) == 1 else {}
        return only.get("quality")

    @property
    def label(self) -> str:
        """Settings in short, for tables: "draft", "gaussians 500", "jpeg 30"."""
        if not self.is_own:
            return " ".join([self.tool, *(str(value) for _, value in self.settings)])
        return self.preset or ", ".join(f"{name} {value}" for name, value in self.settings)

    @property
    def name(self) -> str:
        """Variant in words, for pages: "draft", "500 Gaussians", "vtracer"."""
        count = dict(self.settings).get("gaussians") if len(self.settings) == 1 else None
        name = f"{count} Gaussian{'s' * (count != 1)}"
        return self.label.removesuffix(" default") if count is None else name

    @property
    def slug(self) -> str:
        """Name of the variant's folder: "draft", "gaussians-500", "vtracer"."""
        return (self.label if self.is_own else self.name).replace(" ", "-")

    @property
    def columns(self) -> dict[str, Any]:
        """Columns of a record that describe the variant."""
        names = {"label": self.label, "preset": self.preset, "tool": self.tool}
        return names | {"tool_version": self.version, "settings": dict(self.settings)}


def peer_variants(
    texts: Iterable[str], most: int | None = None, suffix: str = ""
) -> tuple[list[Variant], list[str]]:
    """Return variants of other tools, each once, and the names of tools that are not installed.

    texts   "vtracer" for all settings of the tool, or "vtracer:detailed" for one of them
    most    number of settings, from the first, that "vtracer" stands for; None for all
    suffix  suffix, such as ".svg", of the files that accepted tools write; "" accepts all tools
    Raise InputError for any other text.
    """
    by_text: dict[str, list[Variant]] = {}
    for tool, peer in PEERS.items():
        for settings in peer.settings if peer.suffix.endswith(suffix) else ():
            variant = Variant(tuple(sorted(settings.items())), tool)
            by_text.setdefault(tool, []).append(variant)
            by_text[variant.label.replace(" ", ":")] = [variant]
    peer_field = Field("peer", words=tuple(by_text))
    names = [peer_field.checked(text) for text in _sequence("peers", texts)]
    chosen = dict.fromkeys(variant for name in names for variant in by_text[name][:most])
    versions = {tool: PEERS[tool].version() for tool in dict.fromkeys(v.tool for v in chosen)}
    installed = [v._replace(version=version) for v in chosen if (version := versions[v.tool])]
    return installed, [tool for tool, version in versions.items() if not version]


def variants_of(
    presets: Iterable[str] | None = None,
    counts: Iterable[int] | None = None,
    peers: Iterable[str] = (),
) -> tuple[list[Variant], list[str]]:
    """Return the variants of a gallery, each once, and the peers that are not installed.

    presets  names of PRESETS
    counts   numbers of Gaussians, 0..MOST_GAUSSIANS. Without presets and counts: draft, balanced
             and high.
    peers    tools that write SVGs: "vtracer" for its first settings in gauss2svg.compare.peers, or
             "vtracer:detailed" for others
    Raise InputError for any other value, and if there is no variant.
    """
    if presets is None and counts is None:
        presets = ("draft", "balanced", "high")
    preset = Field("variant", words=tuple(PRESETS))
    count = Field("count", int, 0, MOST_GAUSSIANS)
    own = [("quality", preset.checked(name)) for name in _sequence("variants", presets)]
    own += [("gaussians", count.checked(number)) for number in _sequence("counts", counts)]
    others, absent = peer_variants(peers, 1, ".svg")
    variants = [*(Variant((setting,)) for setting in dict.fromkeys(own)), *others]
    if not variants:
        got = f"only peers that are not installed: {', '.join(absent)}" if absent else "none"
        raise InputError(f"variants must be at least one preset, count or peer; got {got}")
    return variants, absent


def main_variant(variants: Sequence[Variant]) -> Variant:
    """Return the variant that pages show first: the default preset, or else a middle variant."""
    own = [variant for variant in variants if variant.is_own] or variants
    return next((v for v in own if v.preset == DEFAULT_PRESET), own[len(own) // 2])


def _sequence(name: str, values: Any) -> list[Any]:
    """Return the values of an argument; [] for None. Raise InputError if it is no sequence."""
    if isinstance(values, (str, bytes)) or not isinstance(values, Iterable | None):
        raise refusal(name, "a sequence", quoted(values), f"[{quoted(values)}]")
    return [] if values is None else list(values)


# Options that can be an axis: the options of four groups, and two more. The seed cannot, because it
# is an option of the command itself.
AXES: dict[str, Field] = {
    field.name: replace(field, name=f"axis {field.name}")  # name in errors
    for key, group in GROUPS.items()
    for field in fields_of(group)
    if (key in ("goal", "fit", "densify", "svg") and field.name != "seed")
    or field.name in ("renderer", "max_size")
}

# Values for --axis NAME without values, for options of which some values need other programs.
_USUAL = {"form": ("gradient",), "renderer": ("resvg", "cairo")}

# Settings of the benchmark if no axis is given: the presets, then counts and iterations with the
# default preset. They take about a minute for a photo of half a megapixel on two cores.
DEFAULT_GRID: tuple[dict[str, tuple[Any, ...]], ...] = (
    {"quality": tuple(PRESETS)},
    {"gaussians": (500, 2000, 8000), "iterations": (100, 300)},
)


# Type of a module's constant -> range of the values that an axis may set.
_CONSTANTS = {int: (0, 2**63 - 1), float: (-1e300, 1e300)}


def options_in(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings that are options, and not constants of modules."""
    return {name: value for name, value in settings.items() if "." not in name}


def apply_constants(settings: Mapping[str, Any]) -> None:
    """Set the constants of modules that are among the settings.

    The values stay, so this process must make no other run. A value has no effect if its constant
    is compiled into kernels, is the default value of a parameter, or is imported by name.
    """
    for name in settings.keys() - options_in(settings):
        module, _, constant = name.rpartition(".")
        setattr(import_module(f"gauss2svg.{module}"), constant, settings[name])


def parse_axes(texts: Iterable[str]) -> dict[str, tuple[Any, ...]]:
    """Return the values of each axis, from texts such as NAME or NAME=v1,v2 of a command line.

    A value that contains commas, such as a list of inks, must be the only one, or be separated from
    others by semicolons. Texts of one axis add their values. Raise InputError for an unknown axis.
    """
    axes: dict[str, tuple[Any, ...]] = {}
    for text in texts:
        name, equals_sign, listed = text.partition("=")
        axis = _axis(name := name.strip().replace("-", "_"))
        values = _parsed(axis, listed) if equals_sign else _USUAL.get(name, axis.choices)
        axes[name] = axes.get(name, ()) + values
    return axes


def _parsed(axis: Field, text: str) -> tuple[Any, ...]:
    try:
        return (axis.parsed(text.strip()),)
    except InputError:  # the text is not a single value
        values = text.split(";" if ";" in text else ",")
        return tuple(axis.parsed(value.strip()) for value in values)


def settings_of(axes: Mapping[str, Sequence[Any]] | None) -> list[Settings]:
    """Return every combination of the values of axes, each once. The default is DEFAULT_GRID.

    Raise InputError for an unknown axis, an axis without values, an invalid value, and options that
    exclude each other.
    """
    combinations: dict[Settings, None] = {}  # an ordered set
    for grid in [axes] if axes else DEFAULT_GRID:
        columns = []
        for name, values in grid.items():
            axis = _axis(name := name.replace("-", "_"))
            columns.append([(name, axis.checked(value)) for value in _sequence(axis.name, values)])
            if not columns[-1]:
                raise refusal(axis.name, "given with values", "none", f"--axis {name}=VALUE,VALUE")
        combinations |= {tuple(sorted(pairs)): None for pairs in itertools.product(*columns)}
    for settings in combinations:
        try:
            Plan(Options.from_flat(options_in(dict(settings))))
        except Gauss2SvgError as error:
            # The error has options in the form --NAME VALUE. Axes have the form --axis NAME=VALUE.
            line = re.sub(r"(--[\w-]+) (?!and\b|or\b|without\b)(?=\w)", r"\1=", str(error))
            raise InputError(f"axes: {line.replace('--', '--axis ')}") from error
    return list(combinations)


def _axis(name: str) -> Field:
    """Return the Field of an option or of a constant. Raise InputError for any other name."""
    if name in AXES:
        return AXES[name]
    module, _, constant = name.rpartition(".")
    try:
        kind = type(vars(import_module(f"gauss2svg.{module}"))[constant])
    except (ImportError, KeyError):
        kind = None
    if kind not in _CONSTANTS or not constant.isupper():
        needed, advice = f"an option: one of {', '.join(AXES)}", "quality"
        if module:
            needed, advice = "a number that a module has in capitals", "pipeline.limits.FULL"
        raise refusal("axis", needed, quoted(name), advice)
    return Field(f"axis {name}", kind, *_CONSTANTS[kind])
