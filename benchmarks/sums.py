"""Additive Gaussians beside alpha-composited ones: speed, quality, renderers and file size.

    python benchmarks/sums.py IMAGES... [--gaussians 5000] [--iterations 200] [--steps 1.6]
        [--renderers resvg,chromium]

The script first prints the time of a pixel-Gaussian pair, forward and backward, for either blend on
one thread: medians of 40 alternating runs. Then it prints one line per photo and the means: PSNR of
the model and CPU seconds of the fit, alpha-composited (with learned and with Gaussian falloff),
additive (also with --steps times the iterations) and converted by --portable; PSNR of the additive
SVG against the model, by renderer; its bytes per Gaussian, plain and gzipped.
"""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import vectorized
from measure import print_table
from numba import get_num_threads, set_num_threads

from gauss2svg.measure.roundtrip import round_trip
from gauss2svg.photo.load import WHITE, load_image
from gauss2svg.render.cpu import splats_of, squared_error
from gauss2svg.scene import Scene

RUNS = 40
COUNT, WIDTH, HEIGHT = 4000, 768, 512


def time_pairs() -> dict[str, float]:
    """Nanoseconds per pixel-Gaussian pair by blend, forward and backward, on one thread."""
    rng = np.random.default_rng(0)
    composited = Scene(
        WIDTH,
        HEIGHT,
        mean=rng.random((COUNT, 2)) * [WIDTH, HEIGHT],
        sigma=rng.uniform(0.5, 8, (COUNT, 2)),
        rho=rng.uniform(-0.9, 0.9, COUNT),
        color=rng.random((COUNT, 3)),
        opacity=rng.uniform(0.2, 0.9, COUNT),
    )
    additive = composited.replace(
        blend="add", opacity=np.ones(COUNT), color=rng.uniform(-0.3, 0.3, (COUNT, 3))
    )
    target = rng.random((3, HEIGHT, WIDTH)).astype(np.float32)
    seconds: dict[str, list[float]] = {"over": [], "add": []}
    threads = get_num_threads()
    set_num_threads(1)
    pairs = 0
    for _ in range(RUNS):
        for scene in (composited, additive):
            splats = splats_of(scene)
            begun = time.thread_time()
            pairs = squared_error(splats, target)[3] * 16
            seconds[scene.blend].append(time.thread_time() - begun)
    set_num_threads(threads)
    return {blend: statistics.median(runs) / pairs * 1e9 for blend, runs in seconds.items()}


def measure(image: Path, arguments: argparse.Namespace) -> dict[str, float]:
    """One row of the table."""
    count, steps = arguments.gaussians, arguments.iterations
    row: dict[str, float] = {}
    kinds: dict[str, dict[str, Any]] = {
        "over": {},
        "gaussian": {"falloff": "gaussian"},
        "add": {"blend": "add"},
        "longer": {"blend": "add", "iterations": round(steps * arguments.steps)},
        "portable": {"blend": "add", "portable": True},
    }
    for name, given in kinds.items():
        result = vectorized(image, **{"gaussians": count, "iterations": steps} | given)
        row[f"{name}_dB"] = result.report["psnr_model"]
        row[f"{name}_s"] = result.report["fit_cpu_s"]
        if name == "add":
            pixels = load_image(image, matte=WHITE).pixels
            for renderer in arguments.renderers.split(","):
                found = round_trip(result.svg, result.scene, pixels, renderer)
                row[renderer] = found.psnr_roundtrip
            row["raw_B"] = result.report["svg_bytes"] / count
            row["gz_B"] = result.report["svgz_bytes"] / count
    return row


def main() -> None:
    """Parse the command line, print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("images", nargs="+", type=Path)
    parser.add_argument("--gaussians", type=int, default=5000)
    parser.add_argument("--iterations", type=int, default=200)
    parser.add_argument("--steps", type=float, default=1.6)
    parser.add_argument("--renderers", default="resvg")
    arguments = parser.parse_args()
    for blend in ("over", "add"):  # compile before any clock runs
        vectorized(arguments.images[0], gaussians=20, iterations=4, blend=blend)
    pairs = time_pairs()
    print(
        f"a pair: over {pairs['over']:.2f} ns, add {pairs['add']:.2f} ns, "
        f"ratio {pairs['add'] / pairs['over']:.2f}"
    )
    means = print_table(arguments.images, lambda image: measure(image, arguments))
    shares = {n[:-2]: value / means["over_s"] for n, value in means.items() if n.endswith("_s")}
    print("CPU, ratio to over: " + ", ".join(f"{n} {v:.2f}" for n, v in shares.items()))


if __name__ == "__main__":
    main()
