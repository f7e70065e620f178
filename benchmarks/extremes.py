"""Scenes at the limits of what a scene may hold: accuracy of renderers, gradients and files.

    python benchmarks/extremes.py

The script prints a Markdown table with a row for each case:

    float32    largest difference, in 0..1, of the fast renderer's picture from the torch reference
               in float64; in brackets that of the torch reference in float32
    float64    the same for the fast renderer in float64
    gradient   largest relative difference of gradients from the reference's by autograd in
               float64: the fast renderer in float32, in float64, and the torch reference in
               float32. They are taken along the natural coordinates of each shape (natural), and
               relative to the largest of their kind, or to a thousandth of the largest of all
    file       the SVG rasterised by resvg against the model: PSNR in dB and largest error in levels
               of 255, or "refused" where it cannot be written

tests/whole/test_extremes.py asserts the bounds of each case, which are in the table as well. The
reference needs pip install "gauss2svg[torch]".
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from common import head, line
from numpy.typing import NDArray
from reference_render import below_one, render_reference

from gauss2svg import Scene, SceneError, SvgFormat, quantize, write_svg
from gauss2svg.measure import metrics
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.render.autograd import fast_composite
from gauss2svg.render.reference import composite
from gauss2svg.scene import ADD, RHO_LIMIT, narrowing_of

WIDTH, HEIGHT = 40, 36  # px: two and a half tiles by two and a quarter
_MIDDLE = (20.3, 17.6)
_EXACT = SvgFormat(stops=12, opacity_decimals=6)
_NAMES = ("mean", "sigma", "rho", "color", "opacity", "background", "beta")
_FLOOR = 1e-3  # of the largest gradient of all: smaller kinds are compared with this
_TINY = 1e-300  # where all gradients are 0
_SEED = 7

# Reasons for the larger bounds.
_ROUNDED = "reference: parameters in float32"
_SAMPLED = "file: coverage, not samples"
_BOTH = _ROUNDED + "; " + _SAMPLED
_THIN = "file: whole units"
_CUT = "gradient: an early cut"
_ROUNDS = "float32: as many roundings"
_LAYERS = "file: 8-bit layers"
_BLACK = "file: less than a level"
_EDGE = "file: antialiased"

Gradients = dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Case:
    """A scene at a limit of the domain, and the bounds of the errors.

    single, double  in 0..1: pictures of the fast renderer in float32 and float64
    plain           the same for the torch reference in float32
    gradient, double_gradient  relative, for the fast renderer in float32 and float64
    plain_gradient  relative, for the reference in float32
    levels          of 255, for the SVG by resvg; None where writing is refused
    reason          for a bound above the usual one
    """

    name: str
    scene: Scene
    single: float = 3e-5
    double: float = 1e-11
    plain: float = 1e-4
    gradient: float = 1e-3
    double_gradient: float = 1e-6
    plain_gradient: float = 1e-3
    levels: float | None = 4.0
    reason: str = ""


def scene_of(mean: Any, sigma: Any, rho: Any = 0.0, **more: Any) -> Scene:
    """Return a scene of these shapes; every parameter that is not given has a fixed value."""
    mean = np.atleast_2d(np.asarray(mean, np.float64))
    count = len(mean)
    color = np.random.default_rng(_SEED).uniform(0, 1, (count, 3))
    values: dict[str, Any] = {"color": color, "opacity": 0.8, "background": [0.9, 0.5, 0.2]}
    values |= more
    size = values.pop("size", (WIDTH, HEIGHT))
    if values.get("blend") == ADD:
        values["opacity"] = 1.0
    for name, shape in (("opacity", (count,)), ("beta", (count,)), ("color", (count, 3))):
        if name in values:
            values[name] = np.broadcast_to(values[name], shape)
    sigma, rho = np.broadcast_to(sigma, (count, 2)), np.broadcast_to(rho, (count,))
    return Scene(*size, mean=mean, sigma=sigma, rho=rho, **values)


def _corners() -> NDArray[np.float64]:
    """Means on pixel centres, pixel corners, and edges and corners of tiles."""
    centres, corners = [[0.5, 0.5], [15.5, 16.5], [39.5, 35.5]], [[0, 0], [17, 3], [40, 36]]
    return np.array([*centres, *corners, [16, 16], [32, 7.3], [5.2, 32], [16, 16.5]])


def _needle(**more: Any) -> Scene:
    """Return a needle across four tiles, 0.9 of its widths off a diagonal of pixel centres."""
    sigma, rho = 4.0, 1 - 1e-12
    width = sigma * float(narrowing_of(np.array([rho]))[0])
    return scene_of((20.3, 17.3 + 0.9 * width), sigma, rho, **more)


def cases() -> Iterator[Case]:
    """All cases, "over" before "add"."""
    centre, crowd = (20.5, 17.5), np.random.default_rng(_SEED).uniform(0, 1, (10_000, 2))
    rounded = {"plain": 1.0, "plain_gradient": math.inf}
    layers = {"levels": 130.0}
    # A file cannot show what is far thinner than a pixel: its error there is the contrast of the
    # shape to what is below. Bounds are 1.5 times the measured errors.

    yield Case("no Gaussians", scene_of(np.zeros((0, 2)), 1.0))
    yield Case("sigma 1e-6, on a pixel centre", scene_of(centre, 1e-6), levels=176, reason=_SAMPLED)
    beside = scene_of((20.500001, 17.5), 1e-6)
    yield Case("sigma 1e-6, 1e-6 beside a centre", beside, **rounded, levels=106, reason=_BOTH)
    sheared = scene_of((20.5000005, 17.5000006), 1e-6, 0.9)
    yield Case("sigma 1e-6, sheared", sheared, **rounded, levels=146, reason=_BOTH)
    yield Case("sigma 1e6", scene_of(_MIDDLE, 1e6))
    yield Case("sigma 1e6, 2e6 off", scene_of((-2e6, 17.6), 1e6), levels=None)
    yield Case(
        "sigma 1e6, its cut on the canvas", scene_of((3e6 + 20, 17.6), 1e6),
        gradient=2.0, levels=None, reason=_CUT,
    )  # fmt: skip
    yield Case("sigma 1e9, mean at 1e9", scene_of((1e9, -1e9), 1e9), levels=None)
    yield Case("mean at 1e9, sigma 1e6", scene_of((1e9, -1e9), 1e6), levels=None)
    for name, mean, sigma in (
        ("flat", (20.3, 17.5003), (1e3, 1e-3)), ("upright", (20.4997, 17.6), (1e-3, 1e3)),
    ):  # fmt: skip
        thin = scene_of(mean, sigma)
        yield Case(f"aspect 1e6, {name}", thin, **rounded, levels=169, reason=_BOTH)
    yield Case(
        "aspect 1e12, on a row", scene_of((20.3, 17.5), (1e6, 1e-6)), levels=176, reason=_SAMPLED
    )
    for name, sigma, rho in (
        ("aspect 1e4, rotated", 1e3, 1 - 2e-8), ("aspect 1e4, steep", (1e2, 1e3), 1 - 2e-6),
        ("aspect 1e6, rotated", 1e5, 1 - 2e-12),
    ):  # fmt: skip
        rotated = scene_of(_MIDDLE, sigma, rho)
        yield Case(name, rotated, **rounded, levels=40.0, reason=_ROUNDED + "; " + _THIN)
    needles = {**rounded, "double": 1e-10, "reason": _BOTH}
    for name, levels, more in (("", 117.0, {}), (", exponent 2", 143.0, {"beta": 2.0})):
        needle = _needle(**more)
        yield Case("needle, 0.9 widths beside centres" + name, needle, **needles, levels=levels)
    for sign, name in ((1, "rho at its limit"), (-1, "rho at its other limit")):
        yield Case(
            name + ", sigma 12, on centres", scene_of(centre, 12.0, sign * RHO_LIMIT),
            levels=176, reason=_SAMPLED,
        )  # fmt: skip
    for sigma in (1e7, 1e8):
        at_limit = scene_of(_MIDDLE, sigma, RHO_LIMIT)
        name = f"rho at its limit, sigma {sigma:.0e}".replace("+0", "")
        yield Case(name, at_limit, **rounded, levels=None, reason=_ROUNDED)
    for opacity in (0.0, 1e-7, 1 - 1e-7, 1.0):
        yield Case(f"opacity {opacity:.7g}", scene_of(_corners(), 6.0, 0.5, opacity=opacity))
    yield Case("on centres, corners, tile edges", scene_of(_corners(), 2.0, 0.3))
    yield Case("exponent 0.5", scene_of(_corners(), 3.0, 0.3, beta=0.5))
    crisp = scene_of(_corners(), 3.0, 0.3, beta=256)
    yield Case("exponent 256", crisp, levels=104.0, reason=_EDGE)
    yield Case("exponent 256, sigma 1e6, on its rim", scene_of((1.4142135e6, 17.6), 1e6, beta=256))
    crisp = scene_of(_MIDDLE, 1e4, 1 - 2e-8, beta=256)
    yield Case(
        "exponent 256, aspect 1e4, rotated", crisp, **rounded, levels=60.0,
        reason=_ROUNDED + "; " + _EDGE,
    )  # fmt: skip
    small, heap = {"size": (12, 9)}, np.full((10_000, 2), 5.2)
    yield Case("more Gaussians than pixels", scene_of(crowd[:300] * (12, 9), 2.0, **small))
    yield Case(
        "10 000 in one pixel", scene_of(crowd + 5, 0.4, opacity=0.01, **small),
        gradient=0.1, **layers, reason=_CUT + "; " + _LAYERS,
    )  # fmt: skip
    yield Case(
        "10 000 identical", scene_of(heap, 2.0, 0.5, opacity=1e-3, **small),
        single=1e-3, **layers, reason=_ROUNDS + "; " + _LAYERS,
    )  # fmt: skip
    yield Case("1000 identical, opaque", scene_of(heap[:1000], 4.0, opacity=1.0, **small))

    faint, strong = {"blend": ADD, "color": 1e-4}, {"blend": ADD, "color": [[100.0], [-100.0]]}
    thin = scene_of((20.500001, 17.5), 1e-6, blend=ADD)
    yield Case("additive: sigma 1e-6", thin, **rounded, levels=192, reason=_BOTH)
    far = scene_of((-2e6, 17.6), 1e6, blend=ADD)
    yield Case("additive: sigma 1e6", far, levels=None)
    yield Case("additive: needle, 0.9 widths beside centres", _needle(blend=ADD), **needles,
               levels=197)  # fmt: skip
    rotated = scene_of(_MIDDLE, 1e5, 1 - 2e-12, blend=ADD)
    yield Case("additive: aspect 1e6, rotated", rotated, **rounded, levels=40.0,
               reason=_ROUNDED + "; " + _THIN)  # fmt: skip
    at_limit = scene_of(_MIDDLE, 1e8, RHO_LIMIT, blend=ADD)
    yield Case("additive: rho at its limit, sigma 1e8", at_limit, **rounded, levels=None,
               reason=_ROUNDED)  # fmt: skip
    # No bound of the file: each colour is less than the one level that a renderer can add.
    yield Case("additive: 10 000 identical", scene_of(heap, 4.0, 0.5, **faint, **small),
               single=1e-3, plain=1e-3, levels=255.0, reason=_ROUNDS + "; " + _BLACK)  # fmt: skip
    yield Case("additive: colours of 100 that cancel", scene_of([_MIDDLE, _MIDDLE], 5.0, **strong))


def picture_differences(scene: Scene) -> tuple[float, float, float]:
    """Largest differences from the reference: fast float32, fast float64, reference float32."""
    exact = render_reference(scene).numpy()
    plain = render_reference(scene, dtype=torch.float32).numpy()
    pictures = (render(scene), render(scene, dtype=np.float64), plain)
    single, double, plain = (float(np.abs(one - exact).max()) for one in pictures)
    return single, double, plain


def gradients(scene: Scene, fast: bool, dtype: torch.dtype) -> Gradients:
    """Gradients of a random linear loss along the natural coordinates of each shape.

    The fast renderer takes the scene's own parameters in both precisions; the reference takes them
    rounded to its dtype.
    """
    width, height = round(scene.width), round(scene.height)
    weight = np.random.default_rng(_SEED).normal(size=(height, width, 3))
    names = [n for n in _NAMES if scene.blend != ADD or n not in ("opacity", "beta")]
    tensors = {
        name: torch.tensor(getattr(scene, name), dtype=torch.float64 if fast else dtype)
        for name in names
    }
    if fast:  # it computes in float32 if any tensor has that type
        tensors["background"] = tensors["background"].to(dtype)
    else:
        tensors["rho"] = tensors["rho"].clamp(-below_one(dtype), below_one(dtype))
    for tensor in tensors.values():
        tensor.requires_grad_()
    values: dict[str, Any] = {"opacity": None, **tensors}
    image = (fast_composite if fast else composite)(height=height, width=width, **values)
    loss = (image.double() * torch.tensor(weight)).sum()
    found = torch.autograd.grad(
        loss, list(tensors.values()), allow_unused=True, materialize_grads=True
    )
    return natural(scene, {n: g.double().numpy() for n, g in zip(tensors, found, strict=True)})


def natural(scene: Scene, by: Gradients) -> Gradients:
    """Gradients along unit steps in which every shape moves or grows by its own width.

    A step of the mean is a column of the factor, one sigma. A step of ln sigma is sqrt(1 - rho^2),
    which at fixed rho turns a thin shape by its width. The others are of artanh rho and ln beta.
    """
    narrowing = narrowing_of(scene.rho)
    changed = {
        "mean": (by["mean"][:, None, :] @ scene.factor)[:, 0, :],
        "sigma": by["sigma"] * scene.sigma * narrowing[:, None],
        "rho": by["rho"] * narrowing * narrowing,
    }
    if "beta" in by:
        changed["beta"] = by["beta"] * scene.beta
    return by | changed


def gradient_difference(found: Gradients, exact: Gradients) -> tuple[float, str]:
    """Return the largest relative difference, infinite if not finite, and its parameter."""
    largest = {n: np.abs(g).max(initial=0.0) for n, g in exact.items()}
    floor = _FLOOR * max(largest.values())
    off = {
        n: np.abs(found[n] - exact[n]).max(initial=0.0) / max(largest[n], floor, _TINY)
        for n in exact
    }
    worst = max(off, key=lambda n: np.nan_to_num(off[n], nan=np.inf))
    return float(np.nan_to_num(off[worst], nan=np.inf)), worst


def drawn_file(scene: Scene) -> tuple[float, float] | SceneError:
    """PSNR in dB and largest error in levels of 255 of the SVG, by resvg, against the model.

    The model is the quantised scene. Returns the error where the scene cannot be written.
    """
    try:
        svg = write_svg(scene, _EXACT)
    except SceneError as error:
        return error
    width, height = round(scene.width), round(scene.height)
    raster, model = rasterize(svg, width, height), np.clip(render(quantize(scene)), 0, 1)
    return metrics.psnr(raster, model), metrics.largest_error(raster, model)


def row(case: Case) -> list[str]:
    """Return the cells of a case."""
    single, double, plain = picture_differences(case.scene)
    exact = gradients(case.scene, False, torch.float64)
    kinds = ((True, torch.float32), (True, torch.float64), (False, torch.float32))
    off = [gradient_difference(gradients(case.scene, *kind), exact)[0] for kind in kinds]
    file = drawn_file(case.scene)
    shown = "refused" if isinstance(file, SceneError) else f"{file[0]:.1f} dB, {file[1]:.1f}"
    levels = "refused" if case.levels is None else f"{case.levels:g}"
    return [
        case.name, f"{single:.1e} ({plain:.1e})", f"{double:.1e}",
        f"{off[0]:.1e}, {off[1]:.1e} ({off[2]:.1e})", shown,
        f"{case.single:g}, {case.double:g}, {case.gradient:g}, {levels}", case.reason,
    ]  # fmt: skip


if __name__ == "__main__":
    print(head(["case", "float32", "float64", "gradient", "file", "bounds", "reason"]))
    for case in cases():
        print(line(row(case)), flush=True)
