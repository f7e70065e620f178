"""The sizes of the page's experiments; QUICK is for a trial and for tests."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Sizes of the experiments.

    side          px of the longest side that the photos are reduced to
    photos        names of scikit-image's pictures; the first one is shown
    gaussians     of figures 1 to 3: with 2^i added in round i, rounds of 1, 2, 4, ... 64
    rounds        of a progressive fit of so many, also of the linear one
    iterations    of figures 1 to 4, a multiple of one more than the rounds
    seeds         of figure 3 and of the comparison of shapes
    more          counts for all at once, to find the number that it needs
    kernel_sizes  of figure 4, as shares of the side; the public implementation has 101 of 256 px
    window_gaussians, loss_gaussians, shapes   counts in figures 4 and 5 and for claims c and d
    loss_iterations, shape_iterations  of each fit there; step_sizes  of which the best one is used
    counts, inits, table_iterations   of the table
    """

    side: int = 256
    photos: tuple[str, ...] = ("astronaut", "cat", "coffee")
    gaussians: int = 127
    rounds: int = 7
    iterations: int = 560
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    more: tuple[int, ...] = (127, 180, 254, 360, 508)
    more_seeds: tuple[int, ...] = (0, 1)
    kernel_sizes: tuple[float, ...] = (0.2, 101 / 256, 0.6)
    window_gaussians: int = 63
    loss_gaussians: int = 508
    loss_iterations: int = 200
    shapes: int = 128
    shape_iterations: int = 150
    shape_seeds: tuple[int, ...] = (0, 1)
    step_sizes: tuple[float, ...] = (2.0, 4.0)
    counts: tuple[int, ...] = (32, 64, 128, 256, 512, 1024, 2048, 4096, 8192)
    inits: tuple[str, ...] = ("selective", "live", "error", "random")
    table_iterations: int = 120


FULL = Settings()
QUICK = Settings(
    side=64,
    photos=("astronaut",),
    gaussians=7,
    rounds=3,
    iterations=32,
    seeds=(0, 1),
    more=(7, 14, 28),
    more_seeds=(0,),
    kernel_sizes=(0.2,),
    window_gaussians=7,
    loss_gaussians=15,
    loss_iterations=10,
    shapes=12,
    shape_iterations=15,
    shape_seeds=(0,),
    step_sizes=(1.0,),
    counts=(8, 16),
    inits=("selective",),
    table_iterations=10,
)
