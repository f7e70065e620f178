"""Whether targets are met: PSNR, bytes and time asked for, against what came out.

    python examples/targets.py IMAGES... [--psnr 30] [--max-bytes 100k] [--time-limit 5] [--bisect]

One line a photo. --bisect looks for the smallest count given by --gaussians that reaches the
PSNR, to 3 %, and prints how many times as many Gaussians --target-psnr took. The time is the
whole command's, by the wall clock, start of Python included.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from gauss2svg import vectorize

_CLOSE = 1.03  # times the smallest count end the bisection
_MOST = 20000


def smallest_count(image: Path, psnr: float, start: int) -> int | None:
    """The smallest fixed count whose drawn SVG reaches the PSNR; None if _MOST does not."""
    low, high = 1, 0
    tried = start
    while not high or high / low > _CLOSE:
        report = vectorize(image, gaussians=tried).report
        if report["psnr_svg"] >= psnr:
            high = tried
        else:
            low = tried
            if tried == _MOST:
                return None
        if not high:
            tried = min(round(tried * 1.15), _MOST)
        else:
            tried = round(high / 1.15) if low == 1 else round(math.sqrt(low * high))
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
    vectorize(options.images[0], gaussians=10, iterations=2)  # compile before any clock runs
    print(
        f"{'image':12}{'PSNR':>7}{'count':>7}{'smallest':>9}{'ratio':>7}{'s':>6} "
        f"|{'bytes':>9}{'PSNR':>7}  {'ended by':10}|{'wall s':>7}{'PSNR':>7}"
    )
    for image in options.images:
        aimed = vectorize(image, target_psnr=options.psnr).report
        smallest = None
        if options.bisect:
            smallest = smallest_count(image, options.psnr, aimed["gaussians"])
        ratio = f"{aimed['gaussians'] / smallest:.2f}" if smallest else "-"
        sized = vectorize(image, max_bytes=options.max_bytes).report
        timed = vectorize(image, time_limit=options.time_limit).report
        seconds = seconds_of_command(image, options.time_limit)
        print(
            f"{image.stem:12}{aimed['psnr_svg']:>7.2f}{aimed['gaussians']:>7}{smallest or '-':>9}"
            f"{ratio:>7}{aimed['total_s']:>6.1f} |{sized['svg_bytes']:>9}{sized['psnr_svg']:>7.2f}"
            f"  {sized['stop_reason']:10}|{seconds:>7.2f}{timed['psnr_svg']:>7.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
