"""Plots of a summary; the only importer of matplotlib, which is an extra."""

from __future__ import annotations

import importlib.util
import io
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.bench.front import front
from gauss2svg.bench.peers import PEERS
from gauss2svg.bench.rows import TOOL
from gauss2svg.bench.summary import BYTES, SECONDS
from gauss2svg.files import write_atomically

INSTALL = "pip install 'gauss2svg[bench]'"
_OWN, _PRESET, _FRONT = "#9aa5b1", "#0b3d91", "#d1495b"
_PEER_COLORS = ("#2a9d8f", "#e07a1f", "#7b4fa3", "#8a5a2b", "#5b6b00")
_PEER_MARKERS = ("s", "^", "v", "p", "<")
_LEAST = {SECONDS: 1e-4, BYTES: 1.0}  # a cost of 0 has no place on a logarithmic axis
_AXES = {
    SECONDS: ("psnr_seconds", "CPU seconds, after a warm-up"),
    BYTES: ("psnr_bytes", "bytes, gzipped"),
}
_STYLE: dict[Any, Any] = {
    "font.size": 10,
    "font.family": "DejaVu Sans",  # ships with matplotlib: the same on every machine
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#52606d",
    "svg.hashsalt": "gauss2svg",
    "svg.fonttype": "path",
}
# Where a label may go: angle in degrees from its marker and distance in points, best first.
_PLACES = [(a, r) for r in (9, 15, 23, 33, 46) for a in (135, 45, 180, 0, 315, 225, 90, 270)]


def available() -> bool:
    """Whether matplotlib is installed."""
    return importlib.util.find_spec("matplotlib") is not None


def draw_plots(summary: Sequence[dict[str, Any]], directory: Path) -> list[Path]:
    """PSNR against CPU seconds and against bytes, each as PNG and SVG; paths of the four.

    The same summary gives the same bytes. Settings without a finite PSNR are left out.
    """
    shown = [row for row in summary if row["psnr_svg"] is not None]
    return [path for cost in _AXES for path in _draw(shown, cost, directory)]


def _draw(rows: Sequence[dict[str, Any]], cost: str, directory: Path) -> list[Path]:
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    name, label = _AXES[cost]
    written = []
    with mpl.rc_context(mpl.rcParamsDefault):
        mpl.rcParams.update(_STYLE)
        figure = Figure(figsize=(8, 5.5), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        axes.set_xscale("log")
        axes.set_xlabel(label)
        axes.set_ylabel("PSNR of the drawn file, dB")
        axes.grid(color="#e4e7eb", linewidth=0.7)
        axes.set_axisbelow(True)
        points = _points(axes, rows, cost)
        if points:
            _decorate(axes, cost, [x for x, *_ in points])
            # Outside, in one row: inside it would cover points of some run.
            figure.legend(
                loc="outside upper left", ncols=8, frameon=False, fontsize=9,
                columnspacing=1.4, handletextpad=0.5,
            )  # fmt: skip
            _place_labels(figure, axes, points)
        for suffix, canvas, metadata in (
            (".png", FigureCanvasAgg, {"Software": None}),
            (".svg", FigureCanvasSVG, {"Date": None, "Creator": None}),
        ):
            stream = io.BytesIO()
            canvas(figure)
            figure.savefig(stream, format=suffix[1:], metadata=metadata)
            path = directory / f"{name}{suffix}"
            write_atomically(path, stream.getvalue())
            written.append(path)
    return written


def _points(axes: Any, rows: Sequence[dict[str, Any]], cost: str) -> list[tuple[Any, ...]]:
    """Draw all markers; (x, y, text, colour, bold) of each, text "" for those without."""
    found: list[tuple[Any, ...]] = []

    def draw(group: Sequence[dict[str, Any]], **style: Any) -> tuple[list[float], list[float]]:
        x = [max(row[cost], _LEAST[cost]) for row in group]
        y = [row["psnr_svg"] for row in group]
        axes.plot(x, y, **style)
        return x, y

    own = [row for row in rows if row["tool"] == TOOL]
    on_front = [own[i] for i in front([r["psnr_svg"] for r in own], [r[cost] for r in own])]
    if len(on_front) > 1:
        draw(on_front, color=_FRONT, linewidth=1.6, zorder=2, label="Pareto front")
    others = [row for row in own if row["preset"] is None]
    if others:
        x, y = draw(others, **_marker("o", _OWN, 6), zorder=3, label="other settings")
        found += [(a, b, "", _OWN, False) for a, b in zip(x, y, strict=True)]
    presets = [row for row in own if row["preset"] is not None]
    if presets:
        x, y = draw(presets, **_marker("D", _PRESET, 9), zorder=4, label="presets")
        texts = [row["preset"] for row in presets]
        found += [(a, b, t, _PRESET, True) for a, b, t in zip(x, y, texts, strict=True)]
    for tool in dict.fromkeys(r["tool"] for r in rows if r["tool"] != TOOL):
        index = list(PEERS).index(tool)  # the same looks whichever others there are
        color = _PEER_COLORS[index % len(_PEER_COLORS)]
        style = _marker(_PEER_MARKERS[index % len(_PEER_MARKERS)], color, 8)
        group = [row for row in rows if row["tool"] == tool]
        x, y = draw(group, **style, zorder=3, label=tool)
        texts = [row["label"].removeprefix(f"{tool} ") for row in group]
        found += [(a, b, t, color, False) for a, b, t in zip(x, y, texts, strict=True)]
    return found


def _marker(shape: str, color: str, size: float) -> dict[str, Any]:
    return {
        "linestyle": "none", "marker": shape, "markersize": size,
        "markerfacecolor": color, "markeredgecolor": "white", "markeredgewidth": 0.8,
    }  # fmt: skip


def _decorate(axes: Any, cost: str, x: Sequence[float]) -> None:
    """Ticks at 1, 2 and 5 where there is room, in plain numbers, and room at the ends."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    low, high = min(x) / 2, max(x) * 2
    axes.set_xlim(low, high)
    axes.margins(y=0.12)
    decades = math.log10(high / low)
    steps = (1, 2, 5) if decades < 4 else (1,)
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ticks = [step * 10.0**e for e in exponents for step in steps if low <= step * 10.0**e <= high]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_minor_locator(NullLocator())
    tell = _seconds if cost == SECONDS else _bytes
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: tell(value)))


def _seconds(value: float) -> str:
    return f"{value:g}"


def _bytes(value: float) -> str:
    for unit, name in ((1e6, "MB"), (1e3, "kB")):
        if value >= unit:
            return f"{value / unit:g} {name}"
    return f"{value:g} B"


def _place_labels(figure: Any, axes: Any, points: Sequence[tuple[Any, ...]]) -> None:
    """Write each text at the first place where it covers nothing and is read as its marker's."""
    from matplotlib.transforms import Bbox

    figure.draw_without_rendering()
    renderer = figure.canvas.get_renderer()
    point = figure.dpi / 72
    taken = []
    for line in axes.get_lines():
        corners = axes.transData.transform(line.get_xydata())
        radius = 5 * point
        if line.get_marker() == "None":  # a front: boxes all along it
            corners = _along(corners)
            radius = point
        taken += [Bbox.from_extents(*(corner - radius), *(corner + radius)) for corner in corners]
    markers = [axes.transData.transform((x, y)) for x, y, *_ in points]
    frame = axes.get_window_extent(renderer)
    for x, y, text, color, bold in sorted(points, key=lambda p: (not p[4], p[0], p[1], p[2])):
        if not text:
            continue
        note = axes.annotate(
            text, (x, y), (0, 0), textcoords="offset points", color=color, fontsize=9,
            weight="bold" if bold else "normal", va="center", zorder=5,
            arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.6, "shrinkB": 4},
        )  # fmt: skip
        for angle, distance in _PLACES:
            across, up = math.cos(math.radians(angle)), math.sin(math.radians(angle))
            note.set_horizontalalignment(
                "center" if abs(across) < 0.1 else "left" if across > 0 else "right"
            )
            note.set_position((distance * across, distance * up))
            note.arrow_patch.set_visible(distance > 16)
            extent = _text_extent(note, renderer)
            inside = frame.x0 <= extent.x0 and extent.x1 <= frame.x1 and extent.y1 <= frame.y1
            free = not any(extent.overlaps(other) for other in taken)
            # Nearer to its own marker than to any other, or it would be read as the other's.
            own, *others = (_gap(extent, at) for at in [axes.transData.transform((x, y)), *markers])
            if inside and free and all(own <= gap + 1e-6 for gap in others):
                break
        taken.append(_text_extent(note, renderer))


def _along(corners: NDArray[np.floating]) -> NDArray[np.floating]:
    """Points of a line of such corners (n, 2), a few pixels apart."""
    share = np.linspace(0, 1, 200)[:, None]
    return np.concatenate([a + share * (b - a) for a, b in pairwise(corners)])


def _gap(box: Any, at: NDArray[np.floating]) -> float:
    """Distance of a point from a box, in pixels."""
    nearest = np.clip(at, (box.x0, box.y0), (box.x1, box.y1))
    return float(np.hypot(*(nearest - at)))


def _text_extent(note: Any, renderer: Any) -> Any:
    """Of the text alone, without the line to its marker."""
    from matplotlib.text import Text

    note.update_positions(renderer)
    return Text.get_window_extent(note, renderer)
