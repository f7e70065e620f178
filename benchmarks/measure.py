"""Measure gauss2svg on photos, optionally beside another fitter run right after each fit.

    python benchmarks/measure.py IMAGES... [--gaussians 5000] [--palette N] [--against SCRIPT]
        [--iterations 300] [--their-iterations 300] [--falloff adaptive] [--tune perceptual]

The script prints one line per photo and the means: PSNR of the model, PSNR of the SVG by resvg and
CairoSVG against the photo and against the model, bytes per Gaussian raw and gzipped, CPU seconds
of the fit. SCRIPT is a Python script that takes IMAGE, --gaussians and --iterations and prints one
JSON line with psnr and cpu_s; it uses as many threads as the fit, and the ratio of the CPU seconds
is printed.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from common import vectorized

from gauss2svg import FitOptions, vectorize
from gauss2svg.measure.roundtrip import round_trip
from gauss2svg.photo.load import WHITE, load_image

_OTHERS = ("images", "against", "their_iterations")  # arguments that are no options of the run


def measure(image: Path, arguments: argparse.Namespace) -> dict[str, float]:
    """One row of the table."""
    given = {name: value for name, value in vars(arguments).items() if name not in _OTHERS}
    result = vectorized(image, **given)
    report = result.report
    cairo = round_trip(result.svg, result.scene, load_image(image, matte=WHITE).pixels, "cairo")
    row = {
        "model_dB": report["psnr_model"],
        "svg_dB": report["psnr_svg"],
        "svg_ssim": report["ssim_svg"],
        "resvg_dB": report["psnr_roundtrip"],
        "cairo_dB": cairo.psnr_roundtrip,
        "raw_B": report["svg_bytes"] / report["gaussians"],
        "gz_B": report["svgz_bytes"] / report["gaussians"],
        "fit_cpu_s": report["fit_cpu_s"],
        "Mpairs_step": report["pixel_pairs"] / report["iterations"] / 1e6,
    }
    if arguments.against:
        iterations = arguments.their_iterations or report["iterations"]
        other = run_other(image, arguments, iterations, report["threads"])
        row |= {"other_dB": other["psnr"], "other_cpu_s": other["cpu_s"]}
        row["cpu_ratio"] = row["fit_cpu_s"] / row["other_cpu_s"]
    return row


def run_other(
    image: Path, arguments: argparse.Namespace, iterations: int, threads: int
) -> dict[str, float]:
    """The other fitter's JSON line."""
    command = [sys.executable, str(arguments.against), str(image)]
    command += ["--gaussians", str(arguments.gaussians), "--iterations", str(iterations)]
    environment = os.environ | {"NUMBA_NUM_THREADS": str(threads)}
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return json.loads(run.stdout.splitlines()[-1])


def print_table(
    images: Sequence[Path], row_of: Callable[[Path], dict[str, float]]
) -> dict[str, float]:
    """Print one line per photo as it is measured, then the means, which are returned."""
    rows = []
    for image in images:
        row = row_of(image)
        if not rows:
            print("image".ljust(16) + "".join(name.rjust(13) for name in row))
        rows.append(row)
        print(image.stem.ljust(16) + "".join(f"{v:13.3f}" for v in row.values()), flush=True)
    means = {name: statistics.fmean(row[name] for row in rows) for name in rows[0]}
    print("mean".ljust(16) + "".join(f"{v:13.3f}" for v in means.values()))
    return means


def main() -> None:
    """Parse the command line, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("images", nargs="+", type=Path)
    parser.add_argument("--gaussians", type=int, default=5000)
    parser.add_argument("--iterations", type=int)
    parser.add_argument("--quality", default="balanced")
    parser.add_argument("--init", default="selective")
    parser.add_argument("--palette", type=int)
    parser.add_argument("--falloff")
    parser.add_argument("--tune", default="perceptual")
    parser.add_argument("--blend", default="over")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--their-iterations", type=int)
    arguments = parser.parse_args()
    vectorize(arguments.images[0], gaussians=10, fit=FitOptions(iterations=2))  # compile first
    print_table(arguments.images, lambda image: measure(image, arguments))


if __name__ == "__main__":
    main()
