"""How fit time grows with the pixel-Gaussian pairs, and the speed-up by a second thread.

    python benchmarks/scaling.py IMAGE

The script fits the photo with 1000 to 50 000 Gaussians, alternately on one and on two threads, and
prints for each count the pairs per step, the nanoseconds per pair and the ratio of the wall-clock
times: medians of three runs, after one to warm up.
"""

from __future__ import annotations

import statistics
import sys

from numba import set_num_threads

from gauss2svg.fit.fit import fit
from gauss2svg.fit.options import FitConfig
from gauss2svg.photo.load import WHITE, load_image

COUNTS = (1000, 2000, 5000, 10_000, 20_000, 50_000)
ITERATIONS = 300
RUNS = 3


def main() -> None:
    """Print the table."""
    pixels = load_image(sys.argv[1], matte=WHITE).pixels
    fit(pixels, FitConfig(gaussians=100, iterations=10))
    print("gaussians  Mpairs/step  ns/pair, 1 thread  ns/pair, 2 threads  ratio")
    for count in COUNTS:
        config = FitConfig(gaussians=count, iterations=ITERATIONS)
        seconds: dict[int, list[float]] = {1: [], 2: []}
        pairs = 0
        for _ in range(RUNS):
            for threads, runs in seconds.items():
                set_num_threads(threads)
                result = fit(pixels, config)
                runs.append(result.wall_s)
                pairs = result.pixel_pairs
        one, two = (statistics.median(runs) for runs in seconds.values())
        print(
            f"{count:9d}  {pairs / ITERATIONS / 1e6:11.2f}  {one / pairs * 1e9:17.2f}"
            f"  {two / pairs * 1e9:18.2f}  {one / two:5.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
