"""Memory: the peak of each run, and the estimate made before it.

    python benchmarks/memory.py [--quick]

Each row is a process of its own that vectorises a synthetic photo; its peak resident size is read
from /proc (Linux). --quick skips photos of more than a megapixel.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from common import command_line, head, line
from PIL import Image

from gauss2svg.photo.load import header_of
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.run import load_of

_RUN = """
import json, sys
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.vectorize import vectorize_by
report = vectorize_by(Options.from_flat(json.loads(sys.argv[2])), sys.argv[1]).report
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(json.dumps([int(peak.split()[1]) * 1024, report["fit_width"], report["fit_height"]]))
"""
# Size of the photo (px), options, and its file; the number of iterations changes nothing.
_FILES: dict[str, tuple[str, dict[str, Any]]] = {
    "jpg": ("RGB", {"quality": 85}),
    "progressive.jpg": ("RGB", {"quality": 85, "progressive": True, "subsampling": 0}),
    "png": ("RGB", {"compress_level": 1}),
    "alpha.png": ("RGBA", {"compress_level": 1}),
    "webp": ("RGB", {"quality": 80, "method": 0}),
    "alpha.webp": ("RGBA", {"quality": 80, "method": 0}),
    "tif": ("RGB", {}),
    "bmp": ("RGB", {}),
    "gif": ("P", {}),
    "avif": ("RGB", {"quality": 60, "speed": 10}),
}
CASES: tuple[tuple[tuple[int, int], dict[str, Any]], ...] = (
    ((360, 280), {"gaussians": 0}),
    ((360, 280), {"gaussians": 50_000}),
    ((1200, 833), {"gaussians": 1000}),
    ((1200, 833), {"gaussians": 10_000}),
    ((1200, 833), {"gaussians": 10_000, "renderer": "cairo"}),
    ((1200, 833), {"gaussians": 10_000, "blend": "add"}),
    ((1200, 833), {"gaussians": 1000, "loss": "mse+ssim"}),
    ((1200, 833), {"gaussians": 50_000}),
    ((1200, 833), {"gaussians": 60_000, "inks": 6}),
    ((2048, 1536), {"gaussians": 30_000, "quality": "max"}),
    ((2048, 1536), {"gaussians": 1000, "quality": "max", "loss": "mse+ssim"}),
    ((2048, 1536), {"gaussians": 1000, "quality": "max", "inks": 6}),
    ((6000, 4000), {"gaussians": 500, "quality": "draft"}),
    ((6000, 4000), {"gaussians": 500, "quality": "draft", "renderer": "cairo"}),
    ((6000, 4000), {"gaussians": 500, "quality": "draft", "blend": "add"}),
    ((6000, 4000), {"gaussians": 500, "quality": "draft", "full_size": True}),
    *(((6000, 4000), {"gaussians": 500, "quality": "draft", "file": name}) for name in _FILES),
    ((8192, 8192), {"gaussians": 300, "quality": "draft"}),
    ((8192, 8192), {"gaussians": 300, "quality": "draft", "full_size": True}),
)


def photo(width: int, height: int) -> Image.Image:
    """Soft patches of colour, the same every time."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 255, (max(height // 40, 2), max(width // 40, 2), 3), np.uint8)
    return Image.fromarray(coarse).resize((width, height), Image.Resampling.BICUBIC)


def measured(path: Path, options: dict[str, Any]) -> tuple[int, int, int]:
    """Peak of a process in bytes, and the size (px) that its fit ran on."""
    command = [sys.executable, "-c", _RUN, str(path), json.dumps({"iterations": 3} | options)]
    done = subprocess.run(command, check=True, capture_output=True)
    peak, width, height = json.loads(done.stdout)
    return peak, width, height


def main() -> None:
    """Parse the command line, print the table."""
    parser = command_line(__doc__)
    parser.add_argument("--quick", action="store_true")
    quick = parser.parse_args().quick
    print(head(["photo, px", "options", "fit, px", "peak, MB", "estimate, MB", "ratio"]))
    with tempfile.TemporaryDirectory() as folder:
        for (width, height), options in CASES:
            if quick and width * height > 1e6:
                continue
            options = dict(options)
            name = options.pop("file", "jpg")
            path = Path(folder) / f"{width}x{height}.{name}"
            if not path.exists():
                mode, saving = _FILES[name]
                picture = photo(width, height)
                if mode == "RGBA":
                    picture.putalpha(Image.linear_gradient("L").resize((width, height)))
                picture.convert(mode).save(path, **saving)
            peak, fit_width, fit_height = measured(path, options)
            header = header_of(path)
            assert header is not None
            load = load_of(Plan(Options.from_flat(options)), header)
            named = ", ".join([name, *(f"{key} {value}" for key, value in options.items())])
            numbers = [f"{peak / 1e6:.0f}", f"{load.bytes / 1e6:.0f}", f"{load.bytes / peak:.2f}"]
            sizes = f"{width}x{height}", f"{fit_width}x{fit_height}"
            print(line([sizes[0], named, sizes[1], *numbers]), flush=True)


if __name__ == "__main__":
    main()
