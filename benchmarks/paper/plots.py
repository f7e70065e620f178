"""The plots, each as SVG twice: for light pages and for dark ones."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter, NullLocator

from .book import Picture
from .engine import SCHEDULES
from .schedules import Score
from .shapes import ELLIPSES, GAUSSIANS, ShapeFit
from .table import BEST, Kind, Row

_WIDE, _HIGH, _HIGHER = 5.6, 3.7, 4.7  # inches: on a narrow screen a letter stays some 8 px high
_INK = {"light": "#1f2933", "dark": "#e4e7eb"}
_GRID = {"light": "#d3d9e0", "dark": "#3b4754"}
# Contrast of at least 3:1 both on white and on near black.
_COLORS = ("#2f7ed8", "#c26f17", "#2a9d6f", "#c2557a", "#8a63d2")
_MARKERS = ("o", "s", "^", "D", "v")
_STYLE: dict[Any, Any] = {
    "font.size": 10,
    "font.family": "DejaVu Sans",  # ships with matplotlib: the same on every machine
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "gauss2svg",
    "svg.fonttype": "path",
}


def _draw(
    folder: Path,
    name: str,
    alt: str,
    caption: str,
    plot: Callable[[Any], None],
    high: float = _HIGH,
) -> Picture:
    for shade, ink in _INK.items():
        with mpl.rc_context(mpl.rcParamsDefault):
            mpl.rcParams.update(_STYLE)
            for part in ("text.color", "axes.labelcolor", "xtick.color", "ytick.color"):
                mpl.rcParams[part] = ink
            mpl.rcParams["axes.edgecolor"] = ink
            figure = Figure(figsize=(_WIDE, high), layout="constrained")
            FigureCanvasSVG(figure)
            axes = figure.add_subplot()
            axes.grid(color=_GRID[shade], linewidth=0.7)
            axes.set_axisbelow(True)
            plot(axes)
            if axes.get_legend_handles_labels()[0]:
                figure.legend(
                    loc="outside upper left", ncols=2, frameon=False, fontsize=9,
                    columnspacing=1.2, handletextpad=0.5,
                )  # fmt: skip
            stream = io.BytesIO()
            figure.savefig(
                stream, format="svg", transparent=True, metadata={"Date": None, "Creator": None}
            )
        (folder / f"{name}-{shade}.svg").write_bytes(stream.getvalue())
    width, height = round(_WIDE * 72), round(high * 72)
    return Picture(f"{name}-light.svg", width, height, alt, caption, f"{name}-dark.svg")


def _log(axes: Any, ticks: Sequence[float] | None = None) -> None:
    """A logarithmic x axis with plain numbers at its ticks."""
    axes.set_xscale("log")
    if ticks is not None:
        axes.set_xticks(list(ticks))
        axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(_plain))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _plain(value: float, _: int) -> str:
    for unit, name in ((1e6, "M"), (1e3, "k")):
        if value >= unit and value % 256:
            return f"{value / unit:g}{name}"
    return f"{value:g}"


def iterations_plot(folder: Path, points: Sequence[tuple[int, float]]) -> Picture:
    """PSNR over the iterations of one progressive fit."""

    def plot(axes: Any) -> None:
        axes.plot(*zip(*points, strict=True), color=_COLORS[0], linewidth=1.8)
        axes.set_xlabel("iterations")
        axes.set_ylabel("PSNR, dB")

    first, last = points[0], points[-1]
    alt = (
        f"PSNR over the iterations: {first[1]:.1f} dB after {first[0]}, {last[1]:.1f} dB after "
        f"{last[0]}."
    )
    return _draw(folder, "iterations", alt, "PSNR of the model during the fit.", plot)


def schedules_plot(folder: Path, scores: Sequence[Score]) -> Picture:
    """Every fit of figure 3 as a point: a column for each procedure and schedule."""
    ways = list(dict.fromkeys(score.way for score in scores))
    photos = list(dict.fromkeys(score.photo for score in scores))

    def plot(axes: Any) -> None:
        columns = [(way, schedule) for way in ways for schedule in SCHEDULES]
        for k, photo in enumerate(photos):
            points = [
                (columns.index((s.way, s.schedule)) + 0.2 * (k - (len(photos) - 1) / 2), s.psnr)
                for s in scores
                if s.photo == photo
            ]
            axes.plot(
                *zip(*points, strict=True), linestyle="none", marker=_MARKERS[k % len(_MARKERS)],
                markersize=4.5, alpha=0.75, color=_COLORS[k % len(_COLORS)], label=photo,
            )  # fmt: skip
        labels = {"all-at-once": "at once", "exponential": "expon."}
        names = [
            "\n".join([labels.get(schedule, schedule), *way.split(", ")])
            for way, schedule in columns
        ]
        axes.set_xticks(range(len(columns)), names)
        axes.tick_params(axis="x", labelsize=8)
        axes.set_ylabel("PSNR, dB")

    alt = "PSNR of each fit by procedure and schedule; the table below has the means."
    caption = "Each point is one fit of a photo with a seed."
    return _draw(folder, "schedules", alt, caption, plot)


def more_plot(
    folder: Path, by_way: Mapping[str, Sequence[tuple[int, float]]], reached: Mapping[str, float]
) -> Picture:
    """All at once by its count, and the level of exponential with the first count."""

    def plot(axes: Any) -> None:
        for k, (way, line) in enumerate(by_way.items()):
            axes.plot(
                *zip(*line, strict=True), color=_COLORS[k], marker=_MARKERS[k], markersize=5,
                label=f"all at once, {way}",
            )  # fmt: skip
            axes.axhline(
                reached[way], color=_COLORS[k], linestyle="--", linewidth=1.2,
                label=f"exponential with {line[0][0]}, {way}",
            )  # fmt: skip
        counts = sorted({count for line in by_way.values() for count, _ in line})
        _log(axes, counts[:: 2 if len(counts) > 4 else 1])
        axes.set_xlabel("Gaussians, all at once")
        axes.set_ylabel("mean PSNR, dB")

    ends = "; ".join(
        f"{way} {line[-1][1]:.1f} dB with {line[-1][0]}, exponential {reached[way]:.1f} dB with "
        f"{line[0][0]}"
        for way, line in by_way.items()
    )
    alt = f"Mean PSNR of all at once by its number of Gaussians: {ends}."
    caption = "Where a line crosses its dashed level, all at once has caught up."
    return _draw(folder, "more", alt, caption, plot)


def shapes_plot(folder: Path, fits: Sequence[ShapeFit], by_seconds: bool) -> Picture:
    """PSNR of both kinds during the fit, every photo with the first seed."""
    photos = list(dict.fromkeys(fit.photo for fit in fits))
    seed = fits[0].seed

    def plot(axes: Any) -> None:
        for fit in fits:
            if fit.seed != seed:
                continue
            x = fit.seconds if by_seconds else range(len(fit.psnr))
            style = "-" if fit.kind == GAUSSIANS else "--"
            color = _COLORS[photos.index(fit.photo) % len(_COLORS)]
            label = f"{fit.photo}, {fit.kind}"
            axes.plot(x, fit.psnr, style, color=color, linewidth=1.5, label=label)
        axes.set_xlabel("seconds" if by_seconds else "iterations")
        axes.set_ylabel("PSNR, dB")

    axis = "seconds" if by_seconds else "iterations"
    ends = "; ".join(
        f"{fit.photo}, {fit.kind} {fit.psnr[-1]:.1f} dB after "
        + (f"{fit.seconds[-1]:.1f} s" if by_seconds else f"{len(fit.psnr) - 1}")
        for fit in fits
        if fit.seed == seed
    )
    alt = f"PSNR of Gaussians and of {ELLIPSES} over {axis}: {ends}."
    return _draw(folder, f"shapes-{axis}", alt, f"Gaussians and {ELLIPSES}, over {axis}.", plot)


FILE_PLOTS = {
    "psnr-count": ("count", "psnr", "Gaussians", "PSNR of the rasterised SVG, dB"),
    "ssim-count": ("count", "ssim", "Gaussians", "SSIM of the rasterised SVG"),
    "psnr-bytes": ("svg_bytes", "psnr", "bytes", "PSNR of the rasterised SVG, dB"),
}


def file_plot(
    folder: Path,
    name: str,
    kinds: Sequence[Kind],
    own: Sequence[Row],
    peers: Sequence[Row],
    png_bytes: float,
) -> Picture:
    """One of FILE_PLOTS, mean over the photos."""
    x, y, across, up = FILE_PLOTS[name]
    by_count = x == "count"
    inits = list(dict.fromkeys(kind.init for kind in kinds if kind != BEST))
    last = [next(row for row in reversed(own) if row.kind == kind.name) for kind in kinds]

    def plot(axes: Any) -> None:
        for kind in kinds:
            rows = [row for row in own if row.kind == kind.name]
            k = len(inits) if kind == BEST else inits.index(kind.init)
            style = "-" if kind.blend == "over" else ":"
            axes.plot(
                [getattr(r, x) for r in rows], [getattr(r, y) for r in rows], style,
                color=_COLORS[k], marker=_MARKERS[k], markersize=3.5, linewidth=1.4,
                label=kind.name,
            )  # fmt: skip
        if peers and not by_count:
            axes.plot(
                [getattr(r, x) for r in peers], [getattr(r, y) for r in peers], "-.",
                color="#7b8794", marker="*", markersize=8, label="vtracer, polygons",
            )  # fmt: skip
        if not by_count:
            axes.axvline(png_bytes, color="#7b8794", linewidth=1.2, label="the photos as PNG")
        counts = sorted({row.count for row in own})
        _log(axes, counts[::2] if by_count and len(counts) > 4 else counts if by_count else None)
        axes.set_xlabel(across)
        axes.set_ylabel(up)

    pattern = ".3f" if y == "ssim" else ".1f"
    ends = "; ".join(f"{row.kind} {getattr(row, y):{pattern}}" for row in last)
    alt = f"{up} against {across}; at {last[0].count:.0f} Gaussians: {ends}."
    return _draw(folder, name, alt, f"{up} against {across}, mean over the photos.", plot, _HIGHER)
