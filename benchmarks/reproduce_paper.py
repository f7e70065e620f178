"""Reproduce the paper's figures and test its claims: one HTML page with its images.

    python benchmarks/reproduce_paper.py FOLDER [--quick]

The script fits photos that scikit-image ships with the schedules, kernels and losses of
"Investigation into 2D Gaussian Splatting for Image Representation", continues to the rasterised
SVG, and decides for each claim of the abstract whether it holds. It takes minutes; --quick runs
small versions of all experiments in seconds. It needs pip install ".[dev]"; with
vtracer installed the page compares polygons.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path


def main() -> None:
    """Parse the command line, write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", type=Path, help="folder for index.html and its images")
    parser.add_argument(
        "--quick", action="store_true", help="small versions of all experiments, in seconds"
    )
    options = parser.parse_args()
    command = shlex.join(["python", "benchmarks/reproduce_paper.py", *sys.argv[1:]])
    try:
        # Their imports include packages that gauss2svg itself does not need.
        from paper.report import write_report
        from paper.settings import FULL, QUICK

        from gauss2svg.errors import InputError
    except ModuleNotFoundError as error:
        advice = 'Try pip install ".[dev]"'
        parser.exit(2, f"{parser.prog}: {error.name} must be installed. {advice}\n")
    settings = QUICK if options.quick else FULL
    try:
        path = write_report(settings, options.folder, command, lambda part: print(part, flush=True))
    except (InputError, OSError) as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    print(path)


if __name__ == "__main__":
    main()
