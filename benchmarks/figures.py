"""Make the pictures of the documentation, each under 60 kB.

    python benchmarks/figures.py docs/_static [start model progressive-fit ...]

FOLDER/figures/NAME.webp, or NAME.svg, stands on the page that names it. FOLDER/start has the
pictures of the start page and start.inc, which shows them, and by the name `results` the six
results that the start page and the guide link to. The names `readme` and `gallery` make
examples/showcase.jpg and examples/gallery.jpg.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from common import (
    COFFEE,
    PICTURES,
    ROOT,
    Pixels,
    coffee,
    drawn,
    eight_bits,
    encoded,
    shipped,
    to_width,
    vectorized,
    webps,
)
from matplotlib.figure import Figure
from panels import (
    BICUBIC,
    MOST_BYTES,
    WIDTH_IN,
    chart,
    compared,
    enlarged,
    part,
    png,
    said,
    small_webp,
    table_of,
    tiles,
    upto,
)
from PIL import Image, ImageOps
from screenshots import gallery, studio
from skimage import data

from gauss2svg import (
    Document,
    FitOptions,
    Plotter,
    Progress,
    Result,
    Scene,
    placeholder,
    quantize,
    vectorize,
    write_svg,
)  # fmt: skip
from gauss2svg.errors import RendererError
from gauss2svg.measure.heatmap import colors_of, errors
from gauss2svg.measure.metrics import psnr
from gauss2svg.photo.load import load_image
from gauss2svg.photo.pixels import over
from gauss2svg.pipeline.plan import PRESETS
from gauss2svg.raster import RENDERERS, rasterize
from gauss2svg.render import render
from gauss2svg.scene.areas import AreaCounts
from gauss2svg.scene.falloff import BETA_CLASSES, cut_radius, profile
from gauss2svg.svg.forms import gradient_stops

COUNTS = (8, 32, 128, 512, 2048, 8192)  # shapes of the pictures of the start page
WIDTH_PX = 1200
INKS = "#ffffff,#e0a070,#a04818,#201008"


def sizes() -> Figure:
    """Return one photo in files of four sizes."""
    limits = [{"max_bytes": size} for size in (5000, 20_000, 60_000, 150_000)]
    return compared(shipped("chelsea"), "{kB:.0f} kB, {psnr_svg:.1f} dB", limits, "")


def decibels() -> Figure:
    """Return one photo at four PSNRs."""
    targets = [{"target_psnr": target} for target in (25, 30, 35, 40)]
    return compared(coffee(360), "{psnr_svg:.0f} dB, {kB:.0f} kB", targets, "")


def logos() -> Figure:
    """Return a ball with a soft shadow: its areas, with Gaussians, shapes alone, the picture."""
    ball = rasterize((PICTURES / "ball.svg").read_text(), 256, 256)
    both, alone = vectorized(ball), vectorized(ball, areas="never")
    scene = both.scene
    areas = rasterize(write_svg(scene.select(slice(0))), 256, 256)
    titles = [f"{len(scene.areas)} areas and lines", f"and {len(scene)} Gaussians"]
    titles[1] += said(both, ": {kB:.0f} kB, {psnr_svg:.1f} dB")
    titles.append(said(alone, "--areas never: {kB:.0f} kB, {psnr_svg:.1f} dB"))
    return tiles([areas, both.raster, alone.raster, ball], [*titles, "the picture"], columns=2)


def inks() -> Figure:
    """Return a cup of coffee in few inks, and the picture."""
    options = [{"inks": k, "max_bytes": 20_000, "markup": "minimal"} for k in (3, 6, 12)]
    return compared(shipped("coffee"), "{inks} inks: {psnr_svg:.1f} dB", options, "the picture")


def riso() -> Figure:
    """Return an astronaut in two inks that overprint, the plates, and the same in other inks."""
    given = {"paper": "#f5f0e6", "size": "190mm"}
    one = vectorized(shipped("astronaut"), inks="#0078bf,#ff48b0", overprint=3, **given)
    plates = [rasterize(svg, 512, 512) for svg in one.plates().values()]
    other = vectorized(shipped("astronaut"), inks="#3255a4,#ff6c2f", overprint=5, **given)
    pictures = [one.raster, *plates, other.raster]
    titles = ["blue and pink", "blue plate", "pink plate", "blue and orange"]
    return tiles(pictures, titles, columns=4)


def focus() -> Figure:
    """Return an astronaut in 30 kB without and with a mask over her face, and parts of both."""
    photo, (y, x) = shipped("astronaut"), np.mgrid[:512, :512]
    face = np.hypot((x - 220) / 80, (y - 115) / 100) < 1
    found = [
        vectorize(photo, max_bytes=30_000, focus=face, fit=FitOptions(focus_strength=strength))
        for strength in (1, 4)
    ]
    pictures = [part(r.raster, *at) for at in ((0, 0, 1), (0.25, 0.02, 0.36)) for r in found]
    scores = ": face {psnr_svg_inside:.1f} dB, rest {psnr_svg_outside:.1f}"
    titles = [said(r, name + scores) for r, name in zip(found, ("without", "with"), strict=True)]
    return tiles(pictures, [*titles, "", ""], columns=2)


def frames() -> Iterator[np.ndarray]:
    """Yield ten frames of a film, a crop that moves by 3 px and narrows by 1 % in each."""
    photo, (width, height) = Image.fromarray(data.coffee()), (384, 256)
    across = 0.78 * min(photo.width, photo.height * width / height)
    for k in range(10):
        side, x, y = across * 0.99**k, 0.03 * photo.width + 4 * k, 0.03 * photo.height + 2 * k
        box = (x, y, x + side, y + side * height / width)
        yield np.asarray(photo.resize((width, height), Image.Resampling.LANCZOS, box=box))


def refine() -> Figure:
    """Return frames of a film, each refined from the frame before it."""
    results = list[Result]()
    for frame in frames():
        start = results[-1].scene if results else None
        results.append(vectorize(frame, gaussians=1000, start=start))
    titles = [said(results[k], f"frame {k + 1}: {{psnr_svg:.1f}} dB") for k in (0, 1, 9)]
    return tiles([results[k].raster for k in (0, 1, 9)], titles, columns=3)


def editors() -> Figure:
    """Return a file in minimal markup as resvg and as Inkscape draw it, and an editable one."""
    photo = coffee(480)
    files = [vectorized(photo, max_bytes=20_000, markup=m) for m in ("minimal", "editable")]
    by_inkscape = [rasterize(file.svg, 480, 320, "inkscape") for file in files]
    titles = ["minimal, by resvg", "minimal, by Inkscape", "editable, by Inkscape", "the photo"]
    return tiles([files[0].raster, *by_inkscape, photo], titles, columns=2)


def presets() -> Figure:
    """Return one photo by each preset, and a part of each at three times the size."""
    photo = coffee(360)
    found = [vectorize(photo, quality=name) for name in PRESETS]
    whole = [*(r.raster for r in found), photo]
    left, top, width, height = 65, 125, 120, 80  # px of the part
    moved = [r.scene.replace(mean=r.scene.mean - [left, top]) for r in found]
    near = [render(s.replace(width=width, height=height), 3 * width, 3 * height) for s in moved]
    near.append(enlarged(photo[top : top + height, left : left + width], 3, BICUBIC))
    titles = [f"{name}: {said(r, '{kB:.0f} kB')}" for name, r in zip(PRESETS, found, strict=True)]
    order = [*whole[:3], *near[:3], *whole[3:], *near[3:]]
    return tiles(order, [*titles[:3], *[""] * 3, *titles[3:], "the photo", *[""] * 3], columns=3)


def placeholders() -> Figure:
    """Return what a page shows before the photo has come, by bytes, and after."""
    photo = shipped("rocket")
    svgs = [placeholder(photo, max_bytes=limit).svg for limit in (500, 1000, 2000)]
    titles = [f"before: {len(svg)} bytes" for svg in svgs]
    shown = [drawn(svg, *photo.shape[:2]) for svg in svgs]
    return tiles([*shown, photo], [*titles, "after: the photo"], columns=2)


def webp() -> Figure:
    """Return a photo in 1500 bytes as WebP and as a placeholder, and the photo."""
    photo, limit = shipped("chelsea"), 1500
    best = max(webps(photo, limit), key=lambda shown: psnr(shown, photo))
    ours = drawn(placeholder(photo, max_bytes=limit).svg, *photo.shape[:2])
    names = (("WebP", best), ("gauss2svg", ours))
    titles = [f"{name}: {psnr(shown, photo):.1f} dB" for name, shown in names]
    return tiles([best, ours, photo], [*titles, "the photo"], columns=3)


def drawings() -> Figure:
    """Return FLIP by bytes of ten drawings and of vtracer's, from the table of the benchmarks."""
    rows = table_of("drawings.md", "| drawing | bytes | PSNR, dB | FLIP")[1:]
    by_name = {row[0]: [r for r in rows if r[0] == row[0]] for row in rows}
    whole = [mine for mine in by_name.values() if all(row[6] != "-" for row in mine)]
    ticks = {float(n): str(n) for n in (2, 5, 10, 20, 50)}
    figure, axis = chart(3.4, "kB", "FLIP, lower is better", ticks, ylim=(0, 0.45))
    for column, label, colour in ((3, "gauss2svg", "#1668c1"), (6, "vtracer", "#c8501e")):
        values = np.array([[float(row[column]) for row in mine] for mine in whole])
        for one in values:
            axis.plot(list(ticks), one, color=colour, linewidth=0.6, alpha=0.35)
        axis.plot(list(ticks), values.mean(axis=0), "o-", color=colour, label=label)
    axis.legend(fontsize=12)
    return figure


def counts() -> Figure:
    """Return PSNR on Kodak-24 by the number of shapes, from the table of the benchmarks."""
    names, *rows = table_of("peers.md", "| method |")
    numbers = [int(cell.replace(" ", "")) for cell in names[1:]]
    ticks = {256.0: "256", 1e3: "1000", 5e3: "5000", 1e4: "10 000", 5e4: "50 000"}
    figure, axis = chart(5, "shapes", "PSNR on Kodak-24, dB", ticks, ylim=(22, 52))
    for name, *cells in rows:
        points = [(n, float(c)) for n, c in zip(numbers, cells, strict=True) if c]
        ours = name.startswith("gauss2svg")
        style = "o-" if ours else "s--" if "curves" in name else "^:"
        axis.plot(*zip(*points, strict=True), style, label=name, markersize=4,
                  color="black" if ours else None, linewidth=2 if ours else 1,
                  zorder=3 if ours else 2)  # fmt: skip
    axis.legend(fontsize=10.5, loc="upper left", ncols=2)
    return figure


def progressive_fit() -> Figure:
    """Return the rounds of one file, one after the other."""
    scene = vectorize(coffee(300), gaussians=1000).scene
    steps = [upto(scene, share) for share in np.linspace(0, 1, 5)]
    titles = [f"round {s.round_index.max() + 1}: {len(s)} Gaussians" for s in steps]
    return tiles([render(s, 600, 400) for s in steps], titles)


def layers() -> Figure:
    """Return layers of a file alone, and the picture as they come one after the other."""
    scene = vectorize(coffee(300), gaussians=600).scene
    steps = [upto(scene, share) for share in np.linspace(0, 1, 4)]
    last = [int(s.round_index.max()) for s in steps]
    alone = [scene.select(scene.round_index == k).replace(background=np.ones(3)) for k in last]
    titles = [f"round {k + 1}: {len(s)}" for k, s in zip(last, alone, strict=True)]
    titles += [f"up to {k + 1}: {len(s)}" for k, s in zip(last, steps, strict=True)]
    return tiles([render(s, 480, 320) for s in (*alone, *steps)], titles, columns=4)


def forming() -> str:
    """Return a file whose rounds fade in."""
    scene = vectorize(coffee(300), gaussians=190).scene
    alt = "A cup of coffee that forms from large shapes to small ones within six seconds"
    return write_svg(scene, document=Document(title="Coffee", alt=alt, animate=6))


def scenes() -> Figure:
    """Return a scene, edited as arrays: its large shapes, other colours, crisp rims."""
    scene = vectorize(coffee(300), gaussians=600).scene
    large = scene.select(scene.sigma.max(axis=1) > 4)
    edited = {
        "the scene": scene,
        f"the {len(large)} large shapes": large,
        "warmer": scene.replace(color=scene.color ** [0.75, 1, 1.3]),
        "every rim crisp": scene.replace(beta=np.full(len(scene), 64.0)),
    }
    return tiles([render(s, 480, 320) for s in edited.values()], list(edited), columns=2)


def printed() -> Figure:
    """Return a small photo four times as large: by bicubic interpolation, by shapes, the photo."""
    whole = shipped("astronaut")
    small = to_width(whole, 128)
    shapes = rasterize(vectorize(small, gaussians=2000).svg, 512, 512)
    shown = {"bicubic": enlarged(small, 4, BICUBIC), "gauss2svg": shapes}
    titles = [f"{name}: {psnr(one, whole):.1f} dB" for name, one in shown.items()]
    crops = [part(one, 0.28, 0.02, 0.4) for one in (*shown.values(), whole)]
    return tiles(crops, [*titles, "photo, 512 px"], columns=3)


def traced() -> Figure:
    """Return letters of a logo, enlarged: shapes alone, by default, vtracer, the truth."""
    import vtracer  # pyright: ignore[reportMissingImports]

    source = (PICTURES / "badge.svg").read_text()
    logo, truth = (rasterize(source, side, side) for side in (512, 2048))
    png = encoded(logo, "PNG")
    theirs = vtracer.convert_raw_image_to_svg(png, img_format="png", path_precision=2)
    alone = vectorized(logo, areas="never").svg
    svgs = {"--areas never": alone, "by default": vectorize(logo).svg, "vtracer": theirs}
    shown = [drawn(svg, 2048, 2048) for svg in svgs.values()]
    titles = [f"{name}: {len(svg) / 1000:.0f} kB" for name, svg in svgs.items()]
    crops = [part(one, 0.3, 0.34, 0.24) for one in (*shown, truth)]
    return tiles(crops, [*titles, "the drawing"], columns=2)


def line_art() -> np.ndarray:
    """Return a cup of coffee in black lines."""
    return load_image(ROOT / "benchmarks/pictures/line-art.png").pixels


def plotters() -> Figure:
    """Return a photo and line art as a pen of 0.3 mm draws them on A4, and a part of the photo."""
    photo, lines = (
        rasterize(vectorized(pixels).plot().svg, 1680, 2376)[468:1908, 120:1560]
        for pixels in (shipped("astronaut"), line_art())
    )
    titles = ["a photo", "a part of it", "line art"]
    return tiles([photo, part(photo, 0.28, 0.04, 0.3), lines], titles, columns=3)


def transparent() -> Figure:
    """Return one transparent SVG over a light, a dark and a chequered page."""
    y, x = np.mgrid[:512, :512]
    ellipse = np.clip(4 - 4 * np.hypot((x - 230) / 210, (y - 200) / 230), 0, 1)
    photo = np.dstack([data.astronaut() / 255, ellipse])
    raster = rasterize(vectorize(to_width(photo, 256), gaussians=1500).svg, 512, 512, alpha=True)
    checks = np.where((x // 32 + y // 32) % 2, 0.75, 1.0)[:, :, None] * np.ones(3)
    pages = {
        "on white": np.ones(3), "on a dark page": np.array([0.11, 0.15, 0.26]),
        "on a pattern": checks,
    }  # fmt: skip
    return tiles([over(raster, page) for page in pages.values()], list(pages), columns=3)


def errors_map() -> Figure:
    """Return a photo, its SVG and the map of errors that check writes."""
    photo = coffee(360)
    result = vectorize(photo, quality="fast")
    heat = colors_of(errors(result.raster, photo)) / 255
    return tiles([photo, result.raster, heat], ["photo.jpg", "out.svg", "errors.png"], columns=3)


def interrupted() -> Figure:
    """Return what is left of a fit that ends early, and the whole one."""
    rasters, titles = [], []
    for share in (0.15, 0.4, 1.0):
        done = [0.0]

        def watch(progress: Progress, done: list[float] = done) -> None:
            done[0] = progress.fit.done if progress.fit else done[0]

        def ends(done: list[float] = done, share: float = share) -> bool:
            return done[0] >= share

        result = vectorize(coffee(300), gaussians=1000, progress=watch, stop=ends)
        rasters.append(result.raster)
        when = "whole" if share == 1 else f"ended at {share:.0%}"
        titles.append(said(result, when + ": {psnr_svg:.1f} dB"))
    return tiles(rasters, titles, columns=3)


def model() -> Figure:
    """Return the falloff of some exponents, and one ellipse with each."""
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(WIDTH_IN, 2.3), layout="constrained", width_ratios=(1.25, 1)
    )
    r = np.linspace(0, 3.2, 400)
    betas = (1.0, 1.7, 3.0, 16.0)
    shapes = Scene(
        4, 1,
        mean=np.array([[k + 0.5, 0.5] for k in range(4)]), sigma=np.full((4, 2), 0.16),
        rho=np.full(4, 0.6), color=np.tile([0.1, 0.3, 0.6], (4, 1)), opacity=np.ones(4),
        beta=np.array(betas),
    )  # fmt: skip
    row = render(shapes, 800, 200)
    right.imshow(np.block([[[row[:, :400]]], [[row[:, 400:]]]]))
    for k, beta in enumerate(betas):
        left.plot(r, profile(r, beta), label=f"beta = {beta:g}")
        right.text(200 * (k % 2) + 6, 200 * (k // 2) + 22, f"beta = {beta:g}", fontsize=8)
    left.set(xlabel="Mahalanobis distance r", ylabel="falloff f(r)")
    left.legend(fontsize=8)
    right.axis("off")
    return figure


def areas() -> Figure:
    """Return the outlines of areas and lines with their nodes, and the same painted."""
    cat = vectorized(rasterize((PICTURES / "cat.svg").read_text(), 256, 256))
    outlines = re.sub(r'stroke="#\w+"', 'stroke="#000"', cat.outline())
    titles = [said(cat, "{area_count} areas, {line_count} lines, {node_count} nodes")]
    titles.append(said(cat, "painted: {kB:.1f} kB, {psnr_svg:.1f} dB"))
    figure = tiles([rasterize(outlines, 768, 768), rasterize(cat.svg, 768, 768)], titles)
    nodes = [outline.nodes for area in cat.scene.areas for outline in area.outlines]
    figure.axes[0].plot(*3 * np.concatenate(nodes).T, "o", color="tab:red", markersize=3)
    return figure


def gaussian_count() -> Figure:
    """Return pictures and the numbers of Gaussians that they get."""
    dark, light = np.array([0.10, 0.20, 0.50]), np.array([0.95, 0.75, 0.30])
    ramp = np.linspace(0, 1, 256)[None, :, None] * np.ones((256, 1, 1))
    squares: dict[str, Pixels] = {
        name: np.round(255 * (dark + (light - dark) * share)) / 255
        for name, share in (("flat", 0 * ramp), ("linear ramp", ramp))
    }
    for name in ("logo", "coins", "astronaut"):
        side = min(shipped(name).shape[:2])
        squares[name] = shipped(name)[:side, :side]
    results = {name: vectorize(np.float32(pixels)) for name, pixels in squares.items()}
    titles = [f"{name}: {len(result.scene)}" for name, result in results.items()]
    return tiles([result.raster for result in results.values()], titles)


def writing_svg() -> Figure:
    """Return a gradient's stops beside the falloff, and what renderers make of one file."""
    scene = quantize(vectorize(coffee(240), gaussians=1500).scene, palette=300)
    svg, exact = write_svg(scene), render(scene)
    pictures = {}
    for name in RENDERERS:
        try:
            raster = rasterize(svg, 240, 160, name)
        except RendererError as error:
            print(f"without {name}: {error}")
        else:
            title = f"{name}: {psnr(raster, exact):.1f} dB"
            pictures[title] = np.clip(0.5 + 16 * (raster - exact), 0, 1)
    figure = plt.figure(figsize=(WIDTH_IN, 4.2), layout="constrained")
    upper, lower = np.ravel(np.array(figure.subfigures(2, 1, height_ratios=(1, 1.15))))
    for axis, beta in zip(upper.subplots(1, 3, sharey=True), BETA_CLASSES[:3], strict=True):
        radius = float(cut_radius(beta))
        r = np.linspace(0, radius, 300)
        offsets, opacities = gradient_stops(5, beta)
        axis.plot(r, profile(r, beta), color="#999", linewidth=3, label="falloff")
        axis.plot(np.multiply(offsets, radius), opacities, "o-", markersize=3, label="stops")
        axis.set_title(f"beta = {beta:g}", fontsize=8)
        axis.tick_params(labelsize=7)
    upper.axes[-1].legend(fontsize=7)
    axes = np.ravel(lower.subplots(2, -(-len(pictures) // 2)))
    for axis, (title, picture) in zip(axes, pictures.items(), strict=False):
        axis.imshow(picture)
        axis.set_title(title, fontsize=8)
    for axis in axes:
        axis.axis("off")
    return figure


def additive_blending() -> Figure:
    """Return what an additive scene adds, what it takes away, and both."""
    scene = vectorized(coffee(300), gaussians=400, blend="add").scene
    parts = [
        scene.replace(color=np.clip(scene.color, low, high), background=np.full(3, level))
        for low, high, level in ((0, 100, 0), (-100, 0, 1))
    ]
    names = ["positive parts, over black", "negative parts, over white", "background and both"]
    return tiles([render(s, 600, 400) for s in (*parts, scene)], names)


def extremes() -> Figure:
    """Return one scene at three zooms: a needle of aspect 1000, a crisp rim and a Gaussian."""
    scene = Scene(
        80, 60,
        mean=np.array([[40, 30], [40, 30.4], [36, 29]]),
        sigma=np.array([[18, 12], [30, 0.03], [0.4, 0.4]]),
        rho=np.array([0.3, 0, 0]),
        color=np.array([[0.95, 0.75, 0.3], [0.1, 0.2, 0.5], [0.8, 0.1, 0.1]]),
        opacity=np.ones(3), beta=np.array([1, 1, 200]),
    )  # fmt: skip
    zooms = (1, 10, 100)
    moved = [scene.replace(mean=scene.mean - [36.4, 29.4] + [40 / z, 30 / z]) for z in zooms]
    near = [s.replace(width=80 / z, height=60 / z) for s, z in zip(moved, zooms, strict=True)]
    return tiles([render(s, 480, 360) for s in near], [f"{z} times" for z in zooms])


def start(folder: Path) -> None:
    """Write the pictures of the start page's two sliders, and the lines that show them."""
    photo = load_image(COFFEE).pixels
    by_count = {f"{count}": vectorize(photo, gaussians=count) for count in COUNTS}
    pattern = "{gaussians} shapes: {kB:.0f} kB, {gz:.0f} kB gzipped, PSNR {psnr_svg:.1f} dB"
    coffee_slider = slider(
        folder,
        "A cup of coffee on a wooden table, drawn by soft shapes",
        "Few to many shapes",
        {name: (one.raster, said(one, pattern)) for name, one in by_count.items()},
    )
    enlarged_logo = slider(
        folder,
        "Letters and a star of a round logo, enlarged eight times",
        "A logo of 256 px, eight times as large: its pixels, vtracer, gauss2svg",
        {f"logo-{name}": shown for name, shown in logo_frames().items()},
    )
    (folder / "start.inc").write_text(coffee_slider + enlarged_logo)


def slider(folder: Path, alt: str, label: str, frames: dict[str, tuple[Pixels, str]]) -> str:
    """Write the pictures of a slider by their names, and return its HTML, which shows the last.

    A picture stands beside the line that describes it.
    """
    for name, (pixels, _) in frames.items():
        (folder / f"{name}.webp").write_bytes(encoded(pixels, "WEBP", quality=80, method=6))
    *_, (name, (pixels, _)) = frames.items()
    height, width = pixels.shape[:2]
    last = len(frames) - 1
    lines = "\n".join(f"<li>{line}</li>" for _, line in frames.values())
    return f"""<figure class="start">
<img src="_static/start/{name}.webp" width="{width}" height="{height}" alt="{alt}">
<label hidden>{label} <input type="range" min="0" max="{last}" value="{last}"></label>
<ol data-frames="{" ".join(frames)}">
{lines}
</ol>
</figure>
"""


def logo_frames() -> dict[str, tuple[Pixels, str]]:
    """Return part of a logo at eight times its 256 px, with a line: pixels, vtracer, gauss2svg."""
    import vtracer  # pyright: ignore[reportMissingImports]

    logo = rasterize((PICTURES / "badge.svg").read_text(), 256, 256)
    result = vectorize(logo)
    traced = vtracer.convert_raw_image_to_svg(encoded(logo, "PNG"), img_format="png")
    line = said(result, "gauss2svg: {kB:.1f} kB, ") + str(
        AreaCounts.of(result.scene.areas).without_nodes
    )
    large = {
        "pixels": (enlarged(logo, 8, Image.Resampling.NEAREST), "256 x 256 pixels"),
        "vtracer": (drawn(traced, 2048, 2048), f"vtracer: {len(traced) / 1000:.1f} kB"),
        "gauss2svg": (rasterize(result.svg, 2048, 2048), line),
    }
    return {name: (one[820:1220, 620:1220], line) for name, (one, line) in large.items()}


def results(folder: Path) -> None:
    """Write the six results that the start page and the guide link to, of 480x320 px each."""
    cup, rocket = shipped("coffee"), shipped("rocket")
    before = drawn(placeholder(rocket, max_bytes=1000).svg, *rocket.shape[:2])
    half = rocket.shape[1] // 2
    small = Plotter(sheet="120x80mm", margin=2, pen_width=0.5)
    scene = vectorize(coffee(480), gaussians=600).scene
    thirds = [render(upto(scene, share), 480, 320) for share in (0, 0.5, 1)]
    pictures = {
        "size": vectorize(shipped("chelsea"), max_bytes=60_000).raster,
        "placeholder": np.hstack([before[:, :half], rocket[:, half:]]),
        "logo": vectorize(shipped("logo"), max_bytes=20_000).raster,
        "poster": vectorized(cup, inks=6, max_bytes=20_000).raster,
        "plot": rasterize(vectorized(line_art()).plot(small).svg, 960, 640),
        "layers": np.hstack([p[:, 160 * k : 160 * (k + 1)] for k, p in enumerate(thirds)]),
    }
    for name, pixels in pictures.items():
        image, size = eight_bits(pixels), (480, 320)
        whole = name == "logo"
        framed = ImageOps.pad(image, size, color="white") if whole else ImageOps.fit(image, size)
        (folder / f"{name}.webp").write_bytes(encoded(framed, "WEBP", quality=75, method=6))


def readme(_: Path) -> None:
    """Write the README's picture: a photo by soft shapes, and part of a logo at 8x."""
    photo = load_image(COFFEE).pixels
    results = [vectorize(photo, gaussians=count) for count in (200, 5000)]
    titles = [said(r, "{gaussians} shapes, {gz:.0f} kB gzipped") for r in results]
    large = logo_frames()
    names = {"pixels": "a logo, 8 times as large", "vtracer": "vtracer", "gauss2svg": "gauss2svg"}
    titles += ["the photo", *names.values()]
    pictures = [*(r.raster for r in results), photo, *(large[name][0] for name in names)]
    figure = tiles(pictures, titles, columns=3)
    for axis in figure.axes:
        axis.title.set_fontsize(9)
    png(figure, 180).save(ROOT / "examples/showcase.jpg", quality=85)


OF_START = {f.__name__: f for f in (start, results, readme, gallery)}
FIGURES: dict[str, Callable[[], Figure | Image.Image | str]] = {
    **{f.__name__.replace("_", "-"): f for f in (
        sizes, decibels, logos, inks, riso, focus,
        refine, editors, presets, placeholders, webp, drawings,
        counts, progressive_fit, layers, forming, scenes, printed, traced, plotters,
        transparent, interrupted, model, areas, gaussian_count, writing_svg, additive_blending,
        extremes, studio,
    )},
    "errors": errors_map,
}  # fmt: skip


def main() -> None:
    """Write the figures that are named, or all."""
    folder, names = Path(sys.argv[1]), sys.argv[2:] or [*OF_START, *FIGURES]
    for sub in ("start", "figures"):
        (folder / sub).mkdir(parents=True, exist_ok=True)
    for name in names:
        if name in OF_START:
            OF_START[name](folder / "start")
            continue
        figure, suffix = FIGURES[name](), "webp"
        if isinstance(figure, str):
            file, suffix = figure.encode(), "svg"
        else:
            image = png(figure, WIDTH_PX / WIDTH_IN) if isinstance(figure, Figure) else figure
            file = small_webp(image)
        if len(file) > MOST_BYTES:
            raise SystemExit(f"{name} must have at most {MOST_BYTES} bytes; got {len(file)}")
        (folder / "figures" / f"{name}.{suffix}").write_bytes(file)
        print(f"{name}: {len(file)} bytes")


if __name__ == "__main__":
    main()
