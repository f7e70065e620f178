"""A scene as it was written on the way to its targets, how its bytes are met, and the outcome."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gauss2svg.finish import Finish, finished
from gauss2svg.fit.options import FitProgress, FitResult
from gauss2svg.fit.target import target_of
from gauss2svg.render.cpu import splats_of
from gauss2svg.roundtrip import RoundTrip, round_trip
from gauss2svg.scene import Scene
from gauss2svg.svg import Page, SvgOptions, file_bytes, write_svg

# Of a limit of bytes. Files of 500 to 5000 shapes grew by up to 0.9 %, gzipped, and 0.1 %, plain.
_ROOM_FOR_A_FINISH = 0.985


@dataclass(frozen=True, eq=False)
class Attempt:
    """A scene on the photo's canvas, in the colours of its palette, and its SVG.

    model  PSNR in dB of the scene itself on the working picture
    error  mean squared, of the drawn SVG there, over white or over black where it has alpha,
           whichever is larger; NaN if it was not drawn
    """

    scene: Scene
    svg: str
    options: SvgOptions
    page: Page
    gzipped: bool
    model: float
    error: float

    @cached_property
    def size(self) -> int:
        """Bytes of the file."""
        return len(file_bytes(self.svg, self.gzipped))


@dataclass(frozen=True, eq=False)
class Outcome:
    """A fitted, written and measured scene, on the photo's canvas.

    corrections  how often the count was changed after the fit
    finish       what it brought, None if none was asked for
    """

    scene: Scene
    svg: str
    svg_options: SvgOptions
    fitted: FitResult
    measured: RoundTrip
    corrections: int
    finish: Finish | None


def trimmed(attempt: Attempt, limit: int, picture: NDArray[np.float32]) -> Attempt:
    """Without the Gaussians that are missed least, as many of them as `limit` bytes ask for.

    Missed on picture (h, w, 3) or (h, w, 4); what is left is not refined.
    """
    target = target_of(picture, np.float32)
    while attempt.size > limit and len(attempt.scene):
        scene = attempt.scene
        height, width = picture.shape[:2]
        splats = splats_of(scene.scaled(width / scene.width, height / scene.height))
        cost = target.removal_cost(splats)[1][:, 0]
        kept = min(len(scene) - 1, int(len(scene) * limit / attempt.size))
        scene = scene.select(np.sort(np.argsort(-cost, kind="stable")[:kept]))
        svg = write_svg(scene, attempt.options, attempt.page)
        attempt = dataclasses.replace(attempt, scene=scene, svg=svg, error=np.nan)
    return attempt


def measured(
    attempt: Attempt,
    photo: NDArray[np.float32],
    working: NDArray[np.float32],
    renderer: str,
    deadline: float | None,
) -> RoundTrip:
    """At the photo's size; where time is short, at the size that the fit ran on.

    photo and working (h, w, 3) or (h, w, 4); deadline as time.perf_counter() counts, in s, or None.
    """
    if photo.shape != working.shape and deadline is not None:
        begun = time.perf_counter()
        height, width = working.shape[:2]
        scene = attempt.scene.scaled(width / attempt.scene.width, height / attempt.scene.height)
        smaller = round_trip(attempt.svg, scene, working, renderer)
        now = time.perf_counter()
        if (now - begun) * photo.size / working.size > deadline - now:
            return smaller
    return round_trip(attempt.svg, attempt.scene, photo, renderer)


def finished_attempt(
    attempt: Attempt,
    photo: NDArray[np.float32],
    working: NDArray[np.float32],
    name: str,
    limit: float,
    tell: Callable[[FitProgress], None],
) -> tuple[Attempt, Finish]:
    """The attempt after the finish of that name, in a file of at most `limit` bytes.

    A finish makes numbers a little longer: where there is no room for that, the Gaussians that
    are missed least make some first. See gauss2svg.finish.finished.
    """
    if attempt.size > limit * _ROOM_FOR_A_FINISH:
        attempt = trimmed(attempt, int(limit * _ROOM_FOR_A_FINISH), working)
    finish = finished(attempt.scene, attempt.options, attempt.page, photo, name, tell)
    svg = write_svg(finish.scene, attempt.options, attempt.page)
    after = dataclasses.replace(attempt, scene=finish.scene, svg=svg)
    if after.size <= limit:
        return after, finish
    gains = {renderer: (before, before) for renderer, (before, _) in finish.gains.items()}
    return attempt, dataclasses.replace(finish, scene=attempt.scene, gains=gains)
