"""PSNR of examples/loss.py by its learning rates, mean of L1 and squared error.

python benchmarks/rates.py [STEPS]    # needs torch

The rates were found one by one on the first two pictures; the others were not looked at.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from skimage import data

from gauss2svg.render import render

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
import loss  # pyright: ignore[reportMissingImports]

PICTURES = {"found on": (data.astronaut, data.coffee), "others": (data.chelsea, data.rocket)}
LOSSES = (lambda a, b: (a - b).abs().mean(), lambda a, b: (a - b).square().mean())
CHOSEN = tuple(loss.RATES.values())
VARIANTS = (
    ((0.05,) * 5, (0.9, 0.999)),
    ((0.1,) * 5, (0.9, 0.999)),
    (CHOSEN, (0.9, 0.999)),
    (CHOSEN, loss.BETAS),
)


def decibels(picture: np.ndarray, steps: int, n: int = 120) -> float:
    small = Image.fromarray(picture).resize((80, 60), Image.Resampling.LANCZOS)
    target = torch.from_numpy(np.asarray(small, np.float32) / 255)
    found = []
    for loss.loss_of in LOSSES:
        torch.manual_seed(0)
        scene = loss.refined(loss.scattered(target, n), target, steps)
        found.append(-10 * np.log10(np.square(render(scene) - target.numpy()).mean()))
    return float(np.mean(found))


if __name__ == "__main__":
    names, steps = tuple(loss.RATES), int(sys.argv[1]) if len(sys.argv) > 1 else 80
    for rates, loss.BETAS in VARIANTS:
        loss.RATES = dict(zip(names, rates, strict=True))
        means = {
            group: np.mean([decibels(picture(), steps) for picture in pictures])
            for group, pictures in PICTURES.items()
        }
        print(rates, loss.BETAS, {group: f"{mean:.2f} dB" for group, mean in means.items()})
