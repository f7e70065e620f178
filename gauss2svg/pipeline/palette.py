"""Quantisation of a scene's colours and exponents to a palette, by weighted k-means.

The file has one gradient for each entry of the palette, so fewer entries make a smaller file.

k-means gives the entries of a palette to frequent colours, so the only red thing in a photo would
get the colour of its surroundings. A pixel depends linearly on the colours of its shapes, so what a
palette does to a picture is rendered as a picture is:

    palette -> change of the hue of each shape -> change at each pixel -> its mean over a window
    -> shapes that show where this mean is large -> another entry, or entries of their own -> ..

The hue of a colour is its a and b of CIELAB. docs/decisions/palette.md explains the constants.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.errors import quoted, refusal, required
from gauss2svg.measure.metrics import WINDOW, box_mean, chroma
from gauss2svg.render.cpu import moments_of_gradient, render_planar, splats_of, visible_mass
from gauss2svg.scene import ADD, BLURRED, SOFT, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, nearest_class
from gauss2svg.svg.forms import GRADIENT, as_written, is_plain, with_falloffs
from gauss2svg.without_scipy import nearest_entry, weighted_means

# Shapes are clustered by their colours, which are in 0..1, and by their exponents beta. For this,
# ln beta is multiplied by this factor. This value of the factor is the best for photos, and nearly
# the best for files of few bytes.
BETA_WEIGHT = 0.1


def best_palette(
    color: Rows,
    beta: Rows,
    weight: Rows,
    count: int,
    allowed: float = 0.0,
    change: HueChange | None = None,
) -> tuple[Rows, Rows]:
    """Choose a palette for n shapes. Each of its entries is a pair of a colour and an exponent.

    Return the colours (n, 3) in 0..1 and the exponents (n,) that the shapes get from it.

    color    (n, 3) colours of the shapes in 0..1
    beta     (n,) exponents of the shapes
    weight   (n,) weights of the shapes, >= 0
    count    largest number of entries
    allowed  largest error that the palette may cause, see below
    change   if it is given, small parts of its scene keep their hue. This takes some more entries

    Weighted k-means on the vectors (color, BETA_WEIGHT ln beta) minimises the error

        sum of weight |difference of a shape's vector from that of its entry|^2.

    If the weights are the visible masses of the shapes, the colours' part of this sum is the
    squared error that the palette adds to the image. Colours are rounded to 8 bits and exponents to
    BETA_CLASSES. If `allowed` is 0, and there are at most `count` different pairs, all of them are
    kept. If `allowed` is larger, the palette has about the fewest entries whose error is at most
    `allowed`. The result is deterministic, because the first clusters come from repeated splits.
    """
    features = np.column_stack([color, BETA_WEIGHT * portable.log(_class_of(beta))])
    entries, entry = few_entries(features, weight, count, allowed)
    if change is not None and (before := change.largest(entries[entry, :3])) > LARGEST_CHANGE:
        most, palette = count - math.ceil(0.1 * count), (entries, entry)
        if len(entries) > most:  # a tenth of the entries is left to the parts that change
            palette = few_entries(features, weight, most, allowed)
        else:  # a gradient takes as many bytes as three shapes, so few entries are added
            count = min(count, len(entries) + max(4, round(0.06 * len(entry))))
        palette = keep_hues(change, features, palette, count)
        if change.largest(palette[0][palette[1], :3]) < 0.9 * before:
            entries, entry = palette
    beta = _class_of(portable.exp(entries[:, 3] / BETA_WEIGHT))
    return entries[entry, :3], beta[entry]


def _class_of(beta: Rows) -> Rows:
    return np.array(BETA_CLASSES)[nearest_class(beta)]


def _rounded(features: Rows) -> Rows:
    """Round features (n, 4): colours to 8 bits and exponents to their classes.

    The colours of an additive scene, (n, 3), need not be rounded.
    """
    if features.shape[1] == 3:
        return features
    classes = _class_of(portable.exp(features[:, 3] / BETA_WEIGHT))
    colors = np.round(features[:, :3] * 255) / 255
    return np.column_stack([colors, BETA_WEIGHT * portable.log(classes)])


def quantize(
    scene: Scene,
    form: str = GRADIENT,
    palette: int = 0,
    color_error: float = 0.0,
    weight: NDArray[np.floating] | None = None,
) -> Scene:
    """Return the scene with the colours and exponents of a palette.

    A second call with the result and the same palette changes nothing.

    form         form of the shapes in the file, "gradient" or "blur"
    palette      largest number of entries. The file has a gradient for each. If a share of the
                 shapes is blurred, the number is reduced by this share. 0: no limit
    color_error  largest mean squared error that the palette may add to the image. The larger it is,
                 the fewer gradients there are. 0: as many gradients as `palette` allows
    weight       (h, w) weights of the pixels' errors, with mean 1. Their size may differ from that
                 of the scene. None: 1 everywhere

    Plain ellipses and blurred discs need no gradient. They keep their colour, rounded to 8 bits. In
    an additive scene only the colours are quantised, and they are not rounded. Raise InputError for
    an additive scene if the form is not "gradient".
    """
    additive = required(scene, "scene", Scene).blend == ADD
    if additive and form != GRADIENT:
        raise refusal("form", f"{GRADIENT!r} for an additive scene", quoted(form))
    written = as_written(scene, form)
    blurred = written.drawn == BLURRED
    # A shape that only looks the same as a plain ellipse stays soft, because a fit may change it.
    if not additive:
        soft = np.where(scene.drawn == BLURRED, SOFT, scene.drawn)
        written = written.replace(drawn=np.where(blurred, BLURRED, soft))
    shaded = ~is_plain(scene) & ~blurred
    if not shaded.any() or not (palette or color_error):
        return written
    count = max(1, math.ceil(palette * (1 - blurred.mean()))) if palette else len(scene)
    mass, pixels = visible_mass(scene, weight)
    allowed = color_error * 3 * pixels
    if additive:
        entries, entry = few_entries(scene.color, mass, count, allowed)
        return scene.replace(color=entries[entry])
    shades, change = (scene.color[shaded], scene.beta[shaded]), HueChange(scene, shaded)
    beta, color = written.beta.copy(), written.color.copy()
    color[shaded], beta[shaded] = best_palette(*shades, mass[shaded], count, allowed, change)
    return with_falloffs(scene, beta).replace(color=color, drawn=written.drawn)


Rows = NDArray[np.float64]
# Entries (k, d), and the index (n,) of each feature's entry.
Palette = tuple[Rows, NDArray[np.intp]]


def few_entries(features: Rows, weight: Rows, count: int, allowed: float) -> Palette:
    """Choose a palette of at most `count` entries for n features (n, d).

    Return the entries (k, d), and an array (n,) with the index of each feature's entry.

    allowed  largest weighted squared error that the entries may cause. The larger it is, the fewer
             entries there are. 0: there are as many as are needed, up to `count`
    """
    kept, entry_kept = np.unique(_rounded(features), axis=0, return_inverse=True)
    exact, distinct = (kept, entry_kept.reshape(-1)), len(kept)
    if distinct <= 1 or (allowed <= 0 and distinct <= count):
        return exact
    floor = max(float(weight.mean()), np.finfo(np.float64).tiny) * 1e-3
    # Each weight is raised a little, so that the colours of hardly visible shapes count too.
    weight = weight + floor

    def loss(entries: Rows, entry: NDArray[np.intp]) -> float:
        return float(np.sum(weight * np.square(entries[entry] - features).sum(axis=1)))

    def refined(entries: Rows) -> Palette:
        """Improve entries by Lloyd's algorithm.

        Return the improved entries, and an array with the index of each feature's entry.
        """
        for _ in range(6):  # twice as many improve the result by less than 2 %
            entry = nearest_entry(entries, features)[1]
            entries = weighted_means(features, weight, entry, entries)[np.unique(entry)]
        entries = np.unique(_rounded(entries), axis=0)
        return entries, nearest_entry(entries, features)[1]

    if distinct <= count and loss(*exact) > allowed:
        # Rounding alone causes more error than is allowed. Fewer entries would cause still more.
        return exact
    # Clusters are split until their error is at most `aim`, which is larger than the allowed error,
    # because Lloyd's algorithm removes about a tenth.
    most, aim = min(count, distinct), 1.12 * allowed
    clusters = Clusters(features, weight)
    while True:
        clusters.split(most, aim)
        entries, entry = refined(clusters.means)
        excess = loss(entries, entry) - allowed
        if excess <= 0:
            return entries, entry
        if clusters.left > aim or len(clusters) >= most or aim <= 0.1 * allowed:
            # More splits would not help. The error is too large only because colours are rounded,
            # or because no more entries are allowed.
            return exact if distinct <= count else (entries, entry)
        # More clusters are split until they have less error, by the excess and by at least 6 %.
        aim = min(0.94 * aim, aim - excess)


class Clusters:
    """Clusters of features. Again and again, the one with the largest error is split in two.

    It is split at its mean, across the direction of its largest variance (Wan, Wong and
    Prusinkiewicz, "An algorithm for multidimensional data clustering", 1988).

    left  weighted squared error of all features against the means of their clusters
    """

    def __init__(self, features: Rows, weight: Rows) -> None:
        self._features, self._weight = features, weight
        self._heap = [self._cluster(np.arange(len(features)))]
        self.left = -self._heap[0][0]

    def __len__(self) -> int:
        return len(self._heap)

    @property
    def means(self) -> Rows:
        """Means (k, d) of the clusters."""
        return np.array([mean for _, _, _, mean, _ in self._heap])

    @property
    def members(self) -> list[NDArray[np.intp]]:
        """Indices of the features of each cluster."""
        return [members for _, _, members, _, _ in self._heap]

    def split(self, count: int, aim: float) -> None:
        """Split clusters until there are `count`, or until the error is at most `aim`."""
        while len(self._heap) < count and self.left > aim:
            worst, _, members, _, above = self._heap[0]
            if above.all() or not above.any():  # all members of each cluster are equal
                break
            parts = self._cluster(members[above]), self._cluster(members[~above])
            heapq.heapreplace(self._heap, parts[0])
            heapq.heappush(self._heap, parts[1])
            self.left += worst - parts[0][0] - parts[1][0]

    def _cluster(self, members: NDArray[np.intp]) -> tuple[float, int, NDArray, NDArray, NDArray]:
        share = self._weight[members, None]
        mean = (share * self._features[members]).sum(axis=0) / share.sum()
        offset = self._features[members] - mean
        axis = portable.main_axis(np.sqrt(share) * offset)
        spread = float((share * np.square(offset)).sum())
        # The heap compares these tuples. Clusters of equal error are ordered by the index of their
        # first member, so that the arrays are never compared.
        return -spread, int(members[0]), members, mean, portable.product(offset, axis) > 0


LARGEST_CHANGE = 4.0  # largest change of hue by a palette, as a mean over a window
_SCALE = 100.0  # hues are divided by this, so that they are about as large as colours


class HueChange:
    """The change of hue that a palette makes in the picture of a scene.

    shaded  (n,) whether a shape gets its colour from the palette
    hues    (m, 2) hues of the m shaded shapes
    """

    def __init__(self, scene: Scene, shaded: NDArray[np.bool_]) -> None:
        longest = max(scene.width, scene.height)
        side = min(longest, 512)  # larger pictures are reduced
        # A picture that is reduced was measured at about twice this size.
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
        shown[:, 0] = self._splats.opacity_color[:, 0]
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
        # The columns 6 to 8 of the moments are those of the colour (gauss2svg.render.kernels).
        return moments_of_gradient(self._splats, planes)[self._shaded, 6:9]


def keep_hues(change: HueChange, features: Rows, palette: Palette, count: int) -> Palette:
    """Return the palette with other and more entries, so that no place changes its hue visibly.

    features  (m, 4) features of the shaded shapes, of which the first three are the colour
    palette   palette to begin with
    count     largest number of entries. If it is reached, the hue of some places still changes
    """
    entries, entry = palette[0], palette[1].copy()
    for _ in range(12):  # times that entries are added, at most
        own, local = change.of(entries[entry, :3])
        size = portable.hypot(*local)
        hot = size > max(LARGEST_CHANGE, 0.6 * float(size.max()))  # the worst places come first
        if not hot.any() or len(entries) >= count:
            break
        direction = np.where(hot, local / np.maximum(size, 1e-9), 0)
        *along, shown = change.seen(np.stack([*direction, hot])).T
        # A shape is blamed if it changes the hue of its place by nearly the largest change.
        is_blamed = (own * np.stack(along, axis=1)).sum(axis=1) > 0.9 * LARGEST_CHANGE * shown
        blamed = np.flatnonzero(is_blamed & (shown > 0.1))  # px that show the shape
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
            entries = np.vstack([entries, _rounded(mean[None])])
    used, entry = np.unique(entry, return_inverse=True)
    return entries[used], entry.reshape(-1)


def _near(features: Rows, hues: NDArray[np.floating], entries: Rows) -> NDArray[np.intp]:
    """Return the nearest entry of each shape that has its hue, or -1 if it is 0.1 or more away."""
    near, own = np.empty(len(features), np.intp), chroma(entries[:, :3])
    band = max(1, 2**18 // len(entries))  # shapes that are compared at a time, to save memory
    for first in range(0, len(features), band):
        part = slice(first, first + band)
        apart = np.sqrt(np.square(features[part, None] - entries).sum(axis=2))
        turns = np.square(hues[part, None] - own).sum(axis=2)
        apart[turns > LARGEST_CHANGE**2] = np.inf
        near[part] = np.where(apart.min(axis=1) < 0.1, apart.argmin(axis=1), -1)
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
