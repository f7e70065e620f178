"""Scores that are measured on request. They need packages of the extra gauss2svg[scores].

SSIMULACRA2 (package ssimulacra2) and FLIP (package flip-evaluator) agree better with what people
see than PSNR and SSIM do. Each takes about a second for half a megapixel
(docs/decisions/metrics.md). Both are given pictures of 8 bits a channel, like the pictures that
their command lines read. FLIP runs in a process of its own.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.measure import NO_SCORES, ON_REQUEST, packages_missing
from gauss2svg.measure.roundtrip import score_of
from gauss2svg.pool import Pool, WorkerDiedError
from gauss2svg.processes import MEMORY_SHARE, free_bytes


def perceptual_scores(
    raster: NDArray[np.float32],
    photo: NDArray[np.float32],
    spare: int | None = None,
    known: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """Measure the scores of a raster against its photo, both (h, w, 3) or (h, w, 4) in 0..1.

    Return the scores by their keys in a report, and `scores_missing`. If the photo has alpha, a
    score is measured over white and over black, and the worse value counts.

    spare  bytes of memory that measuring each score may take. None means MEMORY_SHARE of the free
           memory
    known  scores that are already measured, by slug

    A score is None if its package is not installed or fails, if the picture is too small or too
    large for it, or if measuring it would take more than `spare` bytes. `scores_missing` then has
    a line that says why.
    """
    spare = max(int(MEMORY_SHARE * free_bytes()) if spare is None else spare, 0)
    values, missing = dict(known or {}), list(packages_missing())
    height, width = photo.shape[:2]
    for score in ON_REQUEST:
        if score.slug in values or not score.is_installed:
            continue
        obstacle, needed = "", score.pixel_bytes * height * width
        if min(height, width) < score.least_side:
            obstacle = f"it needs at least {score.least_side} px a side"
        elif needed > spare:
            memory = f"{needed / 1e9:.2g} GB of memory for {width}x{height} px"
            obstacle = f"it needs {memory}, and {spare / 1e9:.2g} GB are left"
        else:
            try:
                values[score.slug] = score_of(score, raster, photo)
            except (WorkerDiedError, ImportError, MemoryError) as error:
                obstacle = str(error)
        if obstacle:
            missing.append(f"{score.name} is not measured: {obstacle}")
    by_key = {score.key: values[score.slug] for score in ON_REQUEST if score.slug in values}
    return NO_SCORES | by_key | {"scores_missing": missing}


def ssimulacra2(image: NDArray[np.floating], photo: NDArray[np.floating]) -> float:
    """Return the SSIMULACRA2 of an image against its photo, both (h, w, 3) in 0..1.

    It is 100 for equal images. 90 stands for visually lossless, 70 for high quality, 50 for medium
    and 30 for low quality. Poor images are below 0. The order of the arguments matters.

    The score is 100 - 10 s^0.63, where s is a cubic polynomial of a weighted sum of 108 means. For
    each of the three channels of XYB and each of six scales, these are the 1-norm and the 4-norm of
    three errors: in structure, in added edges and in lost edges. The weights were fitted to
    people's opinions of compressed photos. Source: Jon Sneyers,
    https://github.com/cloudinary/ssimulacra2, in the package ssimulacra2.

    Each side must have at least 225 px. Below that, the package, like the reference implementation,
    leaves out the smallest scale, and applies its weights to the wrong means.
    """
    from ssimulacra2 import compute_ssimulacra2

    files = []
    for picture in (photo, image):  # the package reads files
        files.append(io.BytesIO())
        Image.fromarray(_eight_bits(picture)).save(files[-1], "PPM")
        files[-1].seek(0)
    return float(compute_ssimulacra2(*files))


def flip(image: NDArray[np.floating], photo: NDArray[np.floating]) -> float:
    """Return the mean LDR-FLIP of an image against its photo, both (h, w, 3) in 0..1.

    It is 0 for equal images. A pixel's FLIP is dE_c^(1 - dE_f). dE_c is the difference in colour:
    the HyAB distance in Hunt-adjusted L*a*b*, after filters that imitate the contrast sensitivity
    of the eye. dE_f is the difference in edges and points. Both are in 0..1. The package assumes 67
    pixels per degree of vision, as on a display 3840 px and 0.7 m wide that is seen from 0.7 m.
    Source: Andersson, Nilsson, Akenine-Moller, Oskarsson, Astrom and Fairchild, "FLIP: A Difference
    Evaluator for Alternating Images", 2020, in the package flip-evaluator.

    Raise WorkerDiedError if its process dies, and ImportError if the package is not installed.
    """
    # FLIP runs in a new process. Its OpenMP would hang in a forked process if the parent process
    # has used OpenMP.
    with Pool(1) as pool:
        return pool.submit(_flip, _eight_bits(image), _eight_bits(photo)).result()


def _flip(image: NDArray[np.uint8], photo: NDArray[np.uint8]) -> float:
    from flip_evaluator import evaluate

    of_photo, of_image = (one.astype(np.float32) / np.float32(255) for one in (photo, image))
    return float(evaluate(of_photo, of_image, "LDR", applyMagma=False)[1])


def _eight_bits(image: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.round(np.clip(image, 0, 1) * 255).astype(np.uint8)
