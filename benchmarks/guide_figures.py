"""The figures of the guide, for benchmarks/figures.py."""

from __future__ import annotations

import io
import re
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from common import encoded
from matplotlib.figure import Figure
from panels import WIDTH_IN, Pixels, coffee, enlarged, reduced, tiles
from PIL import Image
from skimage import data
from small import of_another_tool
from transparency import pictures as transparent_pictures
from vector_drawings import vector_drawings

from gauss2svg import (
    Document,
    FitOptions,
    Progress,
    Result,
    Scene,
    SvgOptions,
    outline_svg,
    placeholder,
    vectorize,
    write_svg,
)  # fmt: skip
from gauss2svg.files import as_png
from gauss2svg.measure.heatmap import colors_of, errors
from gauss2svg.measure.metrics import psnr
from gauss2svg.photo.alpha import over
from gauss2svg.raster import rasterize, rasterize_rgba
from gauss2svg.raster.inkscape import draw as inkscape_drawn
from gauss2svg.render import render

_DOCS = Path(__file__).parents[1] / "docs"
_NAVY = (0.11, 0.15, 0.26)


def _kilobytes(result: Result) -> str:
    return f"{result.report['svg_bytes'] / 1000:.0f} kB"


def _match(result: Result) -> str:
    return f"{_kilobytes(result)}, {result.report['psnr_svg']:.1f} dB"


def _crop(pixels: Pixels, left: float, top: float, share: float) -> Pixels:
    """The part of an image that begins at shares of its sides and is as long as a share of them."""
    height, width = pixels.shape[:2]
    y, x = round(top * height), round(left * width)
    return pixels[y : y + round(share * height), x : x + round(share * width)]


def sizes() -> Figure:
    """One photo in files of four sizes."""
    found = [vectorize(data.chelsea(), max_bytes=n) for n in (5000, 20_000, 60_000, 150_000)]
    return tiles([r.raster for r in found], [_match(r) for r in found], columns=2)


def decibels() -> Figure:
    """One photo at four PSNRs."""
    found = [vectorize(coffee(360), target_psnr=target) for target in (25, 30, 35, 40)]
    titles = [f"{r.report['psnr_svg']:.0f} dB, {_kilobytes(r)}" for r in found]
    return tiles([r.raster for r in found], titles, columns=2)


def editors() -> Figure:
    """A file in minimal markup as resvg and as Inkscape draw it, and an editable one."""
    photo = coffee(480)
    small, plain = (
        vectorize(photo, max_bytes=20_000, svg=SvgOptions(markup=markup))
        for markup in ("minimal", "editable")
    )
    height, width = photo.shape[:2]
    drawn = [over(inkscape_drawn(one.svg, width, height)) for one in (small, plain)]
    titles = ["minimal, by resvg", "minimal, by Inkscape", "editable, by Inkscape", "the photo"]
    return tiles([small.raster, *drawn, photo], titles, columns=2)


def presets() -> Figure:
    """One photo by each preset, and a part of each at three times the size."""
    photo = coffee(360)
    names = ("draft", "fast", "balanced", "high", "max")
    found = [vectorize(photo, quality=name) for name in names]
    whole = [*(r.raster for r in found), photo]
    left, top, width, height = 65, 125, 120, 80  # px of the part
    moved = [r.scene.replace(mean=r.scene.mean - [left, top]) for r in found]
    near = [render(s.replace(width=width, height=height), 3 * width, 3 * height) for s in moved]
    part = photo[top : top + height, left : left + width]
    near.append(enlarged(part, 3, Image.Resampling.BICUBIC))
    titles = [f"{name}: {_kilobytes(r)}" for name, r in zip(names, found, strict=True)]
    titles.append("the photo")
    order = [*whole[:3], *near[:3], *whole[3:], *near[3:]]
    return tiles(order, [*titles[:3], *[""] * 3, *titles[3:], *[""] * 3], columns=3)


def placeholders() -> Figure:
    """What a page shows before the photo has come, by bytes, and after."""
    photo = data.rocket()
    height, width = photo.shape[:2]
    drawn, titles = [], []
    for limit in (500, 1000, 2000):
        one = placeholder(photo, max_bytes=limit)
        drawn.append(rasterize(one.svg, width, height))
        titles.append(f"before: {len(one.svg)} bytes")
    return tiles([*drawn, photo / 255], [*titles, "after: the photo"], columns=2)


def _stretched(file: bytes, width: int, height: int) -> Pixels:
    """An image file at another size."""
    with Image.open(io.BytesIO(file)) as image:
        large = image.convert("RGB").resize((width, height), Image.Resampling.BICUBIC)
    return np.asarray(large) / 255


def webp() -> Figure:
    """A photo in 1500 bytes as WebP and as a placeholder, and the photo."""
    photo = data.chelsea()
    height, width = photo.shape[:2]
    limit = 1500
    best: tuple[float, Pixels] = (0, photo)
    for side in range(40, 160, 8):
        for quality in range(10, 95, 10):
            file = encoded(reduced(photo, side), "WEBP", quality=quality, method=6)
            if len(file) <= limit:
                shown = _stretched(file, width, height)
                best = max(best, (psnr(shown, photo / 255), shown), key=lambda one: one[0])
    blur = encoded(reduced(photo, 16), "WEBP", quality=50, method=6)
    small = placeholder(photo, max_bytes=500).svg
    shown = [_stretched(blur, width, height), rasterize(small, width, height)]
    for file, pixels in zip((blur, small), shown, strict=True):
        print(f"{len(file)} bytes: {psnr(pixels, photo / 255):.1f} dB")
    one = rasterize(placeholder(photo, max_bytes=limit).svg, width, height)
    titles = [f"WebP: {best[0]:.1f} dB", f"gauss2svg: {psnr(one, photo / 255):.1f} dB", "the photo"]
    return tiles([best[1], one, photo / 255], titles, columns=3)


def drawings() -> Figure:
    """FLIP by bytes of ten drawings and of vtracer's, from the table of docs/benchmarks."""
    rows = [
        [cell.strip() for cell in line.strip("|\n").split("|")]
        for line in (_DOCS / "benchmarks/drawings.md").read_text(encoding="utf-8").splitlines()
        if line.startswith("|") and line.count("|") == 8
    ][2:]
    names = dict.fromkeys(row[0] for row in rows)
    whole = [name for name in names if all(row[6] != "-" for row in rows if row[0] == name)]
    figure, axis = plt.subplots(figsize=(WIDTH_IN, 3.4), layout="constrained")
    for column, label, colour in ((3, "gauss2svg", "#1668c1"), (6, "vtracer", "#c8501e")):
        for name in whole:
            mine = [row for row in rows if row[0] == name]
            axis.plot(
                [int(row[1]) / 1000 for row in mine], [float(row[column]) for row in mine],
                color=colour, linewidth=0.6, alpha=0.35,
            )  # fmt: skip
        steps = sorted({int(row[1]) for row in rows})
        means = [
            np.mean([float(row[column]) for row in rows if int(row[1]) == n and row[0] in whole])
            for n in steps
        ]
        axis.plot([n / 1000 for n in steps], means, "o-", color=colour, label=label)
    axis.set(xscale="log", ylim=(0, 0.45))
    axis.set_xlabel("kB", fontsize=12)
    axis.set_ylabel("FLIP, lower is better", fontsize=12)
    axis.tick_params(labelsize=12)
    axis.set_xticks([2, 5, 10, 20, 50], ["2", "5", "10", "20", "50"])
    axis.minorticks_off()
    axis.legend(fontsize=12)
    return figure


def _rounds(scene: Scene) -> list[int]:
    """Four rounds of a scene, from its first to its last."""
    rounds = np.unique(scene.round_index)
    return [int(rounds[k]) for k in np.round(np.linspace(0, len(rounds) - 1, 4)).astype(int)]


def layers() -> Figure:
    """Layers of a file alone, and the picture as they come one after the other."""
    scene = vectorize(coffee(300), gaussians=600).scene
    chosen = _rounds(scene)
    alone = [scene.select(scene.round_index == k).replace(background=np.ones(3)) for k in chosen]
    upto = [scene.select(scene.round_index <= k) for k in chosen]
    titles = [f"round {k + 1}: {len(s)}" for k, s in zip(chosen, alone, strict=True)]
    titles += [f"up to {k + 1}: {len(s)}" for k, s in zip(chosen, upto, strict=True)]
    return tiles([render(s, 480, 320) for s in (*alone, *upto)], titles, columns=4)


def forming() -> str:
    """A file whose rounds fade in."""
    scene = vectorize(coffee(300), gaussians=190).scene
    alt = "A cup of coffee that forms from large shapes to small ones within six seconds"
    return write_svg(scene, document=Document(title="Coffee", alt=alt, animate=6))


def scenes() -> Figure:
    """A scene, edited as arrays: its large shapes, other colours, crisp rims."""
    scene = vectorize(coffee(300), gaussians=600).scene
    large = scene.select(scene.sigma.max(axis=1) > 4)
    warmer = scene.replace(color=scene.color ** [0.75, 1, 1.3])
    crisp = scene.replace(beta=np.full(len(scene), 64.0))
    pictures = [render(s, 480, 320) for s in (scene, large, warmer, crisp)]
    titles = ["the scene", f"the {len(large)} large shapes", "warmer", "every rim crisp"]
    return tiles(pictures, titles, columns=2)


def printed() -> Figure:
    """A small photo four times as large: its pixels, by bicubic interpolation, by shapes."""
    whole = data.astronaut()
    small = reduced(whole, 128)
    result = vectorize(np.round(small * 255).astype(np.uint8), gaussians=2000)
    shown = [
        enlarged(small, 4, Image.Resampling.BICUBIC), rasterize(result.svg, 512, 512), whole / 255,
    ]  # fmt: skip
    figures = [psnr(one, shown[2]) for one in shown[:2]]
    titles = [f"bicubic: {figures[0]:.1f} dB", f"gauss2svg: {figures[1]:.1f} dB", "photo, 512 px"]
    return tiles([_crop(one, 0.28, 0.02, 0.4) for one in shown], titles, columns=3)


def traced() -> Figure:
    """Letters of a logo four times as large: by gauss2svg, by vtracer, and the truth."""
    import vtracer  # pyright: ignore[reportMissingImports]

    source = vector_drawings()["badge"]
    logo, truth = (rasterize(source, side, side) for side in (512, 2048))
    ours = vectorize(logo)
    theirs = vtracer.convert_raw_image_to_svg(as_png(logo), img_format="png", path_precision=2)
    shown, titles = [], []
    for name, svg in (("gauss2svg", ours.svg), ("vtracer", theirs)):
        small, large = (of_another_tool(svg, at) for at in (logo, truth))
        shown.append(large)
        print(f"{name}: {psnr(small, logo):.1f}, {psnr(large, truth):.1f} dB")
        titles.append(f"{name}: {len(svg) / 1000:.0f} kB")
    print(f"bicubic: {psnr(enlarged(logo, 4, Image.Resampling.BICUBIC), truth):.1f} dB")
    crops = [_crop(one, 0.3, 0.34, 0.24) for one in (*shown, truth)]
    return tiles(crops, [*titles, "the drawing"], columns=3)


def plotters() -> Figure:
    """A picture in inks, the lines of it that are seen, and those without the white pen's."""
    inks = "#ffffff,#e0a070,#a04818,#201008"
    fit = FitOptions(inks=inks)
    result = vectorize(data.coffee(), gaussians=800, fit=fit, document=Document(size="200mm"))
    with tempfile.TemporaryDirectory() as folder:
        lines, seen = Path(folder, "lines.svg"), Path(folder, "seen.svg")
        lines.write_text(outline_svg(result.scene, result.document), encoding="utf-8")
        subprocess.run(
            ["vpype", "read", "--no-crop", lines, "occult", "-i", "crop", "0", "0", "200mm",
             "133.33mm", "write", seen], check=True,
        )  # fmt: skip
        drawn = seen.read_text(encoding="utf-8")
    # resvg takes no metadata of other name spaces, and lines are thin for a picture of this size
    drawn = re.sub(r"<metadata>.*</metadata>", "", drawn, flags=re.DOTALL)
    drawn = re.sub(r'stroke-width="[^"]*"', 'stroke-width="1.2"', drawn)
    white = re.compile(r'stroke="(#fff|#ffffff|white)"')
    page = np.ones((400, 600, 3))
    files = [white.sub('stroke="#3080e0"', drawn), white.sub('stroke="none"', drawn)]
    shown = [of_another_tool(svg, page) for svg in files]
    titles = ["the picture", "lines, white as blue", "without white"]
    return tiles([result.raster, *shown], titles, columns=3)


def transparent() -> Figure:
    """One transparent SVG over a light, a dark and a chequered page."""
    with_alpha = reduced(dict(transparent_pictures())["soft ellipse"], 256)
    result = vectorize(np.round(with_alpha * 255).astype(np.uint8), gaussians=1500)
    drawn = rasterize_rgba(result.svg, 512, 512)
    y, x = np.mgrid[:512, :512] // 32
    checks = np.where((x + y) % 2, 0.75, 1.0)[:, :, None] * np.ones(3)
    pages = {"on white": np.ones(3), "on a dark page": np.array(_NAVY), "on a pattern": checks}
    return tiles([over(drawn, page) for page in pages.values()], list(pages), columns=3)


def errors_map() -> Figure:
    """A photo, its SVG and the map of errors that check writes."""
    photo = coffee(360)
    result = vectorize(photo, quality="fast")
    heat = colors_of(errors(result.raster, photo)) / 255
    return tiles([photo, result.raster, heat], ["photo.jpg", "out.svg", "errors.png"], columns=3)


def interrupted() -> Figure:
    """What is left of a fit that ends early, and the whole one."""
    photo = coffee(300)
    drawn, titles = [], []
    for share in (0.15, 0.4, 1.0):
        seen = [0.0]

        def watch(progress: Progress, seen: list[float] = seen) -> None:
            seen[0] = progress.fit.done if progress.fit else seen[0]

        def ends(seen: list[float] = seen, share: float = share) -> bool:
            return seen[0] >= share

        result = vectorize(photo, gaussians=1000, progress=watch, stop=ends)
        drawn.append(result.raster)
        when = "whole" if share == 1 else f"ended at {share:.0%}"
        titles.append(f"{when}: {result.report['psnr_svg']:.1f} dB")
    return tiles(drawn, titles, columns=3)


def batch() -> Figure:
    """Who does what in a batch: command, scheduler, workers, and what they leave."""
    figure, axis = plt.subplots(figsize=(WIDTH_IN, 3.4), layout="constrained")
    axis.set(xlim=(0, 100), ylim=(0, 36))
    axis.axis("off")
    boxes = {
        "photos\na folder, a bucket": (14, 28), "the command\nshards of up to 500": (14, 8),
        "scheduler": (38, 8), "worker\none photo at a time": (65, 28),
        "worker\non any machine": (65, 18), "worker\n...": (65, 8),
        "SVGs": (91, 28), "records\na line a photo": (91, 8),
    }  # fmt: skip
    frame = {"boxstyle": "round,pad=0.4", "facecolor": "#eef3f9", "edgecolor": "#345"}
    for text, place in boxes.items():
        axis.text(*place, text, ha="center", va="center", fontsize=11, bbox=frame)
    arrows = [(14, 24, 14, 12), (26, 8, 31, 8), (45, 9, 52, 26), (45, 9, 54, 18), (45, 8, 60, 8)]
    arrows += [(78, 28, 87, 28), (76, 18, 87, 27), (70, 8, 87, 26)]
    arrows += [(78, 27, 82, 12), (76, 18, 82, 10), (70, 8, 81, 8)]
    for x, y, to_x, to_y in arrows:
        axis.annotate("", (to_x, to_y), (x, y), arrowprops={"arrowstyle": "->", "color": "#345"})
    return figure


def counts() -> Figure:
    """PSNR on Kodak-24 by the number of shapes, from the table of docs/benchmarks."""
    lines = (_DOCS / "benchmarks/peers.md").read_text(encoding="utf-8").splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("| method |"))
    numbers = [int(cell.replace(" ", "")) for cell in lines[head].strip("| ").split("|")[1:]]
    figure, axis = plt.subplots(figsize=(WIDTH_IN, 5), layout="constrained")
    for line in lines[head + 2 :]:
        if not line.startswith("|"):
            break
        name, *cells = [cell.strip() for cell in line.strip("|").split("|")]
        points = [(n, float(c)) for n, c in zip(numbers, cells, strict=True) if c]
        style = "o-" if name.startswith("gauss2svg") else "s--" if "curves" in name else "^:"
        ours = name.startswith("gauss2svg")
        axis.plot(*zip(*points, strict=True), style, label=name, linewidth=2 if ours else 1,
                  markersize=4, zorder=3 if ours else 2)  # fmt: skip
    axis.set(xscale="log", ylim=(22, 52))
    axis.set_xlabel("shapes", fontsize=12)
    axis.set_ylabel("PSNR on Kodak-24, dB", fontsize=12)
    axis.tick_params(labelsize=11)
    axis.set_xticks([256, 1000, 5000, 10_000, 50_000], ["256", "1000", "5000", "10 000", "50 000"])
    axis.minorticks_off()
    axis.legend(fontsize=10.5, loc="upper left", ncols=2)
    return figure


FIGURES: dict[str, Callable[[], Figure | str]] = {
    "sizes": sizes,
    "decibels": decibels,
    "editors": editors,
    "presets": presets,
    "placeholders": placeholders,
    "webp": webp,
    "drawings": drawings,
    "layers": layers,
    "forming": forming,
    "scenes": scenes,
    "printed": printed,
    "traced": traced,
    "plotters": plotters,
    "transparent": transparent,
    "errors": errors_map,
    "interrupted": interrupted,
    "batch": batch,
    "counts": counts,
}
