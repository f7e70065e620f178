"""Names that options of a fit choose among; without NumPy, for the help of the command line."""

from __future__ import annotations

from typing import Literal

Tune = Literal["perceptual", "psnr"]
PERCEPTUAL, PSNR = "perceptual", "psnr"

DEFAULT_LOSS = "mse"


def has_ssim(loss: str) -> bool:
    """Whether a loss has an SSIM term."""
    return loss.endswith("+ssim")
