"""The paper's figures and claims, measured again, as one HTML page with its images.

    python examples/reproduce_paper.py FOLDER [--quick]

Fits photos that scikit-image ships by the schedules, kernels and losses of "Investigation into 2D
Gaussian Splatting for Image Representation", goes on to the drawn SVG, and says of each claim of
the abstract whether it holds. Takes minutes; --quick measures little of everything in seconds.
Needs pip install 'gauss2svg[bench]'; with vtracer installed there are polygons to compare with.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path


def main() -> None:
    """Parse the command line, write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", type=Path, help="where index.html and its images go")
    parser.add_argument("--quick", action="store_true", help="little of everything, in seconds")
    options = parser.parse_args()
    command = shlex.join(["python", "examples/reproduce_paper.py", *sys.argv[1:]])
    try:
        # What they import is no dependency of gauss2svg itself.
        from paper.report import write_report
        from paper.settings import FULL, QUICK
    except ModuleNotFoundError as error:
        parser.exit(
            2, f"{parser.prog}: {error.name} is not installed; pip install 'gauss2svg[bench]'\n"
        )
    # After the import: it makes sure that gauss2svg is there.
    from gauss2svg.errors import InputError

    settings = QUICK if options.quick else FULL
    try:
        path = write_report(settings, options.folder, command, lambda part: print(part, flush=True))
    except (InputError, OSError) as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    print(path)


if __name__ == "__main__":
    main()
