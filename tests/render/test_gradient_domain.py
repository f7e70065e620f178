"""Gradients against finite differences of another arithmetic, over all of the domain.

Differences are taken of the formula in whitened coordinates z, where each natural step of a shape
(extremes.natural) is a smooth change, so that nothing cancels however thin it is: with
k = sqrt(1 - rho^2) and a step t

    mean along the factor's columns   z1 - t;  z2 - t
    ln sx by k t                      z1 exp(-k t), z2 - rho z1 expm1(-k t) / k
    ln sy by k t                      z2 + (z2 + rho z1 / k) expm1(-k t)
    artanh rho by t                   z2 (cosh t + rho sinh t) - z1 k sinh t

and the rest as it is. Pixels on a cut, where gradients jump, have no weight in the loss.
"""

from with_torch import torch  # isort: skip, for the next module needs it
import extremes
import numpy as np
import pytest
from extreme_scenes import extreme_scenes, near_the_cut, picture, whitened
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gauss2svg.render.autograd import fast_accumulate, fast_composite
from gauss2svg.render.reference import accumulate, composite
from gauss2svg.scene import ADD, OVER, Scene, narrowing_of

STEP, MASKED = 2e-5, 2e-3
SHAPE = ("mean", "sigma", "rho")
# Relative to the largest of a kind, or to a thousandth of the largest of all.
ALLOWED = 1e-3
EXAMPLES = 40
UNSHRUNK = (Phase.explicit, Phase.generate)  # shrinking would take minutes


def moved(scene: Scene, z: NDArray, name: str, i: int, j: int, t: float) -> NDArray:
    """The whitened offsets z after a natural step t of one element of a shape's geometry."""
    z = z.copy()
    z1, z2 = z[i, :, :, 0].copy(), z[i, :, :, 1].copy()
    rho, k = scene.rho[i], float(narrowing_of(scene.rho[i : i + 1])[0])
    if name == "mean":
        z[i, :, :, j] -= t
    elif name == "rho":
        z[i, :, :, 1] = z2 * (np.cosh(t) + rho * np.sinh(t)) - z1 * k * np.sinh(t)
    elif j == 0:
        z[i, :, :, 0] = z1 * np.exp(-k * t)
        z[i, :, :, 1] = z2 - rho * z1 * np.expm1(-k * t) / k
    else:
        z[i, :, :, 1] = z2 + (z2 + rho * z1 / k) * np.expm1(-k * t)
    return z


def differences(scene: Scene, weight: NDArray) -> dict[str, NDArray]:
    """Gradients of sum weight picture along natural steps, by differences of fourth order."""
    z = whitened(scene)
    names = [*SHAPE, "color", "background", *(("opacity", "beta") if scene.blend == OVER else ())]

    def loss(name: str, at: tuple[int, ...], t: float) -> float:
        if name in SHAPE:
            return np.sum(weight * picture(scene, moved(scene, z, name, at[0], at[-1], t)))
        values = getattr(scene, name).copy()
        values[at] = values[at] * np.exp(t) if name == "beta" else values[at] + t
        return np.sum(weight * picture(scene, z, **{name: values}))

    found = {}
    for name in names:
        found[name] = np.zeros(np.shape(getattr(scene, name)))
        for at in np.ndindex(*found[name].shape):
            near = loss(name, at, STEP) - loss(name, at, -STEP)
            far = loss(name, at, 2 * STEP) - loss(name, at, -2 * STEP)
            found[name][at] = (8 * near - far) / (12 * STEP)
    return found


def gradients(
    scene: Scene, weight: NDArray, fast: bool, dtype: torch.dtype, powers: bool
) -> dict[str, NDArray]:
    """Gradients of the same loss by a renderer, along the same steps.

    Without powers exponents have no gradient, and the fast renderer leaves them to the loop of
    Gaussians. Its kernels are float32 if a single tensor is; the others keep the scene's digits.
    """
    names = [*SHAPE, "color", *(("opacity",) if scene.blend == OVER else ()), "background"]
    exact = torch.float64 if fast else dtype
    tensors = [torch.tensor(getattr(scene, n), dtype=exact).requires_grad_() for n in names]
    if fast:
        tensors[-1] = tensors[-1].detach().to(dtype).requires_grad_()
    beta = torch.tensor(scene.beta, dtype=exact)
    size = round(scene.height), round(scene.width)
    if scene.blend == ADD:
        image = (fast_accumulate if fast else accumulate)(*tensors, *size)
    else:
        beta.requires_grad_(powers)
        image = (fast_composite if fast else composite)(*tensors, *size, beta)
        if powers:
            names.append("beta")
            tensors.append(beta)
    found = torch.autograd.grad(
        (image.double() * torch.tensor(weight)).sum(), tensors, allow_unused=True,
        materialize_grads=True,
    )  # fmt: skip
    by = {n: g.double().numpy() for n, g in zip(names, found, strict=True)}
    return extremes.natural(scene, by)


def check(scene: Scene, seed: int) -> None:
    """Compare all renderers' gradients on a scene with differences."""
    weight = np.random.default_rng(seed).normal(size=(round(scene.height), round(scene.width), 3))
    weight[near_the_cut(scene, whitened(scene), MASKED)] = 0
    exact = differences(scene, weight)
    for fast, dtype in ((False, torch.float64), (True, torch.float32), (True, torch.float64)):
        for powers in (False, True):
            by = gradients(scene, weight, fast, dtype, powers)
            off, kind = extremes.gradient_difference(by, {n: exact[n] for n in by})
            where = f"{kind}, sigma {scene.sigma.tolist()}, rho {scene.rho.tolist()}, "
            where += f"beta {scene.beta.tolist()}"
            assert off <= ALLOWED, f"{'kernels' if fast else 'reference'}: {off:.1e} of {where}"


@pytest.mark.sweep
@pytest.mark.parametrize(("blend", "beta"), [(OVER, 1.0), (OVER, 1.7), (ADD, 1.0)])
@pytest.mark.parametrize("sigma", [1.0, 4.0])
def test_gradients_are_those_of_finite_differences_for_a_needle_beside_centres(blend, beta, sigma):
    # down a column it is 1e-6 px wide: a step of a row is 7e5 whitened units at a sigma of 1 px
    shape = {"sigma": [[sigma, sigma]], "rho": [1 - 1e-12], "color": [[0.9, 0.2, 0.6]]}
    scene = Scene(18, 11, [[6.3, 1.3]], **shape, opacity=[1.0], beta=[beta], blend=blend)
    beside = scene.mean - scene.factor[0] @ [0.0, 0.9]
    check(scene.replace(mean=beside), 0)


@pytest.mark.nightly
@pytest.mark.parametrize("blend", [OVER, ADD])
@settings(max_examples=EXAMPLES, phases=UNSHRUNK)
@given(st.data(), st.integers(0, 2**32 - 1))
def test_gradients_are_those_of_finite_differences_over_all_of_the_domain(blend, data, seed):
    check(data.draw(extreme_scenes(blend, most=3, least=1, size=(18, 11))), seed)
