"""All fits of the page: the paper's procedure and the product's, observed during the fit."""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from gauss2svg.fit.options import FitConfig, FitProgress
from gauss2svg.fit.session import FitSession
from gauss2svg.measure import metrics
from gauss2svg.pipeline.options import Options
from gauss2svg.render import render
from gauss2svg.scene import ADD, Scene

from .photos import Pixels

EXPONENTIAL, LINEAR, AT_ONCE = "exponential", "linear", "all-at-once"
SCHEDULES = (AT_ONCE, LINEAR, EXPONENTIAL)
LOSSES = ("mse", "l1", "mse+ssim", "l1+ssim")


@dataclass(frozen=True)
class Way:
    """The procedure of a fit, for any schedule.

    init      placement of new Gaussians; relocate  whether the least useful ones are relocated
    even      as in the paper: rounds of 1, 2, 4, .. or of equal parts, each with the same share of
              the iterations, and a last such share for all of them with a decaying learning rate,
              all on the full picture; else six rounds in the first 30 %, the early ones on a
              reduced picture
    """

    name: str
    init: str
    relocate: bool
    even: bool


RANDOM = Way("paper, random", init="random", relocate=False, even=True)
PAPER = Way("paper, selective", init="live", relocate=False, even=True)
PRODUCT = Way("product", init="selective", relocate=True, even=False)
WAYS = (RANDOM, PAPER, PRODUCT)


@dataclass(frozen=True, eq=False)
class Trace:
    """A finished fit and its course.

    image      (h, w, 3) in 0..1 of the final scene, psnr its dB against the photo
    by_round   the scene at the end of each round
    snapshots  the scene by the number of iterations done
    """

    scene: Scene
    image: Pixels
    psnr: float
    seconds: float
    by_round: dict[int, Scene] = field(default_factory=dict)
    snapshots: dict[int, Scene] = field(default_factory=dict)


def rendered(scene: Scene) -> Pixels:
    """Image (h, w, 3) in 0..1 of the scene, by the product's renderer."""
    return np.clip(render(scene), 0, 1)


def fit(
    pixels: Pixels,
    way: Way,
    schedule: str,
    gaussians: int,
    rounds: int,
    iterations: int,
    seed: int = 0,
    loss: str = "mse",
    watched: Collection[int] = (),
) -> Trace:
    """Fit additive Gaussians; watched are the iterations after which the scene is kept."""
    # The paper's m, which limits no round here, and its k and e.
    added = {AT_ONCE: None, EXPONENTIAL: gaussians, LINEAR: -(-gaussians // rounds)}[schedule]
    share = iterations // (rounds + 1)
    steps = share * rounds if schedule == AT_ONCE else share
    even = {"per_round": added, "round_iterations": steps} if way.even else {}
    given = {"init": way.init, "schedule": schedule, "relocate": way.relocate, **even}
    # The paper's errors are unweighted.
    given = {"loss": loss, "seed": seed, "blend": ADD, "tune": "psnr", **given}
    options = Options.from_flat(given)
    config = FitConfig(
        gaussians=gaussians,
        iterations=iterations,
        fit=options.fit,
        densify=options.densify,
        reduce=not way.even,
    )
    by_round: dict[int, Scene] = {}
    snapshots: dict[int, Scene] = {}

    def look(progress: FitProgress) -> None:
        if not watched:
            return
        scene = session.scene()
        by_round[progress.round] = scene
        if progress.iteration in watched:
            snapshots[progress.iteration] = scene

    session = FitSession(pixels, config, progress=look)
    begun = time.perf_counter()
    session.fit()
    seconds = time.perf_counter() - begun
    scene = session.scene()
    image = rendered(scene)
    return Trace(scene, image, metrics.psnr(image, pixels), seconds, by_round, snapshots)
