"""Scores that are measured on request. They need packages of the extra gauss2svg[scores].

SSIMULACRA2 (package ssimulacra2) and FLIP (package flip-evaluator) are nearer to what people see
than PSNR and SSIM. Each takes about a second for half a megapixel (docs/decisions/metrics.md). Both
get pictures of 8 bits a channel, as their command lines do. FLIP runs in a process of its own,
`python -m gauss2svg.measure.perceptual`.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.errors import InputError
from gauss2svg.measure import (
    ADVICE,
    ON_REQUEST,
    SSIMULACRA2,
    Score,
    Scores,
    ScoresMissingError,
    packages_missing,
)
from gauss2svg.measure.metrics import LEVELS, check_shapes
from gauss2svg.measure.roundtrip import score_of
from gauss2svg.photo import DEFAULT_MAX_PIXELS
from gauss2svg.processes import MEMORY_SHARE, free_bytes, module_command, python_environment, run


def perceptual_scores(
    raster: NDArray[np.float32],
    photo: NDArray[np.float32],
    spare: int | None = None,
    known: Mapping[str, float] | None = None,
) -> Scores:
    """Return the requested scores of a raster against its photo, (h, w, 3) or (h, w, 4) in 0..1.

    spare  bytes of memory that each score may take. None means MEMORY_SHARE of the free memory
    known  scores by slug that are already measured

    A score is None if its package is not installed or fails, if the picture is too small or too
    large for it, or if measuring it would take more than `spare`. `missing` then says why.
    Raise InputError for pictures that differ in shape.
    """
    check_shapes(raster, photo)
    spare = int(MEMORY_SHARE * free_bytes()) if spare is None else spare
    values, missing = dict(known or {}), list(packages_missing())
    for score in ON_REQUEST:
        if score.slug in values or not score.is_installed:
            continue
        obstacle = _obstacle(score, photo.shape[0], photo.shape[1], spare)
        try:
            if not obstacle:
                values[score.slug] = score_of(score, raster, photo)
        except (ChildProcessError, InputError) as error:
            obstacle = str(error)
        if obstacle:
            missing.append(f"{score.name} is not measured: {obstacle}")
    return Scores(values, tuple(missing))


def _obstacle(score: Score, height: int, width: int, spare: int) -> str:
    """Return why a picture of this size cannot be measured in `spare` bytes, "" if it can."""
    needed = score.pixel_bytes * height * width
    if min(height, width) < score.least_side:
        return f"it needs at least {score.least_side} px a side"
    if height * width > DEFAULT_MAX_PIXELS:
        return f"it is limited to {DEFAULT_MAX_PIXELS} px"
    if needed > spare:
        memory = f"{needed / 1e9:.2g} GB of memory for {width}x{height} px"
        return f"it needs {memory}, and {max(spare, 0) / 1e9:.2g} GB are left"
    return ""


def ssimulacra2(image: NDArray[np.floating], photo: NDArray[np.floating]) -> float:
    """Return SSIMULACRA2 of an image against its photo, (h, w, 3) in 0..1. 100 if they are equal.

    It is 100 - 10 s^0.63, where s is a cubic polynomial of a weighted sum of 108 means: for each of
    three channels of XYB and six scales, the 1-norm and the 4-norm of three errors, which are in
    structure, added edges and lost edges. The weights were fitted to people's opinions of
    compressed photos: 30 is low quality, 50 medium, 70 high, 90 visually lossless. Poor pictures
    are below 0. The order of the arguments matters. Source: Jon Sneyers,
    https://github.com/cloudinary/ssimulacra2, in the package ssimulacra2.

    Raise InputError if a side is under 225 px: the smallest scale is then left out, and the
    package, like the reference implementation, applies its weights to the wrong means. Raise
    ScoresMissingError if the package is not installed.
    """
    height, width = image.shape[:2]
    if min(height, width) < SSIMULACRA2.least_side:
        raise InputError(
            f"an image for SSIMULACRA2 must be at least {SSIMULACRA2.least_side} px a side; "
            f"got {width}x{height} px. Try SSIM"
        )
    try:
        from ssimulacra2 import compute_ssimulacra2
    except ImportError as error:
        raise ScoresMissingError(f"SSIMULACRA2 cannot be imported: {error}. {ADVICE}") from error
    # The package reads files, which may be in memory.
    return float(compute_ssimulacra2(_as_file(photo), _as_file(image)))


def flip(image: NDArray[np.floating], photo: NDArray[np.floating]) -> float:
    """Return the mean LDR-FLIP of an image and its photo, (h, w, 3) in 0..1. 0 if they are equal.

    A pixel's FLIP is dE_c^(1 - dE_f). dE_c is the HyAB distance in a Hunt-adjusted L*a*b* after
    filters of contrast sensitivity, and dE_f the difference of edges and points. Both are in 0..1,
    at the package's 67 pixels per degree (a display of 3840 px in 0.7 m, seen from 0.7 m).
    Source: Andersson, Nilsson, Akenine-Moller, Oskarsson, Astrom and Fairchild, "FLIP: A Difference
    Evaluator for Alternating Images", 2020, in the package flip-evaluator.

    Raise ChildProcessError if FLIP's process fails, as it does if the package is not installed.
    """
    height, width = photo.shape[:2]
    # FLIP gets a new process, because its OpenMP hangs in a fork of a process that has used OpenMP.
    command = module_command("gauss2svg.measure.perceptual", str(height), str(width))
    data = _eight_bits(photo).tobytes() + _eight_bits(image).tobytes()
    ended = run(command, data, environment=python_environment())
    if ended.status:
        why = ended.complaint or "was there enough memory?"
        raise ChildProcessError(f"its process ended with status {ended.status}: {why}")
    return float(ended.output)


def main() -> None:
    """Read two pictures (height, width, 3) of 8 bits from standard input, and print their FLIP."""
    from flip_evaluator import evaluate

    height, width = map(int, sys.argv[1:])
    levels = np.frombuffer(sys.stdin.buffer.read(), np.uint8).reshape(2, height, width, 3)
    photo, image = levels.astype(np.float32) / np.float32(LEVELS)
    print(evaluate(photo, image, "LDR", applyMagma=False)[1])


def _eight_bits(image: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.round(np.clip(image, 0, 1) * LEVELS).astype(np.uint8)


def _as_file(image: NDArray[np.floating]) -> io.BytesIO:
    stream = io.BytesIO()
    Image.fromarray(_eight_bits(image)).save(stream, "PPM")
    stream.seek(0)
    return stream


if __name__ == "__main__":
    main()
