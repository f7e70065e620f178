"""Gaussians fitted by a loss of your own: python examples/loss.py PHOTO OUT.svg. It needs torch."""

import sys
from pathlib import Path

import torch

from gauss2svg import Scene, check, write_svg
from gauss2svg.photo.load import load_image
from gauss2svg.render.autograd import fast_composite


def loss_of(image: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Of two pictures (h, w, 3) in 0..1; put yours here."""
    return (image - target).abs().mean()


def fitted(target: torch.Tensor, n: int, steps: int) -> Scene:
    """Mean (n, 2) and sigma (n, 2) in px, rho, color, opacity, each by what may be any number."""
    height, width, _ = target.shape
    mean = torch.rand(n, 2) * torch.tensor([width, height])
    x, y = mean.long().T
    sigma = torch.full((n, 2), 0.5 * (width * height / n) ** 0.5)
    color, opacity = target[y, x].logit(eps=1e-3), torch.zeros(n)
    raw = [t.requires_grad_() for t in (mean, sigma.log(), torch.zeros(n), color, opacity)]
    background = target.mean((0, 1))

    def shapes():
        mean, sigma, rho, color, opacity = raw
        return mean, sigma.exp(), 0.999 * rho.tanh(), color.sigmoid(), opacity.sigmoid(), background

    optimizer = torch.optim.NAdam(raw, lr=0.05)  # or another one
    for _ in range(steps):
        loss = loss_of(fast_composite(*shapes(), height, width), target)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    mean, sigma, rho, color, opacity, _ = (t.detach().numpy() for t in shapes())
    return Scene(width, height, mean, sigma, rho, color, opacity, background.numpy())


def main(photo: str, out: str, n: int = 200, steps: int = 100) -> None:
    scene = fitted(torch.from_numpy(load_image(photo).pixels), n, steps)
    Path(out).write_text(write_svg(scene), encoding="utf-8")
    print(f"{check(photo, out).psnr:.2f} dB")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
