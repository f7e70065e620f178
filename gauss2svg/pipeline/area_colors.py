"""Colours of areas: nearly equal ones made one, and all solved again with Gaussians above them.

A picture is a linear function of these colours: each pixel is g + sum_k w_k c_k. c_k is a flat
colour or that of a stop of a gradient. w_k is its share of the pixel, times what shows through all
that is above. g is the light of the Gaussians.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from itertools import repeat
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.fit.colors import solved_colors
from gauss2svg.photo.pixels import BACKDROPS, views
from gauss2svg.render import render
from gauss2svg.render.areas import coverage_of
from gauss2svg.scene import ABOVE, Area, Scene

if TYPE_CHECKING:
    from gauss2svg.areas.find import FoundAreas

PRIOR = 0.3  # px of its former colour that count for each colour. So hidden colours stay
# Levels of 255 by which colours of areas may differ that become one. In a picture with noise, it is
# OFF divided by the root of the smaller one's px, within NEARLY_EQUAL (docs/decisions/areas.md).
EQUAL, NEARLY_EQUAL, OFF = 2.0, (3.0, 24.0), 128.0
ROWS = 128  # rows of a picture whose shares are in memory at once


def with_shared_colors(found: FoundAreas, is_noisy: bool) -> FoundAreas:
    """Return areas whose nearly equal flat colours are one, that of the larger areas.

    is_noisy  whether noise or JPEG has moved the colours of small areas
    """
    sizes: dict[Any, float] = {} if found.background is None else {found.background: math.inf}
    for area in found.areas:
        if isinstance(area.paint, tuple):
            sizes[area.paint] = sizes.get(area.paint, 0.0) + _size(area)
    shared: dict[Any, Any] = {}
    kept = np.zeros((0, 3))
    for color in sorted(sizes, key=lambda color: -sizes[color]):
        most = float(np.clip(OFF / math.sqrt(max(sizes[color], 1.0)), *NEARLY_EQUAL))
        difference = 255 * np.abs(kept - color).max(axis=1)
        if len(kept) and difference.min() <= (most if is_noisy else EQUAL):
            shared[color] = tuple(kept[difference.argmin()].tolist())
        else:
            shared[color], kept = color, np.vstack([kept, color])
    areas = tuple(
        dataclasses.replace(area, paint=shared.get(area.paint, area.paint)) for area in found.areas
    )
    return dataclasses.replace(found, areas=areas)


def _size(area: Area) -> float:
    """Return about how many px an area has, or a line."""
    total = 0.0
    for outline in area.outlines:
        x, y = outline.nodes.T
        if area.is_line:
            total += area.width * float(portable.hypot(np.diff(x), np.diff(y)).sum())
        else:
            total += 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
    return abs(total)


def with_solved_colors(scene: Scene, picture: NDArray[np.float32]) -> Scene:
    """Return the scene with colours of areas and background that draw a picture best.

    All of these colours are rounded to 8 bits. Flat colours that are equal stay so.

    picture  (h, w, 3) or (h, w, 4) float32 in 0..1
    """
    height, width = picture.shape[:2]
    colors = [color for area in reversed(scene.areas) for color in _colors(area)]
    colors += [] if scene.transparent else [tuple(scene.background)]
    if not colors:
        return scene
    entry = _entries(scene)
    level = np.where(scene.level == ABOVE, len(scene.areas), scene.level)
    lets_through = {k: _transmittance(scene.select(level == k), height, width) for k in set(level)}
    black = scene.replace(
        background=np.zeros(3), areas=[_painted(a, repeat((0.0, 0.0, 0.0))) for a in scene.areas]
    )
    missing = []
    for view, b in zip(views(picture), BACKDROPS, strict=False):
        backdrop = b if scene.transparent else 0.0
        missing.append(view - render(black.replace(background=np.full(3, backdrop)), width, height))
    products, sums = PRIOR * np.eye(len(colors)), PRIOR * np.array(colors)
    for top in range(0, height, ROWS):
        band = slice(top, min(top + ROWS, height))
        through = {k: seen[band] for k, seen in lets_through.items()}
        shares = _shares(scene, through, band, height, width)
        products += len(missing) * (shares @ shares.T).toarray()
        sums += shares @ np.sum([view[band] for view in missing], axis=0).reshape(-1, 3)
    together = np.eye(entry.max() + 1)[:, entry]
    products = portable.product(portable.product(together, products), together.T)
    solution = solved_colors(products, portable.product(together, sums), 255)
    solved = iter(map(tuple, solution[entry].tolist()))
    areas = [_painted(area, solved) for area in reversed(scene.areas)]
    background = scene.background if scene.transparent else next(solved)
    return scene.replace(areas=areas[::-1], background=background)


def _shares(
    scene: Scene,
    lets_through: dict[int, NDArray[np.floating]],
    band: slice,
    height: int,
    width: int,
) -> Any:
    """Return the share (colors, pixels) that each colour has in the pixels of some rows.

    The colours are those of the areas, from the top area down, and of the background.

    lets_through  for some numbers of areas, the share of the light from below that the Gaussians
                  above so many areas let through
    band          rows of a picture of height x width pixels
    """
    from scipy.sparse import csr_array, vstack  # few runs need it

    scale, rows = (width / scene.width, height / scene.height), band.stop - band.start
    across = (np.arange(width, dtype=np.float64) + 0.5) / scale[0]
    down = (np.arange(band.start, band.stop, dtype=np.float64) + 0.5) / scale[1]
    through, shares = np.ones((rows, width)), []
    for k in range(len(scene.areas), -1, -1):  # the top area comes first
        through *= lets_through.get(k, 1.0)
        if k == 0:
            break
        area = scene.areas[k - 1]
        alpha = area.opacity * coverage_of(area, 0, band.start, width, rows, scale)
        seen, stops = alpha * through, _stops(area, across, down)
        shares += [csr_array((seen * stop).reshape(1, -1)) for stop in stops]
        through *= 1 - alpha
    if not scene.transparent:
        shares.append(csr_array(through.reshape(1, -1)))
    return vstack(shares).tocsr()


def _transmittance(scene: Scene, height: int, width: int) -> NDArray[np.floating]:
    """Return the share (height, width) of the light from below that Gaussians let through."""
    shapes = scene.replace(color=np.zeros_like(scene.color), background=np.ones(3))
    alone = shapes.replace(areas=(), level=np.full_like(scene.level, ABOVE))
    return render(alone, width, height)[..., 0]


def _entries(scene: Scene) -> NDArray[np.intp]:
    """Return for each colour that `with_solved_colors` solves the index of the one it shares."""
    keys: dict[Any, int] = {}
    flat = [area.paint if isinstance(area.paint, tuple) else None for area in scene.areas[::-1]]
    flat += [] if scene.transparent else [tuple(scene.background.tolist())]
    names = list[Any]()
    for k, paint in enumerate(flat):
        stops = 1 if paint else len(_colors(scene.areas[-1 - k]))
        names += [paint] if paint else [(k, stop) for stop in range(stops)]
    return np.array([keys.setdefault(name, len(keys)) for name in names])


def _colors(area: Area) -> tuple[Any, ...]:
    """Return the colours of an area's paint."""
    return (area.paint,) if isinstance(area.paint, tuple) else area.paint.colors


def _stops(area: Area, across: NDArray[np.float64], down: NDArray[np.float64]) -> list[Any]:
    """Return the share that each colour of an area's paint has in the pixels of a picture."""
    if isinstance(area.paint, tuple):
        return [1.0]
    ramps = np.eye(len(area.paint.colors))[:, :, None].repeat(3, axis=2)
    paints = [dataclasses.replace(area.paint, colors=ramp) for ramp in ramps]
    return [paint.at(across, down[:, None])[..., 0] for paint in paints]


def _painted(area: Area, colors: Iterator[Any]) -> Area:
    """Return an area with the next colours."""
    if isinstance(area.paint, tuple):
        return dataclasses.replace(area, paint=next(colors))
    stops = tuple(next(colors) for _ in area.paint.colors)
    return dataclasses.replace(area, paint=dataclasses.replace(area.paint, colors=stops))
