"""A fit by a loss of your own beside the usual one: python examples/loss.py PHOTO OUT.svg.

It needs torch.
"""

import sys

import torch
from torch.nn.functional import conv2d

from gauss2svg import FitOptions, vectorize
from gauss2svg.render.autograd import torch_loss

ALONG = torch.tensor([[1.0, 0.0, -1.0], [2.0, 0.0, -2.0], [1.0, 0.0, -1.0]]) / 8
SOBEL = torch.stack([ALONG, ALONG.T])[:, None]
EDGES = 1.0  # weight of the squared error of edges beside that of colours


def edges(image: torch.Tensor) -> torch.Tensor:
    """Return the slopes (3, 2, h - 2, w - 2) of a picture (h, w, 3) along x and y."""
    return conv2d(image.movedim(-1, 0)[:, None], SOBEL)


def loss_of(image: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Return the loss of two pictures (h, w, 3) in 0..1; put yours here."""
    slopes = (edges(image) - edges(target)).square().mean()
    return (image - target).square().mean() + EDGES * slopes


def main(photo: str, out: str, gaussians: int = 1000, iterations: int = 200) -> None:
    for loss in ("weighted", torch_loss(loss_of)):
        options = FitOptions(loss=loss, iterations=iterations)
        result = vectorize(photo, gaussians=gaussians, fit=options)
        count, name = result.report["gaussians"], result.report["loss"]
        print(f"{name}: {result.report['psnr_svg']:.2f} dB by {count} Gaussians")
    result.save(out)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
