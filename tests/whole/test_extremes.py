"""Scenes at the limits of the domain and beyond: renderers, files, round trip."""

import itertools
import math
from operator import attrgetter

from with_torch import render_reference, torch  # isort: skip, for the next module needs it
import extremes
import numpy as np
import pytest
from scenes import random_scene

from gauss2svg.errors import InputError, SceneError
from gauss2svg.render import render
from gauss2svg.render.autograd import fast_composite
from gauss2svg.render.reference import composite
from gauss2svg.scene import LEAST_SIGMA, MOST_MEAN, MOST_SIGNED

pytestmark = pytest.mark.sweep

CASES = list(extremes.cases())
MANY = 1000  # from which on the reference is too slow for more than pictures
SINGLE, DOUBLE = torch.float32, torch.float64


@pytest.mark.parametrize("case", CASES, ids=attrgetter("name"))
def test_pictures_gradients_and_files_at_the_extremes_are_within_the_stated_bounds(case):
    scene, few = case.scene, len(case.scene) < MANY
    exact = render_reference(scene).numpy()
    np.testing.assert_allclose(render(scene), exact, atol=case.single)
    np.testing.assert_allclose(render(scene, dtype=np.float64), exact, atol=case.double)
    if len(scene) <= MANY:
        plain = render_reference(scene, dtype=SINGLE).numpy()
        np.testing.assert_allclose(plain, exact, atol=case.plain)
    steep = extremes.gradients(scene, not few, DOUBLE)
    kinds = {(True, SINGLE): case.gradient}
    if few:
        kinds |= {(True, DOUBLE): case.double_gradient, (False, SINGLE): case.plain_gradient}
    for kind, bound in kinds.items():
        found = extremes.gradients(scene, *kind)
        assert all(np.isfinite(values).all() for values in found.values())
        off, worst = extremes.gradient_difference(found, steep)
        assert off <= bound, (kind, worst)
    if len(scene) <= MANY:
        drawn = extremes.drawn_file(scene)
        if case.levels is None:
            assert isinstance(drawn, SceneError)
            assert "must reach at most" in str(drawn)
            assert "coarser precision" in str(drawn)
        else:
            assert not isinstance(drawn, SceneError), drawn
            assert drawn[1] <= case.levels


# Each parameter with a value just beyond its end, for tensors as for scenes.
BEYOND = {
    "sigma": 0.999 * LEAST_SIGMA, "rho": 1.0, "mean": -1.001 * MOST_MEAN, "opacity": -1e-6,
    "beta": 256.1, "color": 1.01 * MOST_SIGNED, "background": -1.01 * MOST_SIGNED,
}  # fmt: skip


@pytest.mark.parametrize("draw", [composite, fast_composite])
@pytest.mark.parametrize("name", BEYOND)
def test_beyond_the_domain_tensors_are_refused_by_both_renderers(draw, name):
    scene = random_scene(4, 20, 18, 3)
    names = ("mean", "sigma", "rho", "color", "opacity", "background", "beta")
    for dtype, value in itertools.product((SINGLE, DOUBLE), (BEYOND[name], math.nan, math.inf)):
        arrays = {n: torch.tensor(getattr(scene, n), dtype=dtype) for n in names}
        arrays[name].view(-1)[-1] = value
        beta = arrays.pop("beta")
        with pytest.raises(InputError, match=rf"^{name} .* finite and in .* clamp"):
            draw(*arrays.values(), 18, 20, beta)
