"""Properties of a mask: a photo is closer where it is white, whatever the goal and the loss."""

import numpy as np
import pytest
from flat import vectorize
from PIL import Image
from skimage import data

from gauss2svg.errors import InputError
from gauss2svg.fit.target import Target
from gauss2svg.photo.pixels import Focus

HEIGHT, WIDTH = 48, 64
Y, X = np.mgrid[:HEIGHT, :WIDTH]
MASK = np.uint8(255 * ((X - 23) ** 2 / 16**2 + (Y - 27) ** 2 / 13**2 < 1))


def small(name: str) -> np.ndarray:
    """A picture of scikit-image, reduced."""
    picture = Image.fromarray(getattr(data, name)())
    return np.asarray(picture.resize((WIDTH, HEIGHT), Image.Resampling.BOX))


def psnr(raster, photo, where) -> float:
    return float(-10 * np.log10(np.mean(np.square(raster - photo)[where])))


COUNT = {"gaussians": 60, "iterations": 40}
GOALS = {
    "count": COUNT, "inks": {**COUNT, "inks": 8}, "psnr": {**COUNT, "tune": "psnr"},
    "ssim": {**COUNT, "loss": "mse+ssim"}, "additive": {**COUNT, "blend": "add"},
    "small file": {"max_bytes": 1000, "iterations": 40},
    "editable file": {"max_bytes": 9000, "markup": "editable", "iterations": 40},
}  # fmt: skip


@pytest.mark.parametrize(
    "goal", [pytest.param(g, marks=[pytest.mark.sweep] * (k > 1)) for k, g in enumerate(GOALS)]
)
def test_a_photo_is_closer_inside_of_its_mask_at_the_cost_of_the_rest(goal):
    gains = []
    for name in ("astronaut", "coffee", "chelsea"):
        plain, focused = (
            vectorize(small(name), **GOALS[goal], **more) for more in ({}, {"focus": MASK})
        )
        psnrs = [
            [psnr(result.raster, result.photo, where) for where in (MASK > 0, MASK == 0)]
            for result in (plain, focused)
        ]
        report = focused.report
        assert [report["psnr_svg_inside"], report["psnr_svg_outside"]] == pytest.approx(psnrs[1])
        assert plain.report["psnr_svg_inside"] is plain.report["focus_strength"] is None
        gains.append(np.subtract(psnrs[1], psnrs[0]))
    inside, outside = np.mean(gains, axis=0)
    assert inside > 0.5
    assert outside < 0


def test_without_a_count_shapes_are_added_for_the_error_that_the_mask_weighs():
    flat = np.full((HEIGHT, WIDTH, 3), 0.5)
    flat[:, WIDTH // 2 :] = small("coffee")[:, WIDTH // 2 :] / 255
    on_flat, on_detail = (
        vectorize(flat, quality="draft", focus=(X < WIDTH // 2) == left, focus_strength=30)
        for left in (True, False)
    )
    assert on_flat.report["gaussians"] < on_detail.report["gaussians"]


def test_a_mask_is_read_like_a_photo(tmp_path):
    photo, image = small("coffee"), Image.fromarray(MASK)
    image.save(tmp_path / "mask.png")
    clear = np.dstack([np.full((*MASK.shape, 3), 255, np.uint8), MASK])  # white where it is opaque
    masks = [MASK, MASK / 255, MASK > 0, image, str(tmp_path / "mask.png"), clear]
    assert (
        len({vectorize(photo, gaussians=40, iterations=20, focus=mask).svg for mask in masks}) == 1
    )


@pytest.mark.parametrize("tune", ["perceptual", "psnr"])
@pytest.mark.parametrize("size", [(48, 64), (24, 32), (240, 320)])
def test_the_weight_inside_is_larger_by_the_strength_and_has_its_mean(tune, size):
    pixels = small("coffee").astype(np.float32) / 255
    mask = np.asarray(Image.fromarray(MASK).resize(size[::-1], Image.Resampling.BOX), np.float32)
    focus = Focus(mask[:, :, None] / 255, 5.0)
    plain, weighted = (Target(pixels, tune, np.float64, mask=each).weight for each in (None, focus))
    factor, inside = weighted / plain, focus.inside(HEIGHT, WIDTH)
    np.testing.assert_allclose(factor, factor.min() * (1 + 4 * inside), rtol=1e-5)
    assert inside.max() == 1
    assert weighted.mean() == pytest.approx(plain.mean())


@pytest.mark.parametrize(
    ("mask", "line"),
    [
        (MASK.T, r"focus must be a mask of the photo's proportions, 64x48; got 48x64 px. Try the"),
        (MASK[:, :-2], "proportions, 64x48; got 62x48 px"),
        (np.zeros((HEIGHT, WIDTH)), "focus must be a mask with white .*; got greys from 0 to 0 of"),
        (np.ones((HEIGHT, WIDTH)), "got greys from 255 to 255 of 255"),
        (7, "focus must be a picture, but photo must be a path, .*; got int"),
        (np.full((HEIGHT, WIDTH), 2.0), "focus must be a picture, but samples of array .*0..1"),
        (b"rubbish", "focus must be a picture, but .* got an unknown format"),
    ],
)
def test_a_mask_that_does_not_fit_is_refused(mask, line):
    with pytest.raises(InputError, match=line):
        vectorize(small("coffee"), gaussians=10, focus=mask)
