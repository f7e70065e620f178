"""Losses, their gradients, the weight of an error at a pixel, and all that goes by it."""

import numpy as np
import pytest
from flat import choices, fit_config

from gauss2svg.errors import InputError
from gauss2svg.fit.session import fit
from gauss2svg.fit.target import image_gradient


def planes(height: int, width: int, dtype: type = np.float64, channels: int = 3):
    """A picture of soft stripes, and a noisy copy of it."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:height, :width]
    stripes = [0.5 + 0.4 * np.sin(0.3 * x + 0.2 * y * (c + 1)) for c in range(channels)]
    target = np.array(stripes)
    image = np.clip(target + rng.normal(0, 0.08, target.shape), 0, 1)
    return image.astype(dtype), target.astype(dtype)


def own_loss(render, target):
    """A squared error as a function of one's own, in arrays."""
    return np.mean((render - target) ** 2), 2 * (render - target) / render.size


@pytest.mark.parametrize("loss", [*(one for one in choices("loss") if one != "weighted"), own_loss])
@pytest.mark.parametrize("size", [(12, 13), (2, 9), (1, 1)])
@pytest.mark.parametrize("focused", [False, True])
def test_loss_gradient_is_that_of_finite_differences(loss, size, focused):
    # Nowhere equal to the target, where |r - t| has a kink.
    rendered, target = planes(*size)
    focus = np.random.default_rng(2).random(size) if focused else None
    _, gradient = image_gradient(loss, rendered, target, focus)
    direction = np.random.default_rng(1).normal(size=rendered.shape)
    moved = (rendered + s * direction for s in (1e-7, -1e-7))
    values = [image_gradient(loss, one, target, focus)[0] for one in moved]
    slope = (values[0] - values[1]) / 2e-7 * rendered.size
    assert np.sum(gradient * direction) == pytest.approx(slope, rel=1e-5)
    planes_32 = (plane.astype(np.float32) for plane in (rendered, target))
    focus = None if focus is None else focus.astype(np.float32)
    single = image_gradient(loss, *planes_32, focus)[1]
    assert single.dtype == np.float32
    assert np.linalg.norm(single - gradient) <= 1e-3 * np.linalg.norm(gradient)


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
