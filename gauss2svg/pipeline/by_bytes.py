"""The search by bytes. It makes files of hundreds to thousands of bytes that fill a limit.

    photo -> working picture of 96 to 256 px -> a few fits of as many opaque shapes as the bytes
    allow, with few exponents -> coordinates in whole units, colours by least squares -> as many of
    the most useful shapes as the limit allows -> the file with the closest raster

For example, take Kodak 20, 768 x 512 px, and a limit of 250 bytes. A file without Gaussians has 98
bytes. The other 152 bytes suffice for 3 plain ellipses of about 44 bytes each, which are fitted at
96 x 64 px. Each fit is written in units of two sizes, with colours of 6 and of 3 hex digits, until
all of its shapes fit. Of these files, the one whose model is closest is rasterised:

    <svg xmlns=".." viewBox="0 0 66 44"><path fill="#c3b8a0" d="M0 0h66v44H0"/>
    <path fill="#504c34" d="M86 27a93 10-1.8 101 0"/>
    <path fill="#fbf9e8" d="M1-19a91 20 7.2 101 0"/>
    <path fill="#736031" d="M11 18a10 4 32 101 0"/></svg>

If the shapes are fixed, a picture is a linear function of its colours: each pixel is
sum_k w_k c_k, where c_k is the colour of shape k, and w_k is its alpha times the transmittance of
all shapes above it. k = 0 is the background. The best colours within 0..1 are found by solving the
normal equations, and are then rounded to the digits of the file. These colours regain much of the
PSNR that is lost when the coordinates are rounded.

docs/decisions/small.md explains the constants.
"""

import dataclasses
import itertools
import math
from functools import partial
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.fit import ADAPTIVE, FitConfig, FitProgress, FitResult
from gauss2svg.fit.colors import solved_colors
from gauss2svg.fit.session import FitSession
from gauss2svg.photo.pixels import BACKDROPS, Size, elongation, has_alpha, psnr_of, shrunk, views
from gauss2svg.pipeline.outcome import Export, Exporter, Outcome, Subject, filled, scaled_to
from gauss2svg.pipeline.palette import Rows
from gauss2svg.pipeline.plan import INDISTINGUISHABLE, SHAPE_BYTES, Plan
from gauss2svg.pipeline.run import Run
from gauss2svg.raster import rasterize_like
from gauss2svg.render.cpu import color_weights
from gauss2svg.scene import PLAIN, SOFT, Scene
from gauss2svg.scene.falloff import BETA_CLASSES
from gauss2svg.svg.forms import with_falloffs
from gauss2svg.svg.minimal import HEX_DIGITS, minimal_svg, rounded

# Exponents that soft shapes may have. All other shapes are plain ellipses.
Exponents = tuple[float, ...]

DEFINITION = 5  # an exponent's definition takes as many bytes as this number of shapes
ITERATIONS = 200  # number of steps of a fit
SIDE = 256  # px of the longest side of the largest picture that is fitted, unless it is flat


class ByBytes:
    """A search for the best file within a plan's limit of bytes.

    subject     photo and canvas. The search replaces the working picture by a reduced one
    flat        smallest file without Gaussians
    best        best file so far. Its score is the PSNR of its raster in dB
    fits        results of the fits so far
    Raise InputError if a file without Gaussians exceeds the limit.
    """

    def __init__(self, plan: Plan, subject: Subject, run: Run) -> None:
        self._plan, self._run, self._limit = plan, run, plan.goal.byte_limit
        # A flat file needs only the mean colour.
        self.subject = dataclasses.replace(subject, working=shrunk(subject.photo, 1, 1))
        self.fits = list[FitResult]()
        empty = Scene(*subject.canvas, transparent=has_alpha(subject.photo))
        unit = whole_unit(*subject.canvas)
        flat = [self._file(empty, unit, digits) for digits in HEX_DIGITS]
        self.flat = min(flat, key=attrgetter("size"))
        self._shape_bytes = self._limit - self.flat.size  # bytes left for shapes
        plan.check_limit(self.flat.size)
        self._set_up()
        self._is_late = False
        self.best = max(
            [self._rastered(file) for file in flat if file.size <= self._limit],
            key=attrgetter("score"),
        )

    def _set_up(self) -> None:
        """Reduce the working picture. Decide which fits, exponents, grids and digits to try."""
        photo, canvas, options = self.subject.photo, self.subject.canvas, self._plan.options
        learned = options.fit.shaped == ADAPTIVE
        # The edges of a flat picture are crisp. So it is fitted at 640 px, in more steps, with
        # plain ellipses alone, and written in finer units (docs/decisions/small.md).
        self._is_flat = learned and flat_share(photo) >= 0.4
        # The definition of an exponent takes bytes, so small files have few of them.
        soft = (1.0, 3.0) if self._limit >= 2200 else (3.0,)
        soft = () if self._is_flat else soft if learned else (1.0,)
        plain = () if learned and self._limit < 900 else soft
        # Bytes that a soft shape and a plain ellipse usually take
        self._bytes_each = (22, 20) if self._plan.counts_gzipped else SHAPE_BYTES
        count = self._shape_bytes / self._bytes_each[not soft]
        few = count <= 60
        # Each fit has a way in which shapes are placed, a factor on the learning rate, and
        # exponents. The best of several short fits is better than a long one.
        fits = [("selective", 1.0, plain), ("error", 1.0, soft), ("selective", 1.5, plain)]
        self._fits_to_do = fits if few else fits[:2]
        self._grids = (1.2, 0.8) if few else (1.0,)
        side = min(max(12 * math.sqrt(max(count, 1)), 96), SIDE)
        if self._is_flat:
            side, self._grids = 640, tuple(3 * grid for grid in self._grids)
        side *= elongation(*canvas)
        side = min(side, options.run.max_size or side, max(photo.shape[:2]))
        width, height = (max(1, round(length * side / max(canvas))) for length in canvas)
        self.subject = dataclasses.replace(self.subject, working=shrunk(photo, height, width))
        # The cap of any preset is above the number of shapes of so few bytes.
        pixels, count = math.prod(self.subject.size), self._plan.goal.count
        self._most = pixels if count is None else min(count, pixels)
        self._exporter = Exporter(self._plan, self.subject)

    def run(self) -> Outcome:
        """Search for the best file, and return it."""
        for init, rate, exponents in self._fits_to_do:
            if self.best.score > INDISTINGUISHABLE or not self._most or self._stop():
                break
            fitted = self._fit(self._count(exponents), init, exponents, rate)
            written = self._rastered(self._written(fitted, exponents))
            self.best = max(self.best, written, key=attrgetter("score"))
        count, reason = len(self.best.scene), "max_bytes"
        if self._is_late:
            reason = "time_limit"
        elif self.best.score > INDISTINGUISHABLE:
            reason = "enough"
        elif count == self._most:
            reason = "gaussians" if count == self._plan.goal.count else "cap"
        none = FitResult(self.best.scene, 0, 0, 0.0, 0.0, 0, reason)
        *others, last = none, *self.fits
        later_fits = max(len(self.fits) - 1, 0)
        return self._exporter.outcome(self.best, last.after(reason, *others), later_fits)

    def _stop(self) -> bool:
        """Return whether the search must end, and note whether it is for lack of time.

        It must end if the run is stopped. After the first fit, it must also end if the time that is
        left is needed for writing and measuring the file.
        """
        self._is_late |= bool(self.fits) and self._run.budget.must_export
        return self._run.stop() or self._is_late

    def _count(self, exponents: Exponents) -> int:
        """Return the number of shapes to fit so that their file fills the limit.

        Too many shapes do less harm than too few, because the file loses little if the least useful
        ones are left out. Usually those are 3 % of them.
        """
        count = 1.03 * self._shape_bytes / self._bytes_each[not exponents]
        return int(min(max(count - DEFINITION * len(exponents), 1), self._most))

    def _fit(self, count: int, init: str, exponents: Exponents, rate: float) -> Scene:
        """Fit `count` shapes. Return the scene, scaled to the canvas.

        init  way in which the fit places shapes, as in FitOptions
        rate  factor on the learning rate
        """
        options = self._plan.options.fit
        tune, rate = self._plan.tune, rate * options.learning_rate
        config = FitConfig(
            gaussians=count,
            iterations=options.iterations or (600 if self._is_flat else ITERATIONS),
            fit=dataclasses.replace(options, tune=tune, learning_rate=rate, init=init),  # pyright: ignore[reportArgumentType]
            reduce=False,
            opaque=not has_alpha(self.subject.working),
        )

        def progress(now: FitProgress) -> None:
            fits = len(self._fits_to_do)
            done = (min(len(self.fits), fits - 1) + now.done) / fits
            left_s = now.elapsed_s * (1 - done) * fits
            self._run.notify("fit", dataclasses.replace(now, done=done, remaining_s=left_s))

        session = FitSession(
            self._exporter.target, config, progress=progress, stop=self._stop,
            as_written=lambda scene, _: with_few_exponents(scene, exponents),
        )  # fmt: skip
        session.fit()
        self.fits.append(session.result())
        return scaled_to(session.scene(), self.subject.canvas)

    def _written(self, fitted: Scene, exponents: Exponents) -> Export:
        """Write a scene with each grid and number of digits. Return the closest file by its model.

        A file that is too large loses its least useful Gaussians. If a file loses none, coarser
        ones are not tried.
        """
        order, files = self._exporter.by_usefulness(fitted), list[Export]()

        def write_in(unit: float, digits: int, count: int) -> Export:
            scene = rounded(fitted.select(np.sort(order[:count])), unit, digits).scene
            return self._file(scene, unit, digits)

        for grid, digits in itertools.product(self._grids, HEX_DIGITS[::-1]):
            if files and self._stop():
                break
            unit = unit_of(grid, len(fitted), self.subject.canvas)
            write = partial(write_in, unit, digits)
            whole = write(len(fitted))
            file = filled(write, (0, self.flat.size), (len(fitted), whole), self._limit)
            files += [file] if file.size <= self._limit else []
            if file is whole:
                break
        return max(files, key=attrgetter("score"), default=self.flat)

    def _file(self, scene: Scene, unit: float, digits: int) -> Export:
        """Return the file of a scene in the colours that are closest to the working picture."""
        subject = self.subject
        scene, error = recolored(scene, subject.working, digits, subject.weight(subject.working))
        svg = minimal_svg(scene, unit, digits, subject.document)
        return Export(scene, svg, self._plan.format, subject.bytes_of(svg), psnr_of(error))

    def _rastered(self, file: Export) -> Export:
        """Return a file with the PSNR of its raster in place of that of its model."""
        working = self.subject.working
        raster = rasterize_like(file.svg, working, self._plan.options.run.renderer)
        return dataclasses.replace(file, score=self.subject.psnr(raster, working))


def flat_share(pixels: NDArray[np.float32]) -> float:
    """Return the share of pixels (h, w, c) that have one of the 4 most frequent 8-bit colours."""
    down, across = (max(1, side // SIDE) for side in pixels.shape[:2])
    levels = np.round(pixels[::down, ::across] * 255).astype(np.int64)
    numbers = levels @ 256 ** np.arange(pixels.shape[2])
    counts = np.sort(np.unique(numbers, return_counts=True)[1])
    return float(counts[-4:].sum() / numbers.size)


def with_few_exponents(scene: Scene, exponents: Exponents) -> Scene:
    """Return the scene, in which each shape is now a plain ellipse or has one of `exponents`.

    A shape becomes a plain ellipse if its exponent is nearer to the largest class of exponents than
    to all of `exponents`. From then on, the fit draws this ellipse by the share of each pixel that
    it covers. All other shapes are soft. Each of them gets the nearest of `exponents`.
    """
    classes = np.array([*exponents, BETA_CLASSES[-1]])
    nearest = np.abs(portable.log(scene.beta)[:, None] - portable.log(classes)).argmin(axis=1)
    plain = nearest == len(exponents)
    return with_falloffs(scene, classes[nearest]).replace(drawn=np.where(plain, PLAIN, SOFT))


def unit_of(grid: float, count: int, canvas: Size) -> float:
    """Return the length in px of the unit in which a file with `count` shapes has its coordinates.

    grid  factor on the usual number of units along a side. The larger it is, the smaller is the
          unit
    The unit is chosen so that both sides of the canvas are whole numbers of units, because the file
    then needs no width and height. But if this takes more than ten times as many units as wanted,
    only the longest side is a whole number of units (docs/decisions/small.md).
    """
    longest, shortest = max(canvas), min(canvas)
    units = math.ceil(grid * 32 * math.sqrt(max(count, 1)))
    # With fewer than 8 units across, the shapes of a strip would be too thin to be drawn.
    units = max(units, math.ceil(8 * longest / shortest))
    unit = whole_unit(*canvas, units)
    return unit if longest / unit <= 10 * units else longest / units


def recolored(
    scene: Scene,
    pixels: NDArray[np.float32],
    digits: int,
    weight: NDArray[np.float32] | None = None,
) -> tuple[Scene, float]:
    """Return the scene with the colours that minimise its squared error against a picture.

    The second value is the mean squared error with these colours.

    pixels  picture, (h, w, 3) or (h, w, 4) float32 in 0..1. The scene is drawn at the size of the
            picture to compare the two
    digits  number of hex digits, 3 or 6, to which the colours are rounded
    weight  (h, w) weight of each pixel's error, of mean 1. If it is None, all weights are 1
    A picture with alpha is compared over white and over black, and its scene has no background.
    """
    height, width = pixels.shape[:2]
    scaled = scene.scaled(width / scene.width, height / scene.height)
    weights, products = color_weights(scaled, height, width)
    targets = [view.reshape(-1, 3).astype(np.float64) for view in views(pixels)]
    # Each pixel gives an equation. Both of its sides are multiplied by the square root of the
    # pixel's weight, so that the squared error of the equation gets this weight.
    if weight is not None:
        root = np.sqrt(weight.reshape(-1, 1).astype(np.float64))
        weights, targets = weights.multiply(root.T).tocsr(), [root * target for target in targets]
        products = (weights @ weights.T).toarray()
    first = int(has_alpha(pixels))  # index of the first weight that belongs to an unknown colour
    # For a picture with alpha, the targets are the picture over white and over black. Weight 0 says
    # how much of the white or black is visible at each pixel. As this colour is known, its part is
    # subtracted from the targets.
    if first:
        through = weights[[0]].toarray().reshape(-1, 1)
        targets = [t - b * through for t, b in zip(targets, BACKDROPS, strict=True)]
    products = products[first:, first:] * len(targets)
    # Right-hand sides of the normal equations.
    sums = (weights @ np.sum(targets, axis=0))[first:]
    levels = 15 if digits == 3 else 255
    squares = sum(float(np.square(target).sum()) for target in targets)

    def residual(color: Rows) -> float:
        return squares + float(np.sum(color * (portable.product(products, color) - 2 * sums)))

    color = solved_colors(products, sums, levels)
    error = max(residual(color), 0.0) / (3 * len(targets) * width * height)
    background = scene.background if first else color[0]
    return scene.replace(background=background, color=color[1 - first :]), error


def whole_unit(width: int, height: int, about: float = 0) -> float:
    """Return the size of a unit, in px. Both sides are whole numbers of such units.

    about  wanted number of units of the longer side. 0 for as few as possible

    The longer side may have m, 2 m, 3 m, .. units, where m is its length in px divided by the
    greatest common divisor of width and height. The one of these numbers that is nearest to `about`
    is taken. If the divisor is small, m is large, so this number may be far from `about`.
    """
    longer = max(width, height)
    fewest = longer // math.gcd(width, height)
    return longer / (fewest * max(1, round(about / fewest)))
