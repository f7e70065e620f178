"""Gaussians fitted by a loss of your own: python examples/loss.py PHOTO OUT.svg. It needs torch."""

import sys
from pathlib import Path

import numpy as np
import torch

from gauss2svg import Scene, check, write_svg
from gauss2svg.photo.load import load_image
from gauss2svg.render.autograd import fast_composite

# Found best, one by one, on small photos by L1 and squared error: of the mean in shares of the mean
# distance of Gaussians, of the others by what may be any number (logarithm, atanh, logits).
RATES = {"mean": 0.1, "sigma": 0.14, "rho": 0.14, "color": 0.1, "opacity": 0.4}
BETAS = 0.8, 0.95  # decays of Adam's moments


def loss_of(image: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Return the loss of two pictures (h, w, 3) in 0..1; put yours here."""
    return (image - target).abs().mean()


def scattered(target: torch.Tensor, n: int) -> Scene:
    """Round Gaussians at random, each of the colour that is under it."""
    height, width, _ = target.shape
    mean = torch.rand(n, 2).numpy() * [width, height]
    x, y = mean.astype(int).T
    sigma, half = np.full((n, 2), 0.5 * (width * height / n) ** 0.5), np.full(n, 0.5)
    background = target.numpy().mean((0, 1))
    return Scene(width, height, mean, sigma, np.zeros(n), target.numpy()[y, x], half, background)


def refined(scene: Scene, target: torch.Tensor, steps: int) -> Scene:
    """Return a scene after some steps towards the least loss; the last 40 % get ever smaller."""
    height, width, _ = target.shape
    mean, sigma, rho, color, opacity, background = (
        torch.tensor(getattr(scene, name), dtype=torch.float32)
        for name in ("mean", "sigma", "rho", "color", "opacity", "background")
    )
    rho = rho.clamp(-0.999, 0.999).atanh()
    raw = mean, sigma.log(), rho, color.logit(1e-3), opacity.logit(1e-3)
    groups = [
        {"params": [tensor.requires_grad_()], "lr": rate}
        for tensor, rate in zip(raw, RATES.values(), strict=True)
    ]
    groups[0]["lr"] *= (width * height / len(scene)) ** 0.5
    optimizer = torch.optim.Adam(groups, betas=BETAS)
    smaller = torch.optim.lr_scheduler.LambdaLR(
        optimizer, lambda step: 0.5 + 0.5 * np.cos(np.pi * max(0, step / max(1, steps) - 0.6) / 0.4)
    )

    def shapes():
        mean, sigma, rho, color, opacity = raw
        return mean, sigma.exp(), 0.9999 * rho.tanh(), color.sigmoid(), opacity.sigmoid()

    for _ in range(steps):
        loss = loss_of(fast_composite(*shapes(), background, height, width), target)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        smaller.step()
    mean, sigma, rho, color, opacity = (tensor.detach().numpy() for tensor in shapes())
    return Scene(width, height, mean, sigma, rho, color, opacity, scene.background)


def main(photo: str, out: str, n: int = 200, steps: int = 100) -> None:
    target = torch.from_numpy(load_image(photo).pixels)
    scene = refined(scattered(target, n), target, steps)
    Path(out).write_text(write_svg(scene), encoding="utf-8")
    print(f"{check(photo, out).psnr:.2f} dB")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
