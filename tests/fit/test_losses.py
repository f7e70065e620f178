"""Losses, their gradients, the weight of an error at a pixel, and all that goes by it."""

import numpy as np
import pytest
from flat import choices, fit_config
from scenes import random_scene

from gauss2svg.errors import InputError
from gauss2svg.fit.placement import place
from gauss2svg.fit.population import Population
from gauss2svg.fit.session import fit
from gauss2svg.fit.target import Target, image_gradient, structural_similarity
from gauss2svg.render.cpu import moments_of_gradient, splats_of


def planes(height: int, width: int, dtype: type = np.float64, channels: int = 3):
    """A picture of soft stripes, and a noisy copy of it."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:height, :width]
    stripes = [0.5 + 0.4 * np.sin(0.3 * x + 0.2 * y * (c + 1)) for c in range(channels)]
    target = np.array(stripes)
    image = np.clip(target + rng.normal(0, 0.08, target.shape), 0, 1)
    return image.astype(dtype), target.astype(dtype)


def test_ssim_is_that_of_scikit_image_inside(photo):
    from skimage.metrics import structural_similarity as oracle

    other = np.clip(photo + np.random.default_rng(0).normal(0, 0.1, photo.shape), 0, 1)
    one, two = photo[:, :, 0].astype(np.float64), other[:, :, 0]
    full = oracle(
        one, two, data_range=1.0, gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
        full=True,
    )[1]  # fmt: skip
    assert structural_similarity(one, two)[0] == pytest.approx(full[5:-5, 5:-5].mean(), rel=1e-9)


def own_loss(render, target):
    """A squared error as a function of one's own, in arrays."""
    return np.mean((render - target) ** 2), 2 * (render - target) / render.size


@pytest.mark.parametrize("loss", [*(one for one in choices("loss") if one != "weighted"), own_loss])
@pytest.mark.parametrize("size", [(12, 13), (2, 9), (1, 1)])
@pytest.mark.parametrize("focused", [False, True])
def test_loss_gradient_is_that_of_finite_differences(loss, size, focused):
    # Nowhere equal to the target, where |r - t| has a kink.
    rendered, target = planes(*size)
    more = (None, np.random.default_rng(2).random(size) if focused else None)
    _, gradient = image_gradient(loss, rendered, target, *more)
    direction = np.random.default_rng(1).normal(size=rendered.shape)
    moved = (rendered + s * direction for s in (1e-7, -1e-7))
    values = [image_gradient(loss, one, target, *more)[0] for one in moved]
    slope = (values[0] - values[1]) / 2e-7 * rendered.size
    assert np.sum(gradient * direction) == pytest.approx(slope, rel=1e-5)
    planes_32 = (plane.astype(np.float32) for plane in (rendered, target))
    more = None, None if more[1] is None else more[1].astype(np.float32)
    single = image_gradient(loss, *planes_32, *more)[1]
    assert single.dtype == np.float32
    assert np.linalg.norm(single - gradient) <= 1e-3 * np.linalg.norm(gradient)


@pytest.mark.parametrize("loss", ["mse", own_loss])
def test_squared_error_has_no_weights_but_the_default_has(loss):
    _, planar = planes(30, 40)
    scene, target = random_scene(40, 30, 9), Target(np.moveaxis(planar, 0, -1), "psnr")
    splats = splats_of(scene)
    evaluated = target.evaluate(splats, loss, None)
    [image] = evaluated.rendered
    assert evaluated.error == pytest.approx(np.mean((image - planar) ** 2))
    moments = moments_of_gradient(splats, 2 * (image - planar))
    scale = 0.5 if loss == "mse" else 1
    np.testing.assert_allclose(evaluated.moments, scale * moments, rtol=1e-6, atol=1e-9)
    assert not np.allclose(
        target.evaluate(splats, "weighted", None).moments, 0.5 * moments, rtol=0.1
    )


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ((-1.0, np.zeros((6, 9, 3))), "loss >= 0 .* loss -1"),
        ((1.0, np.zeros(3)), r"gradient \(3,\)"),
        ((1.0, np.full((6, 9, 3), np.nan)), "finite gradient"),
        (1.0, "got float.* Try torch_loss"),
    ],
)
def test_a_function_that_is_no_loss_is_refused(answer, message):
    pixels = np.zeros((6, 9, 3), np.float32)
    with pytest.raises(InputError, match=message):
        fit(pixels, fit_config(3, 5, loss=lambda render, target: answer))


def test_an_error_of_a_loss_of_tensors_says_how_it_becomes_one_of_arrays():
    with pytest.raises(AttributeError) as caught:
        fit(np.zeros((6, 9, 3)), fit_config(3, 5, loss=lambda render, target: render.requires_grad))
    assert "Try torch_loss(function)" in caught.value.__notes__[0]


def chequered(height, width, contrast, cell=1) -> np.ndarray:
    """Grey pixels (height, width, 3); with cells of 1 px their variance is contrast (width,)^2."""
    y, x = np.mgrid[:height, :width] // cell
    grey = 0.5 + (2 * ((x + y) % 2) - 1) * np.asarray(contrast)
    return np.repeat(grey[:, :, None], 3, axis=2).astype(np.float32)


def half_flat(cell=4) -> np.ndarray:
    """Pixels (64, 64, 3), textured in the right half; psnr takes cells of 1 px for flat as well."""
    return chequered(64, 64, np.where(np.arange(64) < 32, 0.0, 0.4), cell)


def population(pixels, scene=None, **given) -> Population:
    """That of a fit to pixels, with the Gaussians of a scene."""
    found = Population(Target(pixels, given.get("tune", "perceptual")), fit_config(40, **given))
    if scene is not None:
        found.adopt(scene)
    return found


def test_perceptual_weight_falls_with_the_local_contrast_to_a_bound():
    noise = np.random.default_rng(0).normal(0, 1, (1, 60, 360))
    contrast = np.repeat([0.0, 0.02, 0.06, 0.12, 0.5, 1.0], 60)
    planar = np.repeat(0.5 + noise * contrast, 3, axis=0).astype(np.float32)
    weight = Target(np.moveaxis(planar, 0, -1), "perceptual").weight
    assert weight is not None
    assert weight.mean() == pytest.approx(1, rel=0.02)
    means = np.array([weight[10:-10, x + 15 : x + 45].mean() for x in range(0, 360, 60)])
    assert (np.diff(means[:5]) < 0).all()
    # far above the threshold it is inversely proportional to the contrast
    assert means[2] / means[3] == pytest.approx(2, rel=0.2)
    assert means[5] == pytest.approx(means[4], rel=0.01)


@pytest.mark.parametrize("tune", ["perceptual", "psnr"])
def test_new_gaussians_go_where_an_error_shows(tune):
    target = Target(half_flat(), tune)
    new = place("error", target, target.planar + 0.1, 1000, 1000, np.random.default_rng(0))
    weight = target.weight if tune == "perceptual" else np.ones((64, 64))
    on_flat = (new.mean[:, 0] < 32).mean()
    assert on_flat == pytest.approx(weight[:, :32].sum() / weight.sum(), abs=0.02)


@pytest.mark.parametrize("tune", ["perceptual", "psnr"])
def test_gaussians_are_pruned_by_the_decibels_of_the_weighted_error(tune):
    scene = random_scene(40, 64, 64, seed=2)
    fitted = population(half_flat(), scene, tune=tune)
    target, whole = fitted.target, fitted.state.copy()

    def squares(state) -> float:
        difference = target.rendered(state.splats(fitted.background, "over")) - target.planar
        return float(np.sum(np.square(difference, dtype=np.float64) * target.weight))

    before = squares(whole)
    each = [squares(whole.select(np.arange(40) != i)) for i in range(40)]
    gains = 10 * np.log10(np.array(each) / before)
    positive = np.sort(gains[gains > 0])
    least = float(positive[len(positive) // 2 - 1 : len(positive) // 2 + 1].mean())
    fitted.prune(least)
    np.testing.assert_array_equal(fitted.state.mean, whole.mean[gains > least])
    assert 0 < len(fitted) < 40
