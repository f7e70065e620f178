"""Make the pictures of the documentation, each under 60 kB.

    python benchmarks/figures.py docs/_static [start model progressive-fit ...]

FOLDER/figures/NAME.webp, or NAME.svg, stands on the page that names it; guide_figures.py draws
those of the guide. FOLDER/start has the pictures of the start page and start.inc, which shows them,
and by the name results the six results that the start page and the guide link to.
"""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import scenes
from common import eight_bits, encoded
from guide_figures import FIGURES as OF_THE_GUIDE
from matplotlib.figure import Figure
from panels import COFFEE, WIDTH_IN, coffee, tiles
from PIL import Image, ImageOps
from screenshots import inkscape, studio
from skimage import data
from small import of_another_tool

from gauss2svg import (
    FitOptions,
    Scene,
    SvgOptions,
    placeholder,
    quantize,
    vectorize,
    write_svg,
)  # fmt: skip
from gauss2svg.errors import RendererError
from gauss2svg.measure.metrics import psnr
from gauss2svg.photo.load import load_image
from gauss2svg.raster import RENDERERS, rasterize
from gauss2svg.render import render
from gauss2svg.scene.falloff import BETA_CLASSES, cut_radius, profile
from gauss2svg.svg.stops import gradient_stops

COUNTS = (8, 32, 128, 512, 2048, 8192)
MOST_BYTES = 60_000
WIDTH_PX = 1200


def small_webp(image: Image.Image) -> bytes:
    """An image as WebP of at most MOST_BYTES, as good as that allows; lines without loss."""
    smaller = image.resize((image.width * 3 // 4, image.height * 3 // 4), Image.Resampling.LANCZOS)
    exact = encoded(image, "WEBP", lossless=True, method=4)
    for picture in (image, smaller):
        for quality in (80, 72, 64, 56):
            data = min(exact, encoded(picture, "WEBP", quality=quality, method=6), key=len)
            if len(data) <= MOST_BYTES:
                return data
    raise SystemExit(f"a figure must have at most {MOST_BYTES} bytes; got {len(data)}")


def start(folder: Path) -> None:
    """The pictures of the start page's slider, and the lines that show them."""
    folder.mkdir(parents=True, exist_ok=True)
    photo = load_image(COFFEE).pixels
    frames = []
    for count in COUNTS:
        result = vectorize(photo, gaussians=count)
        report = result.report
        (folder / f"{count}.webp").write_bytes(encoded(result.raster, "WEBP", quality=80, method=6))
        frames.append(
            f"<li>{len(result.scene)} shapes: "
            f"{report['svg_bytes'] / 1000:.0f} kB, {report['svgz_bytes'] / 1000:.0f} kB gzipped, "
            f"PSNR {report['psnr_svg']:.1f} dB</li>"
        )
        print(frames[-1])
    height, width = photo.shape[:2]
    (folder / "start.inc").write_text(
        '<figure class="start" id="start">\n'
        f'<img src="_static/start/{COUNTS[-1]}.webp" width="{width}" height="{height}" '
        'alt="A cup of coffee on a wooden table, drawn by soft shapes">\n'
        '<label hidden>Few to many shapes <input type="range" min="0" '
        f'max="{len(COUNTS) - 1}" value="{len(COUNTS) - 1}"></label>\n'
        f'<ol data-frames="{" ".join(map(str, COUNTS))}">\n' + "\n".join(frames) + "\n</ol>\n"
        "</figure>\n"
    )


def results(folder: Path) -> None:
    """Write the six results that the start page and the guide link to, of 480x320 px each."""
    cup, rocket = data.coffee(), data.rocket() / 255
    height, width = rocket.shape[:2]
    before = rasterize(placeholder(data.rocket(), max_bytes=1000).svg, width, height)
    half = width // 2
    logo = np.asarray(Image.fromarray(data.logo()).convert("RGB")) / np.float32(255)
    inked = vectorize(cup, gaussians=300, fit=FitOptions(inks="#ffffff,#e0a070,#a04818,#201008"))
    lines = re.sub(r'stroke-width="[^"]*"', 'stroke-width="1"', inked.outline())
    rounds = [upto(vectorize(coffee(480), gaussians=600).scene, share) for share in (0, 0.5, 1)]
    thirds = [render(scene, 480, 320)[:, 160 * k : 160 * (k + 1)] for k, scene in enumerate(rounds)]
    pictures = {
        "size": vectorize(data.chelsea(), max_bytes=60_000).raster,
        "placeholder": np.hstack([before[:, :half], rocket[:, half:]]),
        "logo": vectorize(logo, max_bytes=20_000).raster,
        "poster": vectorize(cup, fit=FitOptions(inks=6), max_bytes=20_000).raster,
        "plot": of_another_tool(lines, np.ones((400, 600, 3))),
        "layers": np.hstack(thirds),
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, pixels in pictures.items():
        image = eight_bits(pixels)
        if name == "logo":
            framed = ImageOps.pad(image, (480, 320), color="white")
        else:
            framed = ImageOps.fit(image, (480, 320))
        file = encoded(framed, "WEBP", quality=75, method=6)
        (folder / f"{name}.webp").write_bytes(file)
        print(f"{name}: {len(file)} bytes")


def upto(scene: Scene, share: float) -> Scene:
    """The first rounds of a scene, up to a share of them and at least one."""
    last = scene.round_index.max()
    return scene.select(scene.round_index <= round(share * last))


def model() -> Figure:
    """The falloff of some exponents, and one ellipse with each."""
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(WIDTH_IN, 2.3), layout="constrained", width_ratios=(1.25, 1)
    )
    r = np.linspace(0, 3.2, 400)
    betas = (1.0, 1.7, 3.0, 16.0)
    for beta in betas:
        left.plot(r, profile(r, beta), label=f"beta = {beta:g}")
    left.set_xlabel("Mahalanobis distance r")
    left.set_ylabel("falloff f(r)")
    left.legend(fontsize=8)
    shapes = Scene(
        4, 1,
        mean=np.array([[k + 0.5, 0.5] for k in range(4)]), sigma=np.full((4, 2), 0.16),
        rho=np.full(4, 0.6), color=np.tile([0.1, 0.3, 0.6], (4, 1)), opacity=np.ones(4),
        beta=np.array(betas),
    )  # fmt: skip
    row = render(shapes, 800, 200)
    right.imshow(np.block([[[row[:, :400]]], [[row[:, 400:]]]]))
    for k, beta in enumerate(betas):
        right.text(200 * (k % 2) + 6, 200 * (k // 2) + 22, f"beta = {beta:g}", fontsize=8)
    right.axis("off")
    return figure


def progressive_fit() -> Figure:
    """The rounds of one file, one after the other."""
    photo = coffee(300)
    result = vectorize(photo, gaussians=1000)
    scene = result.scene
    rounds = np.unique(scene.round_index)
    chosen = rounds[np.round(np.linspace(0, len(rounds) - 1, 5)).astype(int)]
    upto = [scene.select(scene.round_index <= k) for k in chosen]
    names = [f"round {k + 1}: {len(s)} Gaussians" for k, s in zip(chosen, upto, strict=True)]
    return tiles([render(s, 600, 400) for s in upto], names)


def gaussian_count() -> Figure:
    """Pictures and the numbers of Gaussians that they get."""
    drawn, titles = [], []
    for name, picture in scenes.pictures():
        if name in ("flat", "linear ramp", "logo", "coins", "astronaut"):
            side = min(picture.shape[:2])
            result = vectorize(np.ascontiguousarray(picture[:side, :side]))
            drawn.append(result.raster)
            titles.append(f"{name}: {len(result.scene)}")
    return tiles(drawn, titles)


def writing_svg() -> Figure:
    """A gradient's stops beside the falloff, and what renderers make of one file."""
    photo = coffee(240)
    scene = quantize(vectorize(photo, gaussians=1500).scene, palette=300)
    svg, exact = write_svg(scene), render(scene)
    names, pictures = [], []
    for name in RENDERERS:
        try:
            raster = rasterize(svg, 240, 160, name)
        except RendererError as error:
            print(f"without {name}: {error}")
            continue
        names.append(f"{name}: {psnr(raster, exact):.1f} dB")
        pictures.append(np.clip(0.5 + 16 * (raster - exact), 0, 1))
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
    for axis, picture, name in zip(
        lower.subplots(2, -(-len(names) // 2)).flat, pictures, names, strict=False
    ):
        axis.imshow(picture)
        axis.set_title(name, fontsize=8)
    for axis in lower.axes:
        axis.axis("off")
    return figure


def additive_blending() -> Figure:
    """What an additive scene adds, what it takes away, and both."""
    scene = vectorize(coffee(300), gaussians=400, fit=FitOptions(blend="add")).scene
    parts = [
        scene.replace(color=np.clip(scene.color, low, high), background=np.full(3, level))
        for low, high, level in ((0, 100, 0), (-100, 0, 1))
    ]
    names = ["positive parts, over black", "negative parts, over white", "background and both"]
    return tiles([render(s, 600, 400) for s in (*parts, scene)], names)


def extremes() -> Figure:
    """One scene at three zooms: a needle of aspect 1000, a crisp rim and a Gaussian."""
    scene = Scene(
        80, 60,
        mean=np.array([[40, 30], [40, 30.4], [36, 29]]),
        sigma=np.array([[18, 12], [30, 0.03], [0.4, 0.4]]),
        rho=np.array([0.3, 0, 0]),
        color=np.array([[0.95, 0.75, 0.3], [0.1, 0.2, 0.5], [0.8, 0.1, 0.1]]),
        opacity=np.ones(3), beta=np.array([1, 1, 200]),
    )  # fmt: skip
    zoomed = []
    for zoom in (1, 10, 100):
        moved = scene.replace(mean=scene.mean - [36.4, 29.4] + [40 / zoom, 30 / zoom])
        near = moved.replace(width=80 / zoom, height=60 / zoom)
        zoomed.append(render(near, 480, 360))
    return tiles(zoomed, [f"{z} times" for z in (1, 10, 100)])


def logos() -> Figure:
    """A logo in files of some sizes, and the picture."""
    logo = np.asarray(Image.fromarray(data.logo()).convert("RGB")) / np.float32(255)
    results = [vectorize(logo, max_bytes=limit) for limit in (5000, 20_000)] + [vectorize(logo)]
    figures = [(r.report["svg_bytes"] / 1000, r.report["psnr_svg"]) for r in results]
    titles = [f"{size:.0f} kB: {match:.1f} dB" for size, match in figures]
    return tiles([*(r.raster for r in results), logo], [*titles, "the picture"], columns=2)


def inks() -> Figure:
    """A cup of coffee in few inks, and the picture."""
    picture = data.coffee() / np.float32(255)
    counts = (3, 6, 12)
    svg = SvgOptions(markup="minimal")
    results = [
        vectorize(picture, max_bytes=20_000, fit=FitOptions(inks=k), svg=svg) for k in counts
    ]
    titles = [
        f"{k} inks: {r.report['psnr_svg']:.1f} dB" for k, r in zip(counts, results, strict=True)
    ]
    return tiles([*(r.raster for r in results), picture], [*titles, "the picture"], columns=2)


FIGURES: dict[str, Callable[[], Figure | Image.Image | str]] = {
    **OF_THE_GUIDE,
    "studio": studio,
    "inkscape": inkscape,
    "model": model,
    "progressive-fit": progressive_fit,
    "gaussian-count": gaussian_count,
    "writing-svg": writing_svg,
    "additive-blending": additive_blending,
    "extremes": extremes,
    "logos": logos,
    "inks": inks,
}


def main() -> None:
    """Write the figures that are named, or all."""
    of_start = {"start": start, "results": results}
    folder, names = Path(sys.argv[1]), sys.argv[2:] or [*of_start, *FIGURES]
    for name in [n for n in names if n in of_start]:
        of_start[name](folder / "start")
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    for name in [n for n in names if n not in of_start]:
        figure, suffix = FIGURES[name](), "webp"
        if isinstance(figure, str):
            data, suffix = figure.encode(), "svg"
            if len(data) > MOST_BYTES:
                raise SystemExit(f"a figure must have at most {MOST_BYTES} bytes; got {len(data)}")
        elif isinstance(figure, Figure):
            stream = io.BytesIO()
            figure.savefig(stream, format="png", dpi=WIDTH_PX / WIDTH_IN)
            plt.close(figure)
            with Image.open(stream) as image:
                data = small_webp(image.convert("RGB"))
        else:
            data = small_webp(figure)
        (folder / "figures" / f"{name}.{suffix}").write_bytes(data)
        print(f"{name}: {len(data)} bytes")


if __name__ == "__main__":
    main()
