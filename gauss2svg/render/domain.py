"""The domain of the differentiable renderers' tensors: that of a scene's parameters."""

from __future__ import annotations

import numpy as np

from gauss2svg.errors import InputError
from gauss2svg.render import TorchMissingError
from gauss2svg.scene import MOST_SIGNED
from gauss2svg.scene.parameters import PARAMETERS

try:  # the modules beside this one take it from here, so that it is missed in one place
    import torch
except ImportError as error:
    raise TorchMissingError(
        'the differentiable renderer needs PyTorch. Try pip install "gauss2svg[torch]"'
    ) from error

_DOMAIN = {parameter.name: (parameter.least, parameter.most) for parameter in PARAMETERS}
_DOMAIN |= dict.fromkeys(("color", "background"), (-MOST_SIGNED, MOST_SIGNED))


def shapes_of(
    mean: torch.Tensor,
    sigma: torch.Tensor,
    rho: torch.Tensor,
    color: torch.Tensor,
    background: torch.Tensor,
    opacity: torch.Tensor | None = None,
    beta: torch.Tensor | None = None,
) -> tuple[torch.Tensor, ...]:
    """Mean, sigma, rho, color, opacity, background and beta; of opaque Gaussians if not given.

    Raises InputError for an element that is not finite or leaves the domain of its parameter: that
    of gauss2svg.scene.scene.Scene, but colours may be signed with both blends, and rho may go up to
    the last number before 1 of its own dtype.
    """
    opacity = torch.ones_like(rho) if opacity is None else opacity
    beta = torch.ones_like(rho) if beta is None else beta
    shapes = {
        "mean": mean, "sigma": sigma, "rho": rho, "color": color, "opacity": opacity,
        "background": background, "beta": beta,
    }  # fmt: skip
    for name, tensor in shapes.items():
        _check(name, tensor)
    return tuple(shapes.values())


def _check(name: str, tensor: torch.Tensor) -> None:
    least, most = _DOMAIN[name]
    # The ends as numbers of the tensor's dtype: float32 rounds 1e-9 down, and 1e-9 and 1e9 lie
    # outside the normal numbers of float16.
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
            f"{name}{list(at)} must be finite and in {least!r}..{most!r}; got "
            f"{values[at]!s}. Try clamping it"
        )


def below_one(dtype: torch.dtype) -> float:
    """The last number before 1 of a floating dtype."""
    return 1 - torch.finfo(dtype).eps / 2
