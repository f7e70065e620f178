"""Inner loops over the pixels of regions: growth from seeds, and mixtures of colours."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gauss2svg.kernel_cache import cached

# The precision is not part of the types, because kernels are compiled for each.
Floats = NDArray[Any]
Ints = NDArray[Any]
Bools = NDArray[np.bool_]

_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
kernel = cached(**_OPTIONS)  # decorator of a kernel that Python calls; it may allocate arrays
_OPTIONS["no_cpython_wrapper"] = True
inner = njit(**_OPTIONS)  # decorator of a function that kernels call
FLAT, LINEAR, RADIAL = range(3)  # forms of paints
SHADES = 1024  # colours of a gradient's table
NEAR, FAR = 1, 2  # px; distances within which the colours of a pixel's mixture lie
ENOUGH = 0.0006  # squared error at which colours farther away are not tried
MOST_NEAR = 12  # largest number of labels around a pixel that are tried in mixtures
# A mixture of three colours must lower the squared error by this, and one of two by less, because
# three colours can make nearly every other.
PRICE_OF_TWO, PRICE_OF_THREE = 2e-5, 1.5e-4
LEAST_CONTRAST = 1e-5  # squared distance below which two colours do not mix


@inner
def shade_index(form, place, x, y):
    """Return the row of a paint's table (SHADES, c) that has its colour at a point.

    form   FLAT, LINEAR or RADIAL
    place  (4,) of a gradient. The position in a linear one is place[0] x + place[1] y + place[2].
           That in a radial one is the length of (place[2] (x - place[0]), place[3] (y - place[1]))
    """
    if form == FLAT:
        return 0
    if form == LINEAR:
        at = place[0] * x + place[1] * y + place[2]
    else:
        across, down = place[2] * (x - place[0]), place[3] * (y - place[1])
        at = math.sqrt(across * across + down * down)
    return int(min(max(at, 0.0), 1.0) * (SHADES - 1) + 0.5)


@inner
def _push(key, place, count, new_key, new_place):
    """Add an entry to a binary heap, whose smallest key comes first, and return the new count."""
    i = count
    while i > 0:
        parent = (i - 1) // 2
        if key[parent] <= new_key:
            break
        key[i], place[i] = key[parent], place[parent]
        i = parent
    key[i], place[i] = new_key, new_place
    return count + 1


@inner
def _pop(key, place, count):
    """Remove the entry with the smallest key, which has been read, and return the new count."""
    count -= 1
    last_key, last_place = key[count], place[count]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= count:
            break
        if child + 1 < count and key[child + 1] < key[child]:
            child += 1
        if key[child] >= last_key:
            break
        key[i], place[i] = key[child], place[child]
        i = child
    key[i], place[i] = last_key, last_place
    return count


@inner
def _push_neighbors(pixels, labels, origin, y, x, least, key, place, count):
    """Push the neighbours of a pixel that have no label, and return the new count.

    An entry is a pixel and the side from which it is reached. Its key is the squared difference of
    its colour, but at least `least`.
    """
    h, w, channels = pixels.shape
    oy, ox = origin[y, x] // w, origin[y, x] % w
    for side in range(4):
        v, u = y + (side == 0) - (side == 1), x + (side == 2) - (side == 3)
        if 0 <= v < h and 0 <= u < w and labels[v, u] < 0:
            error = 0.0
            for c in range(channels):
                error += (pixels[v, u, c] - pixels[oy, ox, c]) ** 2
            count = _push(key, place, count, max(error, least), (v * w + u) * 4 + side)
    return count


@kernel
def grow_labels(pixels, labels, origin, key, place):
    """Give each pixel without a label that of a neighbour, the nearest colours first.

    A pixel is compared with the pixel of a core from which its neighbour got its label.

    labels  (h, w) labels, -1 for none. They are replaced
    origin  (h, w) index of each pixel. It is changed to that of the pixel of the core from which a
            pixel got its label
    key, place  (n,) buffers for a heap with up to four entries for each pixel without a label
    """
    h, w, _ = pixels.shape
    count = 0
    for y in range(h):
        for x in range(w):
            if labels[y, x] >= 0:
                count = _push_neighbors(pixels, labels, origin, y, x, 0.0, key, place, count)
    while count > 0:
        error, entry = key[0], place[0]
        count = _pop(key, place, count)
        side = entry % 4
        y, x = entry // 4 // w, entry // 4 % w
        if labels[y, x] < 0:
            v, u = y - (side == 0) + (side == 1), x - (side == 2) + (side == 3)
            labels[y, x], origin[y, x] = labels[v, u], origin[v, u]
            count = _push_neighbors(pixels, labels, origin, y, x, 0.5 * error, key, place, count)


@inner
def _mixture_error(pixel, color, i, j, k, s, t):
    """Return the squared distance of a pixel from s, t and 1 - s - t parts of three colours."""
    error = 0.0
    for c in range(len(pixel)):
        mixed = s * color[i, c] + t * color[j, c] + (1.0 - s - t) * color[k, c]
        error += (pixel[c] - mixed) ** 2
    return error


@inner
def _mix(pixel, color, count, names, label, share):
    """Write the best mixture of at most three of the colours, and return its squared error.

    color, names  (MOST_NEAR + 1, c) colours and their labels, of which the first `count` are tried
    label, share  (3,) outputs: labels of the mixture, -1 for none, and their shares
    """
    best = 1e9
    for i in range(count):
        error = _mixture_error(pixel, color, i, i, i, 1.0, 0.0)
        if error < best:
            best = error
            label[0], label[1], label[2] = names[i], -1, -1
            share[0], share[1], share[2] = 1.0, 0.0, 0.0
    for i in range(count):
        for j in range(i + 1, count):
            square = along = 0.0
            for c in range(len(pixel)):
                v = color[i, c] - color[j, c]
                square += v * v
                along += (pixel[c] - color[j, c]) * v
            if square < LEAST_CONTRAST:
                continue
            s = min(max(along / square, 0.0), 1.0)
            error = PRICE_OF_TWO + _mixture_error(pixel, color, i, j, j, s, 1.0 - s)
            if error < best:
                best = error
                label[0], label[1], label[2] = names[i], names[j], -1
                share[0], share[1], share[2] = s, 1.0 - s, 0.0
    if best < 2 * PRICE_OF_THREE:
        return best
    for i in range(count):
        for j in range(i + 1, count):
            for k in range(j + 1, count):
                aa = ab = bb = ap = bp = 0.0
                for c in range(len(pixel)):
                    a, b = color[i, c] - color[k, c], color[j, c] - color[k, c]
                    p = pixel[c] - color[k, c]
                    aa += a * a
                    ab += a * b
                    bb += b * b
                    ap += a * p
                    bp += b * p
                det = aa * bb - ab * ab
                if det < LEAST_CONTRAST:
                    continue
                s, t = (bb * ap - ab * bp) / det, (aa * bp - ab * ap) / det
                if min(s, min(t, 1.0 - s - t)) < -0.05:
                    continue
                s, t, r = max(s, 0.0), max(t, 0.0), max(1.0 - s - t, 0.0)
                s, t = s / (s + t + r), t / (s + t + r)
                error = PRICE_OF_THREE + _mixture_error(pixel, color, i, j, k, s, t)
                if error < best:
                    best = error
                    label[0], label[1], label[2] = names[i], names[j], names[k]
                    share[0], share[1], share[2] = s, t, max(1.0 - s - t, 0.0)
    return best


@kernel
def explain(
    pixels, labels, form, place, table, ys, xs, extra, extra_name, label, share, error,
):  # fmt: skip
    """Explain pixels as mixtures of the colours of the labels around them.

    labels    (h, w) label of each pixel
    form, place, table  (k,), (k, 4) and (k, SHADES, c) paints of the labels (shade_index)
    ys, xs    (n,) pixels
    extra     (c,) one more colour, whose label is `extra_name`, or -1 to leave it out. With it,
              labels within FAR are tried. Else those within NEAR are tried first
    label, share, error  (n, 3), (n, 3) and (n,) outputs
    """
    h, w, channels = pixels.shape
    color = np.empty((MOST_NEAR + 1, channels))
    names = np.empty(MOST_NEAR + 1, np.int64)
    for n in range(len(ys)):
        y, x = ys[n], xs[n]
        for radius in range(NEAR if extra_name < 0 else FAR, FAR + 1):
            count = 0
            for v in range(max(0, y - radius), min(h, y + radius + 1)):
                for u in range(max(0, x - radius), min(w, x + radius + 1)):
                    k = labels[v, u]
                    is_new = count < MOST_NEAR and k >= 0
                    for i in range(count):
                        if names[i] == k:
                            is_new = False
                            break
                    if is_new:
                        names[count] = k
                        row = shade_index(form[k], place[k], x + 0.5, y + 0.5)
                        for c in range(channels):
                            color[count, c] = table[k, row, c]
                        count += 1
            if extra_name >= 0:
                names[count] = extra_name
                for c in range(channels):
                    color[count, c] = extra[c]
                count += 1
            error[n] = _mix(pixels[y, x], color, count, names, label[n], share[n])
            if error[n] < ENOUGH:
                break
