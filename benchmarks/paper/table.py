"""SVG files by the number of Gaussians, which the paper lacks; polygons and images beside them."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from common import encoded, vectorized

from gauss2svg import Result
from gauss2svg.compare.peers import PEERS
from gauss2svg.files import as_png
from gauss2svg.measure import metrics
from gauss2svg.photo.load import load_image
from gauss2svg.raster import rasterize
from gauss2svg.scene import BLENDS
from gauss2svg.svg.file import file_bytes

from .photos import Pixels, Smoothness, smoothness
from .settings import Settings

PEER = "vtracer"
JPEG_QUALITY = 90
PNG, JPEG = "PNG, lossless", f"JPEG, quality {JPEG_QUALITY}"


@dataclass(frozen=True)
class Kind:
    """Options of gauss2svg.vectorize that files are compared by."""

    blend: str
    init: str
    falloff: str = "gaussian"

    @property
    def name(self) -> str:
        """As in the table."""
        blend = "source-over" if self.blend == "over" else "additive"
        learned = ", learned rims" if self.falloff == "adaptive" else ""
        return f"{blend}, {self.init}{learned}"


BEST = Kind("over", "selective", "adaptive")  # the product's defaults but for the weight


def kinds(settings: Settings) -> tuple[Kind, ...]:
    """Both blends with every placement, and the product's falloff and placement."""
    return (*(Kind(blend, init) for blend in BLENDS for init in settings.inits), BEST)


# From a few large polygons to one for each patch of colour. All eight bits of colour are kept: with
# vtracer's default of six, errors over smooth areas are up to four times as large.
_COLOR_BITS = 8
_POLYGONS = (
    {"filter_speckle": 10, "layer_difference": 48},
    {"filter_speckle": 4, "layer_difference": 32},
    {"filter_speckle": 4, "layer_difference": 16},
    {"filter_speckle": 2, "layer_difference": 8},
    {"filter_speckle": 0, "layer_difference": 0},
)


@dataclass(frozen=True)
class Row:
    """One file of one photo, or the mean over several.

    kind     of the file, or the peer's settings; count  Gaussians requested, or the peer's paths
    psnr, ssim   of the rasterised SVG against the photo; error, edges  see photos.Smoothness
    flat     gauss2svg.measure.metrics.flat_error, levels
    """

    photo: str
    kind: str
    count: float
    psnr: float
    ssim: float
    flat: float
    error: float
    edges: float
    svg_bytes: float
    svgz_bytes: float
    seconds: float


def own_rows(
    photos: dict[str, Pixels], settings: Settings
) -> tuple[list[Row], dict[tuple[str, str, int], Pixels]]:
    """Every kind, count and photo, and the rasters of the kind BEST."""

    def made(pixels: Pixels, kind: Kind, count: int) -> Result:
        steps = settings.table_iterations
        return vectorized(pixels, gaussians=count, iterations=steps, tune="psnr", **asdict(kind))

    rows, rasters = [], {}
    for kind in kinds(settings):
        # Kernels are loaded and threads start here, outside of the measured seconds.
        made(next(iter(photos.values())), kind, settings.counts[0])
        for count in settings.counts:
            for name, pixels in photos.items():
                result = made(pixels, kind, count)
                report = result.report
                sizes = report["svg_bytes"], report["svgz_bytes"]
                seconds = report["total_s"]
                rows.append(_row(name, kind.name, count, pixels, result.raster, sizes, seconds))
                if kind == BEST:
                    rasters[name, kind.name, count] = result.raster
    return rows, rasters


def peer_version() -> str | None:
    """Version of the tracer of polygons, None if it is not installed."""
    return PEERS[PEER].version()


def peer_rows(
    photos: dict[str, Pixels],
) -> tuple[list[Row], dict[tuple[str, str, int], Pixels]]:
    """Polygons of one colour each, with every setting, and their rasters."""
    rows, rasters = [], {}
    for k, options in enumerate(_POLYGONS):
        kind = f"polygons, {options['filter_speckle']}/{options['layer_difference']}"
        for name, pixels in photos.items():
            svg, raster, seconds = traced(
                pixels, style="polygon", color_precision=_COLOR_BITS, **options
            )
            paths = svg.count("<path")
            sizes = len(file_bytes(svg, gzipped=False)), len(file_bytes(svg, gzipped=True))
            rows.append(_row(name, kind, paths, pixels, raster, sizes, seconds))
            rasters[name, kind, k] = raster
    return rows, rasters


def traced(pixels: Pixels, **settings: Any) -> tuple[str, Pixels, float]:
    """The SVG of the tracer, its raster, and the seconds of the tracing."""
    with tempfile.TemporaryDirectory() as folder:
        png, out = Path(folder) / "photo.png", Path(folder) / "traced.svg"
        png.write_bytes(as_png(pixels))
        work = PEERS[PEER].prepare(png, out, **settings)
        begun = time.perf_counter()
        work()
        seconds = time.perf_counter() - begun
        svg = out.read_text()
    return svg, rasterize(svg, pixels.shape[1], pixels.shape[0]), seconds


def _row(
    name: str,
    kind: str,
    count: int,
    pixels: Pixels,
    raster: Pixels,
    sizes: tuple[int, int],
    seconds: float,
) -> Row:
    smooth: Smoothness = smoothness(raster, pixels)
    return Row(
        photo=name,
        kind=kind,
        count=count,
        psnr=metrics.psnr(raster, pixels),
        ssim=metrics.ssim(raster, pixels),
        flat=metrics.flat_error(raster, pixels),
        error=smooth.error,
        edges=smooth.edges,
        svg_bytes=sizes[0],
        svgz_bytes=sizes[1],
        seconds=seconds,
    )


_NUMBERS = (
    "count", "psnr", "ssim", "flat", "error", "edges", "svg_bytes", "svgz_bytes", "seconds",
)  # fmt: skip


def means(rows: Sequence[Row], group: Callable[[Row], object]) -> list[Row]:
    """The mean over the photos of each group of rows, in the order of their first rows."""
    groups: dict[object, list[Row]] = {}
    for row in rows:
        groups.setdefault(group(row), []).append(row)
    return [
        Row(
            "mean",
            members[0].kind,
            **{n: statistics.fmean(getattr(row, n) for row in members) for n in _NUMBERS},
        )
        for members in groups.values()
    ]


def own_means(rows: Sequence[Row]) -> list[Row]:
    """Means by kind and count."""
    return means(rows, lambda row: (row.kind, row.count))


def peer_means(rows: Sequence[Row]) -> list[Row]:
    """Means by setting: the number of paths differs from photo to photo."""
    return means(rows, lambda row: row.kind)


def at_most_as_large(own: Sequence[Row], peer: Row) -> Row | None:
    """The largest own file of the same photo with no more bytes than the peer's; None if none."""
    fitting = [
        row
        for row in own
        if (row.photo, row.kind) == (peer.photo, BEST.name) and row.svg_bytes <= peer.svg_bytes
    ]
    return max(fitting, key=lambda row: row.svg_bytes, default=None)


def matched(own: Sequence[Row], peers: Sequence[Row]) -> list[tuple[Row, Row]]:
    """Peers' rows beside own files that are at most as large.

    Only of the settings in which every photo has one, so that all means are over all photos.
    """
    matches = [(row, at_most_as_large(own, row)) for row in peers]
    lacking = {row.kind for row, match in matches if match is None}
    return [(row, match) for row, match in matches if match and row.kind not in lacking]


def by_photo(
    pairs: Sequence[tuple[Row, Row]], value: Callable[[Row], float]
) -> list[tuple[float, float]]:
    """Own and peer's values, mean over the settings: a photo is one independent pair."""
    found: dict[str, list[tuple[float, float]]] = {}
    for row, match in pairs:
        found.setdefault(row.photo, []).append((value(match), value(row)))
    return [
        (statistics.fmean(a for a, _ in values), statistics.fmean(b for _, b in values))
        for values in found.values()
    ]


@dataclass(frozen=True)
class Coded:
    """One photo as an image file: bytes, and PSNR in dB and SSIM against the photo."""

    photo: str
    kind: str
    file_bytes: float
    psnr: float
    ssim: float


def coded(photos: dict[str, Pixels]) -> list[Coded]:
    """Every photo as PNG and as JPEG."""
    files = []
    for name, pixels in photos.items():
        for kind, data in (
            (PNG, encoded(pixels, "PNG", optimize=True)),
            (JPEG, encoded(pixels, "JPEG", quality=JPEG_QUALITY)),
        ):
            again = load_image(data).pixels
            psnr, ssim = metrics.psnr(again, pixels), metrics.ssim(again, pixels)
            files.append(Coded(name, kind, len(data), psnr, ssim))
    return files


def coded_means(files: Sequence[Coded]) -> dict[str, Coded]:
    """Mean over the photos, by kind."""
    return {
        kind: Coded(
            "mean",
            kind,
            *(
                statistics.fmean(getattr(f, n) for f in files if f.kind == kind)
                for n in ("file_bytes", "psnr", "ssim")
            ),
        )
        for kind in (PNG, JPEG)
    }


def larger_from(rows: Sequence[Row], column: str, limit: float) -> int | None:
    """Least count from which on all rows exceed the limit; None if the last row does not.

    column is svg_bytes or svgz_bytes; rows ascend by count.
    """
    found = None
    for row in reversed(rows):
        if getattr(row, column) <= limit:
            break
        found = round(row.count)
    return found
