"""Properties of new Gaussians."""

import numpy as np
import pytest

from gauss2svg.fit.placement import place
from gauss2svg.fit.target import Target


@pytest.mark.parametrize("placement", ["error", "random"])
def test_new_gaussians_lie_where_a_target_is_visible(placement):
    rng = np.random.default_rng(3)
    picture = rng.random((40, 40, 4)).astype(np.float32)
    picture[..., 3] = np.hypot(*(np.indices((40, 40)) - 20)) < 6
    target = Target(picture, "psnr")
    new = place(placement, target, np.zeros_like(target.planar), 60, 60, rng)
    x, y = np.clip(np.floor(new.mean.T), 0, 39).astype(int)
    assert picture[y, x, 3].mean() == 1
