"""Print the CPU seconds and the PSNR of a film's frames, refined from the frame before or new.

    python benchmarks/film.py COUNT [PHOTO ...]

A film is a crop of a photo of scikit-image that moves by 3 px and narrows by 1 % in each of its ten
frames of 384x256 px. Each frame has COUNT shapes. The photos are coffee and astronaut by default.
The table has means over all frames but the first: PSNR of the SVG in dB, CPU seconds of the whole
run and of its fit. New fits take the given numbers of steps. The last line is a new fit of the
PSNR of refined frames, interpolated.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from skimage import data

from gauss2svg import FitOptions, Result, vectorize

STEPS = (75, 100, 125, 150, 200)


def frames(name: str, count: int = 10) -> list[NDArray[np.uint8]]:
    """Return the frames of a film over a photo of scikit-image."""
    photo, (width, height) = Image.fromarray(getattr(data, name)()), (384, 256)
    across = 0.78 * min(photo.width, photo.height * width / height)
    boxes = []
    for k in range(count):
        side, x, y = across * 0.99**k, 0.03 * photo.width + 4 * k, 0.03 * photo.height + 2 * k
        boxes.append((x, y, x + side, y + side * height / width))
    return [
        np.asarray(photo.resize((width, height), Image.Resampling.LANCZOS, box)) for box in boxes
    ]


def main() -> None:
    """Parse the command line, print a table for each photo."""
    count, names = int(sys.argv[1]), sys.argv[2:] or ["coffee", "astronaut"]

    def run(frame: NDArray[np.uint8], **given: Any) -> tuple[Result, tuple[float, ...]]:
        begun = time.process_time()
        result = vectorize(frame, gaussians=count, **given)
        cpu_s = time.process_time() - begun
        return result, (result.report["psnr_svg"], cpu_s, result.report["fit_cpu_s"])

    for name in names:
        first, *rest = frames(name)
        before, refined = run(first)[0], []
        run(rest[0], start=before.scene)
        for frame in rest:
            before, costs = run(frame, start=before.scene)
            refined.append(costs)
        rows = {"refined": np.mean(refined, axis=0)}
        for steps in STEPS:
            costs = [run(frame, fit=FitOptions(iterations=steps))[1] for frame in rest]
            rows[f"new, {steps} steps"] = np.mean(costs, axis=0)
        new = np.array(list(rows.values())[1:]).T
        rows["new, as close"] = [np.interp(rows["refined"][0], new[0], values) for values in new]
        for label, row in rows.items():
            print(f"{name:12}{label:16}{row[0]:7.2f} dB {row[1]:6.2f} s {row[2]:6.2f} s")


if __name__ == "__main__":
    main()
