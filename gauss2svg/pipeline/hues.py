"""Palettes that keep the hue of small parts of a picture.

k-means gives the entries of a palette to frequent colours, so the only red thing in a photo would
get the colour of its surroundings. A pixel depends linearly on the colours of its shapes, so what a
palette does to a picture is rendered as a picture is:

    palette -> change of the hue of each shape -> change at each pixel -> its mean over a window
    -> shapes that show where this mean is large -> another entry, or entries of their own -> ..

The hue of a colour is its a and b of CIELAB (docs/decisions/palette.md).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.measure.metrics import WINDOW, box_mean, chroma
from gauss2svg.pipeline.clusters import Clusters, Palette, Rows
from gauss2svg.render.cpu import moments_of_gradient, render_planar, splats_of
from gauss2svg.scene import Scene

# The constants of this module are measured in docs/decisions/palette.md.
LARGEST_CHANGE = 4.0  # largest change of hue by a palette, as a mean over a window
# A shape is blamed for the change at its place if it changes the hue there by at least this share
# of LARGEST_CHANGE.
BLAMED = 0.9
# A blamed shape gets another entry of the palette if the distance of their features is at most
# this. Otherwise it gets a new entry.
NEAR = 0.1
ROUNDS = 12  # largest number of times that entries are added
# In each time, the places are mended whose change is at least this share of the largest one.
WORST = 0.6
# The longest side in px at which the change is rendered. Larger pictures are reduced, and the
# window with them.
LARGEST_SIDE = 512
_PAIRS = 2**18  # number of shapes times entries that are compared at a time, to save memory
_LEAST_SHOWN = 0.1  # px. A shape of which less shows in these places is not blamed
_COLORS = slice(6, 9)  # columns of the moments of a shape's colour (gauss2svg.render.kernels)
_SCALE = 100.0  # hues are divided by this, so that they are about as large as colours


class HueChange:
    """The change of hue that a palette makes in the picture of a scene.

    shaded  (n,) whether a shape gets its colour from the palette
    hues    (m, 2) hues of the m shaded shapes
    """

    def __init__(self, scene: Scene, shaded: NDArray[np.bool_]) -> None:
        longest = max(scene.width, scene.height)
        side = min(longest, LARGEST_SIDE)
        # A picture that is reduced to LARGEST_SIDE was measured at about twice this size.
        self._window = WINDOW if side == longest else WINDOW // 2 + 1
        self._width, self._height = (
            max(1, round(length * side / longest)) for length in (scene.width, scene.height)
        )
        scale = self._width / scene.width, self._height / scene.height
        self._splats, self._shaded = splats_of(scene, scale), np.flatnonzero(shaded)
        self.hues = chroma(scene.color[shaded])

    def of(self, colors: Rows) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the change of hue of each shaded shape (m, 2), and at each pixel (2, h, w).

        The change at a pixel is the mean over a window around it.

        colors  (m, 3) colours of the shaded shapes in a palette
        """
        own = chroma(colors) - self.hues
        shown = np.zeros_like(self._splats.opacity_color)
        shown[:, 0] = self._splats.opacity
        shown[self._shaded, 1:3] = own / _SCALE
        splats = self._splats._replace(opacity_color=shown, background=np.zeros(3))
        planes = render_planar(splats, self._height, self._width)[:2]
        return own, _SCALE * box_mean(planes, self._window)

    def largest(self, colors: Rows) -> float:
        """Return the largest change of hue of any place by these colours of the shaded shapes."""
        return float(portable.hypot(*self.of(colors)[1]).max())

    def seen(self, planes: NDArray[np.floating]) -> Rows:
        """Return the sums (m, 3) of three planes, weighted by what each shaded shape shows."""
        planes = np.ascontiguousarray(planes, np.float32)
        return moments_of_gradient(self._splats, planes)[self._shaded, _COLORS]


def keep_hues(
    change: HueChange,
    features: Rows,
    palette: Palette,
    count: int,
    rounded: Callable[[Rows], Rows],
) -> Palette:
    """Return the palette with other and more entries, so that no place changes its hue visibly.

    features  (m, 4) features of the shaded shapes, of which the first three are the colour
    palette   palette to begin with
    count     largest number of entries. If it is reached, the hue of some places still changes
    rounded   function that rounds features to values that a file can contain
    """
    entries, entry = palette[0], palette[1].copy()
    for _ in range(ROUNDS):
        own, local = change.of(entries[entry, :3])
        size = portable.hypot(*local)
        hot = size > max(LARGEST_CHANGE, WORST * float(size.max()))
        if not hot.any() or len(entries) >= count:
            break
        direction = np.where(hot, local / np.maximum(size, 1e-9), 0)
        *along, shown = change.seen(np.stack([*direction, hot])).T
        is_blamed = (own * np.stack(along, axis=1)).sum(axis=1) > BLAMED * LARGEST_CHANGE * shown
        blamed = np.flatnonzero(is_blamed & (shown > _LEAST_SHOWN))
        if not len(blamed):
            break
        near = _near(features[blamed], change.hues[blamed], entries)
        entry[blamed[near >= 0]] = near[near >= 0]
        rest = blamed[near < 0]
        groups = _groups(features[rest], change.hues[rest], shown[rest])[: count - len(entries)]
        for group in groups:
            members = rest[group]
            mean = np.average(features[members], axis=0, weights=shown[members])
            entry[members] = len(entries)
            entries = np.vstack([entries, rounded(mean[None])])
    used, entry = np.unique(entry, return_inverse=True)
    return entries[used], entry.reshape(-1)


def _near(features: Rows, hues: NDArray[np.floating], entries: Rows) -> NDArray[np.intp]:
    """Return the nearest entry of each shape that has its hue, or -1 if it is not within NEAR."""
    near, own = np.empty(len(features), np.intp), chroma(entries[:, :3])
    band = max(1, _PAIRS // len(entries))
    for first in range(0, len(features), band):
        part = slice(first, first + band)
        apart = np.sqrt(np.square(features[part, None] - entries).sum(axis=2))
        turns = np.square(hues[part, None] - own).sum(axis=2)
        apart[turns > LARGEST_CHANGE**2] = np.inf
        near[part] = np.where(apart.min(axis=1) < NEAR, apart.argmin(axis=1), -1)
    return near


def _groups(features: Rows, hues: NDArray[np.floating], weight: Rows) -> list[NDArray[np.intp]]:
    """Split shapes into groups, the hues of each within LARGEST_CHANGE of their mean.

    Return the indices of the shapes of each group.
    """
    wide, groups = [np.arange(len(features))], []
    both = np.column_stack([features, hues / _SCALE]).astype(np.float64)
    while wide:
        group = wide.pop()
        if not len(group):
            continue
        apart = hues[group] - hues[group].mean(axis=0)
        clusters = Clusters(both[group], weight[group])
        if portable.hypot(*apart.T).max() > LARGEST_CHANGE:
            clusters.split(2, 0.0)
        parts = [group[members] for members in clusters.members]
        (wide if len(parts) > 1 else groups).extend(parts)
    return groups
