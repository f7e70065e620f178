"""Properties of plain ellipses that cover shares of pixels."""

import numpy as np
import pytest
from both_renderers import in_both
from hypothesis import given
from hypothesis import strategies as st
from with_torch import render_reference

from gauss2svg.render.cpu import render_planar, splats_of, squared_error
from gauss2svg.scene import PLAIN, Scene, whitening_of
from gauss2svg.scene.falloff import coverage, covered_radius

WIDTH, HEIGHT = 45, 34
OFF = {np.float32: 2e-6, np.float64: 1e-13}


def ellipses(count: int, seed: int, least: float = 0.3, **changes) -> Scene:
    """Plain ellipses of all sizes, many partly off the canvas."""
    rng = np.random.default_rng(seed)
    fields = {
        "mean": rng.uniform(-5, 50, (count, 2)),
        "sigma": np.exp(rng.uniform(np.log(least), 2.5, (count, 2))),
        "rho": rng.uniform(-0.95, 0.95, count),
        "color": rng.random((count, 3)),
        "opacity": rng.uniform(0.3, 1, count),
        "beta": rng.uniform(3, 250, count),
        "drawn": np.full(count, PLAIN),
        "background": rng.random(3),
    }
    return Scene(WIDTH, HEIGHT, **(fields | changes))


def slow(scene: Scene) -> np.ndarray:
    return render_reference(scene).numpy()


@in_both
@given(seed=st.integers(0, 2**32 - 1), on_a_pixel=st.booleans())
def test_kernel_draws_the_formula(dtype, seed, on_a_pixel):
    scene = ellipses(12, seed, least=0.1)
    if on_a_pixel:
        scene = scene.replace(mean=np.floor(scene.mean) + 0.5)
    image = render_planar(splats_of(scene), HEIGHT, WIDTH, dtype)
    # At the very end of a needle single precision may decide otherwise what lies within it.
    wrong = np.abs(np.moveaxis(image, 0, -1) - slow(scene)).max(axis=2) > 30 * OFF[dtype]
    assert wrong.sum() <= (1 if dtype is np.float32 else 0)


@given(seed=st.integers(0, 2**32 - 1))
def test_coverage_is_what_many_samples_of_a_pixel_say(seed):
    scene = ellipses(1, seed, least=1.0, rho=np.zeros(1), mean=np.full((1, 2), 20.3))
    fine = (np.arange(16 * WIDTH) + 0.5) / 16
    radius = covered_radius(scene.beta)[0]
    u, v = ((fine - 20.3) / (radius * s) for s in scene.sigma[0])
    inside = (u**2 + v[: 16 * HEIGHT, None] ** 2) < 1
    sampled = inside.reshape(HEIGHT, 16, WIDTH, 16).mean(axis=(1, 3))
    z = (np.stack(np.mgrid[:HEIGHT, :WIDTH][::-1], axis=-1) + 0.5 - 20.3) / scene.sigma[0]
    covered = coverage(z, whitening_of(scene.sigma, scene.rho)[0], radius)
    assert np.abs(covered - sampled).max() < 0.25  # at the ends of a needle
    assert np.abs(covered - sampled).mean() < 0.004


@in_both
def test_gradient_is_that_of_differences(dtype):
    """By means, colours and opacities; that by the shape counts the pixel's slope as constant."""
    size = np.random.default_rng(0).uniform(2, 9, (3, 1))
    scene = ellipses(3, 2, sigma=np.repeat(size, 2, axis=1), rho=np.zeros(3))
    target = np.random.default_rng(1).random((3, HEIGHT, WIDTH))
    splats = splats_of(scene)
    _, squares, moments, _ = squared_error(splats, target.astype(dtype))

    def loss(**moved) -> float:
        image = np.moveaxis(slow(scene.replace(**moved)), -1, 0)
        return 0.5 * float(np.square(image - target).sum())

    assert squares / 2 == pytest.approx(loss(), rel=1e-5)
    by_mean = moments[:, :2] * whitening_of(scene.sigma, scene.rho)[:, [0, 2]]
    found = {"mean": by_mean, "color": moments[:, 6:9], "opacity": moments[:, 5] / scene.opacity}
    for name, gradient in found.items():
        values = getattr(scene, name)
        for place in np.ndindex(*values.shape):
            both = []
            for step in (1e-6, -1e-6):
                moved = values.copy()
                moved[place] += step
                both.append(loss(**{name: moved}))
            expected = (both[0] - both[1]) / 2e-6
            assert gradient[place] == pytest.approx(expected, abs=2e-3 * np.abs(gradient).max())
