"""Gaussians that are summed beside Gaussians painted over each other.

    python examples/sums.py IMAGES... [--gaussians 5000] [--iterations 200] [--steps 1.6]
        [--renderers resvg,chromium]

Prints, first, the time of a pixel-Gaussian pair, forward and backward, of both, on one thread:
medians of 40 runs by turns. Then a line a photo and their means: PSNR of the model and CPU seconds
of the fit, painted (with the exponents of shapes and without) and summed, the last also with
--steps times the iterations; what the portable form has; PSNR of the sum's file against the
model, by renderer; its bytes a Gaussian, plain and gzipped.
"""

from __future__ import annotations

import argparse
import statistics
import time

import numpy as np
from numba import get_num_threads, set_num_threads

from gauss2svg import vectorize
from gauss2svg.photo.load import WHITE, load_image
from gauss2svg.render.cpu import splats_of, squared_error
from gauss2svg.measure.roundtrip import round_trip
from gauss2svg.scene import Scene

RUNS = 40
COUNT, WIDTH, HEIGHT = 4000, 768, 512


def time_pairs() -> dict[str, float]:
    """Nanoseconds a pixel-Gaussian pair by blend, forward and backward, on one thread."""
    rng = np.random.default_rng(0)
    painted = Scene(
        WIDTH,
        HEIGHT,
        mean=rng.random((COUNT, 2)) * [WIDTH, HEIGHT],
        sigma=rng.uniform(0.5, 8, (COUNT, 2)),
        rho=rng.uniform(-0.9, 0.9, COUNT),
        color=rng.random((COUNT, 3)),
        opacity=rng.uniform(0.2, 0.9, COUNT),
    )
    summed = painted.replace(
        blend="add", opacity=np.ones(COUNT), color=rng.uniform(-0.3, 0.3, (COUNT, 3))
    )
    target = rng.random((3, HEIGHT, WIDTH)).astype(np.float32)
    seconds: dict[str, list[float]] = {"over": [], "add": []}
    threads = get_num_threads()
    set_num_threads(1)
    pairs = 0
    for _ in range(RUNS):
        for scene in (painted, summed):
            splats = splats_of(scene)
            begun = time.thread_time()
            pairs = squared_error(splats, target)[3] * 16
            seconds[scene.blend].append(time.thread_time() - begun)
    set_num_threads(threads)
    return {blend: statistics.median(runs) / pairs * 1e9 for blend, runs in seconds.items()}


def measure(image: str, options: argparse.Namespace) -> dict[str, float]:
    """One row of the table."""
    count, steps = options.gaussians, options.iterations
    row: dict[str, float] = {}
    kinds = {
        "painted": {"iterations": steps},
        "soft": {"iterations": steps, "falloff": "gaussian"},
        "summed": {"iterations": steps, "blend": "add"},
        "longer": {"iterations": round(steps * options.steps), "blend": "add"},
        "portable": {"iterations": steps, "blend": "add", "portable": True},
    }
    for name, settings in kinds.items():
        result = vectorize(image, gaussians=count, **settings)
        row[f"{name}_dB"] = result.report["psnr_model"]
        row[f"{name}_s"] = result.report["fit_cpu_s"]
        if name == "summed":
            pixels = load_image(image, matte=WHITE).pixels
            for renderer in options.renderers.split(","):
                found = round_trip(result.svg, result.scene, pixels, renderer)
                row[renderer] = found.psnr_roundtrip
            row["raw_B"] = result.report["svg_bytes"] / count
            row["gz_B"] = result.report["svgz_bytes"] / count
    return row


def main() -> None:
    """Parse the command line, print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("images", nargs="+")
    parser.add_argument("--gaussians", type=int, default=5000)
    parser.add_argument("--iterations", type=int, default=200)
    parser.add_argument("--steps", type=float, default=1.6)
    parser.add_argument("--renderers", default="resvg")
    options = parser.parse_args()
    for blend in ("over", "add"):  # compile before any clock runs
        vectorize(options.images[0], gaussians=20, iterations=4, blend=blend)
    pairs = time_pairs()
    print(
        f"a pair: painted {pairs['over']:.2f} ns, summed {pairs['add']:.2f} ns, "
        f"{pairs['add'] / pairs['over']:.2f} of it"
    )
    rows = []
    for image in options.images:
        row = measure(image, options)
        if not rows:
            print("image".ljust(12) + "".join(name.rjust(12) for name in row))
        rows.append(row)
        name = image.rpartition("/")[2].rpartition(".")[0]
        print(name.ljust(12) + "".join(f"{v:12.2f}" for v in row.values()), flush=True)
    means = {name: statistics.fmean(row[name] for row in rows) for name in rows[0]}
    print("mean".ljust(12) + "".join(f"{v:12.2f}" for v in means.values()))
    base = means["painted_s"]
    shares = {name: means[name] / base for name in means if name.endswith("_s")}
    print("of painted's CPU: " + ", ".join(f"{n[:-2]} {v:.2f}" for n, v in shares.items()))


if __name__ == "__main__":
    main()
