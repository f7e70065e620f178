"""Laws of the falloff exponent: at its limits, in a fit, in a file."""

import numpy as np
import pytest
from conftest import needs, random_scene
from flat import fit_config, vectorize

from gauss2svg.fit import adam, population
from gauss2svg.fit.adam import blending_of
from gauss2svg.fit.fit import fit
from gauss2svg.fit.options import FitOptions
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.state import STEPS, State
from gauss2svg.measure import metrics
from gauss2svg.pipeline.palette import quantize
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import BETA_CLASSES, LEAST_BETA, MOST_BETA, RIM_WIDTH, half_radius
from gauss2svg.scene.parameters import LEAST_RAW_BETA, MOST_RAW_BETA
from gauss2svg.svg.document import SvgFormat
from gauss2svg.svg.plain_ellipse import is_plain, plain_radius
from gauss2svg.svg.write import write_svg

QUICK = {"iterations": 60}


def drawing(side: int = 96) -> np.ndarray:
    """A disc and a bar with antialiased edges on a light ground, (side, side, 3) float32."""
    y, x = (np.mgrid[: 4 * side, : 4 * side] + 0.5) / (4 * side)
    picture = np.full((4 * side, 4 * side, 3), 0.93)
    picture[np.hypot(x - 0.4, y - 0.45) < 0.27] = (0.9, 0.6, 0.1)
    picture[(abs(x - 0.7) < 0.2) & (abs(y - 0.75) < 0.09)] = (0.1, 0.2, 0.5)
    small = picture.reshape(side, 4, side, 4, 3).mean(axis=(1, 3))
    return (np.round(small * 255) / 255).astype(np.float32)


@pytest.mark.parametrize("beta", [LEAST_BETA, 1 - 1e-9, 1 + 1e-9, 64.0, MOST_BETA])
@pytest.mark.parametrize("sigma", [1e-6, 1e-3, 0.3, 1e3, 1e6])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_pictures_and_gradients_are_finite_at_the_ends_of_the_domain(beta, sigma, dtype):
    torch = pytest.importorskip("torch")
    from gauss2svg.render.autograd import fast_composite
    from gauss2svg.render.reference import composite, render_reference

    # one mean on a pixel centre, where r is 0, one on a corner, one far off
    mean = np.array([[4.5, 3.5], [3.0, 3.0], [1e5, -1e5]])
    scene = Scene(
        9, 7, mean, np.full((3, 2), sigma), [0.9, -0.9, 0], np.eye(3), np.full(3, 0.9),
        beta=np.full(3, beta),
    )  # fmt: skip
    image = render(scene, dtype=dtype)
    np.testing.assert_allclose(image, render_reference(scene).numpy(), atol=1e-4)
    names = ("mean", "sigma", "rho", "color", "opacity", "background", "beta")
    for renderer, kind in ((composite, torch.float64), (fast_composite, torch.float32)):
        tensors = [torch.tensor(getattr(scene, n), dtype=kind).requires_grad_() for n in names]
        drawn = renderer(*tensors[:6], 7, 9, tensors[6])
        (drawn**2).sum().backward()
        assert all(torch.isfinite(t.grad).all() for t in tensors if t.grad is not None)


def test_gaussians_are_drawn_to_the_bit_beside_sharp_shapes():
    soft = random_scene(20, 60, 40, 3, beta=(1, 1))
    away = random_scene(5, 60, 40, 4).replace(mean=np.full((5, 2), 500.0))
    assert (render(soft.concatenate(away)) == render(soft)).all()


def test_shape_a_hair_from_a_gaussian_is_drawn_as_one():
    scene = random_scene(30, 60, 40, 5, beta=(1, 1))
    near = scene.replace(beta=np.full(30, 1 + 1e-9))
    np.testing.assert_allclose(render(near), render(scene), atol=1e-5)


def test_sharp_shapes_fit_a_drawing_that_gaussians_smear():
    picture = drawing()
    soft, sharp = (
        fit(picture, fit_config(24, 150, falloff=f)).scene for f in ("gaussian", "adaptive")
    )
    assert (soft.beta == 1).all()
    psnr = [metrics.psnr(render(scene), picture) for scene in (soft, sharp)]
    assert psnr[1] > psnr[0] + 6
    assert metrics.flat_error(render(sharp), picture) < metrics.flat_error(render(soft), picture)
    assert (sharp.beta > 2).mean() > 0.4


def test_smooth_scene_keeps_its_gaussians():
    y, x = np.mgrid[:64, :64] / 63
    ramp = np.stack([x, 0.5 * (x + y), 1 - y], axis=-1).astype(np.float32)
    shares = [
        (vectorize(p, gaussians=24, **QUICK).scene.beta == 1).mean() for p in (ramp, drawing())
    ]
    assert shares[0] >= 0.5
    assert shares[1] < shares[0] - 0.1


@pytest.mark.sweep
def test_price_of_an_exponent_keeps_shapes_gaussian(photo, monkeypatch):
    shares = []
    for price in (0.0, 0.06, 1.0):
        monkeypatch.setattr(population, "BETA_PRICE", price)
        betas = vectorize(photo, gaussians=150, **QUICK).scene.beta
        shares.append((betas == 1).mean())
    assert shares[0] < shares[1] < shares[2]


def test_rims_stay_as_wide_as_they_must_be_and_exponents_in_their_range():
    scene = random_scene(300, 80, 60, 6, sigma=(0.4, 40.0), beta=(2, 30))
    factor = scene.factor[:, [0, 1, 1], [0, 0, 1]]
    raw_beta = np.log(scene.beta)
    state = State.of(scene.mean, factor, 0, color=scene.color.copy(), raw_beta=raw_beta)
    gradient = np.random.default_rng(0).choice([-1.0, 1.0], (300, STEPS))
    for _ in range(60):
        adam.step(state, gradient, blending_of(FitOptions()), 50.0, 1.0)
    free = state.raw_beta
    minor = state.scene(np.ones(3), 80, 60).ellipse_axes[0][:, 1]
    assert (free >= LEAST_RAW_BETA).all()
    assert (free <= MOST_RAW_BETA).all()
    sharpest = np.maximum(np.log(RIM_WIDTH * minor / adam.LEAST_RIM), LEAST_RAW_BETA)
    assert (free <= sharpest + 1e-9).all()
    assert (free > 1).any()


@pytest.mark.parametrize("palette", [None, 4, 0])
def test_file_draws_the_exponents_and_colours_that_the_scene_has(palette):
    result = vectorize(drawing(), gaussians=40, palette=palette, **QUICK)
    scene = result.scene
    shaded = ~is_plain(scene)
    nearest = np.abs(scene.beta[shaded, None] / np.array(BETA_CLASSES) - 1).min(axis=1)
    assert (nearest < 1e-12).all()
    again = quantize(scene)
    np.testing.assert_allclose(again.color, scene.color, atol=0.5 / 255)
    np.testing.assert_allclose(again.beta, scene.beta, rtol=1e-12)
    keys = np.column_stack([scene.beta, np.round(scene.color * 255)])[shaded]
    distinct = np.unique(np.round(keys, 6), axis=0)
    assert result.svg.count("<radialGradient") == len(distinct)
    if palette:
        assert len(distinct) <= palette
    assert result.report["psnr_roundtrip"] > 44


def test_quantization_changes_nothing_but_exponents_extents_and_colours():
    scene = random_scene(60, 120, 90, 7, sigma=(1.0, 20.0))
    once = quantize(scene, palette=12)
    for name in ("mean", "rho", "opacity", "round_index"):
        assert (getattr(once, name) == getattr(scene, name)).all()
    shaded = ~is_plain(scene)
    assert (once.beta[~shaded] == scene.beta[~shaded]).all()
    expected = scene.sigma * (half_radius(scene.beta) / half_radius(once.beta))[:, None]
    np.testing.assert_allclose(once.sigma, expected)
    assert len(np.unique(np.column_stack([once.beta, once.color])[shaded], axis=0)) <= 12
    assert metrics.psnr(render(once), render(scene)) > 25


def test_colours_of_different_exponents_share_no_gradient():
    scene = random_scene(40, 60, 40, 8, sigma=(3.0, 9.0)).replace(
        color=np.tile([[0.2, 0.4, 0.6]], (40, 1)), beta=np.resize([1.0, 3.0], 40)
    )
    for palette, gradients in ((0, 2), (2, 2), (1, 1)):
        svg = write_svg(quantize(scene, palette=palette))
        assert svg.count("<radialGradient") == gradients


# The last steps, before which exponents and colours are quantized, may not come.
@pytest.mark.parametrize(
    "limits",
    [
        {"iterations": 1}, {"iterations": 2}, {"iterations": 7},
        {"time_limit": 0.1}, {"time_limit": 0.2, "target_psnr": 26.0},
        {"max_bytes": 10_000, "iterations": 20},
    ],
)  # fmt: skip
@pytest.mark.parametrize("falloff", ["gaussian", "adaptive"])
def test_palette_holds_however_short_the_fit(photo, limits, falloff):
    part = photo[16:48, 56:88]
    result = vectorize(part, palette=16, falloff=falloff, **({"gaussians": 80} | limits))
    assert 1 <= result.svg.count("<radialGradient") <= 16
    assert result.report["gradients"] == result.svg.count("<radialGradient")
    if falloff == "gaussian":
        assert (result.scene.beta == 1).all()
    classes = np.array(BETA_CLASSES)
    assert np.isin(result.scene.beta[~is_plain(result.scene)], classes).all()
    assert (quantize(result.scene).color == result.scene.color).all()


@pytest.mark.sweep
def test_adaptive_palette_holds_however_short_the_time(photo):
    for limit in (0.3, 1.0, 3.0, 9.0):  # a busy machine places too few in a short time
        result = vectorize(photo, quality="fast", time_limit=limit)
        if len(result.scene) >= 50:
            break
    assert len(result.scene) >= 50
    assert result.svg.count("<radialGradient") < 0.6 * result.report["gaussians"]


def test_exponents_stay_and_colours_stay_shared_once_they_are_quantized(photo):
    seen = []

    def as_written(scene, psnr):
        seen.append(quantize(scene, palette=8))
        return seen[-1]

    config = fit_config(60, 80)
    session = FitSession(photo, config, as_written=as_written)
    session.fit()
    assert len(seen) == 1
    last = session.scene()
    pairs = [
        np.unique(np.column_stack([scene.beta, scene.color]).round(9), axis=0)
        for scene in (seen[0], last)
    ]
    assert len(pairs[1]) <= len(pairs[0])
    assert set(pairs[1][:, 0]) <= set(pairs[0][:, 0])
    assert not np.isin(last.color, seen[0].color).all()  # but as one they moved on
    assert not np.isin(last.mean, seen[0].mean).any()  # the rest moved on


@pytest.mark.parametrize("beta", [3.0, 6.0, 16.0, 64.0])
def test_shapes_too_large_to_be_crisp_are_never_plain(beta):
    sigma = np.geomspace(0.4 * beta, 1e6, 60)[:, None] * [1, 1]
    scene = Scene(
        100, 100, np.full((60, 2), 50.0), sigma, np.zeros(60), np.zeros((60, 3)), np.ones(60),
        beta=np.full(60, beta),
    )  # fmt: skip
    width = RIM_WIDTH * sigma[:, 0] / beta
    assert not is_plain(scene)[width > 1.3].any()


def test_shapes_thinner_than_any_pixel_are_left_out_not_refused():
    scene = Scene(100, 100, [[50, 50]], [[2e-6, 2e-6]], [0.0], np.zeros((1, 3)), [1.0], beta=[64.0])
    assert "<circle" not in write_svg(scene, SvgFormat(precision=0.001))


@pytest.mark.sweep
@pytest.mark.parametrize("renderer", ["resvg", "cairo"])
@pytest.mark.parametrize("beta", [1.7, 6.0, 16.0, 64.0])
def test_rims_are_drawn_as_the_model_has_them_at_every_size(renderer, beta):
    needs(renderer)
    # rims of 0.6 px and of 3 px, across the minor axis; not so round that a plain ellipse does
    for rim in (0.6, 3.0):
        minor = rim * beta / RIM_WIDTH
        sigma = [[min(6 * minor, 60), minor]]
        scene = Scene(150, 150, [[75.3, 74.8]], sigma, [0.3], [[0.1, 0.3, 0.2]], [1.0], beta=[beta])
        if is_plain(scene)[0]:
            continue
        svg = write_svg(scene, SvgFormat(stops=12, precision=0.001))
        for scale in (1, 2, 4):
            size = 150 * scale
            difference = np.abs(rasterize(svg, size, size, renderer) - render(scene, size, size))
            assert difference.max() < 12 / 255


@pytest.mark.parametrize("renderer", ["resvg", "cairo"])
def test_plain_ellipses_are_drawn_as_the_model_is_on_average_over_a_pixel(renderer):
    needs(renderer)
    for sigma, beta in ((4.0, 10.0), (20.0, 64.0), (30.0, 64.0)):
        scene = Scene(
            150, 150, [[75.3, 74.8]], [[sigma, sigma]], [0.0], [[0.1, 0.3, 0.2]], [1.0], beta=[beta]
        )
        assert is_plain(scene).all()
        svg = write_svg(scene, SvgFormat(precision=0.001))
        assert "radialGradient" not in svg
        exact = render(scene, 1200, 1200).reshape(150, 8, 150, 8, 3).mean(axis=(1, 3))
        drawn = rasterize(svg, 150, 150, renderer)
        assert metrics.psnr(drawn, exact) > 38
        assert abs(metrics.bias(drawn, exact)) < 0.1


def test_plain_ellipse_covers_what_the_profile_sums_up_to():
    scene = Scene(200, 200, [[100, 100]], [[20, 20]], [0.0], np.zeros((1, 3)), [1.0], beta=[8.0])
    mass = (1 - render(scene)[:, :, 0]).sum()
    assert np.pi * (20 * plain_radius(np.array([8.0]))[0]) ** 2 == pytest.approx(mass, rel=1e-3)


def test_plain_are_crisp_shapes_and_no_others():
    def plain(sigma, beta):
        n = len(sigma)
        scene = Scene(
            99, 99, np.full((n, 2), 50.0), sigma, np.zeros(n), np.zeros((n, 3)), np.ones(n),
            beta=np.full(n, float(beta)),
        )  # fmt: skip
        return is_plain(scene).tolist()

    assert plain([[20, 20], [200, 200], [60, 60], [200, 20]], 64) == [True, False, False, False]
    assert plain([[1, 1], [5, 5], [20, 20]], 2) == [False, False, False]
