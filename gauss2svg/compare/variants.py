"""The variants of a comparison: presets, numbers of Gaussians, other settings and other tools."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from gauss2svg.compare.peers import PEERS, check_peers
from gauss2svg.compare.records import TOOL
from gauss2svg.errors import InputError, quoted, whole_number
from gauss2svg.fit.options import MOST_GAUSSIANS
from gauss2svg.pipeline.presets import DEFAULT_PRESET, PRESETS
from gauss2svg.version import __version__

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
