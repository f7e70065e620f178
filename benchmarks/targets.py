"""Targets and results: the PSNR, file size and time requested, and those reached.

    python benchmarks/targets.py IMAGES... [--psnr 30] [--max-bytes 100k] [--time-limit 5]
        [--bisect]

The script prints one line per photo. --bisect searches for the smallest --gaussians that reaches
the PSNR, to within 3 %, and prints the ratio of --target-psnr's count to it. The time is the
wall-clock time of the whole command, the start of Python included.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from gauss2svg import FitOptions, vectorize

_CLOSE = 1.03  # ratio of the bounds at which the bisection ends
_MOST = 20_000


def smallest_count(image: Path, psnr: float, start: int) -> int | None:
    """The smallest fixed count whose rasterised SVG reaches the PSNR; None if _MOST does not."""
    low, high, tried = 0, 0, start
    while not high or high > max(low * _CLOSE, low + 1):
        if vectorize(image, gaussians=tried).report["psnr_svg"] >= psnr:
            high = tried
        elif tried == _MOST:
            return None
        else:
            low = tried
        if not high:
            tried = min(round(tried * 1.15) + 1, _MOST)
        else:
            tried = round(math.sqrt(low * high)) if low else int(high / 1.15)
    return high


def seconds_of_command(image: Path, limit: float) -> float:
    """Wall-clock seconds of the command under a time limit."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.svg"
        command = [sys.executable, "-m", "gauss2svg", str(image), "-o", str(out), "--quiet"]
        begun = time.perf_counter()
        subprocess.run([*command, "--time-limit", str(limit)], check=True)
        return time.perf_counter() - begun


def main() -> None:
    """Parse the command line, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("images", nargs="+", type=Path)
    parser.add_argument("--psnr", type=float, default=30.0)
    parser.add_argument("--max-bytes", default="100k")
    parser.add_argument("--time-limit", type=float, default=5.0)
    parser.add_argument("--bisect", action="store_true")
    options = parser.parse_args()
    vectorize(options.images[0], gaussians=10, fit=FitOptions(iterations=2))  # compile first
    print(
        f"{'image':12}{'PSNR':>7}{'count':>7}{'smallest':>9}{'ratio':>7}{'s':>6} "
        f"|{'bytes':>9}{'PSNR':>7}  {'ended by':10}|{'wall s':>7}{'PSNR':>7}"
    )
    for image in options.images:
        by_psnr = vectorize(image, target_psnr=options.psnr).report
        smallest = None
        if options.bisect:
            smallest = smallest_count(image, options.psnr, by_psnr["gaussians"])
        ratio = f"{by_psnr['gaussians'] / smallest:.2f}" if smallest else "-"
        sized = vectorize(image, max_bytes=options.max_bytes).report
        timed = vectorize(image, time_limit=options.time_limit).report
        seconds = seconds_of_command(image, options.time_limit)
        print(
            f"{image.stem:12}{by_psnr['psnr_svg']:>7.2f}{by_psnr['gaussians']:>7}"
            f"{smallest or '-':>9}{ratio:>7}{by_psnr['total_s']:>6.1f} |{sized['svg_bytes']:>9}"
            f"{sized['psnr_svg']:>7.2f}  {sized['stop_reason']:10}|{seconds:>7.2f}"
            f"{timed['psnr_svg']:>7.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
