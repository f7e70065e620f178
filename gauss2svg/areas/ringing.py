"""Ringing: what Lanczos' and bicubic filters leave beside the edges of a drawing that they reduce.

Beyond an edge, colours overshoot by up to a tenth of its contrast, in bands of a px. What a filter
changes depends on the drawing alone, as with JPEG. So the areas of the picture without such bands
are drawn enlarged, and reduced by each filter. What the likeliest filter changes is taken out of
the picture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy import ndimage

from gauss2svg import portable
from gauss2svg.areas.arrays import LEVEL, Floats
from gauss2svg.areas.clean import LUMA
from gauss2svg.areas.find import channels_of
from gauss2svg.areas.regions import spread_of
from gauss2svg.photo.pixels import from_views
from gauss2svg.render.areas import draw_areas
from gauss2svg.scene.areas import Area, Color

SIDE = 6  # px on both sides of an edge that are looked at
LEFT = 0.03  # share of the contrast that is left of bands when their filter is known
CLIPPED = 9 * LEVEL  # bands of alpha reach so far from 0 and 1, beyond which alpha is clipped


def is_rung(picture: Floats) -> bool:
    """Return whether colours step back beside many edges of a picture, as those of bands do."""
    # Where the page shows, alpha is clipped, so that only the next and fainter band is left.
    is_clear = picture.shape[2] == 4
    return _has_rung_colors(picture) or (is_clear and _steps_back(picture[..., 3], 0.9 * LEVEL))


def _has_rung_colors(picture: Floats) -> bool:
    channels = channels_of(picture)
    # Over white, a band in the colour that alpha multiplies is paler, and no step back.
    views = np.split(channels, channels.shape[2] // 3, axis=2)
    weights = LUMA[0].astype(np.float32)
    return any(_steps_back(portable.product(view, weights), 2.2 * LEVEL) for view in views)


def _steps_back(plane: Floats, least: float) -> bool:
    """Return whether a plane (h, w) steps back by `least` beside many of its edges."""
    edges = rung = 0
    for rows in (plane, plane.T):
        if rows.shape[1] < 2 * SIDE:
            continue
        step = np.diff(rows)[:, SIDE - 1 : 1 - SIDE]
        whole = rows[:, 2 * SIDE - 1 :] - rows[:, : 1 - 2 * SIDE]
        # At an edge, one step has most of the contrast.
        is_edge = (np.abs(whole) > 48 * LEVEL) & (step * np.sign(whole) > 0.4 * np.abs(whole))
        y, x = np.nonzero(is_edge)
        profile = rows[y[:, None], x[:, None] + np.arange(2 * SIDE)]
        contrast, way = np.abs(whole[y, x]), np.sign(whole[y, x])[:, None]
        sides = np.stack([way * profile[:, SIDE:], -way * profile[:, SIDE - 1 :: -1]])
        is_even = (np.abs(sides[..., -1] - sides[..., -2]) <= 0.03 * contrast).all(axis=0)
        fall = -np.diff(sides[..., :4]).min(axis=(0, 2))  # bands are within 4 px
        edges += np.count_nonzero(is_even)
        rung += np.count_nonzero(is_even & (fall > least) & (fall < 0.15 * contrast))
    # It is a share of .33 and more in reduced drawings, and of at most .1 in others
    # (docs/decisions/areas.md).
    return bool(rung >= max(8, 0.25 * edges))


def without_bands(picture: Floats, most: float = 0.12) -> Floats:
    """Return a picture without narrow bands that differ little from what is on both sides.

    most  difference as a share of the contrast nearby
    """
    if picture.shape[2] == 4:
        alpha = picture[..., 3:]
        alpha = np.where(alpha < CLIPPED, 0, np.where(alpha > 1 - CLIPPED, 1, alpha))
        picture = np.concatenate([picture[..., :3], alpha], axis=2)
        if not _has_rung_colors(picture):
            return picture
    values = _with_alpha(channels_of(picture))
    spread = spread_of(values, 7)
    for smooth in (ndimage.grey_opening, ndimage.grey_closing):
        new = smooth(values, (3, 3, 1))
        values = np.where(np.abs(new - values) <= most * spread, new, values)
    return _picture(_channels(values))


def unrung(
    picture: Floats, areas: Sequence[Area], background: Color | None,
    code: Callable[[Floats], Floats] | None = None,
) -> Floats | None:  # fmt: skip
    """Return a picture without what the filter changed that reduced it, or None if none did.

    areas, background  those of the source, as far as they are known
    code  function that changes a drawing as JPEG has changed the picture. None: nothing has
    """
    from PIL import Image  # few pictures need it

    values, changed = channels_of(picture), code or (lambda drawn: drawn)
    (height, width, _) = values.shape
    times = 4 if height * width <= 2**19 else 2
    large = _enlarged(areas, background, height, width, times)
    mean = large.reshape(height, times, width, times, -1).mean(axis=(1, 3))

    def off(drawn: Floats) -> float:  # few pixels of shadows have large errors
        return float(np.abs(drawn - values).sum())

    filters = Image.Resampling.BICUBIC, Image.Resampling.LANCZOS
    unfiltered, *both = map(changed, (mean, *(reduced(large, times, one) for one in filters)))
    drawn = min(both, key=off)
    change = drawn - unfiltered
    explained = (change * (values - unfiltered)).sum() / max(float((change**2).sum()), 1e-9)
    # It is .23 to 1 of the changes, because areas of thin parts may take on over half of them. In a
    # JPEG, whose noise changes by it, a filter leaves .43 to .85 of the error, others .98 or more.
    is_likely = explained > 0.2 and (code is None or off(drawn) < 0.9 * off(unfiltered))
    return _picture(values - drawn + mean) if is_likely else None


def reduced(large: Floats, times: int, resampling: Any) -> Floats:
    """Return a picture (h, w, c) that Pillow reduced to 1 / times of its size, in 8 bits.

    Colours over black and alpha are reduced each by itself, and clipped.
    """
    from PIL import Image

    size = large.shape[1] // times, large.shape[0] // times
    levels = np.round(255 * np.clip(_with_alpha(large), 0, 1)).astype(np.uint8)
    planes = [
        Image.fromarray(plane).resize(size, resampling) for plane in np.moveaxis(levels, 2, 0)
    ]
    return _channels(np.stack([np.asarray(plane, np.float32) for plane in planes], axis=2) / 255)


def _with_alpha(channels: Floats) -> Floats:
    """Return the channels (h, w, 3), or of a picture with alpha those over black and its alpha."""
    if channels.shape[2] == 3:
        return channels
    black, white = channels[..., :3], channels[..., 3:]
    return np.concatenate([black, 1 - (white - black).mean(axis=2, keepdims=True)], axis=2)


def _channels(planes: Floats) -> Floats:
    """Undo `_with_alpha`: return the channels (h, w, 3) or (h, w, 6) of its planes."""
    if planes.shape[2] == 3:
        return planes
    black = planes[..., :3]
    return np.concatenate([black, black + 1 - planes[..., 3:]], axis=2)


def _enlarged(
    areas: Sequence[Area], background: Color | None, height: int, width: int, times: int
) -> Floats:
    """Return the channels (times * height, times * width, c) of enlarged areas."""
    views = []
    for page in [(0.0,) * 3, (1.0,) * 3] if background is None else [background]:
        views.append(np.full((times * height, times * width, 3), page, np.float32))
        draw_areas(areas, views[-1], (times, times))
    return np.concatenate(views, axis=2)


def _picture(channels: Floats) -> Floats:
    """Return the picture (h, w, 3), or (h, w, 4) with straight alpha, that has these channels."""
    channels = np.clip(channels, 0, 1)
    if channels.shape[2] == 3:
        return channels
    return from_views(channels[..., 3:], channels[..., :3])
