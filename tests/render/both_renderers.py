"""Both renderers of a scene, of either blend and in both precisions."""

import numpy as np
import pytest
from scenes import random_scene, random_sum
from with_torch import torch

from gauss2svg.render.autograd import fast_composite
from gauss2svg.render.reference import composite
from gauss2svg.scene import ADD, OVER, Scene

TORCH = {np.float32: torch.float32, np.float64: torch.float64}
in_both = pytest.mark.parametrize("dtype", TORCH, ids=["float32", "float64"])
of_either_blend = pytest.mark.parametrize("scene_of", [random_scene, random_sum], ids=[OVER, ADD])
# How far pictures and scaled gradients of the fast renderer may be off: three and more times what
# is seen with exponents at the ends of their range. Sums of parts are a few times 1.
OFF = {OVER: {np.float32: 3e-5, np.float64: 1e-13}, ADD: {np.float32: 1e-4, np.float64: 1e-12}}
GRADIENT_OFF = {np.float32: 1e-3, np.float64: 1e-12}


def tensors_of(scene: Scene, dtype: torch.dtype = torch.float64) -> list[torch.Tensor]:
    """What `drawn` takes of a scene, in the order of the renderers' arguments."""
    names = ["mean", "sigma", "rho", "color", "background"]
    if scene.blend == OVER:
        names[4:] = ["opacity", "background", "beta"]
    return [torch.tensor(getattr(scene, n), dtype=dtype).requires_grad_() for n in names]


def drawn(scene: Scene, tensors: list[torch.Tensor], fast: bool = False) -> torch.Tensor:
    """The picture of tensors in place of a scene's parameters, by one of the two renderers."""
    renderer = fast_composite if fast else composite
    size = round(scene.height), round(scene.width)
    if scene.blend == ADD:
        *others, background = tensors
        return renderer(*others, None, background, *size)
    *others, beta = tensors
    return renderer(*others, *size, beta)
