"""How much memory runs take, and how much was estimated before them.

    python examples/memory.py [--quick]

Each row is a process of its own that vectorises a photo made here, after the kernels have been
compiled; its largest resident size is read from /proc (Linux). --quick leaves out photos of more
than a megapixel.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from gauss2svg.pipeline.memory_budget import Load
from gauss2svg.pipeline.kernels import compile_kernels

_RUN = """
import json, sys
from gauss2svg import vectorize
report = vectorize(sys.argv[1], **json.loads(sys.argv[2])).report
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(json.dumps([int(peak.split()[1]) * 1024, report["fit_width"], report["fit_height"]]))
"""
# Photo in px, and options of vectorize; steps of the optimiser change nothing.
CASES: tuple[tuple[tuple[int, int], dict[str, Any]], ...] = (
    ((360, 280), {"gaussians": 0}),
    ((360, 280), {"gaussians": 50_000}),
    ((1200, 833), {"gaussians": 1000}),
    ((1200, 833), {"gaussians": 10_000}),
    ((1200, 833), {"gaussians": 10_000, "renderer": "cairo"}),
    ((1200, 833), {"gaussians": 10_000, "blend": "add"}),
    ((1200, 833), {"gaussians": 10_000, "dtype": "float64"}),
    ((1200, 833), {"gaussians": 1000, "loss": "mse+ssim"}),
    ((1200, 833), {"gaussians": 50_000}),
    ((2048, 1536), {"gaussians": 30_000, "quality": "max"}),
    ((2048, 1536), {"gaussians": 1000, "quality": "max", "loss": "mse+ssim"}),
    ((2048, 1536), {"gaussians": 1000, "quality": "max", "loss": "mse+ssim", "dtype": "float64"}),
    ((6000, 4000), {"gaussians": 500, "quality": "draft"}),
    ((6000, 4000), {"gaussians": 500, "quality": "draft", "renderer": "cairo"}),
    ((6000, 4000), {"gaussians": 500, "quality": "draft", "blend": "add"}),
    ((8192, 8192), {"gaussians": 300, "quality": "draft"}),
)
_QUICK_PX = 1_000_000


def photo(width: int, height: int) -> Image.Image:
    """Soft patches of colour, the same every time."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 255, (max(height // 40, 2), max(width // 40, 2), 3), np.uint8)
    return Image.fromarray(coarse).resize((width, height), Image.Resampling.BICUBIC)


def measured(path: Path, options: dict[str, Any]) -> tuple[int, int, int]:
    """Bytes that a process took, and the size of its fit in px."""
    command = [sys.executable, "-c", _RUN, str(path), json.dumps({"iterations": 3} | options)]
    done = subprocess.run(command, check=True, capture_output=True)
    peak, width, height = json.loads(done.stdout)
    return peak, width, height


def main() -> None:
    """Parse the command line, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true")
    quick = parser.parse_args().quick
    for dtype, blend in (("float32", "over"), ("float64", "over"), ("float32", "add")):
        compile_kernels(dtype, blend)
    print("| photo, px | options | fit, px | took, MB | estimated, MB | ratio |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for (width, height), options in CASES:
            if quick and width * height > _QUICK_PX:
                continue
            path = Path(folder) / f"{width}x{height}.jpg"
            if not path.exists():
                photo(width, height).save(path, quality=85)
            took, across, down = measured(path, options)
            kinds = {name: options[name] for name in ("loss", "dtype", "blend") if name in options}
            expected = Load(width, height, across, down, options["gaussians"], **kinds).bytes
            named = ", ".join(f"{name} {value}" for name, value in options.items())
            print(
                f"| {width}x{height} | {named} | {across}x{down} | {took / 1e6:.0f} "
                f"| {expected / 1e6:.0f} | {expected / took:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
