"""Images with alpha: how backdrops show them, how they are rendered, fitted and kept in scenes."""

import io

import numpy as np
import pytest
from conftest import random_scene
from flat import choices, fit_config

from gauss2svg.errors import InputError
from gauss2svg.fit.adam import gradients
from gauss2svg.fit.fit import fit
from gauss2svg.fit.placement import place
from gauss2svg.fit.target import target_of
from gauss2svg.photo.pixels import BACKDROPS, from_views, matte_color, over, shrunk, straight
from gauss2svg.render.cpu import splats_of
from gauss2svg.scene import Scene

FIELDS = ("mean", "sigma", "rho", "color", "opacity", "beta", "background", "round_index")


def clear_scene(count=12, seed=0, **options):
    """A random scene that is transparent."""
    scene = random_scene(count, seed=seed, **options)
    return scene.replace(transparent=True, background=np.ones(3))


def with_alpha(photo):
    """A photo (h, w, 3) with an alpha that takes all values, 0 and 1 among them."""
    height, width = photo.shape[:2]
    y, x = np.mgrid[:height, :width]
    alpha = np.clip((0.42 * width - np.hypot(x - width / 2, y - height / 2)) / 3, 0, 1)
    return np.dstack([photo, alpha]).astype(np.float32)


@pytest.fixture(scope="module")
def small(photo):
    """48 px of a face, cut out by a disc."""
    return with_alpha(shrunk(photo, 48, 48))


def test_two_backdrops_determine_colour_and_alpha():
    rng = np.random.default_rng(0)
    alpha = rng.choice([0.0, 0.25, 1.0], (9, 7))
    rgba = straight(alpha[:, :, None] * rng.random((9, 7, 3)), alpha)
    np.testing.assert_allclose(from_views(over(rgba, 1.0), over(rgba, 0.0)), rgba, atol=1e-6)


def oracle_loss(scene, rgba, weight):
    """Half the weighted squared error of a scene over white and over black, by the reference."""
    pytest.importorskip("torch")
    from gauss2svg.render.reference import render_reference

    total = 0.0
    for backdrop in BACKDROPS:
        shown = render_reference(scene.replace(background=np.full(3, backdrop))).numpy()
        alpha = rgba[:, :, 3:].astype(np.float64)
        wanted = rgba[:, :, :3] * alpha + (1 - alpha) * backdrop
        total += 0.5 * float(np.sum(weight[:, :, None] * np.square(shown - wanted)))
    return total


def changed(scene, name, at, step):
    values = getattr(scene, name).copy()
    values[at] += step
    return scene.replace(**{name: values})


def test_gradient_over_both_backdrops_is_that_of_the_oracle(small):
    rgba = shrunk(small, 30, 40)
    scene = clear_scene(4, seed=3, beta=(1.0, 4.0))
    scene = scene.replace(opacity=0.2 + 0.6 * scene.opacity, color=0.1 + 0.8 * scene.color)
    target = target_of(rgba, np.float64, "psnr")
    evaluated = target.evaluate(splats_of(scene), "mse", None)
    gradient = gradients(evaluated.moments, splats_of(scene))
    by_mean = np.linalg.solve(np.swapaxes(scene.factor, 1, 2), gradient[:, :2, None])[:, :, 0]
    by_opacity = gradient[:, 5] / (scene.opacity * (1 - scene.opacity))
    step = 1e-5
    for i in range(len(scene)):
        checks = [("opacity", i, by_opacity[i])]
        checks += [("color", (i, c), gradient[i, 6 + c]) for c in range(3)]
        checks += [("mean", (i, k), by_mean[i, k]) for k in range(2)]
        for name, at, given in checks:
            losses = (
                oracle_loss(changed(scene, name, at, d), rgba, target.weight) for d in (step, -step)
            )
            found = np.subtract(*losses) / (2 * step)
            assert given == pytest.approx(found, rel=2e-3, abs=2e-4), (name, at)


@pytest.mark.parametrize("loss", choices("loss")[1:])
def test_gradients_of_other_losses_are_over_both_backdrops(small, loss):
    step = 1e-6
    target = target_of(shrunk(small, 24, 24), np.float64, "psnr")
    splats = splats_of(clear_scene(5, seed=1, width=24, height=24))

    def evaluated(i, c, by):
        moved = splats.opacity_color.copy()
        moved[i, 1 + c] += by
        return target.evaluate(splats._replace(opacity_color=moved), loss, 0.5)

    for i, c in np.ndindex(5, 3):
        slope = (evaluated(i, c, step).loss - evaluated(i, c, -step).loss) / (2 * step)
        moments = evaluated(i, c, 0).moments
        assert moments[i, 6 + c] == pytest.approx(slope, rel=1e-3, abs=1e-3)


def test_removal_costs_what_the_error_over_both_backdrops_grows_by(small):
    target = target_of(small, np.float64, "psnr")
    scene = clear_scene(9, seed=2, width=48, height=48)
    splats = splats_of(scene)
    before = target.squares(splats)[0]
    rendered, cost = target.removal_cost(splats)
    assert before == pytest.approx(
        (np.square(rendered - target.planar) * target.weight).sum(), rel=1e-9
    )
    for i in range(9):
        without = target.squares(splats_of(scene.select(np.arange(9) != i)))[0]
        assert cost[i, 0] == pytest.approx(without - before, abs=1e-6)


@pytest.mark.parametrize("placement", choices("init"))
def test_new_gaussians_are_placed_on_visible_pixels_in_visible_colours(photo, placement):
    rgba = np.dstack([np.full((40, 60, 3), [1.0, 0.0, 1.0]), np.zeros((40, 60))])
    rgba[10:30, 20:40] = [0.0, 0.5, 0.25, 0.6]
    target = target_of(rgba, np.float32, "psnr")
    spot = {"color": [[0, 0, 0]], "opacity": [0.9]}  # where nothing should be
    far = Scene(60, 40, mean=[[52, 34]], sigma=[[3, 3]], rho=[0], transparent=True, **spot)
    rendered = target.rendered(splats_of(far))
    rng = np.random.default_rng(0)
    new = place(placement, target, rendered, 30, 30, rng)
    x, y = new.mean.T
    assert ((x >= 19) & (x <= 41) & (y >= 9) & (y <= 31)).all()
    np.testing.assert_allclose(new.color, np.tile([0.0, 0.5, 0.25], (30, 1)), atol=1e-6)


def test_colours_of_invisible_pixels_change_nothing(small):
    other = small.copy()
    other[small[:, :, 3] == 0, :3] = [1.0, 0.0, 1.0]
    np.testing.assert_array_equal(shrunk(small, 12, 16), shrunk(other, 12, 16))
    options = fit_config(40, 40)
    one, same = (fit(pixels, options).scene for pixels in (small, other))
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(same, name))


def test_scene_comes_back_transparent_from_a_file_and_stays_so():
    scene = clear_scene(6)
    stream = io.BytesIO()
    scene.save(stream)
    stream.seek(0)
    for back in (Scene.load(stream), scene.select([0, 2]), scene.scaled(2)):
        assert back.transparent is True
    assert scene.concatenate(random_scene(2)).transparent
    assert not random_scene(2).concatenate(scene).transparent


@pytest.mark.parametrize(
    ("text", "color"),
    [("white", (1, 1, 1)), ("Black", (0, 0, 0)), ("#f00", (1, 0, 0)), ("#336699", (0.2, 0.4, 0.6))],
)
def test_mattes_are_colours(text, color):
    assert matte_color(text) == pytest.approx(color)


@pytest.mark.parametrize("text", ["", "glass", "#12", "#12345", "#ggg", "rgb(1,2,3)", "#fff "])
def test_other_mattes_are_refused(text):
    with pytest.raises(InputError, match="white, black"):
        matte_color(text)


def test_new_gaussians_go_where_alpha_is_too_low_and_not_where_it_is_too_high():
    rgba = np.full((32, 64, 4), 0.5)
    target = target_of(rgba, np.float32, "psnr")
    covered = np.where(np.arange(64) < 32, 0.8, 0.2) * np.ones((32, 1))
    rendered = np.concatenate([[0.5 * covered + (1 - covered) * b] * 3 for b in BACKDROPS])
    errors = np.square(target.planar - rendered).sum(axis=0)
    assert errors[:, :32].sum() == pytest.approx(errors[:, 32:].sum(), rel=1e-4)
    rng = np.random.default_rng(0)
    new = place("error", target, rendered.astype(np.float32), 100, 100, rng)
    assert (new.mean[:, 0] > 32).mean() > 0.85
