"""Properties of palettes: few gradients, which serve what shows, and shared colours of areas."""

import numpy as np
import pytest
from scenes import random_sum

from gauss2svg.measure.metrics import local_hue_error, psnr
from gauss2svg.pipeline.palette import LARGEST_CHANGE, quantize
from gauss2svg.render import render
from gauss2svg.scene import Scene


@pytest.mark.parametrize("given", [{"color_error": 8e-4}, {"palette": 8}])
def test_the_only_red_thing_keeps_its_hue_at_every_size(given):
    """A few small shapes of another hue among many keep it, whatever the picture's size is."""
    rng = np.random.default_rng(1)
    greys = np.repeat(rng.uniform(0.2, 0.8, (900, 1)), 3, axis=1) * [1.0, 0.97, 0.9]
    mean, sigma = rng.uniform(0, [300, 200], (900, 2)), rng.uniform(2.0, 20.0, (900, 2))
    greys[-6:], mean[-6:], sigma[-6:] = [0.7, 0.3, 0.25], [150, 100] + rng.normal(0, 3, (6, 2)), 2.5
    zero, one = np.zeros(900), np.ones(900)
    scene = Scene(300, 200, mean, sigma, zero, greys, one, background=[0.5, 0.5, 0.45])
    for scale in (1, 5):
        once = quantize(scene.scaled(scale, scale), **given).scaled(1 / scale, 1 / scale)
        colors = len(np.unique(np.column_stack([once.beta, once.color]), axis=0))
        assert colors <= given.get("palette", 300)
        assert local_hue_error(render(once), render(scene)).worst < LARGEST_CHANGE + 2
        if "palette" in given:
            assert (quantize(once, **given).color == once.color).all()


def test_a_palette_of_signed_colours_keeps_signs_and_is_closer_the_larger_it_is():
    scene = random_sum(200, 60, 44, 11)
    kept, fewer = quantize(scene, palette=20), quantize(scene, palette=4)
    assert len(np.unique(kept.color, axis=0)) == 20
    assert kept.color.min() < -0.2 < 0.2 < kept.color.max()
    np.testing.assert_array_equal(quantize(kept, palette=20).color, kept.color)
    assert psnr(render(kept), render(scene)) > psnr(render(fewer), render(scene)) + 3
    np.testing.assert_array_equal(quantize(scene, palette=200).color, scene.color)
