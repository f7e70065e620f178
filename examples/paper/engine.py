"""The one door to the fit: the paper's way and the product's, watched while they go on."""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from gauss2svg.fit.densification import FixedCount
from gauss2svg.fit.options import FitOptions, FitProgress
from gauss2svg.fit.session import FitSession
from gauss2svg.measure import metrics
from gauss2svg.render import render
from gauss2svg.scene import ADD, Scene

from .photos import Pixels

EXPONENTIAL, LINEAR, AT_ONCE = "exponential", "linear", "all-at-once"
SCHEDULES = (AT_ONCE, LINEAR, EXPONENTIAL)


@dataclass(frozen=True)
class Way:
    """How a fit goes, whatever its schedule.

    placement  of new Gaussians; relocate  whether those missed least are placed anew
    even       as in the paper: rounds of 1, 2, 4, .. or of equal parts, each with the same share
               of the iterations, and a last such share for all of them, with steps that get smaller
               in the end, all on the full picture; else six rounds in the first 30 %, the early
               ones on a reduced picture
    """

    name: str
    placement: str
    relocate: bool
    even: bool


RANDOM = Way("paper, random", placement="random", relocate=False, even=True)
PAPER = Way("paper, selective", placement="live", relocate=False, even=True)
PRODUCT = Way("product", placement="selective", relocate=True, even=False)
WAYS = (RANDOM, PAPER, PRODUCT)


@dataclass(frozen=True, eq=False)
class Trace:
    """A finished fit and what it was on the way.

    image      (h, w, 3) in 0..1 of the final scene, psnr its dB against the photo
    by_round   the scene after the steps of each round
    snapshots  the scene after so many iterations
    """

    scene: Scene
    image: Pixels
    psnr: float
    seconds: float
    by_round: dict[int, Scene] = field(default_factory=dict)
    snapshots: dict[int, Scene] = field(default_factory=dict)


def drawn(scene: Scene) -> Pixels:
    """The scene's image (h, w, 3) in 0..1, by the product's renderer."""
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
    """Fit summed Gaussians; watched are the iterations after which the scene is kept."""
    # The paper's m, which bounds no round here, and its k and e.
    added = {AT_ONCE: None, EXPONENTIAL: gaussians, LINEAR: -(-gaussians // rounds)}[schedule]
    share = iterations // (rounds + 1)
    steps = share * rounds if schedule == AT_ONCE else share
    options = FitOptions(
        gaussians=gaussians,
        iterations=iterations,
        placement=way.placement,
        schedule=schedule,
        loss=loss,
        seed=seed,
        blend=ADD,
        per_round=added if way.even else None,
        round_iterations=steps if way.even else None,
        relocate=way.relocate,
        reduce=not way.even,
    )
    by_round: dict[int, Scene] = {}
    snapshots: dict[int, Scene] = {}

    def look(progress: FitProgress) -> None:
        if not watched:
            return
        scene = run.scene()
        by_round[progress.round] = scene
        if progress.iteration in watched:
            snapshots[progress.iteration] = scene

    policy = FixedCount(schedule, gaussians, iterations, options.per_round)
    run = FitSession(pixels, options, policy, progress=look)
    begun = time.perf_counter()
    run.fit()
    seconds = time.perf_counter() - begun
    scene = run.scene()
    image = drawn(scene)
    return Trace(scene, image, metrics.psnr(image, pixels), seconds, by_round, snapshots)
