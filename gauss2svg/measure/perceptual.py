"""Scores that are measured on request. They need packages of the extra gauss2svg[scores].

SSIMULACRA2 (package ssimulacra2) and FLIP (package flip-evaluator) are nearer to what people see
than PSNR and SSIM. Each takes about a second for half a megapixel (docs/decisions/metrics.md). Both
see 8 bits a channel, as their command lines do. FLIP runs in a process of
`python -m gauss2svg.measure.perceptual`.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.errors import InputError
from gauss2svg.measure.memory import SHARE, free_bytes
from gauss2svg.measure.metrics import LEVELS, check_shapes
from gauss2svg.measure.scores import FLIP, ON_REQUEST, SSIMULACRA2, Score
from gauss2svg.photo.alpha import views
from gauss2svg.photo.formats import DEFAULT_MAX_PIXELS
from gauss2svg.processes import module_command, module_path, run

_ADVICE = 'Try pip install "gauss2svg[scores]"'


class ScoresMissingError(InputError, ImportError):
    """A requested score needs a package that is not installed."""


@dataclass(frozen=True)
class Scores:
    """Scores of a raster on request. With alpha, each is the worse of over white and over black.

    values   scores by slug. Each is an attribute as well, which is None if it is not measured
    missing  one line for each reason why a score is None
    """

    values: Mapping[str, float] = field(default_factory=dict)
    missing: tuple[str, ...] = ()

    def __getattr__(self, name: str) -> float | None:
        if name not in (score.slug for score in ON_REQUEST):
            raise AttributeError(name)
        return self.values.get(name)

    @property
    def report(self) -> dict[str, Any]:
        """Scores by the keys of a report."""
        scores = {score.key: self.values.get(score.slug) for score in ON_REQUEST}
        return {**scores, "scores_missing": list(self.missing)}


def perceptual_scores(
    raster: NDArray[np.float32],
    photo: NDArray[np.float32],
    spare: int | None = None,
    known: Mapping[str, float] | None = None,
) -> Scores:
    """Return the scores on request of a raster against its photo, (h, w, 3) or (h, w, 4) in 0..1.

    spare  bytes of memory that may be taken. None means SHARE of the free memory
    known  scores that are measured already, by slug

    A score is None, with a line that says why, if its package is not installed or fails, if the
    picture is too small or too large for it, or if it would take more memory than `spare`. Raise
    InputError for pictures that differ in shape.
    """
    check_shapes(raster, photo)
    spare = int(SHARE * free_bytes()) if spare is None else spare
    values, missing = dict(known or {}), list(packages_missing())
    for score in ON_REQUEST:
        if score.slug in values or not score.is_installed:
            continue
        try:
            _check_size(score, photo.shape[0], photo.shape[1], spare)
            values[score.slug] = measured(score, raster, photo)
        except (ChildProcessError, InputError) as error:
            missing.append(f"{score.name} is not measured: {error}")
    return Scores(values, tuple(missing))


def measured(score: Score, raster: NDArray[np.float32], photo: NDArray[np.float32]) -> float:
    """Return a raster's score. With alpha, it is the worse of over white and over black."""
    pairs = zip(views(raster), views(photo), strict=True)
    return score.worst([score.function(*pair) for pair in pairs])


def _check_size(score: Score, height: int, width: int, spare: int) -> None:
    """Raise InputError if a score cannot measure a picture of this size in `spare` bytes."""
    if min(height, width) < score.least_side:
        raise InputError(f"it needs at least {score.least_side} px a side")
    if height * width > DEFAULT_MAX_PIXELS:
        raise InputError(f"it is limited to {DEFAULT_MAX_PIXELS} px")
    needed = score.pixel_bytes * height * width
    if needed > spare:
        raise InputError(
            f"it needs {needed / 1e9:.2g} GB of memory for {width}x{height} px, and "
            f"{max(spare, 0) / 1e9:.2g} GB are left"
        )


def packages_missing() -> tuple[str, ...]:
    """Return a line that names the scores whose packages are not installed, or nothing."""
    names = [score.name for score in ON_REQUEST if not score.is_installed]
    return (_not_installed(names),) if names else ()


def _not_installed(names: Sequence[str]) -> str:
    verb = "is" if len(names) == 1 else "are"
    return f"{' and '.join(names)} {verb} not measured: not installed. {_ADVICE}"


def require_packages(score: Score | None = None) -> None:
    """Raise ScoresMissingError unless the package of a score is installed.

    Without a score, the package of any is enough, because FLIP has none for the newest Python.
    """
    scores = [each for each in ON_REQUEST if each.module] if score is None else [score]
    if not any(each.is_installed for each in scores):
        raise ScoresMissingError(_not_installed([each.name for each in scores]))


def packages() -> dict[str, str]:
    """Return the versions of the installed packages, by their names on PyPI."""
    return {s.package: version(s.package) for s in ON_REQUEST if s.package and s.is_installed}


def ssimulacra2(image: NDArray[np.floating], photo: NDArray[np.floating]) -> float:
    """Return SSIMULACRA2 of an image against its photo, (h, w, 3) in 0..1. Equal ones have 100.

    It is 100 - 10 s^0.63, where s is a cubic polynomial of the weighted sum of 108 means. They are
    of errors of structure, of edges that the photo does not have, and of edges that are lost. Each
    is taken in the three channels of XYB, at six scales, by the 1-norm and the 4-norm. The weights
    were fitted to opinions of compressed photos: 30 is low quality, 50 medium, 70 high, 90 visually
    lossless. Poor pictures are below 0. The order of the arguments matters. Source: Jon Sneyers,
    https://github.com/cloudinary/ssimulacra2, in the package ssimulacra2.

    Raise InputError under 225 px a side, because the smallest scale is then left out, and the
    package applies its weights to the wrong means, as the reference implementation does. Raise
    ScoresMissingError if the package is not installed.
    """
    check_shapes(image, photo)
    height, width = image.shape[:2]
    if min(height, width) < SSIMULACRA2.least_side:
        raise InputError(
            f"an image for SSIMULACRA2 must be at least {SSIMULACRA2.least_side} px a side; "
            f"got {width}x{height} px. Try SSIM"
        )
    try:
        from ssimulacra2 import compute_ssimulacra2
    except ImportError as error:
        raise ScoresMissingError(f"SSIMULACRA2 cannot be imported: {error}. {_ADVICE}") from error
    # The package reads files, which are in memory here.
    return float(compute_ssimulacra2(_as_file(photo), _as_file(image)))


def flip(image: NDArray[np.floating], photo: NDArray[np.floating]) -> float:
    """Return the mean LDR-FLIP of an image and its photo, (h, w, 3) in 0..1. Equal ones have 0.

    At each pixel it is dE_c^(1 - dE_f). dE_c is the HyAB distance in a Hunt-adjusted L*a*b* after
    filters of contrast sensitivity, and dE_f the difference of edges and points. Both are in 0..1,
    at 67 pixels per degree, the package's default (0.7 m from a display of 3840 px in 0.7 m).
    Source: Andersson, Nilsson, Akenine-Moller, Oskarsson, Astrom and Fairchild, "FLIP: A Difference
    Evaluator for Alternating Images", 2020, in the package flip-evaluator.

    Raise ScoresMissingError if the package is not installed, and ChildProcessError if its process
    fails.
    """
    check_shapes(image, photo)
    if not FLIP.is_installed:
        raise ScoresMissingError(f"FLIP is not installed. {_ADVICE}")
    height, width = photo.shape[:2]
    # FLIP gets a new process, because its OpenMP hangs in a fork of a process that has used it.
    command = module_command("gauss2svg.measure.perceptual", str(height), str(width))
    data = _eight_bits(photo).tobytes() + _eight_bits(image).tobytes()
    ended = run(command, data, environment=module_path())
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
