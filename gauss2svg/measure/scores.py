"""Perceptual scores, by the packages of the optional extra gauss2svg[scores].

SSIMULACRA2 (package ssimulacra2) and FLIP (package flip-evaluator) are nearer to what people see
than PSNR and SSIM, and take about a second each for half a megapixel (docs/decisions/metrics.md).
Both see 8 bits a channel, as their command lines do. `python -m gauss2svg.measure.scores` is the
process in which FLIP runs.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.errors import InputError
from gauss2svg.measure.drawing import import_path
from gauss2svg.measure.memory import SHARE, free_bytes
from gauss2svg.photo.alpha import views
from gauss2svg.photo.limits import DEFAULT_MAX_PIXELS

LEAST_SIDE_FOR_SSIMULACRA2 = 225  # px: at a thirty-second of the size 8 px must be left
SSIMULACRA2_BYTES = 560  # a pixel, docs/decisions/metrics.md
_ADVICE = 'Try pip install "gauss2svg[scores]"'
_COMMAND = (sys.executable, "-P", "-m", "gauss2svg.measure.scores")
_LEVELS = 255


class ScoresMissingError(InputError, ImportError):
    """A package that scores are asked of is not installed."""


@dataclass(frozen=True)
class Scores:
    """Perceptual scores of a raster; of a transparent one the worse of over white and over black.

    ssimulacra2  at most 100, which equal pictures have; None where it is not measured
    flip         0..1, 0 for equal pictures; None where it is not measured
    missing      one line for each reason that a score is None
    """

    ssimulacra2: float | None = None
    flip: float | None = None
    missing: tuple[str, ...] = ()

    @property
    def report(self) -> dict[str, Any]:
        """The scores by the keys of a report."""
        return {
            "ssimulacra2_svg": self.ssimulacra2,
            "flip_svg": self.flip,
            "scores_missing": list(self.missing),
        }


def perceptual_scores(
    raster: NDArray[np.float32],
    photo: NDArray[np.float32],
    spare: int | None = None,
    known: float | None = None,
) -> Scores:
    """Both scores of a raster against its photo, (h, w, 3) or (h, w, 4) float32 in 0..1.

    spare  bytes of memory that may be taken; None: SHARE of those that are free
    known  its SSIMULACRA2, where that has been measured already

    A score is None, with a line that says why, where its package is not installed, where the
    picture is too small or too large for it, where it would take more memory, and where its package
    fails. Raises InputError for pictures that differ in shape.
    """
    _check(raster, photo)
    spare = int(SHARE * free_bytes()) if spare is None else spare
    found = {} if known is None else {"ssimulacra2": known}
    missing = list(packages_missing())
    for metric in _METRICS:
        if metric.key in found or find_spec(metric.module) is None:
            continue
        reason = metric.refusal(photo.shape[0], photo.shape[1], spare)
        if not reason:
            pairs = zip(views(raster), views(photo), strict=True)
            try:
                found[metric.key] = metric.worst([metric.measure(*pair) for pair in pairs])
            except (ChildProcessError, ScoresMissingError) as error:
                reason = str(error)
        if reason:
            missing.append(f"{metric.name} is not measured: {reason}")
    return Scores(**found, missing=tuple(missing))


def packages_missing() -> tuple[str, ...]:
    """A line that names the scores whose packages are not installed; nothing where all are."""
    names = [metric.name for metric in _METRICS if find_spec(metric.module) is None]
    return (_not_installed(names),) if names else ()


def _not_installed(names: Sequence[str]) -> str:
    verb = "is" if len(names) == 1 else "are"
    return f"{' and '.join(names)} {verb} not measured: not installed. {_ADVICE}"


def require_packages(ssimulacra2: bool) -> None:
    """Raise ScoresMissingError, which says how to get it, unless a package is installed.

    ssimulacra2: that of SSIMULACRA2; else any, for FLIP has none for the newest Python.
    """
    names = [metric.name for metric in _METRICS[: 1 if ssimulacra2 else None]]
    missing = [metric.name for metric in _METRICS if find_spec(metric.module) is None]
    if set(names) <= set(missing):
        raise ScoresMissingError(_not_installed(names))


def packages() -> dict[str, str]:
    """Versions of the installed packages, by their names on PyPI."""
    return {m.package: version(m.package) for m in _METRICS if find_spec(m.module) is not None}


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
    _check(image, photo)
    height, width = image.shape[:2]
    if min(height, width) < LEAST_SIDE_FOR_SSIMULACRA2:
        raise InputError(
            f"an image for SSIMULACRA2 must be at least {LEAST_SIDE_FOR_SSIMULACRA2} px a side; "
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
    _check(image, photo)
    if find_spec("flip_evaluator") is None:
        raise ScoresMissingError(f"FLIP is not installed. {_ADVICE}")
    height, width = photo.shape[:2]
    # In a process of its own: its OpenMP hangs in the child of a process that has used it.
    done = subprocess.run(
        [*_COMMAND, str(height), str(width)],
        input=_eight_bits(photo).tobytes() + _eight_bits(image).tobytes(),
        capture_output=True,
        env={**os.environ, "PYTHONPATH": import_path()},
        check=False,
    )
    if done.returncode:
        said = done.stderr[-400:].decode(errors="replace").strip().splitlines()
        why = said[-1] if said else "was there enough memory?"
        raise ChildProcessError(f"its process ended with status {done.returncode}: {why}")
    return float(done.stdout)


def main() -> None:
    """Read two pictures (height, width, 3) of 8 bits from standard input, and print their FLIP."""
    from flip_evaluator import evaluate

    height, width = map(int, sys.argv[1:])
    levels = np.frombuffer(sys.stdin.buffer.read(), np.uint8).reshape(2, height, width, 3)
    photo, image = levels.astype(np.float32) / np.float32(_LEVELS)
    print(evaluate(photo, image, "LDR", applyMagma=False)[1])


@dataclass(frozen=True)
class _Metric:
    """A score: its names, what it needs, and how several of it are summed up.

    pixel_bytes  of memory that it takes a pixel, measured with a tenth added
    """

    name: str
    key: str
    module: str
    package: str
    measure: Callable[[NDArray[np.float32], NDArray[np.float32]], float]
    worst: Callable[[Sequence[float]], float]
    least_side: int
    pixel_bytes: int

    def refusal(self, height: int, width: int, spare: int) -> str:
        """Why a picture of this size cannot be measured in so much memory; "" if it can."""
        if min(height, width) < self.least_side:
            return f"it needs at least {self.least_side} px a side"
        if height * width > DEFAULT_MAX_PIXELS:
            return f"it is limited to {DEFAULT_MAX_PIXELS} px"
        needed = self.pixel_bytes * height * width
        if needed > spare:
            return (
                f"it needs {needed / 1e9:.2g} GB of memory for {width}x{height} px, and "
                f"{max(spare, 0) / 1e9:.2g} GB are left"
            )
        return ""


# Bytes a pixel: docs/decisions/metrics.md.
_METRICS = (
    _Metric(
        "SSIMULACRA2", "ssimulacra2", "ssimulacra2", "ssimulacra2", ssimulacra2, min,
        LEAST_SIDE_FOR_SSIMULACRA2, SSIMULACRA2_BYTES,
    ),
    _Metric("FLIP", "flip", "flip_evaluator", "flip-evaluator", flip, max, 1, 150),
)  # fmt: skip


def _check(image: NDArray[np.floating], photo: NDArray[np.floating]) -> None:
    if image.shape != photo.shape or image.ndim != 3:
        raise InputError(
            f"two images must be of one shape (h, w, channels); got {image.shape} and {photo.shape}"
        )


def _eight_bits(image: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.round(np.clip(image, 0, 1) * _LEVELS).astype(np.uint8)


def _as_file(image: NDArray[np.floating]) -> io.BytesIO:
    stream = io.BytesIO()
    Image.fromarray(_eight_bits(image)).save(stream, "PPM")
    stream.seek(0)
    return stream


if __name__ == "__main__":
    main()
