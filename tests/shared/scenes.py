"""Random scenes, scenes from all of the domain of a scene, and their rounding."""

from __future__ import annotations

from typing import Any
from unittest.mock import patch

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from gauss2svg.scene import (
    ABOVE,
    ADD,
    LEAST_SIGMA,
    MOST_MEAN,
    MOST_SIGMA,
    OVER,
    RHO_LIMIT,
    Area,
    LinearGradient,
    Outline,
    RadialGradient,
    Scene,
    narrowing_of,
)
from gauss2svg.svg import minimal

_BETAS = (0.5, 1.0, 1.0, 1.7, 16.0, 256.0)
_OPACITIES = (0.0, 1e-7, 0.3, 0.9, 1 - 1e-7, 1.0)
_RHOS = (0.0, 0.5, 0.95, 1 - 1e-6, 1 - 1e-12, RHO_LIMIT)
_GRID = 2**20  # of means: whole pixels can be added to them, and they tripled, without rounding


def random_scene(
    count: int,
    width: int = 40,
    height: int = 30,
    seed: int = 0,
    sigma: tuple = (0.5, 8.0),
    beta: tuple = (0.5, 32.0),
) -> Scene:
    """Return a scene of `count` shapes, every parameter over a wide range; half are Gaussians."""
    rng = np.random.default_rng(seed)
    return Scene(
        width,
        height,
        mean=rng.uniform(-5, 5, (count, 2)) + rng.random((count, 2)) * [width, height],
        sigma=np.exp(rng.uniform(*np.log(sigma), (count, 2))),
        rho=rng.uniform(-0.95, 0.95, count),
        color=rng.random((count, 3)),
        opacity=rng.random(count),
        background=rng.random(3),
        round_index=np.sort(rng.integers(0, 3, count)),
        beta=np.where(np.arange(count) % 2, np.exp(rng.uniform(*np.log(beta), count)), 1.0),
    )


def random_sum(count: int, width: int, height: int, seed: int, **shape: tuple) -> Scene:
    """A random scene whose Gaussians have signed colours and are summed."""
    scene = random_scene(count, width, height, seed, **shape)
    color = np.random.default_rng(seed).uniform(-0.6, 0.6, (count, 3))
    one = {"opacity": np.ones(count), "beta": np.ones(count)}
    return scene.replace(blend="add", color=color, **one)


def random_areas(count: int, seed: int, size: tuple[int, int] = (40, 30)) -> tuple[Area, ...]:
    """Return filled areas and lines of all paints, caps and kinds of segments, some off canvas."""
    rng = np.random.default_rng(seed)

    def point() -> tuple[float, float]:
        x, y = np.round(rng.uniform(-0.1, 1.1, 2) * size, rng.choice([0, 3]))
        return float(x), float(y)

    def outline(closed: bool) -> Outline:
        curved = rng.random(rng.integers(2, 7)) < 0.5
        points = [point() for _ in range(len(curved) + 2 * curved.sum() + (not closed))]
        for k in np.flatnonzero(rng.random(len(points)) < 0.3)[1:]:
            points[k] = points[k - 1][0], points[k][1]  # upright lines, and handles without a reach
        return Outline(tuple(points), tuple(curved.tolist()), closed)

    def paint() -> tuple | LinearGradient | RadialGradient:
        colors = tuple(map(tuple, np.round(rng.random((3, 3)) * 2) / 2))
        offsets = 0.0, float(np.round(rng.random(), 2)), 1.0
        if (kind := rng.integers(4)) < 2:
            return colors[0]
        if kind == 2:
            return LinearGradient(offsets, colors, point(), (99.0, -7.0))
        radii = rng.uniform(2, 40, 2)
        return RadialGradient(offsets, colors, point(), (radii[0], radii[rng.integers(2)]))

    areas = []
    for _ in range(count):
        width = float(rng.choice([0.0, 0.0, 0.25, 3.0]))
        outlines = tuple(
            outline(not width or rng.random() < 0.3) for _ in range(rng.integers(1, 4))
        )
        cap = str(rng.choice(["butt", "round", "square"])) if width else "butt"
        areas.append(Area(outlines, paint(), float(rng.choice([1.0, 1.0, 0.4])), width, cap))
    return tuple(areas)


def with_levels(scene: Scene, seed: int) -> Scene:
    """Return the scene with its Gaussians among its areas, some of them above all areas."""
    above = len(scene.areas) + 1
    level = np.sort(np.random.default_rng(seed).integers(0, above + 1, len(scene)))
    return scene.replace(level=np.where(level == above, ABOVE, level))


@st.composite
def sizes(draw: st.DrawFn) -> tuple[float, float]:
    """Sigmas along x and y, alike or not, with the ends of the domain among them."""
    ends = st.sampled_from([LEAST_SIGMA, 1e-6, 1e6, MOST_SIGMA])
    one = st.one_of(st.floats(-6, 6).map(lambda e: 10.0**e), ends)
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
def extreme_scenes(draw: st.DrawFn, blend: str = OVER, size: tuple[int, int] = (40, 36)) -> Scene:
    """A scene of at most six shapes from all of the domain."""
    count = draw(st.integers(0, 6))
    size = draw(st.integers(1, size[0])), draw(st.integers(1, size[1]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))

    def each(values: tuple[float, ...]) -> NDArray[np.float64]:
        return np.array([draw(st.sampled_from(values)) for _ in range(count)], np.float64)

    sigma = np.array([draw(sizes()) for _ in range(count)]).reshape(-1, 2)
    rho, zeros = each((-1, 1)) * each(_RHOS), np.zeros((count, 3))
    blank = Scene(*size, zeros[:, :2], sigma, rho, zeros, np.ones(count), rng.random(3))
    mean = np.array([draw(means(size, factor)) for factor in blank.factor]).reshape(-1, 2)
    if blend == ADD:
        color = rng.choice([-100.0, -0.5, 0.2, 100.0], zeros.shape)
        return blank.replace(mean=mean, color=color, blend=ADD)
    color = rng.choice([0.0, 1.0, *rng.random(4)], zeros.shape)
    return blank.replace(mean=mean, color=color, opacity=each(_OPACITIES), beta=each(_BETAS))


def rounding_of(scene: Scene) -> float:
    """What float64 may differ by: z2 loses eps / sqrt(1 - rho^2), and a rim is beta steep."""
    if not len(scene):
        return 1e-12
    steep = scene.beta * np.maximum(np.abs(scene.color).max(axis=1), 1)
    return 1e-12 + 1e-14 * float((steep / narrowing_of(scene.rho)).max()) * len(scene)


def minimal_by_gradients(scene: Scene, *arguments: Any, **others: Any) -> str:
    """The file of minimal_svg whose soft shapes all have gradients, as in a file of many shapes."""
    with patch.object(minimal, "MOST_MASKED", 0):
        return minimal.minimal_svg(scene, *arguments, **others)
