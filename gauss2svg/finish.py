"""The finish: last changes by what renderers really draw, so that their rounding is fitted away.

Renderers round to 8 bits after every layer: at 10 000 shapes that costs 0.1 to 0.3 dB. The
error looks like noise, but most of it stays where shapes change little: after every shape of
Kodak 04 has moved by 0.04 px, errors before and after correlate by 0.82 in resvg and 0.67 in
CairoSVG. So, again and again,

- shapes that are clear of one another each take a small step in one parameter, the one of
  which the gradient of the raster's error promises most;
- the file is drawn, and each keeps its step if its own pixels came nearer to the photo; if not,
  its other parameters and other shapes come first.

What drawings bring on Kodak 04, 10 000 shapes, resvg, PSNR of the drawn SVG in dB:

    five: steps at random                                         0.013
          against the gradient, of a parameter at random          0.024
          of all parameters at once                               0.019
          of shapes of which not even the faint rims overlap      0.016
    eight: against the gradient, of a parameter at random         0.027
          of the most promising, whatever has failed              0.020
          of the most promising, failures last                    0.033

Before, gradient steps of the fit towards target - (raster - model) were tried: at 5000 and
10 000 shapes the drawn SVG lost 0.03 to 0.2 dB, for the steps undid what they were shown.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gauss2svg import metrics
from gauss2svg.alpha import PAGES, has_alpha, stacked, views
from gauss2svg.falloff import cut_radius
from gauss2svg.fit.adam import gradients
from gauss2svg.fit.options import FitProgress
from gauss2svg.fit.population import LEAST_OPACITY
from gauss2svg.fit.run import LEAST_SIGMA
from gauss2svg.raster import rasterize_like
from gauss2svg.render.cpu import moments_of_gradient, splats_of
from gauss2svg.render.kernels import MOMENTS
from gauss2svg.scene import RHO_LIMIT, Scene
from gauss2svg.svg import Page, SvgOptions, write_svg
from gauss2svg.svg.layers import segment_of

ALL = "all"
FINISHES = ("resvg", "cairo", "chromium", ALL)

_DRAWINGS = 32  # at most, and up to two that only make sure
_LEAST_GAIN, _OVER = 0.0005, 4  # dB a drawing, mean of the last few, under which it ends
_TRUE_EVERY = 8  # drawings; between them the raster is put together from what was kept
_SHIFT, _STRETCH, _FADE = 0.045, 0.03, 0.01  # px, px, opacity; or a step of the file's numbers
# Of what a step promises, for each time that it was drawn in vain: others come first then.
_AFTER_FAILURE = 0.05
_OPAQUE = 0.97  # such shapes stay as opaque as they are: many need no number for it
# Sigmas around a mean that count as a shape's own pixels, and px beyond them.
_CORE, _MARGIN = 1.7, 0.3
_LARGEST = 0.005  # of the canvas: larger shapes would leave no place for others
_NOBODY = -1

_PARAMETERS = ("mean", "sigma", "rho", "opacity")  # what changes


@dataclass(frozen=True, eq=False)
class Finish:
    """A scene after its finish.

    drawings  how often each renderer drew it
    gains     PSNR in dB of the drawn SVG before and after, by renderer; over white and over
              black together where the photo has alpha
    """

    scene: Scene
    drawings: int
    gains: dict[str, tuple[float, float]]


def renderers_of(finish: str) -> tuple[str, ...]:
    """The renderers that a finish, one of FINISHES, compares with."""
    return FINISHES[:-1] if finish == ALL else (finish,)


def finished(
    scene: Scene,
    options: SvgOptions,
    page: Page,
    photo: NDArray[np.float32],
    finish: str,
    tell: Callable[[FitProgress], None] | None = None,
) -> Finish:
    """Change a settled scene so that what renderers draw of its file is nearer to a photo.

    scene    on the canvas of photo, (h, w, 3), or (h, w, 4): then it is nearer over white and
             over black; options and page write it, in its own colours
    finish   one of FINISHES; with all the squared errors of the three are summed
    tell     is called at every drawing but the first

    Colours and order stay. The sum of squared errors never grows: the scene itself is returned
    where nothing was gained. Raises RendererError if a renderer cannot draw.
    """
    names = renderers_of(finish)
    height, width = photo.shape[:2]
    wanted = views(photo)
    grounds = [np.full(3, level) for level in PAGES] if has_alpha(photo) else [scene.background]

    def drawn(one: Scene) -> NDArray[np.float32]:
        """(renderers, pages, h, w, 3) what each draws over each page, less the photo."""
        svg = write_svg(one, options, page)
        return np.stack([views(rasterize_like(svg, photo, name)) for name in names]) - wanted

    failures = np.zeros((len(scene), 3))
    changed, drawings, begun = scene, 1, time.perf_counter()
    first = missed = drawn(scene)
    error, gained = _squared(first), []  # dB of each drawing
    while drawings < _DRAWINGS and error > 0 and _is_gaining(gained):
        if tell is not None:
            tell(_progress(len(scene), drawings, error / first.size, begun))
        steps = _steps(changed, missed.sum(axis=0), grounds, options)
        promise = steps.gain * _AFTER_FAILURE**failures
        kind, order = promise.argmax(axis=1), np.argsort(-promise.max(axis=1), kind="stable")
        owner = claimed(changed, order, height, width)
        turn = np.unique(owner[owner >= 0])
        tried = _changed(changed, steps, turn, kind)
        new = drawn(tried)
        gain = (np.square(missed) - np.square(new)).sum(axis=(0, 1, 4)).reshape(-1)
        kept = np.bincount(owner.reshape(-1) + 1, gain, len(scene) + 1)[1:] > 0
        if page.segments is not None:  # the layers, and with them the order, stay
            kept &= segment_of(tried, page.segments) == segment_of(changed, page.segments)
        failures[turn, kind[turn]] = np.where(kept[turn], 0, failures[turn, kind[turn]] + 1)
        changed = _with(changed, tried, kept)
        missed = np.where(np.append(kept, False)[owner][:, :, None], new, missed)
        drawings += 1
        before, error = error, _squared(missed)
        gained.append(10 * math.log10(before / error) if error else math.inf)
        if drawings % _TRUE_EVERY == 0:
            missed = drawn(changed)
            error = _squared(missed)
            drawings += 1
    last = drawn(changed)
    if _squared(last) >= _squared(first):
        changed, last = scene, first
    gains = {
        name: (_psnr(before + wanted, photo), _psnr(after + wanted, photo))
        for name, before, after in zip(names, first, last, strict=True)
    }
    return Finish(changed, drawings + 1, gains)


def _psnr(drawn: NDArray[np.float32], photo: NDArray[np.float32]) -> float:
    """Of what is drawn, (pages, h, w, 3), over all pages."""
    return metrics.psnr(drawn.reshape(-1, *drawn.shape[2:]), stacked(photo))


def _progress(count: int, drawings: int, error: float, begun: float) -> FitProgress:
    done, elapsed = drawings / _DRAWINGS, time.perf_counter() - begun
    return FitProgress(
        round=0,
        iteration=drawings,
        done=done,
        gaussians=count,
        psnr=-10 * math.log10(error),
        elapsed_s=elapsed,
        remaining_s=elapsed / done * (1 - done),
    )


def _squared(missed: NDArray[np.float32]) -> float:
    return float(np.sum(np.square(missed), dtype=np.float64))


def _is_gaining(gained: list[float]) -> bool:
    return len(gained) < _OVER or sum(gained[-_OVER:]) > _OVER * _LEAST_GAIN


def claimed(scene: Scene, order: NDArray[np.intp], height: int, width: int) -> NDArray[np.intp]:
    """(height, width) index of the shape that a pixel is of, -1 where it is of none.

    In the order given (n,), each shape has the pixels within _CORE sigmas of its mean, if none of
    them is of another yet.
    """
    radius = np.minimum(cut_radius(scene.betas), _CORE)
    sides = np.sqrt(np.diagonal(scene.covariance, axis1=1, axis2=2))
    most = max(_LARGEST * height * width, 1.0)
    small = np.pi * radius**2 * scene.ellipse_axes[0].prod(axis=1) <= most
    owner = np.full((height, width), _NOBODY)
    _claim(
        owner, order[small[order]], scene.mean, scene.whitening, radius + _MARGIN,
        radius[:, None] * sides + _MARGIN,
    )  # fmt: skip
    return owner


@njit(cache=True)
def _claim(owner, order, mean, whitening, radius, extent):
    height, width = owner.shape
    for i in order:
        left, right = max(0, int(mean[i, 0] - extent[i, 0])), int(mean[i, 0] + extent[i, 0]) + 1
        top, bottom = max(0, int(mean[i, 1] - extent[i, 1])), int(mean[i, 1] + extent[i, 1]) + 1
        free = True
        for claiming in (False, True):
            for y in range(top, min(bottom, height)):
                for x in range(left, min(right, width)):
                    u, v = x + 0.5 - mean[i, 0], y + 0.5 - mean[i, 1]
                    across = whitening[i, 1] * u + whitening[i, 2] * v
                    if (whitening[i, 0] * u) ** 2 + across**2 < radius[i] ** 2:
                        if claiming:
                            owner[y, x] = i
                        elif owner[y, x] >= 0:
                            free = False
            if not free:
                break


@dataclass(frozen=True)
class _Steps:
    """For each of n shapes a small step of three kinds, against the gradient of the error.

    shift    (n, 2) of the mean in px
    stretch  (n, 2, 2) A: the covariance becomes factor (1 + A)^2 factor^T
    fade     (n,) of the opacity
    gain     (n, 3) what each is to take off half the squared error, to first order
    """

    shift: NDArray[np.floating]
    stretch: NDArray[np.floating]
    fade: NDArray[np.floating]
    gain: NDArray[np.floating]


def _steps(
    scene: Scene,
    missed: NDArray[np.float32],
    grounds: Sequence[NDArray[np.float64]],
    options: SvgOptions,
) -> _Steps:
    """Steps by what the raster has more than the photo, missed (pages, h, w, 3).

    grounds  colour (3,) of each page
    """
    splats, opacity = splats_of(scene), scene.opacity
    moments = np.zeros((len(scene), MOMENTS))
    for ground, of_page in zip(grounds, missed, strict=True):
        by_image: NDArray[np.float32] = np.ascontiguousarray(np.moveaxis(of_page, -1, 0))
        moments += moments_of_gradient(splats._replace(background=ground), by_image)
    gradient = gradients(moments, opacity, scene.betas)
    # Of the mean in px: it is moved by factor t.
    by_shift = np.linalg.solve(np.swapaxes(scene.factor, 1, 2), gradient[:, :2, None])[:, :, 0]
    shift = -max(_SHIFT, options.precision) * _unit(by_shift)
    by_stretch = gradient[:, [2, 3, 3, 4]] * [1, 0.5, 0.5, 1]
    size = max(_STRETCH, options.precision) * np.minimum(1 / scene.ellipse_axes[0][:, 1], 1.0)
    stretch = -size[:, None] * _unit(by_stretch)
    by_fade = gradient[:, 5] / (opacity * (1 - opacity) + 1e-9)
    fade = -max(_FADE, 10.0**-options.opacity_decimals) * np.sign(by_fade)
    fade[(opacity >= _OPAQUE) | (opacity <= LEAST_OPACITY)] = 0.0
    gain = [-(by_shift * shift).sum(axis=1), -(by_stretch * stretch).sum(axis=1), -by_fade * fade]
    return _Steps(shift, stretch.reshape(-1, 2, 2), fade, np.stack(gain, axis=1))


def _changed(scene: Scene, steps: _Steps, turn: NDArray[np.intp], kind: NDArray[np.intp]) -> Scene:
    """The scene with shapes `turn` shifted, stretched or faded, as kind (n,) says."""
    mean, factor, opacity = scene.mean.copy(), scene.factor.copy(), scene.opacity.copy()
    k = turn[kind[turn] == 0]
    mean[k] += steps.shift[k]
    k = turn[kind[turn] == 1]
    factor[k] = factor[k] @ (np.eye(2) + steps.stretch[k])
    k = turn[kind[turn] == 2]
    opacity[k] = np.clip(opacity[k] + steps.fade[k], LEAST_OPACITY, 1.0)

    covariance = factor @ np.swapaxes(factor, 1, 2)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    rho = np.clip(covariance[:, 0, 1] / sigma.prod(axis=1), -RHO_LIMIT, RHO_LIMIT)
    tried = scene.replace(mean=mean, sigma=sigma, rho=rho, opacity=opacity)
    # Other renderers, and this one at other sizes, draw thinner ones wrongly.
    thinner = tried.ellipse_axes[0][:, 1] < np.minimum(LEAST_SIGMA, scene.ellipse_axes[0][:, 1])
    return _with(tried, scene, thinner)


def _unit(vectors: NDArray[np.floating]) -> NDArray[np.floating]:
    """Vectors (n, k) of length 1; of length 0 where there is no direction."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)


def _with(scene: Scene, other: Scene, chosen: NDArray[np.bool_]) -> Scene:
    """The scene with the parameters of another where chosen (n,)."""
    changes = {}
    for name in _PARAMETERS:
        mine, theirs = getattr(scene, name), getattr(other, name)
        changes[name] = np.where(chosen.reshape(-1, *[1] * (mine.ndim - 1)), theirs, mine)
    return scene.replace(**changes)
