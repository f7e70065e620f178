"""Outlines of masks: contours at half share, their corners, and the first curves through them.

A contour through linearly interpolated shares cuts corners of thin masks, breaks lines of one
pixel, and leaves out those between two rows, because no share of theirs reaches a half. So thin
masks have fields, functions finer than pixels, which are changed until what lies inside the contour
covers each pixel by its share.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage
from skimage.measure import find_contours

from gauss2svg import portable
from gauss2svg.areas.curves import merge_pieces, path_bytes
from gauss2svg.areas.kernels import Bools, Floats, Ints
from gauss2svg.areas.masks import Box
from gauss2svg.without_scipy import smoothed

# Function from points (n, 2) to the weight of a squared distance of 1 px along 1 px of an outline
Weights = Callable[[Floats], Floats]
STEP = 0.5  # px between points of a contour
PIECE = 6  # points of the pieces into which a contour is cut at first
PAD = 3  # px by which thin masks are continued beyond the border, where fields are uneven
LEAST_AREA = 1.0  # px^2; smaller contours are noise
# A corner turns by at least CORNER_RAD between the chords to the points ARM points before and after
# it. The antialiasing has rounded it, so it is put where lines through the points from CUT to LOOK
# points away meet, if that is at most MOST_MOVE px away.
ARM, CORNER_RAD, CUT, LOOK, MOST_MOVE = 5, np.radians(35), 2, 8, 2.0
LEAST_SINE = 0.15  # sine of the angle of two lines that meet at a corner
NOISE = 0.05  # px by which points of a contour are off
# Least weight, and that beyond the picture. Without them, hidden outlines would have no shape, and
# would show at the next step.
HIDDEN, BEYOND = 0.015, 0.003

FINE = 3  # samples of a field for each px
FIELD_STEPS, FIELD_STEP = (
    4,
    0.7,
)  # changes of a field, and the part of the error that each of them takes away
SMOOTH = 0.22  # px, standard deviation of the smoothing after each change
SLOPE = 2.0  # change of a field for each px across a crisp edge
INSIDE, MOST_INSIDE = 0.98, 0.3  # share of a pixel that is inside, and part of a thin mask inside
LEAST_SHARE = 12.0  # px^2 of a thin mask; smaller ones may be slivers beside other areas


class Path(NamedTuple):
    """Segments (k, 4, 2) of a path, and whether each is curved. A line repeats its ends."""

    segments: Floats
    curved: Bools
    closed: bool = True

    def moved(self, by: Floats) -> Path:
        """Return the path moved by a vector (2,)."""
        return self._replace(segments=self.segments + by)

    def bytes(self, unit: float) -> float:
        """Return about how many bytes of path data the path has."""
        return path_bytes(self.segments, self.curved, unit)


def lengths_of(segments: Floats) -> Floats:
    """Return the lengths (k,) in px of the polygons of control points (k, 4, 2)."""
    return portable.hypot(*np.diff(segments, axis=1).transpose(2, 0, 1)).sum(axis=1)


def weights_by(contrast: Floats, left: int, top: int, shape: tuple[int, ...]) -> Weights:
    """Return the function that gives points the contrast (h, w) of a box, whose corner is here.

    shape  rows and columns of the picture
    """
    h, w = contrast.shape

    def weight_at(points: Floats) -> Floats:
        x, y = np.floor(points).astype(np.int64).T
        beyond = (points < 0).any(axis=1) | (points > [shape[1], shape[0]]).any(axis=1)
        at = np.clip(y - top, 0, h - 1), np.clip(x - left, 0, w - 1)
        return np.where(beyond, BEYOND, np.maximum(contrast[at], HIDDEN))

    return weight_at


def contrast_of(pixels: Floats) -> Weights:
    """Return the weights of first outlines: squared differences of colours across an edge."""
    padded = np.pad(pixels, ((2, 2), (2, 2), (0, 0)), mode="edge")
    across = ((padded[2:-2, 4:] - padded[2:-2, :-4]) ** 2).sum(axis=-1)
    down = ((padded[4:, 2:-2] - padded[:-4, 2:-2]) ** 2).sum(axis=-1)
    return weights_by(np.maximum(across, down), 0, 0, pixels.shape)


def field_of(share: Floats) -> Floats:
    """Return a field (FINE h, FINE w) for the shares (h, w) of a mask."""
    h, w = share.shape
    field: Any = ndimage.zoom(
        share.astype(np.float32), FINE, order=3, mode="nearest", grid_mode=True
    )
    for _ in range(FIELD_STEPS):
        inside = np.clip((field - 0.5) * (SLOPE * FINE / 2) + 0.5, 0, 1)
        error = share - inside.reshape(h, FINE, w, FINE).mean(axis=(1, 3))
        field += FIELD_STEP * ndimage.zoom(error, FINE, order=1, mode="nearest", grid_mode=True)
        field = smoothed(field, SMOOTH * FINE, truncate=3)
    return field


def is_thin(share: Floats) -> bool:
    """Return whether few pixels of a mask are inside it."""
    total = share.sum()
    if total < LEAST_SHARE:
        return False
    return np.count_nonzero(ndimage.minimum_filter(share, 3) > INSIDE) < MOST_INSIDE * total


def contours_of(share: Floats, box: Box, shape: tuple[int, ...]) -> list[Floats]:
    """Return the closed contours (n, 2) of a mask at half share, in px of the picture.

    share  (h, w) in a box of a picture of this shape

    A mask that touches the border of the picture is continued beyond it, so that its contour
    leaves the picture.
    """
    thin = is_thin(share)
    reach = PAD if thin else 1
    pad = [
        (reach * (side.start == 0), reach * (side.stop == most))
        for side, most in zip(box, shape, strict=False)
    ]
    corner = np.array([box[1].start - pad[1][0], box[0].start - pad[0][0]])
    padded, fine = np.pad(share, pad, mode="edge"), 1
    if thin:
        padded, fine = field_of(padded), FINE
    contours = []
    for line in find_contours(np.pad(padded, 1), 0.5):
        points = (line[:-1, ::-1] - 0.5) / fine + corner
        x, y = points.T
        area = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
        if len(points) >= 4 and abs(area) >= LEAST_AREA:
            contours.append(points)
    return contours


def resampled(points: Floats, step: float = STEP, closed: bool = True) -> Floats:
    """Return points about `step` px apart along a polyline (n, 2)."""
    line = np.vstack([points, points[:1]]) if closed else points
    place = np.concatenate([[0], np.cumsum(portable.hypot(*np.diff(line, axis=0).T))])
    count = max(round(place[-1] / step), 8 if closed else 2)
    at = np.linspace(0, place[-1], count + 1)[: count if closed else count + 1]
    return np.stack([np.interp(at, place, line[:, i]) for i in (0, 1)], axis=1)


def turns_of(points: Floats, least_rad: float, closed: bool = True) -> Ints:
    """Return the indices of the corners of a polyline (n, 2), whose points are evenly spaced.

    A corner turns by at least `least_rad` between the chords to the points ARM points before and
    after it, and by more than any other point that near.
    """
    n = len(points)
    if n < 4 * ARM:
        return np.arange(0)
    before, after = points - np.roll(points, ARM, axis=0), np.roll(points, -ARM, axis=0) - points
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turn = np.abs(portable.arctan2(cross, (before * after).sum(axis=1)))
    if not closed:
        turn[:ARM] = turn[-ARM:] = 0
    around = np.stack([np.roll(turn, k) for k in range(-ARM, ARM + 1)])
    corners = np.flatnonzero((turn >= least_rad) & (turn == around.max(axis=0)))
    return corners[np.diff(corners, prepend=-n) > ARM // 2]


def _line_through(points: Floats) -> tuple[Floats, Floats]:
    """Return the middle of points (n, 2), and the direction of the line through them."""
    middle = points.mean(axis=0)
    return middle, portable.main_axis(points - middle)


def first_path(points: Floats, weight_at: Weights, unit: float, rate: float) -> Path:
    """Return the first curves through a closed contour (n, 2)."""
    points = resampled(points)
    points, corners = with_corners(points, turns_of(points, CORNER_RAD))
    return fitted_path(points, corners, weight_at, unit, rate, True)


def with_corners(
    points: Floats, corners: Ints, closed: bool = True, cut: int = CUT
) -> tuple[Floats, Ints]:
    """Return a polyline (n, 2) whose corners are no longer rounded, and their indices in it.

    cut  number of points before and after a corner by which it has been rounded
    """
    n = len(points)
    keep, moved = np.ones(n, bool), points.copy()
    gaps = np.diff(corners, append=corners[:1] + n)
    for i, corner in enumerate(corners):
        gap = [gaps[i - 1], gaps[i]]
        if not closed:
            gap = [min(gap[0], corner + cut), min(gap[1], n - 1 - corner + cut)]
        reach = [min(LOOK + cut - CUT, one - cut - 1) for one in gap]
        if min(reach) >= cut + 2:
            p, u = _line_through(points[(corner - np.arange(cut, reach[0] + 1)) % n])
            q, v = _line_through(points[(corner + np.arange(cut, reach[1] + 1)) % n])
            det = u[1] * v[0] - u[0] * v[1]
            if abs(det) > LEAST_SINE:
                meeting = p + ((q - p)[1] * v[0] - (q - p)[0] * v[1]) / det * u
                if portable.hypot(*(meeting - points[corner])) < MOST_MOVE:
                    moved[corner] = meeting
        away = np.arange(1, cut)
        keep[(corner - away) % n] = keep[(corner + away) % n] = False
    keep[corners] = True
    if not closed:
        keep[[0, -1]] = True
    index = np.cumsum(keep) - 1
    return moved[keep], index[corners]


def fitted_path(
    points: Floats, corners: Ints, weight_at: Weights, unit: float, rate: float, closed: bool
) -> Path:
    """Return the curves through points (n, 2), with possible corners at these indices."""
    n = len(points)
    if not closed:
        ends = np.unique([0, *corners, n - 1])
    else:
        ends = np.append(corners, corners[0] + n) if len(corners) else np.array([0, n])
    starts = [
        np.linspace(a, b, max(round((b - a) / PIECE), 1), endpoint=False).astype(np.int64)
        for a, b in itertools.pairwise(ends)
    ]
    start = np.append(np.unique(np.concatenate(starts)), ends[-1])
    if closed and len(start) < 3:
        start = np.array([start[0], (start[0] + start[-1]) // 2, start[-1]])
    gap = portable.hypot(*np.diff(points, axis=0, append=points[:1]).T)
    if not closed:
        gap[-1] = 0.0
    weight = weight_at(points) * 0.5 * (gap + np.roll(gap, 1))
    count = len(start) - 1
    empty = np.empty((count, 4, 2)), np.empty(count, bool)
    segments, curved = merge_pieces(
        points, weight, start, closed, *empty, False, unit, rate, NOISE**2
    )
    return Path(segments, curved, closed)
