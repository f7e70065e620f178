"""What the differentiable renderers take: tensors within the domain of a scene's parameters."""

from __future__ import annotations

import numpy as np
import torch

from gauss2svg.errors import InputError
from gauss2svg.scene import LEAST_SIGMA, MOST_MEAN, MOST_SIGMA, MOST_SIGNED, RHO_LIMIT
from gauss2svg.scene.falloff import LEAST_BETA, MOST_BETA

_DOMAIN = {
    "mean": (-MOST_MEAN, MOST_MEAN),
    "sigma": (LEAST_SIGMA, MOST_SIGMA),
    "rho": (-RHO_LIMIT, RHO_LIMIT),
    "color": (-MOST_SIGNED, MOST_SIGNED),
    "opacity": (0.0, 1.0),
    "background": (-MOST_SIGNED, MOST_SIGNED),
    "beta": (LEAST_BETA, MOST_BETA),
}


def check_domain(**tensors: torch.Tensor) -> None:
    """Raise InputError for an element that is not finite or leaves the domain of its parameter.

    As in gauss2svg.scene.scene.Scene, save that colours may be signed in both blends, and that rho may
    go up to the last number before 1 of its own dtype.
    """
    for name, tensor in tensors.items():
        least, most = _DOMAIN[name]
        # The ends as the tensor's type has them: 1e-9 is a little less in float32, and beyond the
        # normal numbers of float16, as 1e9 is.
        kind = torch.finfo(tensor.dtype)
        least = max(least, kind.tiny) if least > 0 else max(least, kind.min)
        ends = torch.tensor([least, min(most, kind.max)], dtype=tensor.dtype)
        least, most = ends.double().tolist()
        if name == "rho":
            least, most = -below_one(tensor.dtype), below_one(tensor.dtype)
        values = tensor.detach().to("cpu", torch.float64).numpy()
        bad = ~((values >= least) & (values <= most))
        if bad.any():
            at = tuple(int(i) for i in np.argwhere(bad)[0])
            raise InputError(
                f"{name}{list(at)} is {values[at]!s}; needed is finite and in {least!r}..{most!r}: "
                "clamp it"
            )


def below_one(dtype: torch.dtype) -> float:
    """The last number before 1 of a floating dtype."""
    return 1 - torch.finfo(dtype).eps / 2
