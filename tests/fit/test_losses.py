"""Losses and their gradients with respect to the rendered picture."""

import numpy as np
import pytest
from flat import choices

from gauss2svg.fit.target import image_gradient, structural_similarity


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


@pytest.mark.parametrize("loss", choices("loss"))
@pytest.mark.parametrize("size", [(12, 13), (40, 61), (30, 8), (2, 9), (1, 1)])
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


@pytest.mark.parametrize("loss", ["mse", "l1"])
@pytest.mark.parametrize("weight", [0.0, 0.3, 1.0])
def test_pixel_losses_are_means_over_all_values(loss, weight):
    rendered, target = planes(12, 14)
    pixel, by_pixel = image_gradient(loss, rendered, target)
    difference = np.abs(rendered - target) if loss == "l1" else (rendered - target) ** 2
    assert pixel == pytest.approx(difference.mean())
    value, gradient = image_gradient(f"{loss}+ssim", rendered, target, weight)
    structure, by_structure = image_gradient(f"{loss}+ssim", rendered, target, 1.0)
    assert value == pytest.approx((1 - weight) * pixel + weight * structure)
    expected = (1 - weight) * by_pixel + weight * by_structure
    np.testing.assert_allclose(gradient, expected, atol=1e-12)
