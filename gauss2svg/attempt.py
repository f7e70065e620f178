"""A scene as it was written on the way to its targets, how its bytes are met, and the outcome."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.options import FitResult
from gauss2svg.render.cpu import removal_cost, splats_of
from gauss2svg.roundtrip import RoundTrip
from gauss2svg.scene import Scene
from gauss2svg.svg import Page, SvgOptions, file_bytes, write_svg


@dataclass(frozen=True, eq=False)
class Attempt:
    """A scene on the photo's canvas, in the colours of its palette, and its SVG.

    model  PSNR in dB of the scene itself on the working picture
    error  mean squared, of the drawn SVG there; NaN if it was not drawn
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
    """

    scene: Scene
    svg: str
    svg_options: SvgOptions
    fitted: FitResult
    measured: RoundTrip
    corrections: int


def trimmed(attempt: Attempt, limit: int, picture: NDArray[np.float32]) -> Attempt:
    """Without the Gaussians that are missed least, as many of them as `limit` bytes ask for.

    Missed on picture (h, w, 3); what is left is not refined.
    """
    while attempt.size > limit and len(attempt.scene):
        scene = attempt.scene
        height, width = picture.shape[:2]
        planar = np.ascontiguousarray(np.moveaxis(picture, -1, 0))
        splats = splats_of(scene.scaled(width / scene.width, height / scene.height))
        cost = removal_cost(splats, planar)[1][:, 0]
        kept = min(len(scene) - 1, int(len(scene) * limit / attempt.size))
        scene = scene.select(np.sort(np.argsort(-cost, kind="stable")[:kept]))
        svg = write_svg(scene, attempt.options, attempt.page)
        attempt = dataclasses.replace(attempt, scene=scene, svg=svg, error=np.nan)
    return attempt
