"""Stability: absurd learning rates and pictures of few pixels.

    python benchmarks/stability.py [PHOTO]

The script prints two Markdown tables. PSNR is that of the model in dB, if nothing else is said.
The photo, by default examples/coffee.jpg, is reduced to 256 px.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.options import FitConfig, FitOptions
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.target import TargetPyramid
from gauss2svg.measure import metrics
from gauss2svg.photo.alpha import shrunk
from gauss2svg.photo.load import WHITE, load_image
from gauss2svg.render import render

RATES = (1e-6, 0.1, 1.0, 10.0, 100.0, 1e3, 1e6)
SIDE = 256
GAUSSIANS, ITERATIONS = 500, 120
Picture = NDArray[np.float32]


def pictures() -> dict[str, Picture]:
    """Pictures at the limits: a pixel, a row, constant, noise, single steps."""
    rng = np.random.default_rng(0)
    black = np.zeros((64, 64, 3), np.float32)
    spot, level = black.copy(), black + np.float32(0.5)
    spot[20, 30] = 1
    level[20, 30] += 1 / 255
    board = (np.indices((64, 64)).sum(axis=0) % 2).astype(np.float32)
    ramp = np.broadcast_to(np.linspace(0, 1 / 255, 64, dtype=np.float32) + 0.5, (64, 64))
    step = np.broadcast_to((np.arange(64) > 31).astype(np.float32), (64, 64))
    grey = {"1-px checkerboard": board, "ramp of one level": ramp, "step": step}
    return {
        "1x1": np.full((1, 1, 3), 0.3, np.float32),
        "2x2": rng.random((2, 2, 3), np.float32),
        "3x3": rng.random((3, 3, 3), np.float32),
        "1x5000": rng.random((5000, 1, 3), np.float32),
        "5000x1": rng.random((1, 5000, 3), np.float32),
        "black": black,
        "white": black + 1,
        "one white pixel": spot,
        "one pixel a level off": level,
        "noise": rng.random((64, 64, 3), np.float32),
    } | {name: np.repeat(plane[:, :, None], 3, axis=2) for name, plane in grey.items()}


def psnr(picture: Picture, config: FitConfig, dtype: Any = np.float32) -> tuple[float, int]:
    """PSNR of a fit in dB, whose kernels compute in dtype, and how often it was rolled back."""
    targets = TargetPyramid(picture, config.fit.tuned, dtype)
    session = FitSession(picture, config, targets=targets)
    session.fit()
    fitted = session.result()
    model = np.clip(render(fitted.scene, picture.shape[1], picture.shape[0]), 0, 1)
    return metrics.psnr(model, picture), fitted.rollbacks


def of_rates(photo: Picture) -> Iterator[str]:
    columns = "alpha compositing, dB | rollbacks | additive, dB | rollbacks"
    yield f"| learning-rate multiplier | {columns} |"
    yield "|---|---|---|---|---|"
    for rate in RATES:
        kinds = (
            FitOptions(blend="over", learning_rate=rate),
            FitOptions(blend="add", learning_rate=rate),
        )
        configs = (FitConfig(gaussians=GAUSSIANS, iterations=ITERATIONS, fit=k) for k in kinds)
        found = (psnr(photo, config) for config in configs)
        cells = (f"{db:.2f} | {rollbacks}" for db, rollbacks in found)
        yield f"| {rate:g} | {' | '.join(cells)} |"


def of_pictures() -> Iterator[str]:
    yield "| picture | mean colour, dB | float32, dB | float64, dB |"
    yield "|---|---|---|---|"
    for name, picture in pictures().items():
        flat, fitted = FitConfig(gaussians=0, iterations=1), FitConfig(gaussians=60, iterations=60)
        kinds = (flat, np.float32), (fitted, np.float32), (fitted, np.float64)
        found = (psnr(picture, config, dtype)[0] for config, dtype in kinds)
        yield f"| {name} | " + " | ".join(f"{db:.2f}" for db in found) + " |"


def main(path: str) -> None:
    photo = load_image(path, matte=WHITE).pixels
    scale = min(1.0, SIDE / max(photo.shape[:2]))
    height, width = (max(1, round(side * scale)) for side in photo.shape[:2])
    photo = shrunk(photo, height, width)
    for table in (of_rates(photo), of_pictures()):
        for line in table:
            print(line, flush=True)
        print()


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else str(Path(__file__).with_name("coffee.jpg")))
