"""How true four SVG renderers draw crisp rims: gradients against plain ellipses.

    python examples/rims.py [--only centres plain fits]

Shapes of several exponents, sigmas and aspects are written by the project's writer and drawn
by resvg, CairoSVG, librsvg (rsvg-convert) and Chromium, as far as they are installed. A rim is
2.18 sigma_minor / beta px wide: there the falloff goes from 0.9 to 0.1. Ways to write:

    cut     a gradient in the circle of the cut radius, where it ends at 0
    wide    the same in a circle 0.7 px larger: its own antialiased edge is off the rim
    large   wide, and under gradients of radius 100 where the exponent is over 8: cairo keeps
            the inverse of the matrix in units of 1/65536
    plain   no gradient: the circle of the same mass, antialiased by the renderer

All tables take some ten minutes on two cores.
"""

from __future__ import annotations

import argparse
import math
import re
import shutil
import subprocess
import tempfile
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipe
from skimage import data

from gauss2svg import metrics
from gauss2svg.falloff import BETA_CLASSES, FALLOFFS, GAUSSIAN, cut_radius, in_classes, profile
from gauss2svg.fit import FitOptions, fit
from gauss2svg.image import load_image
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.svg.encode import SvgOptions
from gauss2svg.svg.stops import gradient_stops
from gauss2svg.svg.write import write_svg

Pixels = NDArray[np.floating]

_RIMS = 0.25, 0.35, 0.5, 0.7, 1.0, 2.0, 4.0  # px
_ASPECTS = 1, 4
_TURN = math.radians(30)
_RIM_WIDTH = math.log(math.log(0.1) / math.log(0.9)) / math.sqrt(2)  # times sigma / beta
_LEAST_SIGMA, _MOST_SIGMA = 0.35, 150.0
_SCALES = 1, 2, 4
_FINE = 8  # subpixels a side of what counts as the truth of a pixel
_INK, _PAPER = np.array([32, 48, 96]) / 255, np.array([240, 240, 224]) / 255
_OPACITIES = 1.0, 0.5
_MARGIN = 3  # px about a shape
_WAYS = "cut", "wide", "large"
_LARGE = 8.0  # larger exponents have a gradient of radius 100
_WIDER = 0.7  # px: from there on a pixel is wholly inside
_LENGTH = 300  # px of rim that a cell has at least, if so many shapes are allowed
_STOPS = 8
_EXACT = SvgOptions(palette=0, stops=_STOPS, decimals=6, opacity_decimals=6)
_FIT = FitOptions(1000, 200)
_SOFTNESSES = 0.75, 1.0, 1.5  # px
_WRITTEN = SvgOptions(palette=0, stops=_STOPS, decimals=2)


@dataclass(frozen=True)
class Cell:
    """A row of shapes of one exponent, rim and aspect, that do not overlap.

    scene lies on a canvas of its own, top px under the top of the sheet; length is that of
    all rims in px, each weighted by its squared opacity.
    """

    beta: float
    rim: float
    aspect: int
    scene: Scene
    top: int
    length: float

    def cropped(self, sheet: Pixels, scale: int) -> Pixels:
        """The part of a drawn sheet that shows this cell."""
        width, height = round(self.scene.width), round(self.scene.height)
        return sheet[self.top * scale : (self.top + height) * scale, : width * scale]

    def model(self, scale: int, finer: int = 1) -> Pixels:
        """The model at pixel centres, or the mean over finer x finer of them a pixel."""
        width, height = (round(s) * scale for s in (self.scene.width, self.scene.height))
        fine = render(self.scene, width * finer, height * finer, dtype=np.float64)
        return fine.reshape(height, finer, width, finer, 3).mean(axis=(1, 3))

    def distances(self, scale: int) -> tuple[NDArray[np.float64], ...]:
        """Radius r of the nearest shape, its slope in 1/px, its opacity; at pixel centres."""
        shown = self.scene.scaled(scale)
        y, x = np.mgrid[: round(shown.height), : round(shown.width)] + 0.5
        offset = np.stack([x, y], axis=-1)[None] - shown.mean[:, None, None]
        pulled = np.einsum("nij,nyxj->nyxi", shown.conic, offset)
        r = np.sqrt(np.einsum("nyxi,nyxi->nyx", pulled, offset))
        slope = np.linalg.norm(pulled, axis=-1) / np.maximum(r, 1e-9)
        nearest = r.argmin(axis=0)
        r, slope = (np.take_along_axis(a, nearest[None], axis=0)[0] for a in (r, slope))
        return r, slope, self.scene.opacity[nearest]

    def near_rim(self, scale: int) -> NDArray[np.bool_]:
        """Pixels at most one from where the falloff is in 0.01 to 0.99."""
        r, slope, _ = self.distances(scale)
        flat = math.sqrt(2) * (-math.log(0.99)) ** (0.5 / self.beta)
        return (r > flat - slope) & (r < cut_radius(self.beta) + slope)

    def stops(self, scale: int) -> Pixels:
        """What a perfect renderer would make of the gradient's stops."""
        r, _, opacity = self.distances(scale)
        share = np.interp(r / cut_radius(self.beta), *gradient_stops(_STOPS, self.beta))
        return _PAPER + (share * opacity)[:, :, None] * (_INK - _PAPER)


def cells_of(beta: float) -> list[Cell]:
    """Every rim and aspect of an exponent, stacked on a sheet."""
    cells: list[Cell] = []
    top = 0
    for aspect in _ASPECTS:
        for rim in _RIMS:
            minor = rim * beta / _RIM_WIDTH
            if minor >= _LEAST_SIGMA and minor * aspect <= _MOST_SIGMA:
                cells.append(_cell(beta, rim, aspect, top))
                top += round(cells[-1].scene.height)
    return cells


def _cell(beta: float, rim: float, aspect: int, top: int) -> Cell:
    minor = rim * beta / _RIM_WIDTH
    axes = np.array([[math.cos(_TURN), -math.sin(_TURN)], [math.sin(_TURN), math.cos(_TURN)]])
    covariance = axes @ np.diag([(minor * aspect) ** 2, minor**2]) @ axes.T
    sigma = np.sqrt(np.diag(covariance))
    half_width, half_height = np.ceil(sigma * cut_radius(beta) + _MARGIN)
    perimeter = math.sqrt(2) * 4 * minor * aspect * ellipe(1 - aspect**-2)
    count = 2 * math.ceil(np.clip(_LENGTH / perimeter, 2, 24) / 2)
    shift = np.random.default_rng(0).uniform(-0.5, 0.5, (count, 2))
    opacity = np.resize(_OPACITIES, count)
    scene = Scene(
        width=2 * half_width * count,
        height=2 * half_height,
        mean=np.stack([np.arange(count) * 2 + 1, np.ones(count)], 1) * [half_width, half_height]
        + shift,
        sigma=np.tile(sigma, (count, 1)),
        rho=np.full(count, covariance[0, 1] / sigma.prod()),
        color=np.tile(_INK, (count, 1)),
        opacity=opacity,
        background=_PAPER,
        beta=np.full(count, beta),
    )
    return Cell(beta, rim, aspect, scene, top, perimeter * float(np.square(opacity).sum()))


def sheet_of(cells: list[Cell]) -> Scene:
    """All cells on one canvas."""
    moved = [c.scene.replace(mean=c.scene.mean + [0, c.top]) for c in cells]
    return reduce(Scene.concatenate, moved).replace(
        width=max(c.scene.width for c in cells), height=sum(c.scene.height for c in cells)
    )


def written(scene: Scene, way: str, options: SvgOptions = _EXACT, plain: float = math.inf) -> str:
    """The SVG of a scene in one of _WAYS, or "plain": large, but shapes less soft than that."""
    svg = write_svg(scene, options)
    if way == "cut":
        return svg
    beta, widened = in_classes(scene.betas)
    scene = scene.replace(beta=beta, sigma=scene.sigma * widened[:, None])
    radii = 1 + _WIDER / (scene.ellipse_axes[0][:, 1] * cut_radius(beta))
    units = np.where((beta > _LARGE) & (way != "wide"), 100.0, 1.0)
    is_plain = (softness(scene) < plain) & (way == "plain")
    radii = np.where(is_plain, [_plain_radius(b) for b in beta.tolist()], radii)
    ids = re.findall(r'<circle fill="url\(#(\w+)\)"', svg)
    unit_of = dict(zip(ids, units.tolist(), strict=True))
    index = iter(range(len(scene)))

    def circle(match: re.Match[str]) -> str:
        i = next(index)
        unit = float(units[i])
        *axes, e, f = match["matrix"].split()
        matrix = " ".join([*(f"{float(v) / unit:.9g}" for v in axes), e, f])
        text = match[0].replace(match["matrix"], matrix)
        text = text.replace(' r="1"', f' r="{unit * radii[i]:.6g}"')
        if is_plain[i]:
            ink = "".join(f"{round(v * 255):02x}" for v in scene.color[i].tolist())
            text = re.sub(r"url\(#\w+\)", "#" + ink, text)
        return text

    def gradient(match: re.Match[str]) -> str:
        unit = unit_of[match["id"]]
        text = match[0].replace(' r="1"', f' r="{unit:g}"')
        return text.replace('fx=".001"', f'fx="{0.001 * unit:g}"')

    svg = re.sub(r'<radialGradient [^>]*id="(?P<id>\w+)"[^>]*>', gradient, svg)
    return re.sub(r"<circle [^>]*matrix\((?P<matrix>[^)]*)\)[^>]*>", circle, svg)


def softness(scene: Scene) -> NDArray[np.float64]:
    """(n,) px: a rim's width across the minor axis, times the fourth root of the aspect."""
    axes = scene.ellipse_axes[0]
    return _RIM_WIDTH / scene.betas * axes[:, 1] * (axes[:, 0] / axes[:, 1]) ** 0.25


@lru_cache
def _plain_radius(beta: float) -> float:
    """Share of the cut radius at which a disc has the mass of the falloff."""
    x = (np.arange(100_000) + 0.5) / 100_000
    return math.sqrt(2 * np.mean(profile(x * cut_radius(beta), beta) * x))


Renderer = Callable[[str, int, int, int], Pixels]


def renderers(folder: Path) -> dict[str, Renderer]:
    """Those that are installed, each a function of SVG, width and height in px, and scale."""

    def librsvg(svg: str, width: int, height: int, scale: int) -> Pixels:
        (folder / "drawn.svg").write_text(svg)
        size = ["-w", str(width * scale), "-h", str(height * scale)]
        _call("rsvg-convert", *size, "drawn.svg", "-o", "drawn.png")
        return load_image(folder / "drawn.png").pixels

    def chromium(svg: str, width: int, height: int, scale: int) -> Pixels:
        (folder / "drawn.svg").write_text(svg)
        page = '<body style="margin:0"><img src="drawn.svg" style="display:block">'
        (folder / "page.html").write_text(page)
        _call(
            browser, "--headless", "--no-sandbox", "--hide-scrollbars", "--screenshot=drawn.png",
            "--force-color-profile=srgb", f"--force-device-scale-factor={scale}",
            f"--window-size={width + 500},{height + 200}", "page.html",
        )  # fmt: skip
        return load_image(folder / "drawn.png").pixels[: height * scale, : width * scale]

    def _call(*command: str) -> None:
        subprocess.run(command, cwd=folder, check=True, capture_output=True)

    found: dict[str, Renderer] = {
        "resvg": lambda svg, w, h, k: rasterize(svg, w * k, h * k, "resvg"),
        "cairo": lambda svg, w, h, k: rasterize(svg, w * k, h * k, "cairo"),
    }
    browser = shutil.which("chromium") or shutil.which("google-chrome") or ""
    if shutil.which("rsvg-convert"):
        found["librsvg"] = librsvg
    if browser:
        found["chromium"] = chromium
    if missing := [n for n in ("librsvg", "chromium") if n not in found]:
        print(f"not installed, and left out: {', '.join(missing)}")
    return found


@dataclass
class Tally:
    """Differences of pictures, added up: squares over samples, and the largest, of 0..1."""

    squares: float = 0.0
    samples: int = 0
    worst: float = 0.0

    def add(self, difference: Pixels) -> None:
        """Count these in."""
        self.squares += float(np.sum(np.square(difference, dtype=np.float64)))
        self.samples += difference.size
        self.worst = max(self.worst, float(np.abs(difference).max(initial=0)))

    def __str__(self) -> str:
        if not self.samples:
            return "-"
        decibels = -10 * math.log10(max(self.squares / self.samples, 1e-12))
        return f"{decibels:.1f} {self.worst * metrics.LEVELS:2.0f}"


def print_centres(drawers: dict[str, Renderer]) -> None:
    """Against the model at pixel centres: by rim for each scale, by exponent for all."""
    tallies: defaultdict[tuple[object, ...], Tally] = defaultdict(Tally)
    for beta in BETA_CLASSES:
        cells = cells_of(beta)
        scene = sheet_of(cells)
        size = round(scene.width), round(scene.height)
        for scale in _SCALES:
            models = [cell.model(scale) for cell in cells]
            near = [cell.near_rim(scale) for cell in cells]
            for cell, model, rims in zip(cells, models, near, strict=True):
                difference = (cell.stops(scale) - model)[rims]
                tallies["stops", cell.rim, scale].add(difference)
                tallies["stops", beta].add(difference)
            for way, (name, draw) in product(_WAYS, drawers.items()):
                drawn = draw(written(scene, way), *size, scale)
                for cell, model, rims in zip(cells, models, near, strict=True):
                    difference = (cell.cropped(drawn, scale) - model)[rims]
                    tallies[way, name, cell.rim, scale].add(difference)
                    tallies[way, name, beta].add(difference)
    print("\nAgainst the model at pixel centres: PSNR in dB near the rim, largest error in levels")
    scales = "".join(f"{f'{scale}x':>9}" for scale in _SCALES)
    for way in _WAYS:
        print(f"\n{way:8}" + "".join(f" |{name:^27}" for name in ("exact stops", *drawers)))
        print(f"{'rim, px':8}" + f" |{scales}" * (1 + len(drawers)))
        for rim in _RIMS:
            groups = [("stops", rim), *((way, name, rim) for name in drawers)]
            cells = ["".join(f"{tallies[*g, k]!s:>9}" for k in _SCALES) for g in groups]
            print(f"{rim:<8}" + "".join(f" |{cell}" for cell in cells))
    print(f"\n{'all rims and scales':>20}" + "".join(f" |{name:^27}" for name in drawers))
    ways = "".join(f"{way:>9}" for way in _WAYS)
    print(f"{'beta':8}{'exact stops':>12}" + f" |{ways}" * len(drawers))
    for beta in BETA_CLASSES:
        cells = ["".join(f"{tallies[way, n, beta]!s:>9}" for way in _WAYS) for n in drawers]
        print(f"{beta:<8g}{tallies['stops', beta]!s:>12}" + "".join(f" |{c}" for c in cells))


def print_plain(drawers: dict[str, Renderer]) -> None:
    """Gradients and plain ellipses against the mean over each pixel, and its centre."""
    ways = "cut", "large", "plain"
    sums: defaultdict[tuple[object, ...], float] = defaultdict(float)
    contrast = float(np.sum(np.square(_INK - _PAPER))) / len(ways) / len(drawers)
    for beta in BETA_CLASSES[1:]:
        cells = cells_of(beta)
        scene = sheet_of(cells)
        truths = [(cell.model(1, _FINE), cell.model(1)) for cell in cells]
        for way, (name, draw) in product(ways, drawers.items()):
            drawn = draw(written(scene, way), round(scene.width), round(scene.height), 1)
            for cell, truth in zip(cells, truths, strict=True):
                place = cell.aspect, cell.rim
                sums[place] += cell.length * contrast
                for against, pixels in zip(("means", "centres"), truth, strict=True):
                    error = float(np.sum(np.square(cell.cropped(drawn, 1) - pixels)))
                    sums[way, name, against, *place] += error
    print("\nSquared error in 1/1000 px per px of rim, of full contrast; exponents over 1, 1x.")
    print("Against the means of pixels, then against their centres:", ", ".join(ways))
    print(f"\n{'':21}" + "".join(f" |{name:^42}" for name in drawers))
    head = "".join(f"{way:>7}" for way in ways)
    print(f"{'aspect':>6}{'rim':>6}{'softness':>9}" + f" |{head * 2}" * len(drawers))
    for place in product(_ASPECTS, _RIMS):
        line = f"{place[0]:>6}{place[1]:>6}{place[1] * place[0] ** 0.25:>9.2f}"
        for name in drawers:
            line += " |"
            for against, way in product(("means", "centres"), ways):
                line += f"{1000 * sums[way, name, against, *place] / sums[place]:>7.2f}"
        print(line)


def print_fits(drawers: dict[str, Renderer]) -> None:
    """Fitted pictures: each renderer against the model, and ways to write against the picture."""
    print(
        f"\nFits of {_FIT.gaussians} shapes in {_FIT.iterations} iterations against the model, dB"
    )
    scales = "".join(f"{f'{scale}x':>7}" for scale in _SCALES)
    print(f"\n{'':26}" + "".join(f" |{name:^21}" for name in drawers))
    print(f"{'picture':10}{'falloff':9}{'':7}" + f" |{scales}" * len(drawers))
    told: list[str] = []
    for picture, falloff in product(("logo", "astronaut"), FALLOFFS):
        pixels = load_image(getattr(data, picture)()).pixels
        height, width = pixels.shape[:2]
        scene = fit(pixels, replace(_FIT, falloff=falloff)).scene
        models = {k: render(scene, width * k, height * k, dtype=np.float64) for k in _SCALES}
        for way in _WAYS:
            line = f"{picture:10}{falloff:9}{way:7}"
            svg = written(scene, way, _WRITTEN)
            for draw in drawers.values():
                found = (metrics.psnr(draw(svg, width, height, k), models[k]) for k in _SCALES)
                line += " |" + "".join(f"{value:>7.1f}" for value in found)
            print(line, flush=True)
        if falloff == GAUSSIAN:
            continue
        soft = softness(scene)
        line = f"{picture:10}{metrics.psnr(models[1], pixels):>7.2f}"
        for way, limit in (("cut", 0.0), ("large", 0.0), *(("plain", s) for s in _SOFTNESSES)):
            drawn = rasterize(written(scene, way, _WRITTEN, limit), width, height)
            line += f"{metrics.psnr(drawn, pixels):>9.2f}"
            line += f" ({np.sum(soft < limit)})" if way == "plain" else ""
        told.append(line)
    heads = "".join(f"{f'plain < {s}':>15}" for s in _SOFTNESSES)
    print("\nAdaptive by resvg against the picture, dB; plain ellipses (so many) by softness")
    print(f"{'picture':10}{'model':>7}{'cut':>9}{'large':>9}{heads}")
    print("\n".join(told))


_TABLES = {"centres": print_centres, "plain": print_plain, "fits": print_fits}


def main() -> None:
    """Parse the command line, print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--only", nargs="+", choices=_TABLES, default=list(_TABLES))
    names = parser.parse_args().only
    with tempfile.TemporaryDirectory() as folder:
        drawers = renderers(Path(folder))
        for name in names:
            _TABLES[name](drawers)


if __name__ == "__main__":
    main()
