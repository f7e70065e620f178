"""Measure gauss2svg on photos, beside another fitter run in the same minute.

    python examples/measure.py IMAGES... [--gaussians 5000] [--palette N] [--against SCRIPT]
        [--iterations 300] [--their-iterations 300] [--falloff adaptive]

Prints one line a photo and the means: PSNR of the model, PSNR of the SVG by resvg and
CairoSVG against the photo and against the model, bytes a Gaussian raw and gzipped, CPU
seconds of the fit. SCRIPT is a Python script that takes IMAGE, --gaussians and
--iterations and prints one JSON line with psnr and cpu_s; it runs right after each fit
with as many threads, and the ratio of the CPU seconds is printed.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

from gauss2svg import vectorize
from gauss2svg.measure.roundtrip import round_trip
from gauss2svg.photo.load import WHITE, load_image


def measure(image: Path, options: argparse.Namespace) -> dict[str, float]:
    """One row of the table."""
    result = vectorize(
        image,
        gaussians=options.gaussians,
        iterations=options.iterations,
        quality=options.quality,
        init=options.init,
        palette=options.palette,
        falloff=options.falloff,
        blend=options.blend,
        threads=options.threads,
    )
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
    if options.against:
        iterations = options.their_iterations or report["iterations"]
        other = run_other(image, options, iterations, report["threads"])
        row |= {"other_dB": other["psnr"], "other_cpu_s": other["cpu_s"]}
        row["cpu_ratio"] = row["fit_cpu_s"] / row["other_cpu_s"]
    return row


def run_other(
    image: Path, options: argparse.Namespace, iterations: int, threads: int
) -> dict[str, float]:
    """The other fitter's JSON line."""
    command = [sys.executable, str(options.against), str(image)]
    command += ["--gaussians", str(options.gaussians), "--iterations", str(iterations)]
    environment = os.environ | {"NUMBA_NUM_THREADS": str(threads)}
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return json.loads(run.stdout.splitlines()[-1])


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
    parser.add_argument("--blend", default="over")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--their-iterations", type=int)
    options = parser.parse_args()
    vectorize(options.images[0], gaussians=10, iterations=2)  # compile before any clock runs
    rows = []
    for image in options.images:
        row = measure(image, options)
        if not rows:
            print("image".ljust(16) + "".join(name.rjust(13) for name in row))
        rows.append(row)
        print(image.stem.ljust(16) + "".join(f"{v:13.3f}" for v in row.values()), flush=True)
    means = (statistics.fmean(row[name] for row in rows) for name in rows[0])
    print("mean".ljust(16) + "".join(f"{v:13.3f}" for v in means))


if __name__ == "__main__":
    main()
