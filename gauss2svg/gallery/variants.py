"""What is made of every photo: presets, counts and other tools, each with a name of its own."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from gauss2svg.bench.grid import Settings
from gauss2svg.bench.peers import PEERS, check_peers
from gauss2svg.bench.rows import TOOL
from gauss2svg.errors import InputError, whole_number
from gauss2svg.fit.options import MOST_GAUSSIANS
from gauss2svg.pipeline.presets import DEFAULT_PRESET, PRESETS
from gauss2svg.version import __version__

DEFAULT_VARIANTS = ("draft", "balanced", "high")
_USUAL_STYLE = "default"  # of a peer: what it does without options
_SVG = ".svg"
SVG_PEERS = tuple(name for name, peer in PEERS.items() if peer.suffix == _SVG)


@dataclass(frozen=True)
class Variant:
    """One way to make an SVG of a photo.

    name      "balanced", "2000 Gaussians", "vtracer detailed"; slug: the same as a folder's name
    tool      gauss2svg or a peer; version: of it
    settings  keywords and values, sorted, of `vectorize` or of the peer
    """

    name: str
    slug: str
    tool: str
    version: str
    settings: Settings

    @property
    def is_own(self) -> bool:
        """Whether its shapes are Gaussians of ours, with rounds, a scene and outlines."""
        return self.tool == TOOL


def variants_of(
    presets: Iterable[str] | None = None,
    counts: Iterable[int] | None = None,
    peers: Iterable[str] = (),
) -> tuple[list[Variant], list[str]]:
    """The variants, each once and in this order, and the peers that are not installed.

    presets  of gauss2svg.pipeline.presets; counts: of Gaussians, 0..MOST_GAUSSIANS; where neither is
             given, DEFAULT_VARIANTS
    peers    of SVG_PEERS, "vtracer" as it is without options or "vtracer:detailed" in a style
             that the benchmark knows
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
        why = f"; not installed: {', '.join(absent)}" if absent else ""
        raise InputError(f"got no variant{why}; needed is one preset, count or peer at least")
    return list({variant.slug: variant for variant in found}.values()), absent


def main_variant(variants: Iterable[Variant]) -> Variant:
    """The one that pages show first: the default preset, or the middle one of ours, or of all."""
    known = list(variants)
    own = [variant for variant in known if variant.is_own] or known
    by_name = {variant.name: variant for variant in own}
    return by_name.get(DEFAULT_PRESET, own[len(own) // 2])


def _items(name: str, values: Any) -> list[Any]:
    if isinstance(values, (str, bytes)):
        raise InputError(f"{name} is {values!r}; needed is a sequence, such as [{values!r}]")
    try:
        return [] if values is None else list(values)
    except TypeError as error:
        raise InputError(f"{name} is {values!r}; needed is a sequence") from error


def _preset(name: Any) -> Variant:
    if not isinstance(name, str) or name not in PRESETS:
        raise InputError(f"variant is {name!r}; needed is one of {', '.join(PRESETS)}")
    return Variant(name, name, TOOL, __version__, (("quality", name),))


def _counted(count: Any) -> Variant:
    count = whole_number("count", count, 0, MOST_GAUSSIANS)
    name = "1 Gaussian" if count == 1 else f"{count} Gaussians"
    return Variant(name, f"gaussians-{count}", TOOL, __version__, (("gaussians", count),))


def _peer(text: Any) -> Variant:
    tool, named, style = str(text).partition(":")
    if tool not in SVG_PEERS:
        raise InputError(f"peer is {text!r}; needed is one of {', '.join(SVG_PEERS)}")
    peer = PEERS[tool]
    styles = {str(value): one for one in peer.settings for value in one.values()}
    if not named:
        style = _USUAL_STYLE if _USUAL_STYLE in styles else next(iter(styles))
    if style not in styles:
        raise InputError(f"peer is {text!r}; needed is {tool}, or one of {_told(tool, styles)}")
    name = tool if style == _USUAL_STYLE else f"{tool} {style}"
    settings = tuple(sorted(styles[style].items()))
    return Variant(name, name.replace(" ", "-"), tool, peer.version() or "", settings)


def _told(tool: str, styles: Iterable[str]) -> str:
    return ", ".join(f"{tool}:{style}" for style in styles)
