"""Changes to the areas that were found in a picture: equal colours, inks, and areas of a film.

Nearly equal colours become one. With Gaussians above them, all colours are solved again: a picture
is a linear function of them, because each pixel is g + sum_k w_k c_k. c_k is a flat colour or that
of a stop of a gradient. w_k is its share of the pixel, times what shows through all that is above.
g is the light of the Gaussians.

In inks, the nearest ink of each pixel would be a third ink along many edges, because antialiased
pixels mix two colours. So the areas of a drawing get their nearest inks, gradients become bands of
inks, and the picture that is drawn so has crisp edges between inks. Areas are then found in that
picture:

    picture -> areas -> picture in inks -> areas in inks

In a film, the areas of each frame are found anew, because things move, turn, appear and hide each
other. An area of the frame before takes the place of the new one that it matches best, if the
picture then has hardly more error. So what does not move has the same numbers in each frame.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator
from itertools import repeat
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.areas.outlines import sampled
from gauss2svg.areas.pixels import Sprite
from gauss2svg.fit.colors import solved_colors
from gauss2svg.photo.pixels import BACKDROPS, views
from gauss2svg.render import render, render_rgba
from gauss2svg.render.areas import coverage_of
from gauss2svg.scene import ABOVE, Scene
from gauss2svg.scene.areas import MOST_STOPS, Area, Color, LinearGradient, Paint, RadialGradient
from gauss2svg.scene.inks import ink_colors
from gauss2svg.without_scipy import nearest_entry

if TYPE_CHECKING:
    from gauss2svg.areas.find import FoundAreas

PRIOR = 0.3  # px of its former colour that count for each colour. So hidden colours stay
# Levels of 255 by which colours of areas may differ that become one. In a picture with noise, it is
# OFF divided by the root of the smaller one's px, within NEARLY_EQUAL (docs/decisions/areas.md).
EQUAL, NEARLY_EQUAL, OFF = 2.0, (3.0, 24.0), 128.0


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
    colors += [] if scene.transparent else [tuple(scene.background.tolist())]
    if not colors:
        return scene
    # Equal flat colours share an entry of the solution.
    keys = list[Any]()
    for k, area in enumerate(reversed(scene.areas)):
        is_flat = isinstance(area.paint, tuple)
        keys += [area.paint] if is_flat else [(k, stop) for stop in range(len(_colors(area)))]
    keys += colors[len(keys) :]
    entries = {key: n for n, key in enumerate(dict.fromkeys(keys))}
    entry = np.array([entries[key] for key in keys])
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
    for top in range(0, height, 128):  # rows whose shares are in memory at once
        band = slice(top, min(top + 128, height))
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


OPAQUE = 0.5  # areas of at least this opacity are drawn, and are opaque


def nearest_inks(colors: Any, inks: str) -> NDArray[np.float64]:
    """Return for each colour (n, 3) the nearest one of the inks "#rrggbb,#rrggbb,..".

    The distance is that of levels of sRGB, as in fits.
    """
    table = ink_colors(inks)
    return table[nearest_entry(table, np.asarray(colors, np.float64))[1]]


def areas_in_inks(areas: Iterable[Area], inks: str) -> tuple[Area, ...]:
    """Return areas of one ink each. Those that are nearly transparent are left out."""

    def ink(paint: Paint) -> Color:
        color = paint if isinstance(paint, tuple) else np.mean(paint.colors, axis=0)
        return _nearest(color, inks)

    return _opaque(areas, ink)


def found_in_inks(found: FoundAreas, inks: str) -> FoundAreas:
    """Return areas and a background that each have the nearest ink."""
    background = None if found.background is None else _nearest(found.background, inks)
    areas = areas_in_inks(found.areas, inks)
    return dataclasses.replace(found, areas=areas, background=background)


def picture_in_inks(found: FoundAreas, inks: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the picture of areas in inks, with a band of each ink in place of gradients.

    It is (h, w, 3), or (h, w, 4) without a background. Only antialiased pixels mix inks.
    """

    def ink(paint: Paint) -> Paint:
        return _nearest(paint, inks) if isinstance(paint, tuple) else _banded(paint, inks)

    scene = Scene(width, height, areas=_opaque(found.areas, ink))
    if found.background is None:
        return render_rgba(scene.replace(transparent=True), width, height).astype(np.float32)
    scene = scene.replace(background=np.array(_nearest(found.background, inks)))
    return render(scene, width, height).astype(np.float32)


def sprite_in_inks(sprite: Sprite, inks: str) -> Sprite:
    """Return a sprite whose cells have their nearest inks, or are transparent."""
    colors = nearest_inks(sprite.levels[:, :3] / 255, inks)
    opaque = np.rint(255 * np.pad(colors, ((0, 0), (0, 1)), constant_values=1)).astype(np.int64)
    levels = np.where(sprite.levels[:, 3:] < 255 * OPAQUE, 0, opaque)
    levels, entry = np.unique(levels, axis=0, return_inverse=True)
    return sprite._replace(cells=entry.ravel()[sprite.cells], levels=levels)


def _opaque(areas: Iterable[Area], ink: Callable[[Paint], Paint]) -> tuple[Area, ...]:
    """Return opaque areas with another paint in place of each paint."""
    return tuple(
        dataclasses.replace(area, paint=ink(area.paint), opacity=1.0)
        for area in areas
        if area.opacity >= OPAQUE
    )


def _nearest(color: Any, inks: str) -> Color:
    red, green, blue = nearest_inks([color], inks)[0].tolist()
    return red, green, blue


def _banded(paint: LinearGradient | RadialGradient, inks: str) -> LinearGradient | RadialGradient:
    """Return a gradient in the nearest ink at each place. Bands meet within about a pixel."""
    is_linear = isinstance(paint, LinearGradient)
    across = np.subtract(paint.end, paint.start) if is_linear else paint.radii
    half = 0.5 / max(portable.hypot(*across), 1.0)
    place = np.linspace(0, 1, 1024)
    ink = nearest_inks(paint.colors_at(place), inks)
    changes = np.flatnonzero((np.diff(ink, axis=0) != 0).any(axis=1))
    changes = changes[:: 1 + len(changes) // (MOST_STOPS // 2 - 1)]  # a band takes two stops
    middle = 0.5 * (place[changes] + place[changes + 1])
    ends = np.stack([middle - half, middle + half], axis=1).ravel()
    offsets = sorted([0.0, *np.clip(ends, 0, 1).tolist(), 1.0])
    colors = [ink[0], *(ink[k + j] for k in changes for j in (0, 1)), ink[-1]]
    return dataclasses.replace(paint, offsets=tuple(offsets), colors=tuple(map(tuple, colors)))


def kept(
    areas: tuple[Area, ...],
    before: tuple[Area, ...],
    error_of: Callable[[tuple[Area, ...]], float],
) -> tuple[Area, ...]:
    """Return areas of which those that have not changed are areas of the frame before.

    error_of  function that returns the squared error of areas
    """
    left, same = list(before), dict[int, Area]()
    for k, area in enumerate(areas):
        alike = [(_distance(one, area), n) for n, one in enumerate(left) if _is_alike(one, area)]
        distance, nearest = min(alike, default=(math.inf, 0))
        if distance <= 1:  # px
            same[k] = left.pop(nearest)
    most = 1.1 * error_of(areas) + 0.15  # such a rise of the squared error is seen nowhere
    # All of them are tried at once, and else one by one.
    for some in (same, *({k: old} for k, old in same.items())):
        tried = tuple(some.get(k, area) for k, area in enumerate(areas))
        if error_of(tried) <= most:
            areas = tried
            if some is same:
                break
    return areas


def _is_alike(one: Area, other: Area) -> bool:
    """Return whether two areas have the same kind, opacity and about the same paint."""
    means = [
        np.atleast_2d(a.paint if isinstance(a.paint, tuple) else a.paint.colors).mean(axis=0)
        for a in (one, other)
    ]
    same_kind = one.is_line == other.is_line and type(one.paint) is type(other.paint)
    return same_kind and bool(np.abs(means[0] - means[1]).max() <= 0.06)


def _distance(one: Area, other: Area) -> float:
    """Return the mean distance in px of points along outlines from the other outlines."""
    from scipy.spatial import KDTree  # few runs need it

    a, b = _points(one), _points(other)
    return float(0.5 * (KDTree(b).query(a)[0].mean() + KDTree(a).query(b)[0].mean()))


def _points(area: Area) -> NDArray[np.float64]:
    """Return points (n, 2) along all outlines of an area, eight for each segment."""
    segments = np.concatenate([outline.segments for outline in area.outlines])
    curved = np.concatenate([outline.curved for outline in area.outlines])
    return sampled(segments, curved, np.full(len(segments), 8))
