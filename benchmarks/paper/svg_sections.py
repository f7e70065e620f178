"""Section 6: SVG files by the number of Gaussians, beside polygons and crisp ellipses."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import asdict

from . import claims, losses, plots, shapes, table
from .book import ZOOM, Book, Picture, Table, texts
from .photos import Pixels

Rasters = dict[tuple[str, str, int], Pixels]
Pairs = list[tuple[float, float]]

_COLUMNS = {
    "PSNR of the rasterised SVG, dB": ("psnr", ".2f"),
    "SSIM of the rasterised SVG": ("ssim", ".3f"),
    "Bytes of the SVG, in thousands": ("svg_bytes", ".0f"),
    "Bytes of the gzipped SVG, as web servers send it, in thousands": ("svgz_bytes", ".1f"),
    "Seconds": ("seconds", ".2f"),
}


def svg_files(book: Book) -> tuple[dict[str, Pairs], dict[str, Pairs]]:
    """Files by count and polygons; returns errors and false edges of both, pair by pair."""
    own, rasters = table.own_rows(book.photos, book.settings)
    peers, traced = table.peer_rows(book.photos) if table.peer_version() else ([], {})
    means = table.own_means(own)
    peer_means = table.peer_means(peers)
    book.numbers["files_by_count"] = [asdict(row) for row in own]
    book.numbers["polygons"] = [asdict(row) for row in peers]
    png_bytes = _image_files(book, means)
    book.page["file_plots"] = [
        plots.file_plot(book.folder, name, table.kinds(book.settings), means, peer_means, png_bytes)
        for name in plots.FILE_PLOTS
    ]
    book.page["file_tables"] = [
        _by_kind(name, column, pattern, means, book) for name, (column, pattern) in _COLUMNS.items()
    ]
    lines = {
        kind.name: [(row.count, row.psnr) for row in means if row.kind == kind.name]
        for kind in table.kinds(book.settings)
    }
    book.verdicts.append(claims.trade_off(lines))
    found = table.matched(own, peers)
    left_out = [
        k for k in dict.fromkeys(r.kind for r in peers) if k not in {r.kind for r, _ in found}
    ]
    book.page["tracer_is_there"] = bool(peers)
    book.page["polygons_table"] = _polygons(found, left_out) if found else None
    book.page["polygon_pictures"] = _polygon_pictures(book, found, rasters, traced)
    smooth = [(a, b) for a, b in found if not math.isnan(a.error)]
    name = "vtracer's polygons of at least as many bytes"
    error = {name: table.by_photo(smooth, lambda row: row.error)}
    return error, {name: table.by_photo(smooth, lambda row: row.edges)}


def _image_files(book: Book, own: Sequence[table.Row]) -> float:
    """The photos as PNG and JPEG beside files by count; returns the mean bytes of the PNG."""
    files = table.coded(book.photos)
    means = table.coded_means(files)
    best = [row for row in own if row.kind == table.BEST.name]
    png = means[table.PNG].file_bytes
    book.numbers["image_files"] = [asdict(file) for file in files]
    book.page["png_kb"] = png / 1000
    book.page["larger_than_png"] = {
        name: table.larger_from(best, column, png)
        for name, column in (("The SVG", "svg_bytes"), ("the compressed SVG", "svgz_bytes"))
    }
    book.page["image_files_table"] = Table(
        "image-files-table",
        "The photos as image files, mean over the photos",
        ["file", "kB", "PSNR, dB", "SSIM"],
        [
            [
                f.kind, f"{f.file_bytes / 1000:.1f}",
                f"{f.psnr:.2f}" if math.isfinite(f.psnr) else "no error", f"{f.ssim:.3f}",
            ]
            for f in means.values()
        ],
    )  # fmt: skip
    return png


def _by_kind(
    caption: str, column: str, pattern: str, means: Sequence[table.Row], book: Book
) -> Table:
    scale = 1000 if column.endswith("_bytes") else 1
    lines = []
    for kind in table.kinds(book.settings):
        values = [getattr(row, column) / scale for row in means if row.kind == kind.name]
        lines.append([kind.name, *texts(pattern, values)])
    return Table(
        f"file-{column}",
        caption,
        ["blending, placement", *texts("d", book.settings.counts)],
        lines,
    )


def _polygons(found: Sequence[tuple[table.Row, table.Row]], left_out: Sequence[str]) -> Table:
    lines = []
    for kind in dict.fromkeys(row.kind for row, _ in found):
        pairs = [pair for pair in found if pair[0].kind == kind]
        for side, name in enumerate((kind, "Gaussians beside them")):
            rows = [pair[side] for pair in pairs]
            means = [
                statistics.fmean(getattr(row, n) for row in rows)
                for n in ("count", "psnr", "ssim", "error", "edges", "flat", "svg_bytes", "seconds")
            ]
            count, psnr, ssim, error, edges, flat, size, seconds = means
            lines.append(
                [
                    name, f"{count:.0f}", f"{psnr:.2f}", f"{ssim:.3f}", f"{error:.2f}",
                    f"{100 * edges:.2f}", f"{flat:.1f}", f"{size / 1000:.0f}",
                    f"{seconds:.2f}",
                ]
            )  # fmt: skip
    lacking = f"; without {', '.join(left_out)}, where a photo has no such file" if left_out else ""
    return Table(
        "polygons-table",
        "Polygons (speckle filter/layer difference, all eight bits of colour) and Gaussians in no "
        "more bytes, mean over the photos: error over smooth areas in levels of 255, share of "
        "these areas with false edges in %, error of the worst thousandth of flat areas in levels"
        f"{lacking}",
        ["shapes", "count", "PSNR, dB", "SSIM", "error", "edges, %", "flat", "kB", "seconds"],
        lines,
    )


def _polygon_pictures(
    book: Book, found: Sequence[tuple[table.Row, table.Row]], rasters: Rasters, traced: Rasters
) -> list[Picture]:
    """A crop of the shown photo, of polygons with the middle setting, and of Gaussians."""
    own = [pair for pair in found if pair[0].photo == book.shown]
    if not own:
        return []
    row, match = own[len(own) // 2]
    polygons = next(v for k, v in traced.items() if k[:2] == (row.photo, row.kind))
    gaussians = rasters[match.photo, match.kind, int(match.count)]
    square = losses.most_different_square([polygons, gaussians])
    save = book.save
    return [
        save("polygons-photo", book.pixels[square], f"Part of the photo {book.shown}",
             book.shown, ZOOM),
        save("polygons", polygons[square], "The same part by polygons",
             f"{row.kind}: {row.svg_bytes / 1000:.0f} kB, {row.psnr:.2f} dB", ZOOM),
        save("polygons-gaussians", gaussians[square], "The same part by Gaussians",
             f"{match.count:.0f} Gaussians: {match.svg_bytes / 1000:.0f} kB, {match.psnr:.2f} dB",
             ZOOM),
    ]  # fmt: skip


def crisp_ellipses(book: Book, error: dict[str, Pairs], edges: dict[str, Pairs]) -> None:
    """Ellipses of one colour in the same engine; with the pairs of polygons, claims c and d."""
    fits = shapes.compared(book.photos, book.settings)
    pairs = shapes.pairs(fits)
    book.page["shapes_plots"] = [plots.shapes_plot(book.folder, fits, s) for s in (False, True)]
    book.page["shapes_table"] = _shapes_table(fits)
    book.page["shapes_pictures"] = [
        book.save(
            f"shapes-{fit.kind.replace(' ', '-').lower()}", fit.image,
            f"{book.shown} by {fit.kind}", f"{fit.kind}, {fit.psnr[-1]:.2f} dB",
        )
        for fit in fits
        if fit.photo == book.shown and fit.seed == book.settings.shape_seeds[0]
    ]  # fmt: skip
    book.numbers["shapes"] = [
        {
            "photo": f.photo, "kind": f.kind, "seed": f.seed, "step_size": f.step_size,
            "psnr": f.psnr[-1], "seconds": f.seconds[-1], **asdict(f.smoothness),
        }
        for f in fits
    ]  # fmt: skip
    book.numbers["shape_pairs"] = [asdict(pair) for pair in pairs]
    by_key = {(f.photo, f.seed, f.kind): f.smoothness for f in fits}
    both = [
        (own, by_key[photo, seed, shapes.ELLIPSES])
        for (photo, seed, kind), own in by_key.items()
        if kind == shapes.GAUSSIANS and not math.isnan(own.error)
    ]
    error = error | {"crisp ellipses of the same number": [(a.error, b.error) for a, b in both]}
    edges = edges | {"crisp ellipses of the same number": [(a.edges, b.edges) for a, b in both]}
    book.verdicts += [
        claims.faster_than_shapes(
            [pair.by_iterations for pair in pairs], [pair.by_seconds for pair in pairs]
        ),
        claims.faster_than_live(),
        claims.smoother_than_shapes(error, edges),
    ]


def _shapes_table(fits: Sequence[shapes.ShapeFit]) -> Table:
    lines = []
    for photo in dict.fromkeys(fit.photo for fit in fits):
        for kind in (shapes.GAUSSIANS, shapes.ELLIPSES):
            own = [fit for fit in fits if (fit.photo, fit.kind) == (photo, kind)]
            psnr, seconds, error, edges = (
                statistics.fmean(values)
                for values in zip(
                    *((f.psnr[-1], f.seconds[-1], f.smoothness.error, f.smoothness.edges)
                      for f in own),
                    strict=True,
                )
            )  # fmt: skip
            needed = statistics.fmean(
                shapes.iterations_to(f, other.psnr[-1])
                for f in own
                for other in fits
                if (other.photo, other.seed) == (photo, f.seed) and other.kind != kind
            )
            lines.append(
                [f"{photo}, {kind}", f"{psnr:.2f}", f"{seconds:.1f}",
                 f"{needed:.0f}" if math.isfinite(needed) else "not reached",
                 f"{error:.2f}", f"{100 * edges:.2f}"]
            )  # fmt: skip
    return Table(
        "shapes-table",
        "Means over the seeds, of the model; iterations to the final PSNR of the other kind, not "
        "reached if a seed never reaches it; error over smooth areas in levels of 255, share of "
        "these areas with false edges in %",
        ["photo, shapes", "PSNR, dB", "seconds", "to the other's PSNR", "error", "edges, %"],
        lines,
    )
