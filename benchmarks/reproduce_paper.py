"""Test the paper's claims, and make its figures again.

    python benchmarks/reproduce_paper.py FOLDER [--quick]

The script fits photos that scikit-image ships with the schedules, kernels and losses of
"Investigation into 2D Gaussian Splatting for Image Representation", continues to the rasterised
SVG, and prints for each claim of its abstract whether it holds. A difference counts if its mean
exceeds the standard deviation of the paired differences. FOLDER gets the figures. It takes minutes;
--quick shows in seconds what it prints. It needs pip install ".[dev]"; polygons need vtracer.
"""

from __future__ import annotations

import itertools
import math
import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise, product, takewhile
from pathlib import Path

import numpy as np
import torch
from common import (
    command_line,
    drawn,
    encoded,
    head,
    largest_square,
    line,
    resized,
    shipped,
    vectorized,
)
from panels import Pixels, png, tiles
from PIL import Image
from scipy.ndimage import maximum_filter

from gauss2svg import Scene
from gauss2svg.fit import FitConfig, FitProgress
from gauss2svg.fit.schedule import ROUNDS
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.target import Target
from gauss2svg.measure import metrics
from gauss2svg.pipeline.options import Options
from gauss2svg.render import render
from gauss2svg.render.autograd import fast_composite
from gauss2svg.scene.falloff import RIM_WIDTH

AT_ONCE, LINEAR, EXPONENTIAL = "all-at-once", "linear", "exponential"
SCHEDULES = (AT_ONCE, LINEAR, EXPONENTIAL)
LOSSES = ("mse", "l1", "mse+ssim", "l1+ssim")
# Placement of new Gaussians, whether the least useful ones are relocated, and whether rounds are
# the paper's: of 1, 2, 4, .. or equal numbers, each with the same share of the iterations, and a
# last share for all of them, on the full picture.
WAYS = {
    "paper, random": ("random", False, True),
    "paper, selective": ("live", False, True),
    "product": ("selective", True, False),
}
GAUSSIANS, ELLIPSES = "Gaussians", "crisp ellipses"
POLYGONS = ((10, 48), (4, 32), (4, 16), (2, 8), (0, 0))  # speckle filter, layer difference
STEP, AWAY = 0.04, 2  # an edge, and px that a smooth area is away from it
GRID_REACH, WIDEST_UNCROPPED = 5.0, 2.0  # units of a kernel, of which it has a tenth of its size


@dataclass(frozen=True)
class Settings:
    """Sizes of the experiments; sides are in px."""

    side: int = 256
    photos: tuple[str, ...] = ("astronaut", "cat", "coffee")
    gaussians: int = 127
    rounds: int = 7
    iterations: int = 560  # a multiple of one more than the rounds
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    more: tuple[int, ...] = (127, 180, 254, 360, 508)
    loss_gaussians: int = 508
    loss_iterations: int = 200
    shapes: int = 128
    shape_iterations: int = 150
    step_sizes: tuple[float, ...] = (2.0, 4.0)
    counts: tuple[int, ...] = (32, 64, 128, 256, 512, 1024, 2048, 4096, 8192)


FULL = Settings()
QUICK = Settings(
    side=64, photos=("astronaut",), gaussians=7, rounds=3, iterations=32, seeds=(0, 1, 2),
    more=(7, 14, 28), loss_gaussians=15, loss_iterations=10, shapes=12, shape_iterations=15,
    step_sizes=(1.0,), counts=(8, 16, 32, 64),
)  # fmt: skip
Photos = dict[str, Pixels]
Figures = dict[str, tuple[list[Pixels], list[str]]]
Claims = list[tuple[str, str, bool | None]]


def totals(schedule: str, gaussians: int, rounds: int) -> tuple[int, ...]:
    """Return the number of Gaussians after each round. `rounds` is 0 for the product's rounds."""
    if schedule == AT_ONCE:
        return (gaussians,)
    if not rounds:
        even = {math.ceil(gaussians * r / ROUNDS) for r in range(1, ROUNDS + 1)}
        return () if schedule == EXPONENTIAL else tuple(sorted(even))
    step = -(-gaussians // rounds)
    added = (2**i if schedule == EXPONENTIAL else step for i in itertools.count())
    return (*takewhile(gaussians.__gt__, accumulate(added)), gaussians)


def fit(
    pixels: Pixels, way: str, schedule: str, gaussians: int, settings: Settings,
    iterations: int = 0, seed: int = 0, loss: str = "mse",
    look: Callable[[FitProgress, FitSession], None] | None = None,
) -> Scene:  # fmt: skip
    """Fit additive Gaussians by a procedure and a schedule; `look` is called at each iteration."""
    init, relocate, even = WAYS[way]
    iterations, rounds = iterations or settings.iterations, settings.rounds
    share = iterations // (rounds + 1)
    options = Options.from_flat(
        {"init": init, "relocate": relocate, "loss": loss, "seed": seed, "blend": "add",
         "tune": "psnr"}
    )  # fmt: skip
    config = FitConfig(
        gaussians=gaussians, iterations=iterations, fit=options.fit,
        reduce=not even, round_totals=totals(schedule, gaussians, rounds if even else 0),
        round_iterations=(share * rounds if schedule == AT_ONCE else share) if even else None,
    )  # fmt: skip
    session = FitSession(
        Target(pixels, config.fit.tuned),
        config,
        progress=lambda progress: look(progress, session) if look else None,
    )
    session.fit()
    return session.scene()


def shown(scene: Scene) -> Pixels:
    """Return the image of a scene, clipped to 0..1."""
    return np.clip(render(scene), 0, 1)


def gain(values: Sequence[float], unit: str = "dB") -> tuple[str, bool | None]:
    """Return a mean with its standard deviation, and whether it exceeds that of three or more."""
    if len(values) < 3:
        return f"{statistics.fmean(values):+.2f} {unit}, too few to tell", None
    mean, deviation = statistics.fmean(values), statistics.stdev(values)
    return f"{mean:+.2f} ± {deviation:.2f} {unit}", mean > deviation


def rounds(photo: Pixels, settings: Settings, figures: Figures) -> None:
    """Make figures 1 and 2: the rounds of a progressive fit, and some of its iterations."""
    by_round: dict[int, Scene] = {}
    by_iteration: dict[int, Scene] = {}
    wanted = {max(1, round(settings.iterations * s)) for s in (0.02, 0.1, 0.25, 0.5, 1)}

    def look(progress: FitProgress, session: FitSession) -> None:
        by_round[progress.round] = session.scene()
        if progress.iteration in wanted:
            by_iteration[progress.iteration] = session.scene()

    fit(photo, "paper, selective", EXPONENTIAL, settings.gaussians, settings, look=look)
    for name, scenes in (("rounds", by_round), ("iterations", by_iteration)):
        images = [shown(scene) for scene in scenes.values()]
        titles = [f"{k}: {len(scene)}" for k, scene in scenes.items()]
        psnrs = [f", {metrics.psnr(image, photo):.1f} dB" for image in images]
        figures[name] = images, [a + b for a, b in zip(titles, psnrs, strict=True)]


def schedules(photos: Photos, settings: Settings) -> Claims:
    """Print PSNR by schedule, figure 3; return whether adding Gaussians progressively is better."""

    def psnr(name: str, seed: int, way: str, schedule: str, count: int) -> float:
        # Selective placement has no other noise than a photo without some rows and columns.
        pixels = np.ascontiguousarray(photos[name][2 * seed :, 2 * seed :])
        scene = fit(pixels, way, schedule, count, settings, seed=seed)
        return metrics.psnr(shown(scene), pixels)

    print(head(["procedure, schedule", "PSNR, dB", "gain over all at once", "all at once needs"]))
    claims, pairs = [], list(product(photos, settings.seeds))
    for way in WAYS:
        found = {
            schedule: [psnr(*pair, way, schedule, settings.gaussians) for pair in pairs]
            for schedule in SCHEDULES
        }
        few = [pair for pair in pairs if pair[1] in settings.seeds[:2]]
        at_once = [
            statistics.fmean(psnr(*pair, way, AT_ONCE, count) for pair in few)
            for count in settings.more
        ]
        for schedule, values in found.items():
            level = statistics.fmean(values)
            text, holds = gain([a - b for a, b in zip(values, found[AT_ONCE], strict=True)])
            log_count = np.interp(level, at_once, np.log(settings.more))
            needs = "more" if level > at_once[-1] else f"{math.exp(log_count):.0f}"
            print(line([f"{way}, {schedule}", f"{level:.2f}", text, needs]), flush=True)
            if schedule == EXPONENTIAL:
                what = f"{settings.gaussians} Gaussians, added progressively: {way}"
                claims.append((what, f"{text}; all at once needs {needs} for that", holds))
    return claims


def windowed(scene: Scene, kernel_size: float, adaptive: bool) -> tuple[Pixels, Pixels]:
    """Return the paper's image of an additive scene (h, w, 3), and the jump at each window's edge.

    A window of `kernel_size` px reaches 5 units both ways, so that a sigma of two units ends at
    2.5 sigma. A fixed window crops wider ones where they are still bright; an adaptive one grows
    with them. A jump is what exp(-r^2 / 2) has at the edge, at most exp(-3.125) if it is adaptive.
    """
    unit, widest = kernel_size / (2 * GRID_REACH), scene.sigma.max(axis=1)
    growth = np.maximum(widest / (WIDEST_UNCROPPED * unit), 1) if adaptive else np.ones(len(scene))
    reach = growth * unit * GRID_REACH
    y, x = np.mgrid[: round(scene.height), : round(scene.width)] + 0.5
    image = np.tile(scene.background, (*x.shape, 1))
    for k in range(len(scene)):
        u, v = x - scene.mean[k, 0], y - scene.mean[k, 1]
        inside = np.maximum(np.abs(u), np.abs(v)) <= reach[k]
        (a, b), (_, c) = np.linalg.inv(scene.covariance[k])
        bell = np.exp(-0.5 * (a * u * u + 2 * b * u * v + c * v * v)) * inside
        image += bell[:, :, None] * scene.color[k]
    return image, np.exp(-0.5 * (reach / widest) ** 2)


def windows(photo: Pixels, settings: Settings, figures: Figures) -> Claims:
    """Make figure 4: what fixed and adaptive windows crop from a fit."""
    scene = fit(photo, "product", EXPONENTIAL, settings.gaussians // 2, settings)
    size = settings.side * 101 / 256  # the public implementation has 101 of 256 px
    whole = np.clip(windowed(scene, 1e9, False)[0], 0, 1)
    images, texts, largest = [whole], ["no window"], []
    for adaptive in (False, True):
        image, jumps = windowed(scene, size, adaptive)
        images.append(np.clip(image, 0, 1))
        largest.append(255 * float((jumps * np.abs(scene.color).max(axis=1)).max()))
        text = f"{metrics.psnr(images[-1], whole):.1f} dB to no window"
        texts.append(f"{'adaptive' if adaptive else 'fixed'}: {text}")
    figures["windows"] = images, texts
    result = (
        f"jumps of {largest[0]:.0f} and {largest[1]:.0f} levels at edges; {'; '.join(texts[1:])}"
    )
    return [("a fixed window crops, an adaptive one does not", result, largest[1] < largest[0] / 2)]


def losses(photos: Photos, settings: Settings, figures: Figures) -> Claims:
    """Print PSNR and SSIM by loss; make figure 5: where the images of a photo differ most."""
    scores: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for name, photo in photos.items():
        images = [
            shown(fit(photo, "product", EXPONENTIAL, settings.loss_gaussians, settings,
                      settings.loss_iterations, loss=loss))
            for loss in LOSSES
        ]  # fmt: skip
        for loss, image in zip(LOSSES, images, strict=True):
            scores[loss].append((metrics.psnr(image, photo), metrics.ssim(image, photo)))
        square = largest_square(np.var(images, axis=0).sum(axis=2), min(photo.shape[:2]) // 4)
        figures[f"losses-{name}"] = [one[square] for one in (photo, *images)], [name, *LOSSES]
    means = {loss: np.mean(pairs, axis=0) for loss, pairs in scores.items()}
    print(head(["loss", "PSNR, dB", "SSIM"]))
    for loss, (psnr, ssim) in means.items():
        print(line([loss, f"{psnr:.2f}", f"{ssim:.4f}"]))
    best, similar = (max(means, key=lambda loss: means[loss][k]) for k in (0, 1))
    lost_db, lost_ssim = means[best] - means[similar]
    text = f"{similar} loses {lost_db:.2f} dB to {best}, and gains {-lost_ssim:.4f} SSIM"
    differs = bool(lost_db > 0.05 and lost_ssim < -0.002)
    return [("the loss decides what is kept", text, differs)]


def steep(pixels: Pixels) -> np.ndarray:
    """Return the pixels (h, w) on either side of a step of 0.04 or more in any channel."""
    found = np.zeros(pixels.shape[:2], bool)
    for axis in (0, 1):
        steps = np.abs(np.diff(pixels, axis=axis)).max(axis=2) >= STEP
        pad = [(0, 0), (0, 0)]
        for pad[axis] in ((0, 1), (1, 0)):
            found |= np.pad(steps, pad)
    return found


def false_edges(image: Pixels, photo: Pixels) -> float:
    """Return the share, in per cent, of the smooth areas of a photo where an image has an edge."""
    smooth = maximum_filter(steep(photo), size=2 * AWAY + 1) == 0
    return 100 * float(steep(image)[smooth].mean()) if smooth.any() else math.nan


def files(photos: Photos, settings: Settings) -> Claims:
    """Print SVGs by count; return whether fewer Gaussians are worse, and smoother than polygons."""
    print(head(["Gaussians", "PSNR of the SVG, dB", "SSIM", "kB", "gzipped"]))
    own: dict[str, list[tuple[int, Pixels]]] = defaultdict(list)
    line_of_psnr = []
    for count in settings.counts:
        rows = []
        for name, photo in photos.items():
            result = vectorized(photo, gaussians=count, tune="psnr")
            report = result.report
            rows.append([report[key] for key in
                         ("psnr_svg", "ssim_svg", "svg_bytes", "svgz_bytes")])  # fmt: skip
            own[name].append((report["svg_bytes"], result.raster))
        psnr, ssim, size, packed = np.mean(rows, axis=0)
        line_of_psnr.append(psnr)
        cells = [count, f"{psnr:.2f}", f"{ssim:.3f}", f"{size / 1e3:.0f}", f"{packed / 1e3:.1f}"]
        print(line(cells), flush=True)
    rising = [b > a for a, b in pairwise(line_of_psnr)]
    text = f"{sum(rising)} of {len(rising)} steps to more Gaussians raise the PSNR"
    claims: Claims = [("fewer Gaussians, a worse image", text, all(rising))]
    try:
        import vtracer  # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError:
        return [*claims, ("smoother than polygons", "vtracer is not installed", None)]
    shares = []
    for (name, photo), (speckle, difference) in product(photos.items(), POLYGONS):
        svg = vtracer.convert_raw_image_to_svg(
            encoded(photo, "PNG"), img_format="png", mode="polygon", path_precision=0,
            color_precision=8, filter_speckle=speckle, layer_difference=difference,
        )  # fmt: skip
        smaller = [raster for size, raster in own[name] if size <= len(svg)]
        if smaller:
            rasters = drawn(svg, *photo.shape[:2]), smaller[-1]
            shares.append([false_edges(raster, photo) for raster in rasters])
    return [*claims, smoother("polygons of as many bytes", shares)]


def smoother(rival: str, shares: list[list[float]]) -> tuple[str, str, bool | None]:
    """Return whether Gaussians have fewer false edges on smooth areas than other shapes."""
    if not shares:
        return f"smoother than {rival}", "none to compare with", None
    other, ours = np.mean(shares, axis=0)
    text = f"false edges on {ours:.1f} % of the smooth areas, {rival} on {other:.1f} %"
    return f"smoother than {rival}", text, gain([a - b for a, b in shares])[1]


def shape_fit(
    photo: Pixels, kind: str, settings: Settings, seed: int, step_size: float
) -> tuple[list[float], list[float], Pixels]:
    """Fit shapes by plain Adam; return PSNR (dB) and seconds by iteration, and the last image.

    Ellipses have the exponent whose rim is a pixel wide, and differ from Gaussians in nothing else.
    """
    rng = np.random.default_rng(seed)
    height, width = photo.shape[:2]
    spacing = math.sqrt(height * width / (math.pi * settings.shapes))
    mean = rng.random((settings.shapes, 2)) * [width, height]
    x, y = np.minimum(mean.astype(int), [width - 1, height - 1]).T
    color = np.clip(photo[y, x], 0.02, 0.98)
    first = {  # and the step sizes of Adam
        "mean": (mean / spacing, 0.04),
        "sigma": (np.full((settings.shapes, 2), math.log(0.6 * spacing)), 0.04),
        "rho": (np.zeros(settings.shapes), 0.04),
        "color": (np.log(color / (1 - color)), 0.06),
        "opacity": (np.zeros(settings.shapes), 0.06),
    }
    raw = {
        n: torch.tensor(v, dtype=torch.float32, requires_grad=True) for n, (v, _) in first.items()
    }
    groups = [{"params": [raw[n]], "lr": step_size * step} for n, (_, step) in first.items()]
    optimizer = torch.optim.Adam(groups)
    target = torch.from_numpy(photo)

    def image() -> torch.Tensor:
        sigma, rho = raw["sigma"].exp().clamp(min=0.35), 0.95 * raw["rho"].tanh()
        beta = None
        if kind == ELLIPSES:
            with torch.no_grad():
                trace = (sigma**2).sum(dim=1)
                determinant = (sigma**2).prod(dim=1) * (1 - rho**2)
                major = 0.5 * (trace + (trace**2 - 4 * determinant).clamp(min=0).sqrt())
                # Above 64 gradients vanish; a shape too small for such a rim is flatter still.
                beta = (RIM_WIDTH * (determinant / major).sqrt()).clamp(4.0, 64.0)
        return fast_composite(
            raw["mean"] * spacing, sigma, rho, raw["color"].sigmoid(), raw["opacity"].sigmoid(),
            target.mean(dim=(0, 1)), height, width, beta,
        )  # fmt: skip

    psnr, seconds, begun = [], [], time.perf_counter()
    for _ in range(settings.shape_iterations):
        optimizer.zero_grad()
        loss = torch.nn.functional.mse_loss(image(), target)
        loss.backward()
        optimizer.step()
        psnr.append(-10 * math.log10(float(loss.detach())))
        seconds.append(time.perf_counter() - begun)
    return psnr, seconds, image().detach().numpy()


def ellipses(photos: Photos, settings: Settings, figures: Figures) -> Claims:
    """Return whether Gaussians are faster to optimise and smoother than crisp ellipses."""
    torch.set_num_threads(1)  # its waiting threads would slow those of the kernels
    by_iterations, by_seconds, shares = [], [], []
    for photo, seed in product(photos.values(), settings.seeds[:2]):
        best = {}
        for kind in (ELLIPSES, GAUSSIANS):
            tried = [shape_fit(photo, kind, settings, seed, s) for s in settings.step_sizes]
            best[kind] = max(tried, key=lambda one: one[0][-1])
        crisp, soft = best[ELLIPSES], best[GAUSSIANS]
        end = min(crisp[1][-1], soft[1][-1])
        at_end = [psnr[np.searchsorted(s, end, "right") - 1] for psnr, s, _ in (soft, crisp)]
        by_iterations.append(soft[0][-1] - crisp[0][-1])
        by_seconds.append(at_end[0] - at_end[1])
        shares.append([false_edges(one[2], photo) for one in (crisp, soft)])
        if not figures.get("shapes"):
            figures["shapes"] = [crisp[2], soft[2]], [ELLIPSES, GAUSSIANS]
    iterations, holds = gain(by_iterations)
    seconds, holds_too = gain(by_seconds)
    faster = f"{iterations} after the same iterations, {seconds} after the same seconds"
    both = None if None in (holds, holds_too) else bool(holds and holds_too)
    return [("faster to optimise than crisp ellipses", faster, both), smoother(ELLIPSES, shares)]


def main() -> None:
    """Parse the command line, print the tables, write the figures."""
    parser = command_line(__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--quick", action="store_true")
    given = parser.parse_args()
    settings, figures = QUICK if given.quick else FULL, Figures()
    photos = {}
    for name in settings.photos:
        photo = shipped(name)
        height, width = (round(s * settings.side / max(photo.shape[:2])) for s in photo.shape[:2])
        photos[name] = np.float32(resized(photo, height, width, Image.Resampling.BOX))
    first = photos[settings.photos[0]]
    rounds(first, settings, figures)
    claims = schedules(photos, settings)
    claims += windows(first, settings, figures)
    claims += losses(photos, settings, figures)
    claims += files(photos, settings)
    claims += ellipses(photos, settings, figures)
    claims.append(("faster than LIVE", "LIVE needs diffvg, which is not run here", None))
    print(head(["claim tested", "result", "holds"]))
    for claim, result, holds in claims:
        print(line([claim, result, {True: "yes", False: "no", None: "not tested"}[holds]]))
    given.folder.mkdir(parents=True, exist_ok=True)
    for name, (images, titles) in figures.items():
        png(tiles(images, titles), 200).save(given.folder / f"{name}.png")


if __name__ == "__main__":
    main()
