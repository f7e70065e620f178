"""Renderers of scenes: the fast CPU renderer, the reference in PyTorch, and small JPEGs."""

from __future__ import annotations

import dataclasses
import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.errors import InputError, refusal, required
from gauss2svg.options import Field
from gauss2svg.photo import MOST_PIXELS
from gauss2svg.photo.pixels import straight
from gauss2svg.render.cpu import Real, render_planar, splats_of
from gauss2svg.scene import ABOVE, ADD, Scene


class TorchMissingError(InputError, ImportError):
    """PyTorch, which only the differentiable renderer needs, is not installed."""


def render(
    scene: Scene,
    width: int | None = None,
    height: int | None = None,
    dtype: type[Real] = np.float32,
) -> NDArray[Real]:
    """Return the image (height, width, 3) in 0..1 of a scene, by default at the size of its canvas.

    dtype  np.float32 or np.float64. In float32 most values are within 3e-5 of the model's formula.
           In float64, which takes twice the time, most are within 1e-12. The largest known errors
           are 1.5e-4 in float32, where 10 000 equal shapes overlap, and 2.2e-11 in float64, for
           very thin shapes

    The scene is scaled to the size of the image and sampled at pixel centres. A transparent scene
    is rendered over its background, which is white by default. Areas, lines and plain ellipses
    (scene.drawn) have no falloff. They cover pixels by shares, as SVG renderers draw them. A
    Gaussian lies above the number of areas that scene.level says. Raise InputError if `scene` is no
    Scene, if the dtype is another one, if a side is not a whole number of at least 1 px, or if the
    image has more pixels than any photo.
    """
    width, height = output_size(scene, width, height)
    scale = (width / scene.width, height / scene.height)
    if not scene.areas:
        splats = splats_of(scene, scale)
    else:
        from gauss2svg.render.areas import ground_of  # few scenes need its kernels

        splats = splats_of(scene.select(scene.level == ABOVE), scale)
        splats = splats._replace(ground=ground_of(scene, height, width, dtype))
    planar = render_planar(splats, height, width, dtype)
    if scene.blend == ADD:
        planar = np.clip(planar, 0, 1)
    return np.ascontiguousarray(np.moveaxis(planar, 0, -1))


def render_rgba(
    scene: Scene,
    width: int | None = None,
    height: int | None = None,
    dtype: type[Real] = np.float32,
) -> NDArray[np.float32]:
    """Return the colour and straight alpha (height, width, 4) in 0..1 of a scene.

    With the weights w_k of gauss2svg.render.reference, alpha is A = sum w_k, and A = 1 if the scene
    is not transparent. Areas have such weights too. The colour is sum w_k c_k / A, or black where A
    is 0. Arguments and errors are those of `render`.
    """
    if not required(scene, "scene", Scene).transparent:
        color = np.clip(render(scene, width, height, dtype), 0, 1)
        return np.dstack([color, np.ones(color.shape[:2])]).astype(np.float32)
    on_black = scene.replace(background=np.zeros(3))
    color = render(on_black, width, height, dtype)
    white_areas = tuple(dataclasses.replace(area, paint=(1.0, 1.0, 1.0)) for area in scene.areas)
    white = on_black.replace(color=np.ones((len(scene), 3)), areas=white_areas)
    covered = render(white, width, height, dtype)
    return straight(color, covered[:, :, 0])


def output_size(scene: Scene, width: int | None, height: int | None) -> tuple[int, int]:
    """Return the width and height of a render in px.

    A width or height of None stands for that of the canvas, rounded. Raise InputError if `scene` is
    not a Scene, if a side is not a whole number of at least 1 px, or if the render has more pixels
    than a photo may have.
    """
    scene = required(scene, "scene", Scene)
    sizes = {
        "output width": round(scene.width) if width is None else width,
        "output height": round(scene.height) if height is None else height,
    }
    across, down = (side_of(name, px) for name, px in sizes.items())
    if across * down > MOST_PIXELS:
        needed, advice = f"at most {MOST_PIXELS} px", "to render it smaller"
        raise refusal("output size", needed, f"{across}x{down}", advice)
    return across, down


def side_of(name: str, px: int) -> int:
    """Return a side of a render in px. Raise InputError if it is not an integer of at least 1."""
    return Field(name, int, 1, MOST_PIXELS).checked(px)


MOST_SIDE = 768  # the longer side of a frame is at most this number of px


def as_jpeg(scene: Scene, most_side: int = MOST_SIDE) -> bytes:
    """Return a JPEG of a scene over its background.

    The JPEG has the size of the canvas, but its longer side is at most most_side px.
    """
    share = min(1.0, most_side / max(scene.width, scene.height))
    width, height = (max(1, round(side * share)) for side in (scene.width, scene.height))
    levels = np.clip(render(scene, width, height) * 255 + 0.5, 0, 255).astype(np.uint8)
    stream = io.BytesIO()
    Image.fromarray(levels).save(stream, "JPEG", quality=80)
    return stream.getvalue()
