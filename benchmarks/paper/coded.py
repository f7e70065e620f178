"""The photos as ordinary image files: a lossless PNG and a JPEG."""

from __future__ import annotations

import io
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image

from gauss2svg.measure import metrics

from .photos import Pixels
from .table import Row

JPEG_QUALITY = 90
PNG, JPEG = "PNG, lossless", f"JPEG, quality {JPEG_QUALITY}"


@dataclass(frozen=True)
class Coded:
    """One photo as an image file: bytes, and PSNR in dB and SSIM against the photo."""

    photo: str
    kind: str
    file_bytes: float
    psnr: float
    ssim: float


def coded(photos: dict[str, Pixels]) -> list[Coded]:
    """Every photo as PNG and as JPEG."""
    files = []
    for name, pixels in photos.items():
        levels = Image.fromarray(np.round(pixels * 255).astype(np.uint8))
        for kind, options in (
            (PNG, {"format": "PNG", "optimize": True}),
            (JPEG, {"format": "JPEG", "quality": JPEG_QUALITY}),
        ):
            stream = io.BytesIO()
            levels.save(stream, **options)
            with Image.open(stream) as image:
                again = np.asarray(image.convert("RGB"), np.float32) / 255
            psnr, ssim = metrics.psnr(again, pixels), metrics.ssim(again, pixels)
            files.append(Coded(name, kind, stream.tell(), psnr, ssim))
    return files


def means(files: Sequence[Coded]) -> dict[str, Coded]:
    """Mean over the photos, by kind."""
    return {
        kind: Coded(
            "mean",
            kind,
            *(
                statistics.fmean(getattr(f, n) for f in files if f.kind == kind)
                for n in ("file_bytes", "psnr", "ssim")
            ),
        )
        for kind in (PNG, JPEG)
    }


def larger_from(rows: Sequence[Row], column: str, limit: float) -> int | None:
    """Least count from which on all rows exceed the limit; None if the last row does not.

    column is svg_bytes or svgz_bytes; rows ascend by count.
    """
    found = None
    for row in reversed(rows):
        if getattr(row, column) <= limit:
            break
        found = round(row.count)
    return found
