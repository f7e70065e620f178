"""The size in px at which a scene is rendered."""

from __future__ import annotations

from gauss2svg.errors import InputError, required, whole_number
from gauss2svg.photo.formats import MOST_PIXELS
from gauss2svg.scene import Scene


def output_size(scene: Scene, width: int | None, height: int | None) -> tuple[int, int]:
    """Width and height; None is that of the canvas, rounded.

    Raises InputError for something else than a scene, and for a size that is under one pixel, not
    whole, or larger than any photo's.
    """
    scene = required(scene, "scene", Scene)
    width = whole_number(
        "output width", round(scene.width) if width is None else width, 1, MOST_PIXELS
    )
    height = whole_number(
        "output height", round(scene.height) if height is None else height, 1, MOST_PIXELS
    )
    if width * height > MOST_PIXELS:
        raise InputError(
            f"output size must be at most {MOST_PIXELS} px; got {width}x{height}. Try to render "
            "it smaller"
        )
    return width, height
