"""Scenes in inks: their shapes grouped by ink, and the plate of each ink for printing.

Yellow ellipses, blue ones over them and yellow ones over those are three groups of two inks. The
plate of the yellow has the first group in black, the blue ones in white, the last group in black.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import quoted, refusal
from gauss2svg.scene import Scene
from gauss2svg.svg.element import hex_color
from gauss2svg.svg.minimal_shapes import color_levels, colors_together, overlaps
from gauss2svg.svg.plain_ellipse import plain_radius

_MARGIN = 1.0  # least distance in px of ellipses that count as apart: edges are antialiased


def inks_of_scene(scene: Scene) -> NDArray[np.float64]:
    """Return Scene.inks. Raise InputError if the scene has none."""
    if scene.inks is None:
        raise refusal("the scene", "of opaque plain ellipses alone", "others", "a fit with inks")
    return scene.inks


def ink_name(ink: NDArray[np.float64]) -> str:
    """Return an ink (3,) as #rrggbb."""
    return hex_color(color_levels(ink, 6), short=False)


def grouped_by_ink(scene: Scene) -> Scene:
    """Return the scene with its shapes grouped by ink, as far as it still looks the same.

    Each run of one ink becomes a round. Raise InputError for a scene that is not in inks.
    """
    inks_of_scene(scene)
    mean, factor = _ellipses(scene)
    keys = np.stack([mean[:, 0], mean[:, 1], scene.beta])
    order = colors_together(mean, factor, color_levels(scene.color, 6), keys, _MARGIN)
    scene = scene.replace(round_index=np.zeros(len(scene), np.int32)).select(order)
    changes = (np.diff(color_levels(scene.color, 6), axis=0) != 0).any(axis=1)
    index = np.concatenate([[0], np.cumsum(changes)])[: len(scene)]
    return scene.replace(round_index=index)


def plate_of(scene: Scene, ink: str) -> Scene:
    """Return the plate of an ink #rrggbb: black where the ink is visible, and white elsewhere.

    Shapes of other inks are white where they cover shapes of this ink. Shapes that change nothing
    are left out. Raise InputError for an ink that the scene does not have.
    """
    names = [ink_name(one) for one in inks_of_scene(scene)]
    if ink not in names:
        raise refusal("ink", f"one of {', '.join(names)}", quoted(ink))
    wanted = np.array(list(bytes.fromhex(ink[1:])))
    printed = (color_levels(scene.color, 6) == wanted).all(axis=1)
    ground = not scene.transparent and bool((color_levels(scene.background, 6) == wanted).all())
    shows = printed != ground
    # Shapes in the colour of the plate's background are needed where they cover other shapes.
    below = overlaps(*_ellipses(scene), shows, _MARGIN)[shows]
    shows |= np.unpackbits(np.bitwise_or.reduce(below), count=len(scene)).astype(bool)
    black = np.where(printed, 0.0, 1.0)[:, None]
    plate = scene.replace(
        color=np.broadcast_to(black, (len(scene), 3)),
        background=np.zeros(3) if ground else np.ones(3),
        transparent=False,
    )
    return plate.select(shows)


def _ellipses(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the centres (n, 2) and factors (n, 3) of the ellipses that are drawn, in px."""
    factor = scene.factor * plain_radius(scene.beta)[:, None, None]
    return scene.mean, np.stack([factor[:, 0, 0], factor[:, 1, 0], factor[:, 1, 1]], axis=1)
