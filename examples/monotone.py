"""More must not be worse: PSNR over the presets, over byte limits and over counts.

    python examples/monotone.py [PHOTOS...] [--families presets,bytes,counts] [--only NAME,...]
        [--workers 2]

The pictures are those of examples/drawings.py, two flat faces, coffee and chelsea of scikit-image,
and PHOTOS. The script prints one Markdown row per picture and family: the PSNR of the rasterised
SVG in dB for each setting, in brackets how often the fit was rolled back; and at the end the
largest step down of each family, up to 50 dB, and the number of rollbacks.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from drawings import drawings
from drawn_pictures import flat_faces
from numpy.typing import NDArray
from skimage import data

from gauss2svg.photo.load import WHITE, load_image
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.presets import PRESETS
from gauss2svg.pipeline.vectorize import vectorize_by

FAMILIES: dict[str, list[dict[str, Any]]] = {
    "presets": [{"quality": name} for name in PRESETS],
    "bytes": [
        {"max_bytes": limit, "markup": "editable"} for limit in ("5k", "10k", "20k", "50k", "100k")
    ],
    "counts": [{"gaussians": count} for count in (256, 512, 1000, 2000, 4000, 8000)],
}


# dB: above it the 8 bits in which a renderer composites decide, not the Gaussians.
_MOST = 50.0


@dataclass(frozen=True)
class Series:
    """One picture over one family of settings: PSNR in dB, and rollbacks."""

    picture: str
    family: str
    psnr: list[float]
    rollbacks: list[int]

    @property
    def step_down(self) -> float:
        """How far in dB a setting ends under the best of the cheaper ones."""
        capped = np.minimum(self.psnr, _MOST)
        return float(max(np.maximum.accumulate(capped) - capped))

    def __str__(self) -> str:
        cells = (
            f"{db:.2f}" + (f" ({n})" if n else "")
            for db, n in zip(self.psnr, self.rollbacks, strict=True)
        )
        return f"| {self.picture} | {self.family} | {' | '.join(cells)} |"


def pictures(photos: list[Path]) -> Iterator[tuple[str, NDArray[np.float32]]]:
    """Name and picture (h, w, 3) in 0..1."""
    yield from drawings()
    yield from flat_faces()
    for name in ("coffee", "chelsea"):
        yield name, load_image(getattr(data, name)()).pixels
    for path in photos:
        yield path.stem, load_image(path, matte=WHITE).pixels


def series(threads: int | None, task: tuple[str, NDArray[np.float32], str]) -> Series:
    """The picture with every setting of the family."""
    name, pixels, family = task
    settings = [{**given, "threads": threads} for given in FAMILIES[family]]
    reports = [vectorize_by(Options.from_flat(given), pixels).report for given in settings]
    psnr = [np.inf if r["psnr_svg"] is None else r["psnr_svg"] for r in reports]
    return Series(name, family, psnr, [r["rollbacks"] for r in reports])


def main() -> None:
    """Parse the command line, print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("photos", nargs="*", type=Path)
    parser.add_argument("--families", default=",".join(FAMILIES))
    parser.add_argument("--only")
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    only = arguments.only and arguments.only.split(",")
    chosen = [p for p in pictures(arguments.photos) if not only or p[0] in only]
    tasks = [(*p, family) for family in arguments.families.split(",") for p in chosen]
    work = partial(series, 1 if arguments.workers > 1 else None)
    found = []
    with ProcessPoolExecutor(arguments.workers, get_context("spawn")) as pool:
        for row in pool.map(work, tasks):
            found.append(row)
            print(row, flush=True)
    for family in arguments.families.split(","):
        rows = [row for row in found if row.family == family]
        worst = max(rows, key=lambda row: row.step_down)
        rollbacks = sum(sum(row.rollbacks) for row in rows)
        print(
            f"{family}: largest step down {worst.step_down:.2f} dB ({worst.picture}), "
            f"{sum(row.step_down > 0.1 for row in rows)} of {len(rows)} over 0.1 dB, "
            f"{rollbacks} rollbacks"
        )


if __name__ == "__main__":
    main()
