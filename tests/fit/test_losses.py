"""Losses and their gradients with respect to the rendered picture."""

import numpy as np
import pytest
from flat import choices

from gauss2svg.fit.losses import image_gradient, structural_similarity


def planes(height: int, width: int, dtype: type = np.float64, channels: int = 3):
    """A picture of soft stripes, and a noisy copy of it."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:height, :width]
    stripes = [0.5 + 0.4 * np.sin(0.3 * x + 0.2 * y * (c + 1)) for c in range(channels)]
    target = np.array(stripes)
    image = np.clip(target + rng.normal(0, 0.08, target.shape), 0, 1)
    return image.astype(dtype), target.astype(dtype)


def torch_similarity(torch, image, other):
    """Mean SSIM of two planes by torch's convolution, differentiable: the oracle."""
    side = min(11, *(s - 1 + s % 2 for s in image.shape))
    offset = torch.arange(side, dtype=image.dtype) - side // 2
    taps = torch.exp(-0.5 * (offset / 1.5) ** 2)
    window = torch.outer(taps, taps)[None, None] / taps.sum() ** 2

    def mean(plane):
        return torch.nn.functional.conv2d(plane[None, None], window)[0, 0]

    a, b = mean(image), mean(other)
    covariance = mean(image * other) - a * b
    variances = mean(image**2) - a**2 + mean(other**2) - b**2
    c1, c2 = 0.01**2, 0.03**2
    luminance = (2 * a * b + c1) / (a**2 + b**2 + c1)
    return (luminance * (2 * covariance + c2) / (variances + c2)).mean()


@pytest.mark.parametrize(
    ("size", "dtype", "tolerance"),
    [
        ((40, 61), np.float32, 1e-4),
        ((40, 61), np.float64, 1e-10),
        ((11, 11), np.float64, 1e-10),
        ((30, 8), np.float64, 1e-10),
        ((2, 9), np.float64, 1e-10),
        ((1, 1), np.float64, 1e-10),
    ],
)
def test_ssim_and_its_gradient_are_those_of_torch(size, dtype, tolerance):
    torch = pytest.importorskip("torch")
    image, target = (p[0] for p in planes(*size, dtype))
    value, gradient = structural_similarity(image, target)
    variable = torch.from_numpy(image.astype(np.float64)).requires_grad_()
    oracle = torch_similarity(torch, variable, torch.from_numpy(target.astype(np.float64)))
    oracle.backward()
    assert variable.grad is not None
    expected = variable.grad.numpy() * image.size
    assert gradient.dtype == dtype
    assert value == pytest.approx(oracle.item(), rel=tolerance)
    assert np.linalg.norm(gradient - expected) <= tolerance * np.linalg.norm(expected)


def test_ssim_is_that_of_scikit_image_inside(photo):
    from skimage.metrics import structural_similarity as oracle

    other = np.clip(photo + np.random.default_rng(0).normal(0, 0.1, photo.shape), 0, 1)
    one, two = photo[:, :, 0].astype(np.float64), other[:, :, 0]
    full = oracle(
        one, two, data_range=1.0, gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
        full=True,
    )[1]  # fmt: skip
    assert structural_similarity(one, two)[0] == pytest.approx(full[5:-5, 5:-5].mean(), rel=1e-9)


def test_a_picture_is_most_similar_to_itself():
    target = planes(20, 30)[1][0]
    value, gradient = structural_similarity(target, target)
    assert value == pytest.approx(1)
    assert np.abs(gradient).max() < 1e-9


@pytest.mark.parametrize("weight", [0.0, 0.3, 1.0])
def test_losses_weight_ssim_by_their_option(weight):
    rng = np.random.default_rng(0)
    rendered, target = rng.random((2, 3, 20, 24))
    pixel, by_pixel = image_gradient("l1", rendered, target)
    value, gradient = image_gradient("l1+ssim", rendered, target, weight)
    structure, by_structure = image_gradient("l1+ssim", rendered, target, 1.0)
    assert value == pytest.approx((1 - weight) * pixel + weight * structure)
    np.testing.assert_allclose(
        gradient, (1 - weight) * by_pixel + weight * by_structure, atol=1e-12
    )


@pytest.mark.parametrize("loss", choices("loss"))
def test_loss_gradient_is_that_of_finite_differences(loss):
    # Nowhere equal to the target, where |r - t| has a kink.
    rendered, target = planes(12, 13)
    _, gradient = image_gradient(loss, rendered, target)
    direction = np.random.default_rng(1).normal(size=rendered.shape)
    values = [image_gradient(loss, rendered + s * direction, target)[0] for s in (1e-7, -1e-7)]
    slope = (values[0] - values[1]) / 2e-7 * rendered.size
    assert np.sum(gradient * direction) == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize("loss", ["mse", "l1"])
def test_pixel_losses_are_means_over_all_values(loss):
    rendered, target = planes(9, 14)
    difference = np.abs(rendered - target) if loss == "l1" else (rendered - target) ** 2
    assert image_gradient(loss, rendered, target)[0] == pytest.approx(difference.mean())
    assert image_gradient(f"{loss}+ssim", rendered, target)[0] > 0.8 * difference.mean()
