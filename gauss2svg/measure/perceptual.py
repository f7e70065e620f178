"""The scores that are measured on request, and those of the optional extra gauss2svg[scores].

SSIMULACRA2 (package ssimulacra2) and FLIP (package flip-evaluator) are nearer to what people see
than PSNR and SSIM, and take about a second each for half a megapixel (docs/decisions/metrics.md).
Both see 8 bits a channel, as their command lines do. `python -m gauss2svg.measure.perceptual` is
the process in which FLIP runs.
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
    """A package that scores are asked of is not installed."""


@dataclass(frozen=True)
class Scores:
    """Scores of a raster on request; of a transparent one the worse of over white and over black.

    values   by the names of the scores; each is an attribute as well, None where it is not measured
    missing  one line for each reason that a score is None
    """

    values: Mapping[str, float] = field(default_factory=dict)
    missing: tuple[str, ...] = ()

    def __getattr__(self, name: str) -> float | None:
        if name not in (score.slug for score in ON_REQUEST):
            raise AttributeError(name)
        return self.values.get(name)

    @property
    def report(self) -> dict[str, Any]:
        """The scores by the keys of a report."""
        found = {score.key: self.values.get(score.slug) for score in ON_REQUEST}
        return {**found, "scores_missing": list(self.missing)}


def perceptual_scores(
    raster: NDArray[np.float32],
    photo: NDArray[np.float32],
    spare: int | None = None,
    known: Mapping[str, float] | None = None,
) -> Scores:
    """The scores on request of a raster against its photo, (h, w, 3) or (h, w, 4) in 0..1.

    spare  bytes of memory that may be taken; None: SHARE of those that are free
    known  what has been measured already, by name

    A score is None, with a line that says why, where its package is not installed, where the
    picture is too small or too large for it, where it would take more memory, and where its package
    fails. Raises InputError for pictures that differ in shape.
    """
    check_shapes(raster, photo)
    spare = int(SHARE * free_bytes()) if spare is None else spare
    found, missing = dict(known or {}), list(packages_missing())
    for score in ON_REQUEST:
        if score.slug in found or not score.is_installed:
            continue
        try:
            _check_size(score, photo.shape[0], photo.shape[1], spare)
            found[score.slug] = measured(score, raster, photo)
        except (ChildProcessError, InputError) as error:
            missing.append(f"{score.name} is not measured: {error}")
    return Scores(found, tuple(missing))


def measured(score: Score, raster: NDArray[np.float32], photo: NDArray[np.float32]) -> float:
    """A score of a raster against a photo of its shape; with alpha the worse of white and black."""
    pairs = zip(views(raster), views(photo), strict=True)
    return score.worst([score.function(*pair) for pair in pairs])


def _check_size(score: Score, height: int, width: int, spare: int) -> None:
    """Raise InputError for a picture that cannot be measured in so much memory."""
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
    """A line that names the scores whose packages are not installed; nothing where all are."""
    names = [score.name for score in ON_REQUEST if not score.is_installed]
    return (_not_installed(names),) if names else ()


def _not_installed(names: Sequence[str]) -> str:
    verb = "is" if len(names) == 1 else "are"
    return f"{' and '.join(names)} {verb} not measured: not installed. {_ADVICE}"


def require_packages(asked: Score | None = None) -> None:
    """Raise ScoresMissingError, which says how to get it, unless a score's package is installed.

    Without a score any is enough, for FLIP has no package for the newest Python.
    """
    scores = [score for score in ON_REQUEST if score.module] if asked is None else [asked]
    if not any(score.is_installed for score in scores):
        raise ScoresMissingError(_not_installed([score.name for score in scores]))


def packages() -> dict[str, str]:
    """Versions of the installed packages, by their names on PyPI."""
    return {s.package: version(s.package) for s in ON_REQUEST if s.package and s.is_installed}


def ssimulacra2(image: NDArray[np.floating], photo: NDArray[np.floating]) -> float:
    """SSIMULACRA2 of an image against its photo, (h, w, 3) in 0..1; equal ones have 100.

    100 - 10 s^0.63, with s a cubic polynomial of the weighted sum of 108 means: of the errors of
    structure, of edges that the photo does not have and of edges that are lost, in the three
    channels of XYB, at six scales, by the 1-norm and the 4-norm. The weights were fitted to
    opinions of compressed photos: 30 is low quality, 50 medium, 70 high, 90 visually lossless;
    poor pictures are below 0. Jon Sneyers, https://github.com/cloudinary/ssimulacra2; by the
    package ssimulacra2, whose own function this is. The order matters.

    Raises InputError under 225 px a side, where a scale falls away and the weights of the
    reference implementation, and of the package, meet the wrong means. Raises ScoresMissingError
    where the package is not installed.
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
    # The package reads files; these are in memory.
    return float(compute_ssimulacra2(_as_file(photo), _as_file(image)))


def flip(image: NDArray[np.floating], photo: NDArray[np.floating]) -> float:
    """Mean of the LDR-FLIP map of an image and its photo, (h, w, 3) in 0..1; equal ones have 0.

    At each pixel dE_c^(1 - dE_f): dE_c is the HyAB distance in a Hunt-adjusted L*a*b* after
    filters of contrast sensitivity, dE_f the difference of edges and points; both in 0..1, at 67
    pixels per degree, the package's default (0.7 m from a display of 3840 px in 0.7 m). Andersson,
    Nilsson, Akenine-Moller, Oskarsson, Astrom and Fairchild, "FLIP: A Difference Evaluator for
    Alternating Images", 2020; by the package flip-evaluator, in a process of its own.

    Raises ScoresMissingError where the package is not installed, ChildProcessError where its
    process fails.
    """
    check_shapes(image, photo)
    if not FLIP.is_installed:
        raise ScoresMissingError(f"FLIP is not installed. {_ADVICE}")
    height, width = photo.shape[:2]
    # In a process of its own: its OpenMP hangs in the child of a process that has used it.
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
