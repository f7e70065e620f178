"""Scenes from all of the domain of a scene, and their render by another arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from gauss2svg.scene import (
    ADD,
    LEAST_SIGMA,
    MOST_MEAN,
    MOST_SIGMA,
    OVER,
    RHO_LIMIT,
    Scene,
    narrowing_of,
)
from gauss2svg.scene.falloff import cut_radius, profile

EDGE_BETAS = (0.5, 1.0, 1.0, 1.7, 16.0, 256.0)
_OPACITIES = (0.0, 1e-7, 0.3, 0.9, 1 - 1e-7, 1.0)
_RHOS = (0.0, 0.5, 0.95, 1 - 1e-6, 1 - 1e-12, RHO_LIMIT)
_GRID = 2**20  # of means: whole pixels can be added to them, and they tripled, without rounding


@st.composite
def sizes(draw: st.DrawFn, dtype: type = np.float64) -> tuple[float, float]:
    """Sigmas along x and y, alike or not, with the ends of the domain among them."""
    one = st.one_of(
        st.floats(-6, 6).map(lambda e: 10.0**e), st.sampled_from([1e-6, 1e6]),
        st.sampled_from([float(dtype(LEAST_SIGMA)), float(dtype(MOST_SIGMA))]),
    )  # fmt: skip
    first = draw(one)
    return (first, first) if draw(st.booleans()) else (first, draw(one))


@st.composite
def means(draw: st.DrawFn, size: tuple[int, int], factor: NDArray[np.float64]) -> list[float]:
    """A mean: where a shape shows, on centres, corners and edges of tiles, or far off."""
    pixel = [draw(st.integers(0, side - 1)) for side in size]
    kind = draw(st.sampled_from(["seen", "seen", "seen", "centre", "corner", "tile", "far"]))
    if kind == "far":
        return [draw(st.sampled_from([-MOST_MEAN, -1e9, 1e9, MOST_MEAN])) for _ in range(2)]
    if kind == "tile":
        return [16.0 * draw(st.integers(0, 2)) for _ in range(2)]
    at = np.array(pixel) + (0.0 if kind == "corner" else 0.5)
    if kind == "seen":
        at = at + factor @ [draw(st.floats(-2, 2)), draw(st.floats(-2, 2))]
    return np.clip(np.round(at * _GRID) / _GRID, -MOST_MEAN, MOST_MEAN).tolist()


@st.composite
def extreme_scenes(
    draw: st.DrawFn,
    blend: str = OVER,
    most: int = 6,
    betas: tuple[float, ...] = EDGE_BETAS,
    least: int = 0,
    size: tuple[int, int] = (40, 36),
) -> Scene:
    """A scene of a few shapes from all of the domain."""
    count = draw(st.integers(least, most))
    size = draw(st.integers(1, size[0])), draw(st.integers(1, size[1]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    sigma = np.array([draw(sizes()) for _ in range(count)]).reshape(-1, 2)
    rho = [draw(st.sampled_from([-1, 1])) * draw(st.sampled_from(_RHOS)) for _ in range(count)]
    blank = Scene(*size, np.zeros((count, 2)), sigma, rho, np.zeros((count, 3)), np.ones(count))
    mean = [draw(means(size, factor)) for factor in blank.factor]
    color = rng.choice([0.0, 1.0, *rng.random(4)], (count, 3))
    changes = {"opacity": [draw(st.sampled_from(_OPACITIES)) for _ in range(count)],
               "beta": [draw(st.sampled_from(betas)) for _ in range(count)]}  # fmt: skip
    if blend == ADD:
        changes, color = {"blend": ADD}, rng.choice([-100.0, -0.5, 0.2, 100.0], (count, 3))
    return blank.replace(
        mean=np.array(mean).reshape(-1, 2), color=color, background=rng.random(3),
        **{name: np.array(values) if name != "blend" else values
           for name, values in changes.items()},
    )  # fmt: skip


def whitened(scene: Scene) -> NDArray[np.float64]:
    """(n, h, w, 2) whitened offsets of the pixel centres, in exact arithmetic until the end.

    z1 = u / sx and z2 = (v / sy - rho u / sx) / sqrt(1 - rho^2).
    """
    width, height = round(scene.width), round(scene.height)
    z = np.empty((len(scene), height, width, 2))
    for i in range(len(scene)):
        (mx, my), (sx, sy) = ([Fraction(v) for v in row[i]] for row in (scene.mean, scene.sigma))
        rho = Fraction(scene.rho[i])
        narrow = float((1 - rho) * (1 + rho)) ** 0.5
        z1 = [(Fraction(2 * x + 1, 2) - mx) / sx for x in range(width)]
        v = [(Fraction(2 * y + 1, 2) - my) / sy for y in range(height)]
        z[i, :, :, 0] = [float(one) for one in z1]
        z[i, :, :, 1] = [[float(down - rho * across) / narrow for across in z1] for down in v]
    return z


def picture(scene: Scene, z: NDArray[np.float64], **changed: NDArray[np.float64]) -> NDArray:
    """(h, w, 3) the formula once more, from whitened offsets; not clipped where it is additive.

    changed  colours and the like in place of the scene's, whatever their range
    """
    beta, opacity, color, background = (
        changed.get(name, getattr(scene, name)) for name in
        ("beta", "opacity", "color", "background")
    )  # fmt: skip
    image = np.broadcast_to(background, (*z.shape[1:3], 3))
    for k in range(len(z)):
        alpha = (opacity[k] * profile(np.hypot(z[k, :, :, 0], z[k, :, :, 1]), beta[k]))[..., None]
        image = image + alpha * (color[k] - (0 if scene.blend == ADD else image))
    return image


def rounding_of(scene: Scene) -> float:
    """What float64 may differ by: z2 loses eps / sqrt(1 - rho^2), and a rim is beta steep."""
    if not len(scene):
        return 1e-12
    steep = scene.beta * np.maximum(np.abs(scene.color).max(axis=1), 1)
    return 1e-12 + 1e-14 * float((steep / narrowing_of(scene.rho)).max()) * len(scene)


def near_the_cut(scene: Scene, z: NDArray[np.float64], within: float) -> NDArray[np.bool_]:
    """(h, w) pixels on a cut, where gradients jump, or at the mean of a peak that has none."""
    r = np.hypot(z[..., 0], z[..., 1])
    beta = scene.beta[:, None, None]
    near = np.abs(r / cut_radius(beta) - 1) < within
    return (near | ((beta < 1) & (r < 0.05))).any(axis=0)
